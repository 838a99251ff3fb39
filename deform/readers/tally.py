"""A vendor's listing in, through its column map; a run out, with what the listing holds."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, cast

import xarray as xr

from deform.errors import Fault, InputError, MissingExtraError
from deform.readers import delimited, listing
from deform.readers.columns import ColumnMap, column_map, shipped
from deform.readers.delimited import Sheet
from deform.readers.findings import Findings
from deform.readers.frame import Frame
from deform.readers.reader import Request, Scan
from deform.readers.rows import classify
from deform.run import history

_REQUIRED = ("distance", "event")
_HEAD = 60  # rows in which the header is looked for
_SUFFIXES = ", ".join(delimited.SUFFIXES)


class TallyReader:
    """A vendor's listing (pipe tally), by a column map."""

    name = "tally"
    description = "vendor's listing through a column map (CSV, Excel, Parquet)"

    def recognise(self, request: Request) -> str:
        """Return an empty text when a column map is named, or a shipped one fits the header."""
        if request.path.is_dir():
            return "a folder, not a listing"
        if request.path.suffix.lower() not in delimited.SUFFIXES:
            return f"the name does not end in one of {_SUFFIXES}"
        if request.columns is not None:
            return ""
        try:
            return "" if _fitting_map(request.path) else _refusal(request.path)
        except (InputError, MissingExtraError, OSError) as fault:
            return f"cannot be read as a table ({fault})"

    def scan(self, request: Request) -> Scan:
        """Return the column map, the span and the number of rows of each kind."""
        findings = Findings(request.path.name)
        columns = _map_of(request)
        rows = _rows(request.path, columns, findings)
        welds = rows["distance"][rows["kind"] == "weld"]
        summary: dict = {
            "column_map": columns.name,
            "rows": len(rows),
            "kinds": dict(Counter(rows["kind"].tolist()).most_common()),
        }
        if len(welds):
            summary |= {
                "first_weld_m": float(welds.min()),
                "last_weld_m": float(welds.max()),
                "length_m": float(welds.max() - welds.min()),
            }
        return Scan("listing", request.path, summary, (*findings.repairs, *map(str, findings.faults)))

    def read(self, request: Request) -> xr.DataTree:
        """Return the run.

        Raises
        ------
        InputError
            With every fault of the listing and of its column map.
        """
        findings = Findings(request.path.name)
        columns = _map_of(request)
        if request.date is None:
            findings.fault("", "date", "a listing does not know its date", "give it, such as date = 2015-05-01 in [[runs]]")
        rows = _rows(request.path, columns, findings)
        findings.raise_if()
        run = listing.build_run(rows, columns, request, findings)
        findings.raise_if()
        run.attrs["input_sha256"] = history.sha256(request.path)
        run.attrs["repairs"] = "\n".join(findings.repairs)
        history.append(cast(dict[str, Any], run.attrs), f"read {request.path.name} by column map {columns.name}")
        return run


def _rows(path: Path, columns: ColumnMap, findings: Findings) -> Frame:
    sheet = _sheet(path, columns, findings)
    absent = delimited.absent_columns(sheet, columns.columns, _REQUIRED)
    if absent:
        raise InputError(absent)
    if not sheet.rows:
        raise InputError(Fault(path.name, "", "has a header and no rows"))
    optional = [
        f.field for f in delimited.absent_columns(sheet, columns.columns, tuple(c for c in columns.columns if c not in _REQUIRED))
    ]
    if optional:
        findings.repair("", "columns", f"the file has no column for {', '.join(optional)} of column map {columns.name}")
    return classify(sheet, columns, findings)


def _head(path: Path, columns: ColumnMap) -> Sheet:
    return _sheet(path, columns, most=_HEAD)


def _sheet(path: Path, columns: ColumnMap, findings: Findings | None = None, most: int | None = None) -> Sheet:
    wanted = [tuple(h for c in several for h in c.header) for several in columns.columns.values()]
    return delimited.read_sheet(path, columns.file, wanted, findings, most)


def _map_of(request: Request) -> ColumnMap:
    if request.columns is not None:
        return column_map(request.columns)
    found = _fitting_map(request.path)
    if found is None:
        raise InputError(Fault(str(request.path), "columns", _refusal(request.path), "name the column map: columns = ..."))
    return found


def _fitting_map(path: Path) -> ColumnMap | None:
    """Return the shipped map whose required columns are there and which finds most of its others."""
    best, most = None, 0
    for columns in shipped().values():
        sheet = _head(path, columns)
        if delimited.absent_columns(sheet, columns.columns, _REQUIRED):
            continue
        fitting = len(columns.columns) - len(delimited.absent_columns(sheet, columns.columns, tuple(columns.columns)))
        if fitting > most:
            best, most = columns, fitting
    return best


def _refusal(path: Path) -> str:
    """Say why no shipped map fits."""
    reasons = []
    for name, columns in shipped().items():
        faults = delimited.absent_columns(_head(path, columns), columns.columns, _REQUIRED)
        reasons.append(f"{name} lacks {', '.join(f.rule.removeprefix('no column ') for f in faults)}")
    return f"no shipped column map fits ({'; '.join(reasons)})"
