"""A registry in, what happened to the welds out: status of every weld in every run with its reason, and the edits of the line."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pandas as pd

from deform.correlate._kernel_types import BIN
from deform.correlate.length_model import LengthModel
from deform.correlate.registry import Registry
from deform.correlate.weld_list import WeldList

_NEAR = 0.3  # metre; two lengths that differ less are of the same pipe
_TOO_LONG = 7.0  # nats against a joint longer than the longest of the line
_REPLACED = 3.0  # nats by which new pipe must outweigh welds that were missed, or invented
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


def find_changes(registry: Registry, own: np.ndarray, lists: list[WeldList], model: LengthModel) -> list[Change]:
    """Return the replaced stretches between runs that follow each other.

    Notes
    -----
    Between two successive common welds the pipe counts as the same when one of the runs shows no further weld there and the
    lengths agree (missed or false welds, unless the other runs say that it was replaced), or when each shows one (a displaced
    weld); else it was replaced.
    """
    sigma = model.rates.sigma
    changes = []
    runs = registry.member.shape[1]
    for a in range(runs - 1):
        b = a + 1
        common = np.flatnonzero((registry.member[:, a] >= 0) & (registry.member[:, b] >= 0))
        has_a, has_b = (np.cumsum(registry.member[:, r] >= 0) for r in (a, b))
        for c, d in itertools.pairwise(common):
            if d == c + 1:
                continue
            n_a, n_b = int(has_a[d] - has_a[c] - 1), int(has_b[d] - has_b[c] - 1)
            length_a, length_b = own[d, a] - own[c, a], own[d, b] - own[c, b]
            apart = abs(length_a - length_b)
            near = apart < max(8.0 * sigma, _NEAR, 0.003 * length_a)
            if n_a + n_b == 0 or (near and n_a == n_b == 1):
                continue
            if near and min(n_a, n_b) == 0 and not _replaced(registry, own, lists, model, a, np.arange(c + 1, d)):
                continue
            kind = "cutout" if apart < max(_IN_PLACE, 0.01 * length_a) else "reroute"
            changes.append(Change(a, b, int(c), int(d), kind, n_a + 1, n_b + 1, float(length_a), float(length_b)))
    return changes


def _replaced(registry, own, lists, model, before: int, columns: np.ndarray) -> bool:
    """True where all runs to one side of a date show the same further welds in a joint, all to the other side none.

    That pipe was then replaced is weighed against each other run having missed these welds, and against the one run that shows
    them having invented them; where a dent of that run lies it may well have.
    """
    member = registry.member >= 0
    shown = member[columns].any(axis=1)
    columns = columns[shown]
    over = np.array([_reaches_over(member[:, r], columns) for r in range(member.shape[1])])
    later = np.arange(over.size) > before
    with_later = member[columns][:, over & later].all() and not member[columns][:, over & ~later].any()
    with_former = member[columns][:, over & ~later].all() and not member[columns][:, over & later].any()
    if not with_later and not with_former:
        return False
    those = np.flatnonzero(over & (later if with_later else ~later))
    missed, false, n = *_errors(model.rates), columns.size
    once = np.log(missed) + (n - 1) * np.log(model.rates.again)  # misses come in rows
    odds = np.log(model.rates.cut) - (over.sum() - those.size) * once
    if those.size == 1:
        run = int(those[0])
        if lists[run].dented[registry.member[columns, run]].any():
            return False
        detected = lists[run].probability[registry.member[columns, run]].clip(1e-3, 1.0 - 1e-6)
        invented = np.log(model.rates.cut) + _detector_odds(detected) + _length_odds(own, run, columns, model, missed, false, 0)
        odds = min(odds, invented)
    return bool(odds > _REPLACED)


def _reaches_over(shown: np.ndarray, columns: np.ndarray) -> bool:
    """True where a run shows welds before and behind the columns."""
    seen = np.flatnonzero(shown)
    return bool(seen.size and seen[0] < columns[0] and columns[-1] < seen[-1])


def _errors(rates) -> tuple[float, float]:
    """Rates of a missed weld (per weld) and of a false one (per metre), of the worse list."""
    return max(rates.missed_a, rates.missed_b, 1e-3), max(rates.false_a, rates.false_b, 1e-4)


def _detector_odds(detected: np.ndarray) -> float:
    """Log of the odds of welds by their detector, against ordinary welds of 0.9."""
    return float(np.log(detected / (1.0 - detected)).sum() - np.log(9.0) * detected.size)


def real_columns(
    registry: Registry, own: np.ndarray, lists: list[WeldList], changes: list[Change], model: LengthModel
) -> np.ndarray:
    """True for columns that are welds, false for those that only one run shows and that split a joint of the line.

    Notes
    -----
    Two runs with the weld make it real. A group of k welds that one run alone shows between two welds that it shares is judged
    by the joint lengths: real, the pieces are drawn from the line's joint lengths and every other run missed k welds; false, the
    whole joint is, and k false events fell into it at random. The detector's own probability enters as odds.
    """
    n_members = (registry.member >= 0).sum(axis=1)
    real = n_members >= 2
    missed, false = _errors(model.rates)
    column = 0
    while column < real.size:
        if n_members[column] != 1:
            column += 1
            continue
        run = int(np.flatnonzero(registry.member[column] >= 0)[0])
        group = [column]
        while group[-1] + 1 < real.size and n_members[group[-1] + 1] == 1 and registry.member[group[-1] + 1, run] >= 0:
            group.append(group[-1] + 1)
        detected = lists[run].probability[registry.member[group, run]].clip(0.001, 0.999)
        others = _who_see_whole(registry, run, group, changes)
        if not others:
            real[group] = _credible(own, run, group, detected)
            column = group[-1] + 1
            continue
        odds = _detector_odds(detected) + _length_odds(own, run, group, model, missed, false, others)
        real[group] = (odds > 0.0) & (detected >= 0.5)
        column = group[-1] + 1
    return real


def _who_see_whole(registry, run, group, changes) -> int:
    """Number of runs that have the same pipe here and do not show the welds of the group."""
    count = 0
    for r in range(registry.member.shape[1]):
        if r == run:
            continue
        if not _reaches_over(registry.member[:, r] >= 0, np.asarray(group)):
            continue
        count += not changed_between(changes, run, r, group[0])
    return count


def _credible(own, run, group, detected) -> np.ndarray:
    """True for welds of new pipe, that no other run can vouch for: the detector's odds times what the joint lengths say.

    New pipe may have any length up to the line's longest joints (98 in 100 are no longer): two pieces of a joint then weigh
    (left + right) over the longest, and a joint beyond it hardly can be. The weld that is least credible is taken away first,
    and the others are judged anew.
    """
    good = np.ones(len(group), bool)
    places = own[:, run]
    present = np.isfinite(places)
    longest = float(np.quantile(np.diff(places[present]), 0.98))
    while True:
        kept = np.flatnonzero(present)
        at = np.searchsorted(kept, group)
        odds = np.full(len(group), np.inf)
        for k in np.flatnonzero(good):
            inner = 0 < at[k] < kept.size - 1
            odds[k] = np.log(detected[k] / (1.0 - detected[k]))
            if inner:
                left, right = np.diff(places[kept[at[k] - 1 : at[k] + 2]])
                odds[k] += np.log((left + right) / longest) + (_TOO_LONG if left + right > 1.05 * longest else 0.0)
            if detected[k] >= 0.5:  # the detector alone is enough
                odds[k] = np.inf
        worst = int(np.argmin(odds))
        if odds[worst] >= 0.0:
            return good
        good[worst] = False
        present[group[worst]] = False


def _log_density(model: LengthModel, length: np.ndarray) -> np.ndarray:
    return np.log(model.density[np.minimum((np.abs(length) / BIN).astype(int), model.density.size - 1)])


def _length_odds(own, run, group, model, missed, false, others):
    present = np.flatnonzero(np.isfinite(own[:, run]))
    k = int(np.searchsorted(present, group[0]))
    e = int(np.searchsorted(present, group[-1]))
    if k == 0 or e + 1 >= present.size:
        return 0.0
    places = own[present[k - 1 : e + 2], run]
    pieces, whole = np.diff(places), places[-1] - places[0]
    n = len(group)
    as_real = _log_density(model, pieces).sum() + others * n * np.log(missed)
    as_false = _log_density(model, np.asarray([whole]))[0] + n * np.log(false) + np.log(float(n))
    return float(as_real - as_false)


def changed_between(changes: list[Change], a: int, b: int, column: int) -> Change | None:
    """The first change between two runs (places in time) that covers a column."""
    low, high = min(a, b), max(a, b)
    for change in changes:
        if low <= change.before and change.after <= high and change.covers(column):
            return change
    return None


@dataclass(frozen=True)
class History:
    """Everything that the status of a weld rests on: see `Registry`, `WeldList`, `Change`, `real_columns`, `displacement`."""

    registry: Registry
    lists: list[WeldList]
    own: np.ndarray
    changes: list[Change]
    real: np.ndarray
    moved: np.ndarray

    def __post_init__(self) -> None:
        """Hold the first and last column of each run."""
        object.__setattr__(self, "spans", [_span(self.registry, r) for r in range(len(self.lists))])

    def covers(self, run: int, column: int) -> bool:
        """True where a run's list goes over a column."""
        first, last = self.spans[run]  # type: ignore[attr-defined] # set in __post_init__ of a frozen class
        return first <= column <= last

    def name(self, runs) -> str:
        """Ids of runs in words."""
        return ", ".join(self.lists[q].run for q in runs)

    def why(self, change: Change) -> str:
        """A change in words: which kind it is, stands in the table of edits alone, for where the new pipe lies may tell later."""
        return f"pipe replaced between {self.lists[change.before].run} and {self.lists[change.after].run}"


