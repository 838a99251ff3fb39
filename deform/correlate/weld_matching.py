"""Runs of one line in, their welds matched out: one identity per weld, a chainage map per run, and what was changed."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from scipy import sparse

from deform.correlate.alignment import PairAlignment, align
from deform.correlate.chainage import ChainageMap, identity_map
from deform.correlate.edit_table import edit_table
from deform.correlate.edits import History, displacement, find_changes, real_columns, reference_lengths, weld_rows
from deform.correlate.evidence import Traits, check_locks, locks_between
from deform.correlate.joints import joint_table
from deform.correlate.length_model import alone
from deform.correlate.registry import Registry, merge
from deform.correlate.stretches import stretch_rows
from deform.correlate.weld_list import WeldList, weld_list
from deform.errors import Fault, InputError, WrongLineError
from deform.options import MatchOptions
from deform.run import build


@dataclass(frozen=True)
class Matching:
    """What the runs of a line have in common.

    Attributes
    ----------
    welds : rows of ``tables/welds.csv``.
    joints : rows of ``tables/joints.csv``, with columns ``length_m:<run>``, ``change_m:<run>``, ``change_sigma_m:<run>``.
    maps : `ChainageMap` of each run id.
    pairs : one row per pair of runs: direction, scale, noise, drift, welds matched, evidence.
    edits : one row per edit of the line or of a list: kind, run, first and last weld, reference chainage, joints, reason.
    stretches : one row per pair of runs and stretch of unchanged pipe: its ends, and how much it outweighs the next best.
    reference : id of the reference run.
    """

    welds: pd.DataFrame
    joints: pd.DataFrame
    maps: dict[str, ChainageMap]
    pairs: pd.DataFrame
    edits: pd.DataFrame
    stretches: pd.DataFrame
    reference: str


def match_runs(
    runs: list[xr.DataTree],
    options: MatchOptions | None = None,
    reference: str | None = None,
    locks: pd.DataFrame | None = None,
    progress: Callable[[float], None] | None = None,
) -> Matching:
    """Match the girth welds of all runs of a line.

    Parameters
    ----------
    runs : runs in the order of their dates, each with a group ``/welds``.
    reference : id of the run whose chainage is the axis; default the first.
    locks : pairs that must, or must not, be one weld: columns ``run_a``, ``index_a``, ``run_b``, ``index_b``, ``kind``
        (``lock`` or ``forbid``); ``index`` is the place in the run's ``/welds``.
    progress : called with the fraction done.

    Raises
    ------
    InputError
        When a run has no usable welds, an id occurs twice, the reference is not among the runs, or the welds of a raw run lie in
        the reverse order of another's: the chainage of both rises downstream, so that one header has the wrong direction.
    WrongLineError
        When a run has nothing in common with any other; with the numbers.
    """
    options = options or MatchOptions()
    lists = [weld_list(run, options.least_joint_m) for run in runs]
    ref = _reference(lists, reference)
    locks = None if locks is None else check_locks(locks)
    pairs = _align_all(lists, ref, options, locks, progress)
    _check_directions(runs, pairs)
    scales = _scales(pairs, lists, ref)
    posteriors = {
        (a, b): sparse.csr_matrix((p.posterior, (p.i, p.j)), shape=(lists[a].n, lists[b].n)) for (a, b), p in pairs.items()
    }
    registry = merge(lists, posteriors, ref, scales, options.least_probability)
    own = reference_lengths(registry, lists, scales)
    model = max((p.model for p in pairs.values()), key=lambda m: m.rates.sigma, default=alone(lists[ref].place))
    changes = find_changes(registry, own, lists, model)
    real = real_columns(registry, own, lists, changes, model)
    moved = displacement(registry, own)
    maps = _maps(registry, lists, ref, changes, pairs, moved, options.shift_m)
    history = History(registry, lists, own, changes, real, moved)
    welds = build.table("welds", weld_rows(history, lambda r, s: maps[lists[r].run].to_run(s), options.shift_m))
    joints = joint_table(history, ref, pairs)
    stretches = [row for (a, b), p in pairs.items() for row in stretch_rows(p, lists[a], lists[b])]
    return Matching(
        welds=welds,
        joints=joints,
        maps=maps,
        pairs=build.table("pairs", _pair_table(pairs, lists)),
        edits=build.table("edits", edit_table(history, welds)),
        stretches=build.table("stretches", pd.DataFrame(stretches)),
        reference=lists[ref].run,
    )


def _reference(lists: list[WeldList], reference: str | None) -> int:
    ids = [w.run for w in lists]
    twice = sorted({i for i in ids if ids.count(i) > 1})
    if twice:
        raise InputError([Fault(i, "id", "occurs twice among the runs; ids must differ") for i in twice])
    if not ids:
        raise InputError("no runs were given to match")
    if reference is not None and reference not in ids:
        raise InputError(Fault("survey", "reference", f"{reference!r} is not among the runs {', '.join(ids)}"))
    return ids.index(reference) if reference is not None else 0


def _align_all(lists, ref, options, locks, progress) -> dict[tuple[int, int], PairAlignment]:
    """Align every pair of runs; a pair that fails is left out when both runs are held by others."""
    found: dict[tuple[int, int], PairAlignment] = {}
    faults: list[Fault] = []
    todo = sorted(itertools.combinations(range(len(lists)), 2), key=lambda p: ref not in p)
    for done, (a, b) in enumerate(todo):
        try:
            one, other = lists[a], lists[b]
            held = locks_between(locks, one, other)
            traits = Traits.of(one), Traits.of(other)
            found[a, b] = align(one.place, other.place, options, (one.run, other.run), traits, held)
        except WrongLineError as fault:
            faults += fault.faults
        if progress:
            progress((done + 1) / len(todo))
    inside = {ref}
    for _ in lists:
        inside |= {r for pair in found if set(pair) & inside for r in pair}
    if len(inside) < len(lists):
        raise WrongLineError(faults)
    return found


def _check_directions(runs: list[xr.DataTree], pairs: dict[tuple[int, int], PairAlignment]) -> None:
    """Refuse raw runs of which one header says the wrong direction: signs of curvature and clocks would be mirrored."""
    raw = [run.attrs.get("source") == "raw" for run in runs]
    against = [pair for pair, p in pairs.items() if p.direction < 0 and raw[pair[0]] and raw[pair[1]]]
    if not against:
        return
    count = np.bincount(np.ravel(against), minlength=len(runs))
    said = [f"{run.attrs['id']} {run.attrs.get('direction', 'not said')}" for run, here in zip(runs, raw, strict=True) if here]
    faults = []
    for r in np.flatnonzero(count == count.max()):
        others = ", ".join(str(runs[sum(pair) - r].attrs["id"]) for pair in against if r in pair)
        rule = f"its welds lie in the reverse order of those of {others}; the headers say: {', '.join(said)}"
        hint = "correct direction in the run.toml of the run that is wrong: its clocks and horizontal curvature are mirrored"
        faults.append(Fault(str(runs[r].attrs["id"]), "[run] direction", rule, hint))
    raise InputError(faults)


def _scales(pairs, lists, ref) -> dict[int, float]:
    """Signed scale of each run against the reference, along the pairs."""
    scales = {ref: 1.0}
    while len(scales) < len(lists):
        for (a, b), p in pairs.items():
            if a in scales and b not in scales:
                scales[b] = scales[a] * p.scale * p.direction
            elif b in scales and a not in scales:
                scales[a] = scales[b] / (p.scale * p.direction)
    return scales


def _maps(registry: Registry, lists, ref, changes, pairs, moved, shift_m) -> dict[str, ChainageMap]:
    maps = {}
    for r, welds in enumerate(lists):
        if r == ref:
            maps[welds.run] = identity_map(welds.run, welds.place)
            continue
        rows = np.flatnonzero(registry.member[:, r] >= 0)
        common = rows[registry.member[rows, ref] >= 0]
        steady = common[
            np.maximum(np.abs(moved[common, r]), np.abs(moved[common, ref])) < shift_m
        ]  # a displaced weld bends the map
        common = steady if steady.size >= 2 else common
        if common.size < 2:
            common = rows
        broken = _broken(registry, changes, ref, r, common)
        pair = pairs.get((min(r, ref), max(r, ref)))
        sigma = 0.03 if pair is None else float(pair.model.rates.sigma)
        maps[welds.run] = ChainageMap(welds.run, registry.place[common], welds.place[registry.member[common, r]], sigma, broken)
    return maps


def _broken(registry, changes, ref, r, common) -> np.ndarray:
    """Stretches of the reference chainage that changed between the reference and run r, from common weld to common weld."""
    low, high = min(ref, r), max(ref, r)
    stretches = []
    for change in changes:
        if low <= change.before and change.after <= high:
            left = common[common <= change.first]
            right = common[common >= change.last]
            first = registry.place[left[-1]] if left.size else registry.place[change.first]
            last = registry.place[right[0]] if right.size else registry.place[change.last]
            stretches.append((first, last))
    return np.asarray(sorted(set(stretches)), float).reshape(-1, 2)


def _pair_table(pairs, lists) -> pd.DataFrame:
    rows = []
    for (a, b), p in pairs.items():
        held = p.partner >= 0
        drift = np.nan
        if held.sum() > 2:
            x, y = lists[a].place[held], lists[b].place[p.partner[held]]
            drift = float(np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max())
        rows.append(
            {
                "run_a": lists[a].run,
                "run_b": lists[b].run,
                "direction": p.direction,
                "scale": p.scale,
                "noise_sigma_m": p.model.rates.sigma,
                "noise_freedom": 2 ** (p.model.rates.shape + 1) - 1,
                "drift_max_m": drift,
                "n_a": lists[a].n,
                "n_b": lists[b].n,
                "n_matched": int(held.sum()),
                "missed_a": p.model.rates.missed_a,
                "missed_b": p.model.rates.missed_b,
                "cut_outs": p.model.rates.cut,
                "evidence_nats": p.evidence_nats,
            }
        )
    return pd.DataFrame(rows)
