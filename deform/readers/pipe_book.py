"""A pipe book in (joints as laid, straight stretches along them); a listing's run and an array of stretches out."""

from __future__ import annotations

import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from deform.errors import Fault, InputError
from deform.readers.events import parse_number, read_rows
from deform.readers.findings import Findings
from deform.readers.reader import read_source
from deform.run.raw import RawRun

_COLUMNS = ("from_m", "to_m", "sigma_deg")
_UNDATED = datetime.date(1900, 1, 1)  # a pipe book is no inspection; its date decides nothing


def read_joints(path: Path | str, columns: str | None = None, outside_diameter_m: float | None = None) -> xr.DataTree:
    """Return the joints of a pipe book: a listing (its column map as for a vendor's), or a stored run whose lengths are trusted.

    Raises
    ------
    InputError
        With every fault of the listing, or when it holds no welds.
    """
    book = read_source(path, columns, "pipe book", _UNDATED, outside_diameter_m=outside_diameter_m)
    if isinstance(book, RawRun) or "welds" not in book.children:
        raise InputError(Fault(Path(path).name, "joints", "holds no welds", "give a listing of the joints as laid"))
    return book


def read_straights(path: Path | str) -> np.ndarray:
    """Return stretches laid without bends, (stretch, 3): from and to (metre along the pipe book), sigma of the azimuth (degree).

    Parameters
    ----------
    path : CSV with columns ``from_m``, ``to_m`` and ``sigma_deg``: how far the azimuth may stray within the stretch.

    Raises
    ------
    InputError
        With every fault: columns, cells, a stretch that ends before it begins, overlaps another, or has no positive sigma.
    """
    path = Path(path)
    findings = Findings(path.name)
    rows = read_rows(path, _COLUMNS, (), findings) or []
    table = np.array([[parse_number(row.get(c, ""), path.name, f"{c}, line {n}", findings) for c in _COLUMNS] for n, row in rows])
    table = table.reshape(-1, 3)
    for (n, _), (low, high, sigma) in zip(rows, table, strict=True):
        if not high > low:
            findings.fault(path.name, f"to_m, line {n}", f"is {high:g}; a stretch ends behind its beginning at {low:g} m")
        if not sigma > 0:
            findings.fault(path.name, f"sigma_deg, line {n}", f"is {sigma:g}; a standard deviation is positive")
    table = table[np.argsort(table[:, 0], kind="stable")]
    for before, after in pairwise(table):
        if after[0] < before[1]:
            findings.fault(path.name, "from_m", f"{after[0]:g} m lies within the stretch from {before[0]:g} to {before[1]:g} m")
    findings.raise_if()
    return table
