"""Rows of a listing in, its girth welds in order out, with number, length, wall and seam of the joint that begins at each."""

from __future__ import annotations

import numpy as np

from deform.readers.cells import is_empty
from deform.readers.columns import Joints
from deform.readers.findings import Findings
from deform.readers.frame import Frame

_SAME_PLACE_M = 0.0005
_JOINT_RANGE_M = (0.8, 30.0)  # median of a line: pups pull it down, double joints are 24 m
_LENGTH_RATIO = (0.9, 1.1)
_ROW_BEHIND_M = 1.0
_LARGE_MISFIT_M = 0.05
_FOOT = 0.3048


def weld_rows(frame: Frame, options: Joints, findings: Findings) -> Frame | None:
    """Return the girth welds with rising distance and ``label``; None, and a fault, when their spacing cannot be that of joints.

    Notes
    -----
    Welds out of order are sorted, welds at one place are one, lengths that belong to the joint upstream are moved: all recorded.
    """
    welds = frame.take(frame["kind"] == "weld")
    if len(welds) < 2:
        advice = "does the map's rule for welds fit the events?"
        findings.fault("", "rows", f"{len(welds)} girth welds found; a run needs two at least", advice)
        return None
    falls = np.count_nonzero(np.diff(welds["distance"]) < 0)
    if falls:
        rule = f"falls {falls} times from one girth weld to the next; the rows are sorted by distance"
        findings.repair("", "distance", rule)
        welds = welds.sorted_by("distance")
    welds = welds.put({"label": np.array([joint_number(t) for t in welds["joint"]], dtype=object)})
    welds = _once(welds, findings)
    if not _possible_spacing(welds, findings):
        return None
    welds = _belonging(welds, options, findings)
    _note_repeated(welds, findings)
    return welds


def joint_number(text: str) -> str:
    """Return a joint number as text, 30.0 and 30.00 as 30; an empty cell as an empty text."""
    if is_empty(text):
        return ""
    try:
        return f"{float(text):.10g}"
    except ValueError:
        return text


def joint_of(welds: Frame, distance: np.ndarray) -> np.ndarray:
    """Return the index of the weld at which the joint of each place begins, -1 upstream of the first."""
    return np.searchsorted(welds["distance"], distance + _SAME_PLACE_M, side="right") - 1


def labels_at(welds: Frame, rows: Frame) -> np.ndarray:
    """Return the joint number of each row: its own, else that of the weld upstream."""
    before = joint_of(welds, rows["distance"])
    own = [joint_number(t) for t in rows["joint"]]
    return np.array([o or (welds["label"][i] if i >= 0 else "") for o, i in zip(own, before, strict=True)], dtype=object)


def with_rows_behind(welds: Frame, frame: Frame) -> Frame:
    """Return the welds with seam and wall from rows of their own behind the weld, where the weld's row does not say them.

    A wall holds for the following joints until the next change; one that changes inside a joint holds from the next joint on.
    """
    seams = frame.take(frame["kind"] == "seam")
    owner = joint_of(welds, seams["distance"])
    kind, clock = welds["seam"].copy(), welds["seam_clock"].copy()
    for row in np.flatnonzero(owner >= 0)[::-1]:  # from the end: the first row of a joint has the last word
        i, own = owner[row], welds["seam_clock"][owner[row]]
        kind[i] = seams["seam"][row]
        stated = seams["seam_clock"][row] if np.isfinite(seams["seam_clock"][row]) else seams["clock"][row]
        clock[i] = own if np.isfinite(own) else stated
    wall = welds["wall"]
    changes = frame.take((frame["kind"] == "wall_change") & np.isfinite(frame["wall"]))
    if len(changes) and not np.isfinite(wall).any():
        last = np.searchsorted(changes["distance"] - _ROW_BEHIND_M, welds["distance"], side="right") - 1
        wall = np.where(last >= 0, changes["wall"][np.maximum(last, 0)], np.nan)
    return welds.put({"seam": kind, "seam_clock": clock, "wall": wall})


