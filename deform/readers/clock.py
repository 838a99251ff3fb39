"""Time stamps of a recording in, stamps that rise out: isolated slips are repaired, everything else is named."""

from __future__ import annotations

import numpy as np

from deform.readers.findings import Findings
from deform.run import stamps

MOST_SLIPS = 20
MOST_SLIPS_FRACTION = 1e-3
_LONGEST_LIST = 3


def rising_time(time: np.ndarray, file: str, findings: Findings) -> np.ndarray:
    """Return stamps that rise strictly.

    Parameters
    ----------
    time : stamps (second), shape (n,).
    file : name of the file, for the messages.
    findings : takes the faults and the repairs.

    Notes
    -----
    The rule of repair: a stamp that does not exceed the one before it is *isolated* when one of the two can be replaced by
    the middle of its own neighbours and the sequence of these four stamps then rises. Of the two candidates the one that
    stands further from the middle of its neighbours is replaced (its counts are kept: they are increments that happened).
    Two slips that touch each other, or more than a thousandth of the samples (and more than 20), are a fault: the clock
    itself jumped and nobody can know where the samples belong.
    """
    time = np.array(time, dtype=float)
    if time.size == 0:
        findings.fault(file, "time", "has no samples; the recording is empty", "was the recorder on?")
        return time
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        findings.fault(
            file,
            "time",
            f"is not a number at {bad.size} of {time.size} samples, first at sample {bad[0]}; every sample needs its time",
        )
        return time
    slips = np.flatnonzero(np.diff(time) <= 0) + 1
    if slips.size:
        _repair_slips(time, slips, file, findings)
    return time


def missing_samples(time: np.ndarray, file: str, findings: Findings, *, cumulative: bool = False) -> None:
    """Record where samples are missing: gaps, and shorter stretches, which the navigation bridges.

    Parameters
    ----------
    time : stamps that rise (second), shape (n,).
    file : name of the file, for the messages.
    findings : takes the findings.
    cumulative : the counts go on through a short stretch, of which nothing is then said.

    Notes
    -----
    The rule is `stamps.lost_before`; up to `stamps.MOST_BRIDGED` missing samples are bridged.
    """
    if time.size < 2:
        return
    at, lost = stamps.losses(time)
    usual, wide = stamps.usual_step(time), at[lost > stamps.MOST_BRIDGED]
    for i in wide[:_LONGEST_LIST]:
        length = f"{time[i] - time[i - 1]:.3g} s at t={time[i - 1]:.3f} s"
        findings.repair(file, "time", f"gap of {length} (usual step {usual:.4g} s), kept")
    if wide.size > _LONGEST_LIST:
        further = wide[_LONGEST_LIST:]
        total = float(np.sum(time[further] - time[further - 1]))
        findings.repair(file, "time", f"{further.size} further gaps, {total:.3g} s in all, kept")
    narrow = lost <= stamps.MOST_BRIDGED
    if narrow.any() and not cumulative:
        where = f"at {int(narrow.sum())} places, first " if narrow.sum() > 1 else ""
        first = f"{where}at t={time[at[narrow][0] - 1]:.3f} s"
        findings.repair(file, "time", f"samples missing: {int(lost[narrow].sum())} {first}; bridged")


def same_span(time: np.ndarray, other: np.ndarray, file: str, other_file: str, findings: Findings) -> None:
    """Fault when less than half of the shorter recording overlaps the other one: they are not on one clock."""
    if not (time.size and other.size and np.isfinite([time[0], time[-1], other[0], other[-1]]).all()):
        return
    overlap = min(time[-1], other[-1]) - max(time[0], other[0])
    shorter = min(time[-1] - time[0], other[-1] - other[0])
    if overlap < 0.5 * shorter or overlap < 0:
        rule = f"runs from {time[0]:.1f} to {time[-1]:.1f} s, {other_file} from {other[0]:.1f} to {other[-1]:.1f} s"
        findings.fault(file, "time", f"{rule}; both must be on one clock", "is a file of another run in this folder?")


def _repair_slips(time: np.ndarray, slips: np.ndarray, file: str, findings: Findings) -> None:
    places = ", ".join(f"sample {i} ({time[i - 1]:.6g} then {time[i]:.6g} s)" for i in slips[:_LONGEST_LIST])
    places += ", ..." if slips.size > _LONGEST_LIST else ""
    touching = slips.size > 1 and int(np.diff(slips).min()) < 3
    if touching or slips.size > max(MOST_SLIPS, MOST_SLIPS_FRACTION * time.size) or not all(_mend(time, int(i)) for i in slips):
        rule = f"does not rise at {slips.size} of {time.size} samples: {places}; times must rise strictly"
        findings.fault(file, "time", rule, "only isolated slips are repaired: did the clock restart?")
        return
    findings.repair(file, "time", f"{slips.size} isolated slips of the clock set between their neighbours: {places}")


def _mend(time: np.ndarray, i: int) -> bool:
    """Set stamp i, or the one before it, between its neighbours; False when neither makes the sequence rise."""
    candidates = sorted(((abs(time[k] - _between(time, k)), k) for k in (i, i - 1)), key=lambda c: -c[0])
    for _, k in candidates:
        old, time[k] = time[k], _between(time, k)
        around = time[max(k - 2, 0) : k + 3]
        if (np.diff(around) > 0).all():
            return True
        time[k] = old
    return False


def _between(time: np.ndarray, k: int) -> float:
    if 0 < k < time.size - 1:
        return 0.5 * (time[k - 1] + time[k + 1])
    if time.size < 3:
        return float("nan")
    return 2 * time[1] - time[2] if k == 0 else 2 * time[-2] - time[-3]
