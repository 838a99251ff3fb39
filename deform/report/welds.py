"""The table of welds in, one row per weld with its place and status in every run out."""

from __future__ import annotations

from typing import Any

import numpy as np

from deform.report.content import Content


def weld_table(content: Content) -> dict[str, Any]:
    """Return one row per weld: id, reference chainage, (chainage, status) in every run, least probability, reason."""
    welds = content.tables["welds"]
    if welds.empty:
        return {"runs": content.ids, "rows": []}
    wide = welds.drop_duplicates(["weld_id", "run"]).pivot(index="weld_id", columns="run", values=["chainage_m", "status"])
    groups = welds.groupby("weld_id")
    place, probability = groups.reference_chainage_m.mean().sort_values(), groups.probability.min()
    told = welds[(welds.reason != "") & (welds.status != "matched")]
    reason = told.groupby("weld_id").reason.agg(lambda texts: "; ".join(dict.fromkeys(texts))).to_dict()
    names = [name for name in content.ids if ("status", name) in wide]
    wide, probability = wide.reindex(place.index), probability.reindex(place.index)
    columns: list[list[Any]] = [place.index.tolist(), _rounded(place)]
    for name in names:
        columns.append(_rounded(wide[("chainage_m", name)]))
        columns.append([status if isinstance(status, str) else "" for status in wide[("status", name)]])
    columns += [_rounded(probability, 4), [reason.get(weld, "") for weld in place.index]]
    return {"runs": names, "rows": [list(row) for row in zip(*columns, strict=True)]}


def odd_rows(table: dict[str, Any]) -> list[list[Any]]:
    """Return the rows of the welds that are not matched in all runs."""
    return [row for row in table["rows"] if any(word not in ("matched", "shifted") for word in row[3:-2:2])]


def _rounded(values: Any, decimals: int = 2) -> list[float | None]:
    return [round(float(v), decimals) if np.isfinite(float(v)) else None for v in values]