def usual_wall(welds: Frame) -> float | None:
    """Return the wall that most of the pipe has (metre), None when no wall is known."""
    wall, length = welds["wall"][:-1], np.diff(welds["distance"])
    known = np.isfinite(wall)
    if not known.any():
        return None
    walls, place = np.unique(np.round(wall[known], 5), return_inverse=True)
    return float(walls[np.argmax(np.bincount(place, weights=length[known]))])


def _once(welds: Frame, findings: Findings) -> Frame:
    twice = np.append(False, np.diff(welds["distance"]) < _SAME_PLACE_M)
    if twice.any():
        i = int(np.argmax(twice))
        first = f"line {welds['line'][i]}, joint {welds['label'][i] or '(no number)'}"
        findings.repair("", "rows", f"{twice.sum()} girth welds stand there twice, first {first}; one of each is kept")
    return welds.take(~twice)


def _possible_spacing(welds: Frame, findings: Findings) -> bool:
    """Hold the spacing of the welds against what joints can be, and the vendor's joint lengths against the spacing."""
    spacing = np.diff(welds["distance"])
    median = float(np.median(spacing)) if spacing.size else 0.0
    if not _JOINT_RANGE_M[0] <= median <= _JOINT_RANGE_M[1]:
        rule = f"gives joints of {median:.4g} m (median); pipe joints have {_JOINT_RANGE_M[0]:g} to {_JOINT_RANGE_M[1]:g} m"
        findings.fault("", "distance", rule, "is the unit of the column map right?")
        return False
    length = welds["joint_length"]
    ratios = [_ratio(length[:-1], spacing), _ratio(length[1:], spacing)]
    if np.isfinite(ratios[0]) and not any(_LENGTH_RATIO[0] < r < _LENGTH_RATIO[1] for r in ratios):
        rule = f"is {ratios[0]:.4g} times the distance between welds (median)"
        findings.fault("", "joint_length", rule, "are the units of distance and of joint length right?")
        return False
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.append(length[:-1] / spacing, np.nan)
    mixed = (np.abs(ratio * _FOOT - 1) < 0.02) | (np.abs(ratio / _FOOT - 1) < 0.02)
    if mixed.any() and abs(ratios[0] - 1) < 0.05:
        rule = f"{mixed.sum()} lengths look as if foot and metre were exchanged, first in line {welds['line'][np.argmax(mixed)]}"
        findings.repair("", "joint_length", f"{rule}; taken as empty")
        length[mixed] = np.nan
    return True


def _ratio(length: np.ndarray, spacing: np.ndarray) -> float:
    known = np.isfinite(length) & (length > 0)
    return float(np.median(length[known] / spacing[known])) if known.sum() > 2 else float("nan")


def _belonging(welds: Frame, options: Joints, findings: Findings) -> Frame:
    """Move numbers and lengths that are those of the joint that ends at the weld to the weld at which it begins."""
    label, length, spacing = welds["label"], welds["joint_length"], np.diff(welds["distance"])
    if options.number == "ends":
        label = np.append(label[1:], "")
    begins, ends = _misfit(length[:-1] - spacing), _misfit(length[1:] - spacing)
    moves = options.length == "ends"
    if not moves and len(welds) > 10 and begins > _LARGE_MISFIT_M and ends < 0.25 * begins:
        moves = True
        rule = f"fits the joint that ends at the weld (misfit {ends:.3g} m) and not the one that begins there ({begins:.3g} m)"
        findings.repair("", "joint_length", f"{rule}; moved")
    return welds.put({"label": label, "joint_length": np.append(length[1:], np.nan) if moves else length})


def _misfit(departure: np.ndarray) -> float:
    """Return a mean departure (metre) in which no single one counts for more than one metre."""
    known = np.abs(departure[np.isfinite(departure)])
    return float(np.mean(np.minimum(known, 1.0))) if known.size else float("inf")


def _note_repeated(welds: Frame, findings: Findings) -> None:
    named = welds["label"][welds["label"] != ""]
    labels, counts = np.unique(named.astype(str), return_counts=True)
    if (counts > 1).any():
        findings.repair(
            "", "joint", f"{(counts > 1).sum()} joint numbers occur more than once, first {labels[counts > 1][0]}; kept"
        )