def column_ids(history: History) -> list[str]:
    """Identity of each column: ``W00001`` ... along the line, and one of its own for each weld that is none."""
    ids, number = [], 0
    for column, real in enumerate(history.real):
        if real:
            number += 1
            ids.append(f"W{number:05d}")
        else:
            r = int(np.flatnonzero(history.registry.member[column] >= 0)[0])
            ids.append(f"F-{history.lists[r].run}-{history.lists[r].index[history.registry.member[column, r]]}")
    return ids


def weld_rows(history: History, to_run, shift_m: float) -> pd.DataFrame:
    """Rows of ``tables/welds.csv``: one per weld and run, with status and reason.

    Parameters
    ----------
    to_run : called with (run, reference chainage) for the place of a weld that the run does not show.
    shift_m : a weld that stands further than this from where the other runs have it is `shifted`.
    """
    registry, lists = history.registry, history.lists
    rows: list[dict] = []
    for column, weld_id in enumerate(column_ids(history)):
        members = np.flatnonzero(registry.member[column] >= 0)
        for r, welds in enumerate(lists):
            k = int(registry.member[column, r])
            row = {"weld_id": weld_id, "run": welds.run, "reference_chainage_m": registry.place[column]}
            if k >= 0:
                status, reason = _status(history, column, r, members, shift_m)
                probability = registry.probability[column, r]
                row |= {"index": int(welds.index[k]), "log_distance_m": welds.log_distance[k], "chainage_m": welds.place[k]}
                row["probability"] = welds.probability[k] if np.isnan(probability) else min(probability, 1.0)
            elif history.real[column] and history.covers(r, column):
                status, reason = _absent(history, column, r, members)
                if not status:
                    continue
                row["chainage_m"] = float(to_run(r, registry.place[column])) if status == "missed" else np.nan
            else:
                continue
            rows.append({**row, "status": status, "reason": reason})
    return pd.DataFrame(rows + [row for r, welds in enumerate(lists) for row in _double_rows(welds, registry, r)])


