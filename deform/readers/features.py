"""Rows of a listing that are neither weld, seam nor dent in, group ``features`` out: points, stretches, and steps of the wall."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pandas as pd
import xarray as xr

from deform.readers import joints
from deform.readers.findings import Findings
from deform.run import build

_WALL_STEP_M = 0.0003
_NO_FEATURES = ("weld", "seam", "dent")


def read_features(frame: pd.DataFrame, welds: pd.DataFrame, findings: Findings) -> xr.Dataset | None:
    """Return group ``features``, sorted by chainage; None when the listing has none.

    Parameters
    ----------
    frame : rows sorted by distance, with ``chainage`` and ``chainage_end``.
    welds : girth welds with ``chainage``, ``wall``, ``label``.
    findings : takes remarks about starts without an end.

    Notes
    -----
    Where the walls of the joints stand in the rows of the welds, each step of at least 0.3 mm becomes a ``wall_change``.
    """
    rows = frame[~frame["kind"].isin(_NO_FEATURES)].copy()
    rows["label"] = joints.labels_at(welds, rows) if len(rows) else []
    rows["value"] = _values(rows)
    rows = pd.concat([_stretches(rows, findings), _wall_steps(rows, welds)], ignore_index=True)
    if not len(rows):
        return None
    rows = rows.sort_values("chainage", kind="stable")
    values = {name: rows[name].to_numpy() for name in ("chainage", "kind", "text", "label")}
    for name in ("chainage_end", "clock", "value"):
        if np.isfinite(rows[name].to_numpy(float)).any():
            values[name] = rows[name].to_numpy(float)
    if rows["direction"].astype(bool).any():
        values["direction"] = rows["direction"].to_numpy()
    return build.dataset("features", values)


def _values(rows: pd.DataFrame) -> np.ndarray:
    """Size of each feature: angle of a bend (degree), wall after a change (metre), depth of metal loss (fraction of the wall)."""
    kind = rows["kind"].to_numpy()
    relative = rows["depth_wall"].to_numpy(float)
    absolute = rows["depth"].to_numpy(float) / rows["wall"].to_numpy(float)
    loss = np.where(np.isfinite(relative), relative, absolute)
    return np.select(
        [kind == "bend", kind == "wall_change", kind == "metal_loss"],
        [rows["bend_angle"].to_numpy(float), rows["wall"].to_numpy(float), loss],
        default=np.nan,
    )


def _stretches(rows: pd.DataFrame, findings: Findings) -> pd.DataFrame:
    """Join the rows at which a stretch starts and ends; what has no partner stays a point and is counted."""
    open_, lost = defaultdict(list), []
    part, pair = rows["part"].to_numpy(), rows["pair"].to_numpy()
    keep = np.ones(len(rows), bool)
    place = rows.columns.get_loc("chainage_end")
    for i in range(len(rows)):
        if part[i] == "start":
            open_[pair[i]].append(i)
        elif part[i] == "end" and open_[pair[i]]:
            start = open_[pair[i]].pop()
            rows.iat[start, place] = rows["chainage"].iat[i]
            keep[i] = False
        elif part[i] == "end":
            lost.append(i)
    lost += [i for several in open_.values() for i in several]
    if lost:
        first = rows.iloc[min(lost)]
        findings.repair(
            "",
            "rows",
            f"{len(lost)} starts or ends of a stretch have no partner, first line {first['line']} ({first['text']}); kept as points",
        )
    return rows[keep]


def _wall_steps(rows: pd.DataFrame, welds: pd.DataFrame) -> pd.DataFrame:
    wall = welds["wall"].to_numpy(float)
    if (rows["kind"] == "wall_change").any() or not np.isfinite(wall).any():
        return rows.iloc[:0]
    at = np.flatnonzero(np.abs(np.diff(wall)) >= _WALL_STEP_M) + 1
    steps = pd.DataFrame(
        {"chainage": welds["chainage"].to_numpy()[at], "value": wall[at], "label": welds["label"].to_numpy()[at]}
    )
    steps["kind"], steps["direction"], steps["chainage_end"], steps["clock"] = "wall_change", "", np.nan, np.nan
    steps["text"] = [
        f"wall {before * 1e3:.2f} mm, then {after * 1e3:.2f} mm" for before, after in zip(wall[at - 1], wall[at], strict=True)
    ]
    return steps
