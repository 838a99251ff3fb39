"""The features of all runs in, their counts by kind and one list of all of them out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from deform.report.content import Content
from deform.report.quantities import measure
from deform.report.words import NOTHING, number, percent
from deform.units import clock_text

_OF_KIND = {"bend": "turn", "wall_change": "wall"}  # what `value` of a feature is; metal loss is a part of the wall
_LENGTHS = ("valve", "tee", "tap", "wrinkle")  # of these it is a wall, a depth or a height (m), as the source's words say


def feature_rows(content: Content) -> dict[str, Any]:
    """Return how many features of which kind every run holds (``counts``), and all of them (``rows``), by run and chainage."""
    counts: dict[str, dict[str, int]] = {}
    rows: list[list[Any]] = []
    for run in content.ids:
        ds = content.group(run, "features")
        if ds is None or not ds.sizes.get("feature"):
            continue
        for kind, n in zip(*np.unique(ds["kind"].values.astype(str), return_counts=True), strict=True):
            counts.setdefault(str(kind), {})[run] = int(n)
        rows += _features(ds, run)
    table = [
        (kind.replace("_", " "), [number(row[run], 0) if run in row else NOTHING for run in content.ids])
        for kind, row in sorted(counts.items())
    ]
    return {"counts": table, "runs": content.ids, "rows": rows}


def _features(ds: xr.Dataset, run: str) -> list[list[Any]]:
    """Return (run, chainage, end, kind, clock, size, source's words, label) of every feature."""
    n = ds.sizes["feature"]
    columns = [
        ds[name].values if name in ds else np.full(n, "" if name in ("text", "label") else np.nan)
        for name in ("chainage", "chainage_end", "kind", "clock", "value", "text", "label")
    ]
    rows = []
    for start, end, kind, clock, value, text, label in zip(*columns, strict=True):
        hour = clock_text(float(clock)) if np.isfinite(clock) else None
        ends = [round(float(v), 2) if np.isfinite(v) else None for v in (start, end)]
        rows.append([run, *ends, str(kind).replace("_", " "), hour, _size(str(kind), float(value)), str(text), str(label)])
    return rows


def _size(kind: str, value: float) -> str | None:
    if not np.isfinite(value):
        return None
    if kind == "metal_loss":
        return f"{percent(value)} of the wall"
    if kind in _LENGTHS:
        return number(1000 * value, 1, "mm")
    return str(measure(_OF_KIND[kind], value)) if kind in _OF_KIND else number(value, 3)