def _status(history: History, column: int, r: int, members: np.ndarray, shift_m: float) -> tuple[str, str]:
    """Status and reason of a weld that run r shows."""
    changes = history.changes
    others = [q for q in members if q != r]
    if not history.real[column]:
        detected = history.lists[r].probability[history.registry.member[column, r]]
        why = f"detector's probability {detected:.2f}" if detected < 0.5 else "it splits a joint that the other runs see whole"
        return "false", f"no other run shows it, and {why}"
    if r == members[0]:
        change = next((c for q in range(r) if (c := changed_between(changes, q, r, column))), None)
        spanned = [q for q in range(r) if not changed_between(changes, q, r, column) and history.covers(q, column)]
        if change and not spanned:
            return "added", history.why(change)
    shift = history.moved[column, r]
    if others and abs(shift) > shift_m:
        return "shifted", f"stands {shift:+.2f} m from where {history.name(others)} has it; both neighbours agree"
    if others:
        return "matched", f"also in {history.name(others)}"
    if any(history.covers(q, column) for q in range(len(history.lists)) if q != r):
        return "matched", "only this run shows it; its joints have lengths of this line"
    return "matched", "only this run covers this place"


def _absent(history: History, column: int, r: int, members: np.ndarray) -> tuple[str, str]:
    """Status and reason of a weld that run r does not show; empty when the run could not have it."""
    before = [q for q in members if q < r]
    near = before[-1] if before else members[0]
    change = changed_between(history.changes, int(near), r, column)
    if change is None:
        return "missed", f"in {history.name(members)}; the pipe is the same and this run does not show it"
    return ("removed", history.why(change)) if before else ("", "")


def displacement(registry: Registry, own: np.ndarray) -> np.ndarray:
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
    shared = np.flatnonzero(registry.member[:, r] >= 0)
    return (int(shared[0]), int(shared[-1])) if shared.size else (0, -1)


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
