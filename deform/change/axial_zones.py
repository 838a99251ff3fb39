"""Joint lengths of two runs in, stretches that grew longer or shorter along their axis out: the one cue of an axial strain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.change.joint_change import Elongation
from deform.change.significance import caution_factor, confidence_of, limit_of
from deform.options import ChangeOptions

Floats = NDArray[Any]
_COUNTS = (2, 3, 4, 6, 8, 12, 16, 24, 32)
_SHARED = 0.4  # least part of an elongation that must stay when the joint that tells most is left out
_BESIDE = 2  # joints on either side that must not give back what a string has gained
_LOOKS = 2.0  # independent strings per string length


@dataclass(frozen=True)
class Strings:
    """Strings of so many joints of a pair: mean length (m), independent looks, sigma (m), factor of caution, threshold, changes
    (m).
    """

    count: int
    length: float
    looks: float
    sigma: float
    caution: float
    limit: float
    change: Floats


@dataclass(frozen=True)
class AxialZone:
    """A stretch whose joints changed in length together, between two runs.

    Attributes
    ----------
    run, since : names of the later and the earlier run. start, end : m. change, sigma : m. joints : how many. statistic, limit :
    chi-square and its threshold. looks : independent strings of all lengths that were looked at in this pair.
    """

    run: str
    since: str
    start: float
    end: float
    change: float
    sigma: float
    joints: int
    statistic: float
    limit: float
    looks: float

    @property
    def confidence(self) -> float:
        """Chance that the noise of the joints shows nothing as strong anywhere on the line."""
        return confidence_of(self.statistic, self.looks, 1)


def strings_of(elongation: Elongation, false_alarms_per_100_km: float) -> list[Strings]:
    """Return the strings of joints of a pair with the noise that their own changes show."""
    known = np.isfinite(elongation.change)
    joints = int(known.sum())
    if joints < 20:
        return []
    length = float(np.nanmedian(np.diff(elongation.begin)))
    looks_per_100_km = sum(_LOOKS * 1e5 / length / n for n in _COUNTS)
    limit = limit_of(false_alarms_per_100_km, looks_per_100_km, 1)
    found = []
    for count in _COUNTS:
        change = elongation.strings(count)
        looks = _LOOKS * joints / count
        sigma = elongation.sigma(count)
        if looks < 10 or not sigma > 0:
            break
        caution = caution_factor(change / sigma, looks, np.sqrt(limit))
        found.append(Strings(count, count * length, looks, sigma, caution, limit, change))
    return found


def axial_zones(joints: pd.DataFrame, reference: str, runs: list[str], options: ChangeOptions) -> list[AxialZone]:
    """Return the stretches whose joints changed in length since the reference run, and since the run before.

    Parameters
    ----------
    joints : joint table with ``change_m:<run>``.
    reference, runs : names, the earliest first.
    options : rate of false alarms.

    Notes
    -----
    Strings of 2 to 32 joints, each against the spread of all strings of so many joints of the pair, with the threshold raised
    for heavy tails (`significance.tail_factor`). One joint proves nothing: a weld set wrong or a slip of the odometer changes
    one or two joints, so a good part must stay when the joint that tells most is left out; and where the one or two joints
    beside a string give back half of its change, a stretch of chainage lay wrong, as after a slip, and no steel has stretched.
    What grows over more than some 50 joints is taken for scale of the odometers by the matching, and is not seen.
    """
    if joints is None or not len(joints):
        return []
    zones: list[AxialZone] = []
    at = runs.index(reference)
    pairs: list[tuple[str, str, str | None]] = [(run, reference, None) for run in runs if run != reference]
    pairs += [(runs[k], runs[k - 1], runs[k - 1]) for k in range(1, len(runs)) if reference not in (runs[k], runs[k - 1])]
    for run, since, base in pairs:
        if f"change_m:{run}" not in joints or (base is not None and f"change_m:{base}" not in joints):
            continue
        sign = -1.0 if runs.index(run) < at and base is None else 1.0
        later, earlier = (run, since) if sign > 0 else (since, run)
        zones += [
            AxialZone(later, earlier, start, end, sign * change, *rest)
            for start, end, change, *rest in _stretches(Elongation(joints, run, base), options)
        ]
    return _distinct(zones)


def _stretches(elongation: Elongation, options: ChangeOptions) -> list[tuple]:
    """Strings that changed, the most significant of those that overlap."""
    rows = []
    searched = strings_of(elongation, options.false_alarms_per_100_km)
    looks = sum(strings.looks for strings in searched)
    for strings in searched:
        score = (strings.change / (strings.sigma * strings.caution)) ** 2
        high = np.flatnonzero(np.nan_to_num(score) > strings.limit)
        shared = [
            i for i in high if _shared(elongation.change[i : i + strings.count], strings) and _kept(elongation, int(i), strings)
        ]
        rows += [(float(score[i]), int(i), strings) for i in shared]
    rows.sort(key=lambda row: -row[0])
    taken: list[tuple[int, int]] = []
    found = []
    for top, i, strings in rows:
        if any(i < b and i + strings.count > a for a, b in taken):
            continue
        taken.append((i, i + strings.count))
        first, last = _shortest(elongation, i, strings)
        end = elongation.begin[last] if last < elongation.begin.size else elongation.begin[-1]
        size = float(strings.change[i]), strings.sigma
        found.append((elongation.begin[first], end, *size, last - first, top, strings.limit, looks))
    return found


def _shortest(elongation: Elongation, first: int, strings: Strings) -> tuple[int, int]:
    """The shortest string within a string that holds its change but for one sigma: longer ones tell the same and lie wider."""
    total = float(strings.change[first])
    least = abs(total) - strings.sigma
    summed = np.concatenate([[0.0], np.cumsum(elongation.change[first : first + strings.count])]) * np.sign(total)
    for count in range(2, strings.count):
        held = summed[count:] - summed[:-count]
        if held.max() >= least:
            begin = first + int(np.argmax(held))
            return begin, begin + count
    return first, first + strings.count


def _shared(change: Floats, strings: Strings) -> bool:
    """True when more than one joint tells the change of a string."""
    total = float(change.sum())
    rest = total - float(change[np.argmax(change * np.sign(total))])
    return rest * np.sign(total) > max(_SHARED * abs(total), 2.0 * strings.sigma)


def _kept(elongation: Elongation, first: int, strings: Strings) -> bool:
    """True when the joints beside a string do not give back half of its change."""
    total = float(strings.change[first])
    last = first + strings.count
    with np.errstate(invalid="ignore"):
        before = np.nancumsum(elongation.change[max(first - _BESIDE, 0) : first][::-1])
        after = np.nancumsum(elongation.change[last : last + _BESIDE])
    beside = np.add.outer(np.append(0.0, before), np.append(0.0, after)) * np.sign(total)
    return bool(beside.min() > -0.5 * abs(total))


def _distinct(zones: list[AxialZone]) -> list[AxialZone]:
    """One zone of those of several pairs that overlap: the most significant, at the first run that shows it."""
    zones = sorted(zones, key=lambda z: -z.statistic)
    kept: list[AxialZone] = []
    for zone in zones:
        same = [k for k in kept if min(k.end, zone.end) > max(k.start, zone.start) and k.change * zone.change > 0]
        if not same:
            kept.append(zone)
    return kept
