"""A table of text (CSV with any delimiter, encoding and decimal mark, Excel, Parquet) in, a frame of fields in SI out."""

from __future__ import annotations

import csv
import datetime
import difflib
import io
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deform.errors import Fault, InputError, MissingExtraError
from deform.readers import cells
from deform.readers.columns import FIELDS, RELATIVE, Column, FileOptions
from deform.readers.findings import Findings
from deform.readers.frame import Frame

_TEXT = (".csv", ".txt", ".tsv", ".dat")
_SPREADSHEET = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")
_PARQUET = (".parquet", ".pq")
SUFFIXES = _TEXT + _SPREADSHEET + _PARQUET
_DELIMITERS = ",;\t|"
_HEADER_WITHIN = 60
_WESTERN = "cp1252"


@dataclass(frozen=True)
class Sheet:
    """A table as text: header cells, rows, and the line (or row) of the file at which each row stands."""

    path: Path
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]

    def place(self, headers: tuple[str, ...]) -> int | None:
        """Return the place of the column with one of these headers; case, spacing and line breaks do not matter."""
        keys = [cells.key(h) for h in self.header]
        return next((keys.index(cells.key(h)) for h in headers if cells.key(h) in keys), None)

    def column(self, place: int) -> np.ndarray:
        """Return one column as text."""
        return np.array([row[place] for row in self.rows], dtype=object)


def read_sheet(
    path: Path,
    options: FileOptions,
    wanted: list[tuple[str, ...]],
    findings: Findings | None = None,
    most: int | None = None,
) -> Sheet:
    """Read a table as text and find its header.

    Parameters
    ----------
    path : the file.
    options : delimiter, encoding, sheet; what is absent is found out.
    wanted : spellings of each header that is looked for; the header is the row among the first 60 that holds most of them.
    findings : takes remarks about the encoding and about rows that are longer than the header.
    most : number of rows to read; None reads all.

    Raises
    ------
    InputError
        When the file is empty or is no such table.
    MissingExtraError
        For Parquet without its library.
    """
    rows = _raw_rows(Path(path), options, findings, most)
    if not rows:
        raise InputError(Fault(str(path), "", "is empty"))
    spellings = [{cells.key(h) for h in headers} for headers in wanted]
    heads = [{cells.key(c) for c in row} for _, row in rows[:_HEADER_WITHIN]]
    fitting = [sum(bool(s & head) for s in spellings) for head in heads]
    top = int(np.argmax(fitting))
    header = tuple(cells.words(c) for c in rows[top][1])
    body = rows[top + 1 + options.rows_below_header :]
    longer = sum(any(c.strip() for c in row[len(header) :]) for _, row in body)
    if longer and findings is not None:
        rule = f"{longer} rows have more cells than the header; what is over is read as part of the last column"
        findings.repair("", "", rule)
    return Sheet(Path(path), header, [_fitted(row, len(header)) for _, row in body], [n for n, _ in body])


def absent_columns(sheet: Sheet, columns: Mapping[str, tuple[Column, ...]], names: tuple[str, ...]) -> list[Fault]:
    """Return a fault for each of the named fields of which no column is there, with the nearest header."""
    faults = []
    for name in names:
        headers = [h for column in columns[name] for h in column.header]
        if sheet.place(tuple(headers)) is None:
            near = difflib.get_close_matches(cells.key(headers[0]), [cells.key(h) for h in sheet.header], 1, 0.6)
            advice = f"is it {near[0]!r}?" if near else f"the file holds {', '.join(h for h in sheet.header if h) or 'no header'}"
            faults.append(Fault(sheet.path.name, name, f"no column {' or '.join(map(repr, headers))}", advice))
    return faults


