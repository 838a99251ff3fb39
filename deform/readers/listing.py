"""Classified rows of a listing in, the run as a `DataTree` out: chainage from the first girth weld, nothing invented."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.readers import coordinates, joints
from deform.readers.columns import ColumnMap
from deform.readers.features import read_features
from deform.readers.findings import Findings
from deform.readers.frame import Frame
from deform.readers.reader import Request
from deform.run import build

_DIAMETER_SPREAD = 0.05


def build_run(rows: Frame, columns: ColumnMap, request: Request, findings: Findings) -> xr.DataTree:
    """Return the run of a listing.

    Notes
    -----
    `chainage` is the log distance from the first girth weld; `log_distance` stays the vendor's own. The number in the row of a
    girth weld is that of the joint that begins there.
    """
    welds = joints.weld_rows(rows, columns.joints, findings)
    if welds is None:
        return xr.DataTree()
    frame = rows.sorted_by("distance")
    welds = joints.with_rows_behind(welds, frame)
    origin = float(welds["distance"][0])
    welds = welds.put({"chainage": welds["distance"] - origin})
    frame = frame.put({"chainage": frame["distance"] - origin, "chainage_end": frame["distance_end"] - origin})
    diameter = _diameter(frame, columns, request, findings)
    groups = {
        "welds": _welds(welds),
        "features": read_features(frame, welds, findings),
        "dents": _dents(frame.take(frame["kind"] == "dent"), welds, diameter, findings),
        "markers": _markers(frame.take(frame["kind"] == "marker")),
        "centreline": coordinates.centreline(frame, columns.coordinates, findings),
    }
    return build.run_tree(_attrs(welds, columns, request, diameter), **groups)


def _attrs(welds: Frame, columns: ColumnMap, request: Request, diameter: float | None) -> dict:
    """Return the root attributes; what is not known is absent."""
    wall = columns.pipe.nominal_wall_m or joints.usual_wall(welds)
    attrs = {
        "id": request.run_id or request.path.stem,
        "date": request.date.isoformat() if request.date else None,
        "line": request.line or columns.pipe.line or None,
        "direction": "downstream",
        "source": "listing",
        "outside_diameter_m": diameter,
        "nominal_wall_m": wall,
        "column_map": columns.name,
        "first_weld_log_distance_m": float(welds["distance"][0]),
    }
    return {k: v for k, v in attrs.items() if v is not None}


def _diameter(frame: Frame, columns: ColumnMap, request: Request, findings: Findings) -> float | None:
    """Return the outside diameter (metre): the survey's, the map's, or the one at which the two depths of the dents agree."""
    stated = request.outside_diameter_m or columns.pipe.outside_diameter_m
    depth, relative = frame["dent_depth"], frame["dent_depth_od"]
    both = (depth > 0) & (relative > 0)
    if not both.any():
        return stated
    ratio = depth[both] / relative[both]
    found = float(np.median(ratio))
    if np.abs(ratio / found - 1).max() > _DIAMETER_SPREAD:
        findings.repair(
            "", "dent_depth", f"depth and depth in % OD of {both.sum()} dents do not agree on one diameter; the depth is taken"
        )
        return stated
    if stated is None:
        return round(found, 4)
    if abs(found / stated - 1) > _DIAMETER_SPREAD:
        findings.repair(
            "",
            "dent_depth",
            f"depth and depth in % OD agree at a diameter of {found:.4g} m, stated is {stated:.4g} m; the stated one is kept",
        )
    return stated


def _welds(welds: Frame) -> xr.Dataset:
    values = {
        "chainage": welds["chainage"],
        "log_distance": welds["distance"],
        "probability": np.ones(len(welds)),
        "source": ["listing"] * len(welds),
        "joint_length": welds["joint_length"],
        "wall_thickness": welds["wall"],
        "seam_clock": welds["seam_clock"],
        "elevation": welds["elevation"],
        "label": welds["label"],
        "seam_kind": welds["seam"],
    }
    return build.dataset("welds", _said(values))


def _dents(rows: Frame, welds: Frame, diameter: float | None, findings: Findings) -> xr.Dataset | None:
    if not len(rows):
        return None
    depth, relative = rows["dent_depth"], rows["dent_depth_od"]
    needs = np.isnan(depth) & np.isfinite(relative)
    if diameter is not None:
        depth = np.where(needs, relative * diameter, depth)
    elif needs.any():
        findings.repair(
            "",
            "dent_depth",
            f"{needs.sum()} dents have a depth in % OD only and the diameter is not known; unmeasured. Give outside_diameter_m",
        )
    too_deep = depth > 0.5
    if too_deep.any():
        findings.repair("", "dent_depth", f"{too_deep.sum()} dents are deeper than 0.5 m, that cannot be; unmeasured")
    depth = np.where(too_deep, np.nan, np.abs(depth))
    before = joints.joint_of(welds, rows["distance"])
    to_weld = rows["distance"] - welds["distance"][np.maximum(before, 0)]
    values = {
        "chainage": rows["chainage"],
        "clock": rows["clock"],
        "depth": depth,
        "length": _positive(rows["length"]),
        "width": _positive(rows["width"]),
        "weld_distance": np.where(before >= 0, to_weld, np.nan),
        "label": joints.labels_at(welds, rows),
        "sizing": np.where(np.isfinite(depth), "vendor", "unmeasured"),
        "text": rows["text"],
    }
    return build.dataset("dents", _said(values, keep=("depth",)))


def _markers(rows: Frame) -> xr.Dataset | None:
    if not len(rows):
        return None
    names: list[str] = []
    for i in range(len(rows)):
        name = str(rows["name"][i] or rows["comment"][i] or f"{rows['event'][i]} {i + 1}")
        count = sum(n == name or n.startswith(f"{name} (") for n in names)
        names.append(f"{name} ({count + 1})" if count else name)
    values = {"name": names, "kind": ["agm"] * len(rows)} | {n: rows[n] for n in ("chainage", "latitude", "longitude")}
    values |= {"height": rows["elevation"]} if np.isfinite(rows["latitude"]).any() else {}
    return build.dataset("markers", _said(values))


def _positive(sizes: np.ndarray) -> np.ndarray:
    return np.where(sizes > 0, sizes, np.nan)


def _said(values: dict, keep: tuple[str, ...] = ()) -> dict:
    """Leave out what the listing says nowhere."""
    return {name: np.asarray(v) for name, v in values.items() if name in keep or _says(np.asarray(v))}


def _says(value: np.ndarray) -> bool:
    return bool(np.isfinite(value).any()) if value.dtype.kind in "fiu" else any(str(v) for v in value)
