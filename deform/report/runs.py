"""Every run in, what it is and what it found on its own out: inventory, geometry and bends (Porter 1990, section 4.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import Content, records
from deform.report.quantities import Measure, measure
from deform.report.words import NOTHING, number, percent
from deform.units import clock_text

_MOST_BENDS = 60
_BEND_MARGIN_M = 3.0
_MOST_PLACES = 4
_POINTS = ("valve", "tee", "tap", "flange", "sleeve", "casing", "support", "wrinkle", "marker")


def run_rows(content: Content) -> list[dict[str, Any]]:
    """Return one row per run: who, when, of what, how long, how many welds and dents."""
    rows = []
    for run in content.runs:
        name, attrs = str(run.attrs["id"]), run.attrs
        source = str(attrs.get("source", ""))
        rows.append(
            {
                "id": name,
                "i": content.ids.index(name),
                "date": str(attrs.get("date", "")),
                "source": {"raw": "raw data", "listing": "vendor listing"}.get(source, source),
                "direction": str(attrs.get("direction", "")),
                "length": measure("line length", _length(run)),
                "diameter": measure("diameter", attrs.get("outside_diameter_m")),
                "wall": measure("wall", attrs.get("nominal_wall_m")),
                "is_reference": name == content.reference,
                **{g: NOTHING if _size(run, g) is None else number(_size(run, g), 0) for g in ("welds", "dents", "markers")},
            }
        )
    return rows


def run_reports(content: Content) -> list[dict[str, Any]]:
    """Return what each run says on its own: inventory of features, geometry, bends."""
    return [
        {"id": name, "date": content.dates[name], "inventory": _inventory(content, name), "geometry": _geometry(content, name)}
        | _bends(content, name)
        for name in content.ids
    ]


def _size(run: xr.DataTree, group: str) -> int | None:
    return int(next(iter(run[group].to_dataset().sizes.values()), 0)) if group in run.children else None


def _length(run: xr.DataTree) -> float:
    lengths = [float(run[g].to_dataset()["chainage"].values[-1]) for g in ("centreline", "welds") if _size(run, g)]
    return lengths[0] if lengths else np.nan


def largest(content: Content, run: str, variable: str, quantity: str, *, bends: bool = False) -> tuple[Measure, Measure] | None:
    """Return the largest value of a centreline variable outside bends, or in them, with its place; None where there is none.

    Bends are those of ``tables/doglegs.csv`` and of the run's features, with a margin for the gauge length; without either all
    pipe counts as straight.
    """
    ds = content.group(run, "centreline")
    if ds is None or variable not in ds:
        return None
    s, values = ds["chainage"].values, ds[variable].values
    inside = np.zeros(s.size, bool)
    for start, end in _bent(content, run):
        inside[np.searchsorted(s, start - _BEND_MARGIN_M) : np.searchsorted(s, end + _BEND_MARGIN_M)] = True
    values = np.where(inside == bends, values, np.nan)
    if not np.isfinite(values).any():
        return None
    i = int(np.nanargmax(values))
    return measure(quantity, values[i]), measure("place", s[i])


def _bent(content: Content, run: str) -> list[tuple[float, float]]:
    """Return the ends of all bends and doglegs of a run."""
    found = []
    table, features = content.tables.get("doglegs", pd.DataFrame()), content.group(run, "features")
    if {"run", "start_m", "end_m"} <= set(table.columns):
        found += [(float(row.start_m), float(row.end_m)) for row in records(table[table.run.astype(str) == run])]
    if features is not None:
        bends = features.isel(feature=features["kind"].values.astype(str) == "bend")
        starts = bends["chainage"].values
        ends = bends["chainage_end"].values if "chainage_end" in bends else starts
        found += [(float(a), float(b) if np.isfinite(b) else float(a)) for a, b in zip(starts, ends, strict=True)]
    return found


def _inventory(content: Content, run: str) -> list[tuple[str, str, str]]:
    """Return (what, how many, remark): welds and joints, dents, then every kind of feature."""
    rows = []
    welds, dents, features = (content.group(run, name) for name in ("welds", "dents", "features"))
    if welds is not None:
        sure = welds["probability"].values > 0.5
        doubtful = int((~sure).sum())
        rows.append(("girth welds", number(sure.sum(), 0), f"{doubtful} further ones are doubtful" if doubtful else ""))
        rows += _joints(welds)
    if dents is not None:
        rows.append(("dents", number(dents.sizes.get("dent", 0), 0), _deepest(dents, content.outside_diameter)))
    if features is not None and features.sizes.get("feature"):
        kinds = features["kind"].values.astype(str)
        rows += [_feature(features.isel(feature=kinds == kind), kind) for kind in sorted(set(kinds))]
    return rows


def _joints(welds: xr.Dataset) -> list[tuple[str, str, str]]:
    lengths = welds["joint_length"].values if "joint_length" in welds else np.diff(welds["chainage"].values)
    lengths = lengths[np.isfinite(lengths)]
    rows = []
    if lengths.size:
        ends = [measure("joint length", v) for v in (np.median(lengths), lengths.min(), lengths.max())]
        rows.append(("joints", number(lengths.size, 0), f"median {ends[0]}, {ends[1].number} to {ends[2]}"))
    if "wall_thickness" in welds:
        walls = welds["wall_thickness"].values
        walls = walls[np.isfinite(walls)]
        if walls.size:
            rows.append(("wall of the joints", "", f"{measure('wall', walls.min()).number} to {measure('wall', walls.max())}"))
    return rows


def _deepest(dents: xr.Dataset, diameter: float) -> str:
    depth = dents["depth"].values if "depth" in dents else np.array([])
    if not np.isfinite(depth).any():
        return ""
    i = int(np.nanargmax(depth))
    share = f" ({measure('dent depth share', depth[i] / diameter)})" if diameter > 0 else ""
    return f"deepest {measure('dent depth', depth[i])}{share} at {measure('chainage', dents['chainage'].values[i])}"


def _feature(found: xr.Dataset, kind: str) -> tuple[str, str, str]:
    title, places = kind.replace("_", " "), found["chainage"].values
    values = np.abs(found["value"].values) if "value" in found else np.full(places.size, np.nan)
    remark = ""
    if np.isfinite(values).any():
        i = int(np.nanargmax(values))
        where = f"at {measure('place', places[i])}"
        if kind == "bend":
            remark = f"largest {measure('turn', values[i])} {where}"
        elif kind == "metal_loss":
            remark = f"deepest {percent(values[i])} of the wall {where}"
        elif kind == "wall_change":
            remark = f"walls of {measure('wall', np.nanmin(values)).number} to {measure('wall', np.nanmax(values))}"
    elif kind in _POINTS:
        shown = ", ".join(measure("place", p).number for p in places[:_MOST_PLACES])
        remark = f"at {shown} m" + (" and further on" if places.size > _MOST_PLACES else "")
    return title, number(places.size, 0), remark


def _geometry(content: Content, run: str) -> list[tuple[str, str, str]]:
    """Return (what, value, where) of the extremes of the centreline; strain and ovality outside bends and in them."""
    ds = content.group(run, "centreline")
    if ds is None:
        return []
    s = ds["chainage"].values
    rows = [("length of pipe", str(measure("line length", s[-1] - s[0])), "along the centreline")]
    for name, title, of, pick in (
        ("height", "highest point", "height", np.nanargmax),
        ("height", "lowest point", "height", np.nanargmin),
        ("pitch", "steepest rise downstream", "turn", np.nanargmax),
        ("pitch", "steepest fall downstream", "turn", np.nanargmin),
        ("diameter_min", "least inner diameter", "diameter", np.nanargmin),
        ("speed", "fastest", "speed", np.nanargmax),
    ):
        values = ds[name].values if name in ds else np.array([np.nan])
        if np.isfinite(values).any():
            i = int(pick(values))
            rows.append((title, str(measure(of, values[i])), f"at {measure('place', s[i])}"))
    for name, title, of in (("bending_strain", "bending strain", "strain"), ("ovality", "ovality", "ovality")):
        for bends, where in ((False, "outside bends"), (True, "in bends")):
            found = largest(content, run, name, of, bends=bends)
            if found:
                rows.append((f"largest {title} {where}", str(found[0]), f"at {found[1]}"))
    sigma = [np.nanmedian(ds[f"{axis}_sigma"].values) for axis in ("east", "north", "up") if f"{axis}_sigma" in ds]
    if sigma:
        shown = " / ".join(measure("position sigma", v).number for v in sigma)
        rows.append(("sigma of the position, median", f"{shown}\u00a0m", "east / north / up"))
    return rows


def _bends(content: Content, run: str) -> dict[str, Any]:
    """Return the largest bends and doglegs of a run: place, angle with its two components, radius, clock of the tension side."""
    table = content.tables.get("doglegs", pd.DataFrame())
    if not {"run", "kind", "start_m", "angle_deg"} <= set(table.columns):
        return {"bends": [], "more_bends": 0}
    own = table[table.run.astype(str) == run]
    shown = own.loc[own.angle_deg.abs().sort_values(ascending=False).index[:_MOST_BENDS]].sort_values("start_m")
    rows = []
    for row in records(shown):
        clock = getattr(row, "clock_deg", np.nan)
        rows.append(
            {
                "kind": row.kind,
                "place": measure("place", row.start_m),
                "angle": measure("turn", row.angle_deg, getattr(row, "angle_sigma_deg", None)),
                "right": measure("signed turn", getattr(row, "angle_horizontal_deg", None)),
                "up": measure("signed turn", getattr(row, "angle_vertical_deg", None)),
                "radius": measure("bend radius", getattr(row, "radius_m", None)),
                "curvature": measure("standardised curvature", getattr(row, "standardised_percent", None)),
                "clock": NOTHING if pd.isna(clock) else clock_text(float(clock)),
            }
        )
    return {"bends": rows, "more_bends": len(own) - len(rows)}