def read_fields(
    sheet: Sheet,
    columns: Mapping[str, tuple[Column, ...]],
    options: FileOptions,
    findings: Findings,
    rows: np.ndarray | None = None,
) -> Frame:
    """Return the fields of a table: numbers in metre and degree (NaN where empty), words as text.

    Parameters
    ----------
    sheet : the table.
    columns : where each field stands; of several alternatives the first that says something in a row is taken.
    options : decimal mark.
    findings : takes remarks about cells that cannot be read and columns that are absent.
    rows : mask of the rows that are read; the others stay empty.

    Returns
    -------
    One row per row of the table. A field in a relative unit (``% OD``, ``% wall``) is a fraction in a column of its own,
    ``dent_depth_od`` and ``depth_wall``.
    """
    chosen = np.ones(len(sheet.rows), bool) if rows is None else rows
    fields: dict[str, np.ndarray] = {}
    for name, alternatives in columns.items():
        for column in alternatives:
            place = sheet.place(column.header)
            if place is None:
                if column.required:
                    findings.fault("", name, f"no column {' or '.join(map(repr, column.header))}")
                continue
            target, values = _field(name, column, sheet, place, chosen, options.decimal, findings)
            fields[target] = values if target not in fields else _filled(fields[target], values)
    return Frame(len(sheet.rows), fields)


def _field(
    name: str, column: Column, sheet: Sheet, place: int, chosen: np.ndarray, decimal: str, findings: Findings
) -> tuple[str, np.ndarray]:
    text = np.where(chosen, sheet.column(place), "")
    if FIELDS[name] == "text":
        return name, np.array([cells.words(t) for t in text], dtype=object)
    one, scale, target = _conversion(name, column, decimal)
    values, refused = cells.convert(text, one)
    refused = [i for i in refused if not cells.is_empty(text[i])]
    if refused:
        first = f"first {text[refused[0]]!r} in line {sheet.lines[refused[0]]}"
        rule = f"{len(refused)} cells of column {sheet.header[place]!r} cannot be read, {first}"
        if len(refused) > 0.5 * sum(bool(t) and not cells.is_empty(t) for t in text):
            findings.fault("", name, rule, "is decimal, format or unit of the column map right?")
        else:
            findings.repair("", name, f"{rule}; taken as empty")
    return target, values * scale


def _conversion(name: str, column: Column, decimal: str) -> tuple[Callable[[str], float], float, str]:
    """Return the function of a cell, the factor to SI, and the name of the field."""
    if FIELDS[name] == "clock":
        return lambda text: cells.clock(text, column.format, decimal), 1.0, name
    if FIELDS[name] == "place":
        return lambda text: cells.angle(text, decimal), 1.0, name
    if FIELDS[name] == "angle":
        return lambda text: cells.number(text, decimal), cells.factor(column.unit or "degree", "angle"), name
    if column.unit in RELATIVE:
        return (
            lambda text: cells.number(text.rstrip("% "), decimal),
            RELATIVE[column.unit][1],
            f"{name}_{column.unit.split()[1].lower()}",
        )
    number = cells.station if column.format == "station" else cells.number
    return lambda text: number(text, decimal), cells.factor(column.unit, "length"), name


def _filled(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    empty = np.array([v == "" for v in values]) if values.dtype == object else np.isnan(values.astype(float))
    return np.where(empty, others, values)


def _fitted(row: list[str], width: int) -> list[str]:
    if len(row) <= width:
        return row + [""] * (width - len(row))
    over = [c for c in row[width - 1 :] if c.strip()]
    return [*row[: width - 1], " ".join(over)]


def _raw_rows(path: Path, options: FileOptions, findings: Findings | None, most: int | None) -> list[tuple[int, list[str]]]:
    """Return line numbers and cells of the rows that hold anything."""
    suffix = path.suffix.lower()
    if suffix in _SPREADSHEET:
        return _spreadsheet(path, options.sheet, options.decimal)[:most]
    if suffix in _PARQUET:
        return _parquet(path, options.decimal)[:most]
    text = _decoded(path, options.encoding, findings)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=options.delimiter or _delimiter(text))
    try:
        rows = ((reader.line_num, row) for row in reader if any(c.strip() for c in row))
        return list(itertools.islice(rows, most))
    except csv.Error as fault:
        raise InputError(Fault(path.name, f"line {reader.line_num}", f"is no delimited text ({fault})")) from None


