"""A registry in, the joint table of the line through time out: each joint, its length in every run, its change with sigma."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd

from deform.correlate.alignment import PairAlignment
from deform.correlate.edits import Change, History, changed_between, column_ids
from deform.correlate.registry import Registry
from deform.run import build


def joint_table(history: History, ref: int, pairs: dict[tuple[int, int], PairAlignment]) -> pd.DataFrame:
    """Rows of ``tables/joints.csv``: one per physical joint, that is per two welds that follow each other in at least one run.

    Notes
    -----
    A missed weld still ends a joint; the joints at it have no length in that run. ``change_m`` is the length in the run, divided
    by the run's local scale against the reference (over some 50 joints), minus the length in the reference run: a scale error of
    the odometer is no elongation. Its sigma is the noise of the pair's joint lengths.
    """
    registry, lists, changes, real = history.registry, history.lists, history.changes, history.real
    ids = column_ids(history)
    present = _present(registry, changes, real)
    found: dict[tuple[int, int], list[int]] = {}
    for r in range(len(lists)):
        columns = np.flatnonzero(present[:, r])
        for c, d in itertools.pairwise(columns):
            found.setdefault((int(c), int(d)), []).append(r)
    keys = sorted(found)
    table: dict[str, list] = {
        "joint_id": [f"J{k + 1:05d}" for k in range(len(keys))],
        "weld_id_start": [ids[c] for c, _ in keys],
        "weld_id_end": [ids[d] for _, d in keys],
        "reference_chainage_m": [float(registry.place[c]) for c, _ in keys],
        "begins": [_begins(found[key], key, lists, changes) for key in keys],
        "ends": [_ends(found[key], key, lists, changes) for key in keys],
    }
    first, last = (np.asarray([k[e] for k in keys], np.int64) for e in (0, 1))
    lengths = {r: _lengths(registry, lists[r], r, first, last) for r in range(len(lists))}
    for r, run in enumerate(lists):
        table[f"length_m:{run.run}"] = list(lengths[r])
        if r == ref:
            continue
        scale, sigma = _scale(pairs, lists, registry, ref, r, first)
        change = lengths[r] / scale - lengths[ref]
        table[f"change_m:{run.run}"] = list(change)
        table[f"change_sigma_m:{run.run}"] = list(np.where(np.isfinite(change), sigma, np.nan))
    return build.table("joints", table)


def _present(registry: Registry, changes: list[Change], real: np.ndarray) -> np.ndarray:
    """True where a weld is there in a run, seen or missed (c, runs)."""
    member = registry.member >= 0
    present = member & real[:, None]
    for r in range(member.shape[1]):
        seen = np.flatnonzero(member[:, r])
        for column in np.flatnonzero(real & ~member[:, r]):
            if seen.size and seen[0] < column < seen[-1]:
                members = np.flatnonzero(member[column])
                near = members[np.argmin(np.abs(members - r))]
                present[column, r] = changed_between(changes, int(near), r, int(column)) is None
    return present


def _lengths(registry, welds, r, first, last) -> np.ndarray:
    a, b = registry.member[first, r], registry.member[last, r]
    return np.where((a >= 0) & (b >= 0), np.abs(welds.place[b] - welds.place[a]), np.nan)


def _scale(pairs, lists, registry, ref, r, first):
    """Local scale of run r against the reference at each joint, and the noise of a length difference (metre)."""
    pair = pairs.get((min(ref, r), max(ref, r)))
    if pair is None:
        return 1.0, np.nan
    a = min(ref, r)
    local = np.interp(np.arange(registry.place.size), *_known(registry.member[:, a], pair.local))[first]
    return (local if a == ref else 1.0 / local), pair.model.length_sigma


def _known(member, values):
    rows = np.flatnonzero(member >= 0)
    return rows, values[member[rows]]


def _begins(runs, key, lists, changes) -> str:
    if runs[0] == 0:
        return f"{lists[0].run}: first run"
    change = _touching(changes, runs[0] - 1, runs[0], key)
    return f"{lists[runs[0]].run}: {'pipe replaced' if change else 'first run that shows it'}"


def _ends(runs, key, lists, changes) -> str:
    if runs[-1] == len(lists) - 1:
        return ""
    change = _touching(changes, runs[-1], runs[-1] + 1, key)
    return f"{lists[runs[-1]].run}: {'pipe replaced' if change else 'last run that shows it'}"


def _touching(changes, before, after, key) -> Change | None:
    for change in changes:
        if (change.before, change.after) == (before, after) and change.first <= key[0] and key[1] <= change.last:
            return change
    return None
