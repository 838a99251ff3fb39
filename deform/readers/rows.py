"""Rows of a listing in, each with its kind, its captured values and its own words out; a row that no rule knows is `other`."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pandas as pd

from deform.readers import cells, delimited
from deform.readers.columns import RELATIVE, ColumnMap, RowRule
from deform.readers.delimited import Sheet
from deform.readers.findings import Findings

NUMBERS = (
    "distance",
    "distance_end",
    "joint_length",
    "wall",
    "elevation",
    "weld_distance",
    "dent_depth",
    "dent_depth_od",
    "depth",
    "depth_wall",
) + ("length", "width", "easting", "northing", "latitude", "longitude", "clock", "seam_clock", "bend_angle")
TEXTS = ("joint", "event", "comment", "name", "direction", "seam")


@dataclass(frozen=True)
class Rows:
    """Rows of a listing by kind.

    Attributes
    ----------
    frame : one row per row of the listing that has a distance: ``kind``, ``part``, ``pair``, ``line``, ``text`` and the fields
        of `NUMBERS` (SI, degree, NaN where nothing is said) and `TEXTS`.
    """

    frame: pd.DataFrame

    def of(self, *kinds: str) -> pd.DataFrame:
        """Return the rows of some kinds."""
        return self.frame[self.frame["kind"].isin(kinds)]


def classify(sheet: Sheet, columns: ColumnMap, findings: Findings) -> Rows:
    """Return the rows of a listing by kind.

    Notes
    -----
    Rows that no rule of the map takes are kept as kind ``other``; a warning counts them by their words. Rows without a
    distance (foot lines, sums) have no place on the pipe: they are left out, and counted as well.
    """
    frame = delimited.read_fields(sheet, columns.columns, columns.file, findings)
    for name in NUMBERS:
        if name not in frame:
            frame[name] = np.nan
    for name in TEXTS:
        if name not in frame:
            frame[name] = ""
    frame["line"] = sheet.lines
    chosen = _rule_of_rows(frame, columns.rows)
    frame["kind"] = [columns.rows[r].kind if r >= 0 else "other" for r in chosen]
    frame["part"] = [columns.rows[r].part if r >= 0 else "point" for r in chosen]
    frame["pair"] = [(columns.rows[r].pair or columns.rows[r].kind) if r >= 0 else "" for r in chosen]
    frame["seam"] = [columns.rows[r].seam if r >= 0 else "" for r in chosen]
    for r, rule in enumerate(columns.rows):
        mask = chosen == r
        if mask.any():
            _own_columns(frame, mask, rule, sheet, columns, findings)
            _capture(frame, mask, rule, findings)
    frame["text"] = [": ".join(t for t in pair if t) for pair in zip(frame["event"], frame["comment"], strict=True)]
    _unknown(frame, chosen, findings)
    return Rows(_placed(frame, findings))


def _rule_of_rows(frame: pd.DataFrame, rules: tuple[RowRule, ...]) -> np.ndarray:
    """Return for each row the number of the first rule that takes it, -1 for none."""
    chosen = np.full(len(frame), -1)
    events = np.array([cells.key(e) for e in frame["event"]], dtype=object)
    for r, rule in enumerate(rules):
        fits = chosen < 0
        if rule.event:
            fits &= np.isin(events, [cells.key(e) for e in rule.event])
        for pattern, column in ((rule.event_pattern, "event"), (rule.comment_pattern, "comment")):
            if pattern:
                search = re.compile(pattern, re.IGNORECASE).search
                fits &= np.array([bool(search(t)) for t in frame[column]], bool)
        chosen[fits] = r
    return chosen


def _own_columns(
    frame: pd.DataFrame, mask: np.ndarray, rule: RowRule, sheet: Sheet, columns: ColumnMap, findings: Findings
) -> None:
    if not rule.columns:
        return
    own = delimited.read_fields(sheet, rule.columns, columns.file, findings, mask)
    for name in own:
        frame.loc[mask, name] = own.loc[mask, name]


def _capture(frame: pd.DataFrame, mask: np.ndarray, rule: RowRule, findings: Findings) -> None:
    """Put what the rule's pattern finds in the comments into the fields of the rows."""
    if not rule.capture:
        return
    search = re.compile(rule.capture, re.IGNORECASE).search
    for i in np.flatnonzero(mask):
        match = search(frame["comment"].iat[i])
        for name, text in (match.groupdict() if match else {}).items():
            if text is None:
                continue
            field, value = _captured(name, text, rule)
            if isinstance(value, float) and np.isnan(value):
                findings.repair("", f"line {frame['line'].iat[i]}", f"{text!r} captured as {name} cannot be read; taken as empty")
                continue
            frame.iat[i, frame.columns.get_loc(field)] = value


def _captured(name: str, text: str, rule: RowRule) -> tuple[str, float | str]:
    if name == "direction":
        word = {cells.key(k): v for k, v in rule.words.items()}.get(cells.key(text), text.casefold())
        return "direction", word
    if name == "name":
        return "name", text.strip()
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        if name != "clock":
            return name, float("nan")
        try:
            return "clock", cells.clock(text, "h:mm")
        except ValueError:
            return "clock", float("nan")
    if name == "angle":
        return "bend_angle", number
    if name == "clock":
        return "clock", number * 30.0 % 360.0
    unit = rule.units[name]
    target = "dent_depth" if name == "depth" and rule.kind == "dent" else name
    if unit in RELATIVE:
        return f"{target}_{unit.split()[1].lower()}", number * RELATIVE[unit][1]
    return target, number * cells.factor(unit, "length")


def _unknown(frame: pd.DataFrame, chosen: np.ndarray, findings: Findings) -> None:
    unknown = Counter(frame["event"].to_numpy()[chosen < 0].tolist())
    if unknown:
        said = ", ".join(f"{event or '(empty)'} ({n})" for event, n in unknown.most_common(8))
        more = f" and {len(unknown) - 8} more" if len(unknown) > 8 else ""
        findings.repair(
            "",
            "event",
            f"{sum(unknown.values())} rows have an event that the column map does not know, kept as other: {said}{more}",
        )


def _placed(frame: pd.DataFrame, findings: Findings) -> pd.DataFrame:
    placed = np.isfinite(frame["distance"].to_numpy(float))
    lost = frame[~placed]
    for row in lost[lost["kind"] == "weld"].itertuples():
        findings.fault(
            "",
            f"distance, line {row.line}",
            "a girth weld without a distance",
            "is the unit, format or decimal mark of the map right?",
        )
        if len(findings.faults) > 20:
            break
    others = lost[lost["kind"] != "weld"]
    if len(others):
        first = others.iloc[0]
        findings.repair(
            "",
            "distance",
            f"{len(others)} rows without a distance are left out, first line {first['line']}: {first['text'] or '(no words)'}",
        )
    return frame[placed].reset_index(drop=True)
