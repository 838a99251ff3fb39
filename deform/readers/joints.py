"""Rows of a listing in, its girth welds in order out, with number, length, wall and seam of the joint that begins at each."""

from __future__ import annotations

import numpy as np
import pandas as pd

from deform.readers.cells import is_empty
from deform.readers.columns import Joints
from deform.readers.findings import Findings

_SAME_PLACE_M = 0.0005
_JOINT_RANGE_M = (0.8, 30.0)  # median of a line: pups pull it down, double joints are 24 m
_LENGTH_RATIO = (0.9, 1.1)
_ROW_BEHIND_M = 1.0
_FEET = 0.3048


def weld_rows(frame: pd.DataFrame, options: Joints, findings: Findings) -> pd.DataFrame | None:
    """Return the girth welds with rising distance; None, and a fault, when there are not two, or their spacing cannot be.

    Notes
    -----
    Welds out of order are sorted, welds at one place are one: both are recorded.
    """
    welds = frame[frame["kind"] == "weld"].copy()
    if len(welds) < 2:
        findings.fault(
            "",
            "rows",
            f"{len(welds)} girth welds found; a run needs two at least",
            "does the map's rule for welds fit the events?",
        )
        return None
    falls = np.count_nonzero(np.diff(welds["distance"]) < 0)
    if falls:
        findings.repair("", "distance", f"falls {falls} times from one girth weld to the next; the rows are sorted by distance")
        welds = welds.sort_values("distance", kind="stable")
    welds["label"] = [joint_number(t) for t in welds["joint"]]
    welds = _once(welds.reset_index(drop=True), findings)
    if not _possible_spacing(welds, findings):
        return None
    _belonging(welds, options, findings)
    _check_labels(welds, findings)
    return welds


def joint_number(text: str) -> str:
    """Return a joint number as text, 30.0 and 30.00 as 30; an empty cell as an empty text."""
    if is_empty(text):
        return ""
    try:
        return f"{float(text):.10g}"
    except ValueError:
        return text


def joint_of(welds: pd.DataFrame, distance: np.ndarray) -> np.ndarray:
    """Return the index of the weld at which the joint of each place begins, -1 upstream of the first."""
    return np.searchsorted(welds["distance"].to_numpy(float), distance + _SAME_PLACE_M, side="right") - 1


def labels_at(welds: pd.DataFrame, rows: pd.DataFrame) -> np.ndarray:
    """Return the joint number of each row: its own, else that of the weld upstream."""
    before = joint_of(welds, rows["distance"].to_numpy(float))
    labels = welds["label"].to_numpy()
    own = [joint_number(t) for t in rows["joint"]]
    return np.array([o or (labels[i] if i >= 0 else "") for o, i in zip(own, before, strict=True)], dtype=object)


def take_from_rows_behind(welds: pd.DataFrame, frame: pd.DataFrame) -> None:
    """Take seam and wall of a joint from rows of their own behind its weld, where the weld's row does not say them.

    A wall holds for the following joints until the next change; one that changes inside a joint holds from the next joint on.
    """
    for row in frame[frame["kind"] == "seam"].itertuples():
        i = int(joint_of(welds, np.array([row.distance]))[0])
        if i >= 0 and not welds["seam"].iat[i]:
            welds.iat[i, welds.columns.get_loc("seam")] = row.seam
            if np.isnan(welds["seam_clock"].iat[i]):
                welds.iat[i, welds.columns.get_loc("seam_clock")] = row.seam_clock if np.isfinite(row.seam_clock) else row.clock
    changes = frame[(frame["kind"] == "wall_change") & np.isfinite(frame["wall"].to_numpy(float))]
    if len(changes) and not np.isfinite(welds["wall"].to_numpy(float)).any():
        place, wall = changes["distance"].to_numpy(float) - _ROW_BEHIND_M, changes["wall"].to_numpy(float)
        last = np.searchsorted(place, welds["distance"].to_numpy(float), side="right") - 1
        welds["wall"] = np.where(last >= 0, wall[np.maximum(last, 0)], np.nan)


