"""The features of all runs in, their counts by kind and the list of the last run out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from deform.report.content import Content
from deform.report.words import NOTHING
from deform.units import clock_text


def feature_rows(content: Content) -> dict[str, Any]:
    """Return how many features of which kind every run holds, and the features of the last run that holds any."""
    counts: dict[str, dict[str, int]] = {}
    last: dict[str, Any] = {"run": "", "rows": []}
    for run in content.ids:
        ds = content.group(run, "features")
        if ds is None or not ds.sizes.get("feature"):
            continue
        kinds, number_of = np.unique(ds["kind"].values.astype(str), return_counts=True)
        for kind, n in zip(kinds, number_of, strict=True):
            counts.setdefault(str(kind), {})[run] = int(n)
        last = {"run": run, "rows": _features(ds)}
    table = [(kind, [str(row.get(run, NOTHING)) for run in content.ids]) for kind, row in sorted(counts.items())]
    return {"counts": table, "runs": content.ids, **last}


def _features(ds: xr.Dataset) -> list[list[Any]]:
    columns = []
    for name in ("chainage", "chainage_end", "kind", "clock", "value", "text", "label"):
        values = ds[name].values if name in ds else np.full(ds.sizes["feature"], "" if name in ("text", "label") else np.nan)
        columns.append(values)
    rows = []
    for start, end, kind, clock, value, text, label in zip(*columns, strict=True):
        hour = clock_text(float(clock)) if np.isfinite(clock) else None
        sizes = [None if not np.isfinite(v) else round(float(v), 4) for v in (start, end, value)]
        rows.append([sizes[0], sizes[1], str(kind), hour, sizes[2], str(text), str(label)])
    return rows
