"""The content of an output folder in, a workbook in the wording of a pipe tally out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import xlsxwriter

from deform.options import ReportOptions
from deform.report import sheets
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.quantities import QUANTITIES
from deform.run import store

_WIDEST = 60
_HEAD_ROW = 1
_COLOURS = {  # word of a status or severity: letters, ground
    "high": ("#B3261E", "#FBE9E7"),
    "grown": ("#B3261E", "#FBE9E7"),
    "medium": ("#B35C00", "#FFF1DE"),
    "new": ("#B35C00", "#FFF1DE"),
    "removed": ("#5B626C", "#ECEFF2"),
    "added": ("#1B6E53", "#E3F4EE"),
    "missed": ("#5B626C", "#ECEFF2"),
}


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``report/report.xlsx`` and return its path."""
    path = content.folder / "report" / "report.xlsx"
    numbers = build_context(content, options)
    with store.atomic(path) as place:
        book = xlsxwriter.Workbook(place, {"nan_inf_to_errors": False, "strings_to_formulas": False, "strings_to_urls": False})
        book.set_properties({"title": numbers["title"], "comments": f"made {numbers['made']} by deform {numbers['version']}"})
        styles = _styles(book)
        _write_summary(book.add_worksheet("Summary"), numbers, styles)
        for sheet in sheets.build(content, numbers):
            _write_sheet(book.add_worksheet(sheet.name), sheet, styles)
        book.close()
    return path


def _styles(book: Any) -> dict[str, Any]:
    common = {"font_name": "Calibri", "font_size": 10, "valign": "top"}
    styles = {name: book.add_format({**common, "num_format": of.excel}) for name, of in QUANTITIES.items()}
    head = {"bold": True, "text_wrap": True, "bg_color": "#E8ECF0", "bottom": 1, "border_color": "#5B626C"}
    return styles | {
        "head": book.add_format({**common, **head}),
        "text": book.add_format(common),
        "count": book.add_format({**common, "num_format": "#,##0"}),
        "clock": book.add_format({**common, "align": "right", "num_format": "@"}),
        "wrap": book.add_format({**common, "text_wrap": True}),
        "title": book.add_format({**common, "bold": True, "font_size": 16}),
        "lead": book.add_format({**common, "bold": True, "font_size": 12, "text_wrap": True}),
        "bold": book.add_format({**common, "bold": True}),
        "quiet": book.add_format({**common, "italic": True, "font_color": "#5B626C"}),
        **{f"word {word}": book.add_format({"font_color": ink, "bg_color": ground}) for word, (ink, ground) in _COLOURS.items()},
    }


def _write_summary(sheet: Any, numbers: dict[str, Any], styles: dict[str, Any]) -> None:
    sheet.set_column(0, 0, 26)
    sheet.set_column(1, 9, 15)
    sheet.hide_gridlines(2)
    sheet.write_string(0, 0, numbers["title"], styles["title"])
    line = 2
    for i, sentence in enumerate([*numbers["verdict"], *numbers["limits_of_sources"]]):
        sheet.merge_range(line, 0, line, 9, sentence, styles["lead" if i == 0 else "wrap"])
        sheet.set_row(line, 15.0 * (1 + len(sentence) // (100 if i == 0 else 130)) + (3 if i == 0 else 0))
        line += 1
        if i + 1 == len(numbers["verdict"]):
            line += 1
    line += 1
    for fact in numbers["facts"]:
        sheet.write_string(line, 0, fact["name"].capitalize(), styles["bold"])
        sheet.write_string(line, 1, fact["value"], styles["text"])
        sheet.write_string(line, 2, fact["note"], styles["quiet"])
        line += 1
    line += 1
    head = ("run", "date", "source", "direction", "length", "diameter", "wall", "welds", "dents", "markers")
    for j, key in enumerate(head):
        sheet.write_string(line, j, key.capitalize(), styles["head"])
    for run in numbers["runs"]:
        line += 1
        for j, key in enumerate(("id", *head[1:])):
            mark = " (reference)" if key == "id" and run["is_reference"] else ""
            sheet.write_string(line, j, str(run[key]) + mark, styles["text"])
    sheet.write_string(line + 2, 0, f"Made {numbers['made']} by deform {numbers['version']}", styles["quiet"])
    _paper(sheet)


def _write_sheet(page: Any, sheet: sheets.Sheet, styles: dict[str, Any]) -> None:
    """Write a table below one line of note: filters, frozen head, a unit in each head, widths that fit, words in colour."""
    frame = sheet.frame
    page.write_string(0, 0, sheet.note, styles["quiet"])
    page.set_row(_HEAD_ROW, 44)
    for j, title in enumerate(frame.columns):
        kind = sheet.kinds.get(title, "text")
        values = frame[title].tolist()
        page.write_string(_HEAD_ROW, j, title, styles["head"])
        page.set_column(j, j, _width(title, values, kind))
        for i, value in enumerate(values):
            _write_cell(page, i + _HEAD_ROW + 1, j, value, styles[kind])
        if title in sheet.coloured and len(frame):
            for word in _COLOURS:
                rule = {"type": "cell", "criteria": "==", "value": f'"{word}"', "format": styles[f"word {word}"]}
                page.conditional_format(_HEAD_ROW + 1, j, len(frame) + _HEAD_ROW, j, rule)
    page.freeze_panes(_HEAD_ROW + 1, 1)
    if len(frame.columns):
        page.autofilter(_HEAD_ROW, 0, max(len(frame) + _HEAD_ROW, 2), len(frame.columns) - 1)
    page.repeat_rows(_HEAD_ROW)
    _paper(page)


def _paper(page: Any) -> None:
    page.set_landscape()
    page.set_paper(9)
    page.fit_to_pages(1, 0)
    page.set_margins(0.4, 0.4, 0.5, 0.6)
    page.set_footer("&L&A&RPage &P of &N")


def _width(title: str, values: list[Any], kind: str) -> float:
    longest = max((len(str(v)) for v in values[:500] if v is not None and not (isinstance(v, float) and pd.isna(v))), default=0)
    words = max(len(word) for word in title.split())
    room = min(longest, _WIDEST) if kind in ("text", "wrap") else 9
    return max(room, words, len(title) / 3, 7) + 2


def _write_cell(page: Any, row: int, column: int, value: Any, style: Any) -> None:
    if value is None or value is pd.NA or (not isinstance(value, str) and pd.isna(value)):
        page.write_blank(row, column, None, style)
    elif isinstance(value, str):
        page.write_string(row, column, value, style)
    else:
        page.write_number(row, column, float(value), style)