def usual_wall(welds: pd.DataFrame) -> float | None:
    """Return the wall that most of the pipe has (metre), None when no wall is known."""
    wall, length = welds["wall"].to_numpy(float)[:-1], np.diff(welds["distance"].to_numpy(float))
    known = np.isfinite(wall)
    if not known.any():
        return None
    walls, place = np.unique(np.round(wall[known], 5), return_inverse=True)
    return float(walls[np.argmax(np.bincount(place, weights=length[known]))])


def _once(welds: pd.DataFrame, findings: Findings) -> pd.DataFrame:
    twice = np.append(False, np.diff(welds["distance"].to_numpy(float)) < _SAME_PLACE_M)
    if twice.any():
        i = int(np.flatnonzero(twice)[0])
        pair = f"line {welds['line'].iat[i]}, joint {welds['label'].iat[i] or '(no number)'}"
        findings.repair("", "rows", f"{twice.sum()} girth welds stand there twice, first {pair}; one of each is kept")
    return welds[~twice].reset_index(drop=True)


def _possible_spacing(welds: pd.DataFrame, findings: Findings) -> bool:
    spacing = np.diff(welds["distance"].to_numpy(float))
    median = float(np.median(spacing)) if spacing.size else 0.0
    if not _JOINT_RANGE_M[0] <= median <= _JOINT_RANGE_M[1]:
        rule = f"gives joints of {median:.4g} m (median); pipe joints have {_JOINT_RANGE_M[0]:g} to {_JOINT_RANGE_M[1]:g} m"
        findings.fault("", "distance", rule, "is the unit of the column map right?")
        return False
    length = welds["joint_length"].to_numpy(float)[:-1]
    known = np.isfinite(length) & (length > 0)
    if known.sum() < 3:
        return True
    ratio = length[known] / spacing[known]
    usual = float(np.median(ratio))
    if not _LENGTH_RATIO[0] < usual < _LENGTH_RATIO[1] and float(np.median(length[known])) > 0:
        shifted = np.median(length[1:][known[1:]] / spacing[:-1][known[1:]]) if known[1:].any() else np.inf
        if not _LENGTH_RATIO[0] < shifted < _LENGTH_RATIO[1]:
            rule = f"is {usual:.4g} times the distance between welds (median)"
            findings.fault("", "joint_length", rule, "are unit of distance and of joint length right?")
            return False
    mixed = (np.abs(ratio * _FEET - 1) < 0.02) | (np.abs(ratio / _FEET - 1) < 0.02)
    if mixed.any():
        i = int(np.flatnonzero(known)[np.flatnonzero(mixed)[0]])
        text = f"{mixed.sum()} joint lengths are in the other of foot and metre, first in line {welds['line'].iat[i]}; taken as empty"
        findings.repair("", "joint_length", text)
        welds.iloc[np.flatnonzero(known)[mixed], welds.columns.get_loc("joint_length")] = np.nan
    return True


def _belonging(welds: pd.DataFrame, options: Joints, findings: Findings) -> None:
    """Move numbers and lengths that are those of the joint that ends at the weld to the weld at which it begins."""
    if options.number == "ends":
        welds["label"] = [*welds["label"].to_numpy()[1:], ""]
    length, spacing = welds["joint_length"].to_numpy(float), np.diff(welds["distance"].to_numpy(float))
    if np.isfinite(length).sum() < 3:
        return
    begins, ends = _misfit(length[:-1] - spacing), _misfit(length[1:] - spacing)
    moves = options.length == "ends"
    if not moves and len(welds) > 10 and ends < 0.25 * begins and begins > 0.05:
        moves = True
        text = f"fits the joint that ends at the weld (median misfit {ends:.3g} m) and not the one that begins there ({begins:.3g} m); moved"
        findings.repair("", "joint_length", text)
    if moves:
        welds["joint_length"] = np.append(length[1:], np.nan)


def _misfit(departure: np.ndarray) -> float:
    known = np.abs(departure[np.isfinite(departure)])
    return float(np.mean(np.minimum(known, 1.0))) if known.size else np.inf


def _check_labels(welds: pd.DataFrame, findings: Findings) -> None:
    labels = pd.Series([t for t in welds["label"] if t])
    repeated = labels[labels.duplicated()]
    if len(repeated):
        findings.repair("", "joint", f"{len(repeated)} joint numbers occur twice, first {repeated.iat[0]}; kept")
