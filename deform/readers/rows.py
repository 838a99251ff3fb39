"""Rows of a listing in, each with its kind, its captured values and its own words out; a row that no rule knows is `other`."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from deform.readers import cells, delimited
from deform.readers.columns import FIELDS, RELATIVE, ColumnMap, RowRule
from deform.readers.delimited import Sheet
from deform.readers.findings import Findings
from deform.readers.frame import Frame

NUMBERS = (*(n for n, kind in FIELDS.items() if kind != "text"), "dent_depth_od", "depth_wall")
TEXTS = tuple(n for n, kind in FIELDS.items() if kind == "text")
_LONGEST_LIST = 8


def classify(sheet: Sheet, columns: ColumnMap, findings: Findings) -> Frame:
    """Return the rows of a listing with their kind.

    Returns
    -------
    One row per row of the listing that has a distance: ``kind``, ``part``, ``pair``, ``seam``, ``line``, ``text`` (the source's
    own words), and all fields of a column map (SI, degree; NaN and empty text where nothing is said).

    Notes
    -----
    Rows that no rule of the map takes are kept as kind ``other``; a warning counts them by their words. Rows without a
    distance (foot lines, sums) have no place on the pipe: they are left out, and counted as well.
    """
    frame = _complete(delimited.read_fields(sheet, columns.columns, columns.file, findings))
    chosen = _rule_of_rows(frame, columns.rows)
    unknown = RowRule(kind="other", event_pattern=".*")
    rules = [columns.rows[r] if r >= 0 else unknown for r in chosen]
    said = {name: [getattr(rule, name) for rule in rules] for name in ("kind", "part", "seam")}
    said["pair"] = [rule.pair or rule.kind for rule in rules]
    said["text"] = [": ".join(t for t in pair if t) for pair in zip(frame["event"], frame["comment"], strict=True)]
    frame = frame.put({name: np.array(texts, dtype=object) for name, texts in said.items()} | {"line": np.array(sheet.lines)})
    for r, rule in enumerate(columns.rows):
        mask = chosen == r
        if mask.any():
            _own_columns(frame, mask, rule, sheet, columns, findings)
            _capture(frame, mask, rule, findings)
    _count_unknown(frame["event"][chosen < 0], findings)
    return _placed(frame, findings)


def _complete(frame: Frame) -> Frame:
    numbers = {name: np.full(len(frame), np.nan) for name in NUMBERS if name not in frame}
    texts = {name: np.full(len(frame), "", dtype=object) for name in TEXTS if name not in frame}
    return frame.put(numbers | texts)


def _rule_of_rows(frame: Frame, rules: tuple[RowRule, ...]) -> np.ndarray:
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


def _own_columns(frame: Frame, mask: np.ndarray, rule: RowRule, sheet: Sheet, columns: ColumnMap, findings: Findings) -> None:
    """Fill in place the fields that stand elsewhere in rows of this kind."""
    if rule.columns:
        own = delimited.read_fields(sheet, rule.columns, columns.file, findings, mask)
        for name, values in own.columns.items():
            frame[name][mask] = values[mask]


def _capture(frame: Frame, mask: np.ndarray, rule: RowRule, findings: Findings) -> None:
    """Put what the rule's pattern finds in the comments into the fields of the rows, in place."""
    if not rule.capture:
        return
    search = re.compile(rule.capture, re.IGNORECASE).search
    for i in np.flatnonzero(mask):
        match = search(frame["comment"][i])
        for name, text in (match.groupdict() if match else {}).items():
            if text is None:
                continue
            field, value = _captured(name, text, rule)
            if isinstance(value, float) and np.isnan(value):
                findings.repair("", f"line {frame['line'][i]}", f"{text!r} captured as {name} cannot be read; taken as empty")
            else:
                frame[field][i] = value


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


def _count_unknown(events: np.ndarray, findings: Findings) -> None:
    if not events.size:
        return
    counts = Counter(events.tolist())
    said = ", ".join(f"{event or '(empty)'} ({n})" for event, n in counts.most_common(_LONGEST_LIST))
    more = f" and {len(counts) - _LONGEST_LIST} more" if len(counts) > _LONGEST_LIST else ""
    rule = f"{events.size} rows have an event that the column map does not know, kept as other: {said}{more}"
    findings.repair("", "event", rule)


def _placed(frame: Frame, findings: Findings) -> Frame:
    """Leave out rows without a distance; a girth weld without one is a fault."""
    placed = np.isfinite(frame["distance"])
    weld = frame["kind"] == "weld"
    for line in frame["line"][~placed & weld][:_LONGEST_LIST]:
        advice = "is the unit, format or decimal mark of the map right?"
        findings.fault("", f"distance, line {line}", "a girth weld without a distance", advice)
    lost = np.flatnonzero(~placed & ~weld)
    if lost.size:
        first = f"line {frame['line'][lost[0]]}: {frame['text'][lost[0]] or '(no words)'}"
        findings.repair("", "distance", f"{lost.size} rows without a distance are left out, first {first}")
    return frame.take(placed)
