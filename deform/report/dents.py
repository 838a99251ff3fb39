"""The table of dents in, one entry per dent with its sizes in every run for people out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from deform.report.content import Content, records
from deform.report.quantities import measure
from deform.report.trends import headline
from deform.report.words import NOTHING, sentence
from deform.units import clock_text

FIRST_MEASURED = "first measured"
_URGENCY = {"grown": 0, "new": 1, "rerounded": 2}


def dent_rows(content: Content) -> list[dict[str, Any]]:
    """Return one entry per dent with its sizes in every run; grown and new dents first, then by depth, those cut out last."""
    order = {name: i for i, name in enumerate(content.ids)}
    trends = dict(list(content.tables["trends"].groupby("subject")))
    groups: dict[str, list[Any]] = {}
    table = content.tables["dents"]
    for row in sorted(records(table.assign(status=told_status(table))), key=lambda r: order.get(r.run, -1)):
        groups.setdefault(str(row.dent_id), []).append(row)
    rows = [_entry(dent, group, trends.get(dent), content.outside_diameter) for dent, group in groups.items()]
    rows.sort(key=lambda r: (_URGENCY.get(r["status"], 3), r["status"] == "removed", -(r["depth"].value if r["depth"] else -1)))
    return rows


def deepest(dents: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the dent of the greatest depth, each as the last run that measured it says; what was cut out is gone."""
    left = [d for d in dents if d["status"] != "removed" and d["depth"]]
    return max(left, key=lambda d: d["depth"].value, default=None)


def told_status(table: pd.DataFrame) -> pd.Series:
    """Return the status of every row of the table for people: what was measured for the first time is not called stable."""
    return table.status.astype(str).mask((table.status == "stable") & table.depth_change_m.isna(), FIRST_MEASURED)


def _entry(dent: str, group: list[Any], trends: pd.DataFrame | None, diameter: float) -> dict[str, Any]:
    """Return one dent: its status in the last run that names it, its sizes in the last run that measured it."""
    last, epochs = group[-1], [_epoch(row, diameter) for row in group]
    going_on = "" if trends is None else headline(trends)
    sized = next((e for e in reversed(epochs) if e["depth"]), epochs[-1])
    return sized | {
        "id": dent,
        "status": str(last.status),
        "joint": last.joint_id or NOTHING,
        "chainage": float(last.reference_chainage_m),
        "place": measure("chainage", last.reference_chainage_m),
        "clock_deg": sized["clock_value"],
        "compared": any(not pd.isna(row.depth_change_m) for row in group),
        "epochs": epochs,
        "going_on": going_on,
        "reason": sentence(last.reason),
        "headline": going_on or sentence(last.reason),
        "reasons": [f"{row.run}: {row.reason}" for row in group if row.reason],
    }


def _epoch(row: Any, diameter: float) -> dict[str, Any]:
    known = diameter > 0 and not pd.isna(row.depth_m)
    return {
        "run": row.run,
        "status": str(row.status),
        "run_chainage": float(row.run_chainage_m),
        "clock": NOTHING if pd.isna(row.clock_deg) else clock_text(float(row.clock_deg)),
        "clock_value": np.nan if pd.isna(row.clock_deg) else float(row.clock_deg),
        "depth": measure("dent depth", row.depth_m, row.depth_sigma_m),
        "depth_share": measure("dent depth share", row.depth_m / diameter if known else None),
        "length": measure("dent size", row.length_m),
        "width": measure("dent size", row.width_m),
        "strain": measure("dent strain", row.strain_max),
        "change": measure("dent depth change", row.depth_change_m, row.depth_change_sigma_m),
        "reason": sentence(row.reason),
    }
