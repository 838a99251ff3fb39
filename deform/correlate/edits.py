"""A registry in, what happened to the welds out: status of every weld in every run with its reason, and the edits of the line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from deform.correlate.length_model import LengthModel
from deform.correlate.registry import Registry
from deform.correlate.weld_list import WeldList

_IN_PLACE = 1.0  # metre; a replaced stretch whose length stays within this is a cut-out, else a re-route


@dataclass(frozen=True)
class Change:
    """A stretch of the line whose pipe is not the same in two runs that follow each other in time.

    Attributes
    ----------
    before, after : runs (places in the list).
    first, last : columns of the last common weld before and the first common weld after the stretch.
    kind : ``cutout`` or ``reroute``.
    n_old, n_new : joints of it in the two runs.
    length_old, length_new : metre, both on the reference scale.
    """

    before: int
    after: int
    first: int
    last: int
    kind: str
    n_old: int
    n_new: int
    length_old: float
    length_new: float

    def covers(self, column: int) -> bool:
        """True for a column strictly inside."""
        return self.first < column < self.last


def reference_lengths(registry: Registry, lists: list[WeldList], scales: dict[int, float]) -> np.ndarray:
    """Place of every member (c, runs) in its own run, on the reference scale, rising with the reference; NaN where absent."""
    own = np.full(registry.member.shape, np.nan)
    for r, welds in enumerate(lists):
        rows = registry.member[:, r] >= 0
        own[rows, r] = welds.place[registry.member[rows, r]] / scales[r]
    return own


def find_changes(registry: Registry, own: np.ndarray, sigma: float) -> list[Change]:
    """Return the replaced stretches between runs that follow each other.

    Notes
    -----
    Between two successive common welds the pipe counts as the same when one of the runs shows no further weld there and the
    lengths agree (missed or false welds), or when each shows one (a displaced weld); else it was replaced.
    """
    changes = []
    runs = registry.member.shape[1]
    for a in range(runs - 1):
        b = a + 1
        common = np.flatnonzero((registry.member[:, a] >= 0) & (registry.member[:, b] >= 0))
        has_a, has_b = (np.cumsum(registry.member[:, r] >= 0) for r in (a, b))
        for c, d in zip(common[:-1], common[1:], strict=True):
            if d == c + 1:
                continue
            n_a, n_b = int(has_a[d] - has_a[c] - 1), int(has_b[d] - has_b[c] - 1)
            length_a, length_b = own[d, a] - own[c, a], own[d, b] - own[c, b]
            apart = abs(length_a - length_b)
            near = apart < max(8.0 * sigma, 0.003 * length_a)
            if n_a + n_b == 0 or (near and (min(n_a, n_b) == 0 or n_a == n_b == 1)):
                continue
            kind = "cutout" if apart < max(_IN_PLACE, 0.01 * length_a) else "reroute"
            changes.append(Change(a, b, int(c), int(d), kind, n_a + 1, n_b + 1, float(length_a), float(length_b)))
    return changes


def real_columns(registry: Registry, own: np.ndarray, lists: list[WeldList], changes: list[Change], model: LengthModel) -> np.ndarray:
    """True for columns that are welds, false for those that only one run shows and that split a joint of the line.

    Notes
    -----
    Two runs with the weld make it real. A group of k welds that one run alone shows between two welds that it shares is judged
    by the joint lengths: real, the pieces are drawn from the line's joint lengths and every other run missed k welds; false, the
    whole joint is, and k false events fell into it at random. The detector's own probability enters as odds.
    """
    n_members = (registry.member >= 0).sum(axis=1)
    real = n_members >= 2
    rates = model.rates
    missed, false = max(rates.missed_a, rates.missed_b, 1e-3), max(rates.false_a, rates.false_b, 1e-3)
    column = 0
    while column < real.size:
        if n_members[column] != 1:
            column += 1
            continue
        run = int(np.flatnonzero(registry.member[column] >= 0)[0])
        group = [column]
        while group[-1] + 1 < real.size and n_members[group[-1] + 1] == 1 and registry.member[group[-1] + 1, run] >= 0:
            group.append(group[-1] + 1)
        detected = lists[run].probability[registry.member[group, run]].clip(0.01, 0.99)
        others = _who_see_whole(registry, own, run, group, changes)
        odds = np.log(detected / (1.0 - detected)).sum() - np.log(9.0) * len(group)  # 0.9 is an ordinary weld
        if others:
            odds += _length_odds(own, run, group, model, missed, false, others)
        else:
            odds += 2.0 * len(group)
        low = detected < 0.5
        real[group] = (odds > 0.0) & ~low
        column = group[-1] + 1
    return real


def _who_see_whole(registry, own, run, group, changes) -> int:
    """Number of runs that have the same pipe here and do not show the welds of the group."""
    count = 0
    for r in range(registry.member.shape[1]):
        if r == run:
            continue
        seen = np.flatnonzero(registry.member[:, r] >= 0)
        if not seen.size or not seen[0] < group[0] <= group[-1] < seen[-1]:
            continue
        count += not changed_between(changes, run, r, group[0])
    return count


def _length_odds(own, run, group, model, missed, false, others):
    present = np.flatnonzero(np.isfinite(own[:, run]))
    k = int(np.searchsorted(present, group[0]))
    e = int(np.searchsorted(present, group[-1]))
    if k == 0 or e + 1 >= present.size:
        return 0.0
    places = own[present[k - 1 : e + 2], run]
    pieces, whole = np.diff(places), places[-1] - places[0]
    density = model.density

    def log_g(length):
        return np.log(density[np.minimum((np.abs(length) / 0.01).astype(int), density.size - 1)])

    n = len(group)
    as_real = log_g(pieces).sum() + others * n * np.log(missed)
    as_false = log_g(np.asarray([whole]))[0] + n * (np.log(false) - np.log(max(whole, 0.1))) + np.log(float(n))
    return float(as_real - as_false)


def changed_between(changes: list[Change], a: int, b: int, column: int) -> Change | None:
    """The first change between two runs (places in time) that covers a column."""
    low, high = min(a, b), max(a, b)
    for change in changes:
        if low <= change.before and change.after <= high and change.covers(column):
            return change
    return None


def weld_rows(registry: Registry, lists: list[WeldList], own: np.ndarray, changes: list[Change], real: np.ndarray, to_run, shift_m: float) -> pd.DataFrame:
    """Rows of ``tables/welds.csv``: one per weld and run, with status and reason.

    Parameters
    ----------
    to_run : called with (run, reference chainage) for the place of a weld that the run does not show.
    shift_m : a weld that stands further than this from where the other runs have it is `shifted`.
    """
    moved = _displacement(registry, own)
    rows: list[dict] = []
    spans = [_span(registry, r) for r in range(len(lists))]
    number = 0
    for column in range(real.size):
        members = np.flatnonzero(registry.member[column] >= 0)
        if real[column]:
            number += 1
            weld_id = f"W{number:05d}"
        else:
            weld_id = f"F-{lists[members[0]].run}-{lists[members[0]].index[registry.member[column, members[0]]]}"
        first = int(members[0])
        for r, welds in enumerate(lists):
            k = int(registry.member[column, r])
            if k >= 0:
                status, reason = _status(registry, column, r, members, lists, changes, real, moved, shift_m)
                probability = registry.probability[column, r]
                rows.append(
                    {
                        "weld_id": weld_id,
                        "run": welds.run,
                        "index": int(welds.index[k]),
                        "log_distance_m": welds.log_distance[k],
                        "chainage_m": welds.place[k],
                        "reference_chainage_m": registry.place[column],
                        "probability": welds.probability[k] if np.isnan(probability) else probability,
                        "status": status,
                        "reason": reason,
                    }
                )
            elif real[column] and spans[r][0] <= column <= spans[r][1]:
                absent = _absent(column, r, first, members, lists, changes)
                if absent:
                    gone = absent[0] == "removed"
                    rows.append(
                        {
                            "weld_id": weld_id,
                            "run": welds.run,
                            "index": None,
                            "chainage_m": np.nan if gone else float(to_run(r, registry.place[column])),
                            "reference_chainage_m": registry.place[column],
                            "status": absent[0],
                            "reason": absent[1],
                        }
                    )
    rows += [row for r, welds in enumerate(lists) for row in _double_rows(welds, registry, r)]
    return pd.DataFrame(rows)


def _status(registry, column, r, members, lists, changes, real, moved, shift_m):
    others = [lists[q].run for q in members if q != r]
    if not real[column]:
        k = registry.member[column, r]
        low = lists[r].probability[k] < 0.5
        why = f"detector's probability {lists[r].probability[k]:.2f}" if low else "it splits a joint that the other runs see whole"
        return "false", f"no other run shows it, and {why}"
    if r == members[0] and r > 0:
        change = next((c for q in range(r) if (c := changed_between(changes, q, r, column))), None)
        spanned = [q for q in range(r) if not changed_between(changes, q, r, column) and _spans(registry, q, column)]
        if change and not spanned:
            return "added", f"{change.kind} between {lists[change.before].run} and {lists[change.after].run}"
    if abs(moved[column, r]) > shift_m and others:
        return "shifted", f"stands {moved[column, r]:+.2f} m from where {', '.join(others)} has it; both neighbours agree"
    if others:
        return "matched", f"also in {', '.join(others)}"
    return "matched", "only this run shows it; its joints have lengths of this line"


def _absent(column, r, first, members, lists, changes):
    """Status and reason of a weld that run r does not show; None when the run could not have it."""
    before = [q for q in members if q < r]
    after = [q for q in members if q > r]
    near = before[-1] if before else after[0]
    change = changed_between(changes, near, r, column)
    if change is None:
        return "missed", f"in {', '.join(lists[q].run for q in members)}; the pipe is the same and this run does not show it"
    if before:
        return "removed", f"{change.kind} between {lists[change.before].run} and {lists[change.after].run}"
    return None


def _displacement(registry: Registry, own: np.ndarray) -> np.ndarray:
    """How far each member stands from where the other members' places between its neighbours put it (c, runs), metre."""
    moved = np.zeros(own.shape)
    for r in range(own.shape[1]):
        for q in range(own.shape[1]):
            if q == r:
                continue
            both = np.flatnonzero(np.isfinite(own[:, r]) & np.isfinite(own[:, q]))
            if both.size < 3:
                continue
            x, y = own[both, q], own[both, r]
            left, right = (y[1:-1] - y[:-2]) - (x[1:-1] - x[:-2]), (y[2:] - y[1:-1]) - (x[2:] - x[1:-1])
            shift = np.where(np.abs(left + right) < 0.5 * np.minimum(np.abs(left), np.abs(right)), 0.5 * (left - right), 0.0)
            least = np.abs(shift) < np.abs(moved[both[1:-1], r])
            unset = moved[both[1:-1], r] == 0.0
            moved[both[1:-1], r] = np.where(least | unset, shift, moved[both[1:-1], r])
    for column in np.flatnonzero((np.abs(moved) > 0).any(axis=1)):
        members = np.flatnonzero(np.isfinite(own[column]))
        if members.size == 2:
            moved[column, members[0]] = 0.0  # of two runs, the later one counts as displaced
    return moved


def _span(registry: Registry, r: int) -> tuple[int, int]:
    """First and last column of a run that another run has as well."""
    shared = np.flatnonzero((registry.member[:, r] >= 0))
    return (int(shared[0]), int(shared[-1])) if shared.size else (0, -1)


def _spans(registry: Registry, r: int, column: int) -> bool:
    first, last = _span(registry, r)
    return first <= column <= last


def _double_rows(welds: WeldList, registry: Registry, r: int) -> list[dict]:
    column_of = {int(welds.index[k]): c for c, k in enumerate(registry.member[:, r]) if k >= 0}
    return [
        {
            "weld_id": f"F-{welds.run}-{double}",
            "run": welds.run,
            "index": double,
            "reference_chainage_m": registry.place[column_of[kept]] if kept in column_of else np.nan,
            "chainage_m": np.nan,
            "status": "false",
            "reason": f"stands upon weld {kept} of the same run",
        }
        for double, kept in welds.doubles.items()
    ]