def _decoded(path: Path, encoding: str, findings: Findings | None) -> str:
    content = path.read_bytes()
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\x00" in content[:4096] and not wide:
        raise InputError(Fault(path.name, "", "holds zero bytes; it is no text"))
    known = encoding or ("utf-16" if wide else "utf-8-sig")
    try:
        return content.decode(known)
    except LookupError:
        raise InputError(Fault(path.name, "encoding", f"{encoding!r} is unknown")) from None
    except UnicodeDecodeError as fault:
        if encoding or wide:
            rule = f"is no text in {known} ({fault.reason} at byte {fault.start})"
            raise InputError(Fault(path.name, "", rule)) from None
        if findings is not None:
            findings.repair(
                "", "", f"is no UTF-8 (byte {fault.start}); read as {_WESTERN}, name another in [file] encoding of the map"
            )
        return content.decode(_WESTERN, errors="replace")


def _delimiter(text: str) -> str:
    """Return the delimiter that stands most often, outside quotes, in the first lines."""
    head = text[:20_000]
    bare = "".join(part for i, part in enumerate(head.split('"')) if i % 2 == 0)
    counts = {d: bare.count(d) for d in _DELIMITERS}
    lines = max(bare.count("\n"), 1)
    if counts[";"] >= lines:  # a comma beside it is the decimal mark
        counts[","] = 0
    return max(counts, key=lambda d: counts[d])


def _spreadsheet(path: Path, sheet: str | int, decimal: str) -> list[tuple[int, list[str]]]:
    import python_calamine  # a library in Rust, loaded only where a workbook is read

    try:
        book = python_calamine.CalamineWorkbook.from_path(str(path))
        known = range(len(book.sheet_names)) if isinstance(sheet, int) else book.sheet_names
        if sheet not in known:
            raise InputError(Fault(path.name, "sheet", f"has no sheet {sheet!r}; there are {', '.join(book.sheet_names)}"))
        found = book.get_sheet_by_index(sheet) if isinstance(sheet, int) else book.get_sheet_by_name(sheet)
        rows = found.to_python(skip_empty_area=False)
    except InputError:
        raise
    except Exception as fault:  # the library has an error class for each format below a plain Exception
        raise InputError(Fault(path.name, "", f"cannot be opened as a workbook ({fault})")) from None
    return [(n, [_cell(c, decimal) for c in row]) for n, row in enumerate(rows, 1) if any(_cell(c, decimal).strip() for c in row)]


def _parquet(path: Path, decimal: str) -> list[tuple[int, list[str]]]:
    try:
        frame = pd.read_parquet(path)
    except ImportError:
        raise MissingExtraError("reading Parquet", "parquet") from None
    except Exception as fault:  # pyarrow raises its own classes, an OSError or a ValueError
        raise InputError(Fault(path.name, "", f"cannot be opened as Parquet ({fault})")) from None
    rows = [[_cell(c, decimal) for c in row] for row in frame.itertuples(index=False, name=None)]
    return [(1, [str(c) for c in frame.columns]), *enumerate(rows, 2)]


def _cell(value: Any, decimal: str) -> str:
    """Return a cell as text; times of day and durations as h:mm:ss, whole numbers without a point."""
    if value is None or value is pd.NaT or value is pd.NA:
        return ""
    if isinstance(value, datetime.datetime):
        return value.strftime("%H:%M:%S") if value.year < 1905 else value.isoformat(sep=" ")
    if isinstance(value, datetime.time):
        return value.strftime("%H:%M:%S")
    if isinstance(value, datetime.timedelta):
        minutes, seconds = divmod(round(value.total_seconds()), 60)
        return f"{minutes // 60:02d}:{minutes % 60:02d}:{seconds:02d}"
    if isinstance(value, float | np.floating):
        number = float(value)
        whole = np.isfinite(number) and abs(number) < 1e15 and number == int(number)
        return "" if np.isnan(number) else str(int(number)) if whole else repr(number).replace(".", decimal)
    return str(value)
