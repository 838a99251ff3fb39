"""The content of an output folder in, datasets on the reference chainage out: what the line's figures are drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import Content
from deform.report.interactive import local_metres, on_reference, turned

_OF_RUN = ("height", "bending_strain", "curvature_horizontal", "curvature_vertical", "azimuth", "pitch", "tool_roll")
_OF_CHANGE = (
    "displacement_east",
    "displacement_north",
    "displacement_up",
    "displacement_lateral",
    "bending_strain_change_horizontal",
    "bending_strain_change_vertical",
    "curvature_change_horizontal",
    "curvature_change_vertical",
)


def line_dataset(content: Content) -> xr.Dataset | None:
    """Return profile, strain, curvature and changes with sigma, each (run, chainage); None without a centreline.

    ``along`` and ``across`` (chainage) are metres in the plan, turned so that the line runs to the right; attribute ``turn_deg``
    is the azimuth of the right.
    """
    reference = content.group(content.reference, "centreline")
    if reference is None:
        return None
    s = reference["chainage"].values
    coords = {"run": content.ids, "chainage": s}
    ds = xr.Dataset(coords=coords, attrs={"reference": content.reference, "line": content.line})
    ds["date"] = ("run", [content.dates[name] for name in content.ids])
    for name in _OF_RUN:
        columns = [_on_axis(on_reference(content, run, name), s) for run in content.ids]
        if any(np.isfinite(column).any() for column in columns):
            ds[name] = (("run", "chainage"), np.stack(columns))
    if "latitude" in reference and np.isfinite(reference["latitude"].values).any():
        latitude, longitude = reference["latitude"].values, reference["longitude"].values
        origin = float(np.nanmean(latitude)), float(np.nanmean(longitude))
        east, north = local_metres(latitude, longitude, origin)
        good = np.isfinite(east)
        along, across = np.full(s.size, np.nan), np.full(s.size, np.nan)
        along[good], across[good], ds.attrs["turn_deg"] = turned(east[good], north[good])
        ds["along"], ds["across"] = ("chainage", along), ("chainage", across)
    return _with_changes(ds, content, s)


def _on_axis(found: tuple[np.ndarray, np.ndarray] | None, s: np.ndarray) -> np.ndarray:
    if found is None:
        return np.full(s.size, np.nan)
    if found[0].size == s.size and np.array_equal(found[0], s):
        return found[1]
    return np.interp(s, found[0], found[1], left=np.nan, right=np.nan)


def _with_changes(ds: xr.Dataset, content: Content, s: np.ndarray) -> xr.Dataset:
    comparison = content.comparison
    if comparison is None:
        return ds
    epochs = [str(name) for name in comparison["epoch"].values]
    for name in [n for base in _OF_CHANGE for n in (base, f"{base}_sigma")]:
        if name not in comparison:
            continue
        columns = [np.full(s.size, np.nan)] * len(content.ids)
        for k, run in enumerate(content.ids):
            if run in epochs:
                columns[k] = _on_axis((comparison["chainage"].values, comparison[name].values[epochs.index(run)]), s)
        ds[name] = (("run", "chainage"), np.stack(columns))
    return ds


def cut(ds: xr.Dataset, start: float, end: float, margin: float) -> xr.Dataset:
    """Return the stretch between two chainages with a margin (m) on both sides."""
    return ds.sel(chainage=slice(start - margin, end + margin)).assign_attrs(start_m=start, end_m=end)


def trend_dataset(content: Content, subject: str) -> xr.Dataset | None:
    """Return the values of a zone or dent in every run, its rate in the attributes: ``value``, ``sigma``, ``year`` (run).

    A zone's value is its largest displacement, or change of bending strain, between its ends; a dent's is its depth. None when
    fewer than two runs carry a value.
    """
    rows = content.tables["trends"][content.tables["trends"].subject == subject]
    if rows.empty:
        return None
    trend = rows.iloc[0]
    values, sigmas = _dent_values(content, subject) if "dent" in trend.kind else _zone_values(content, subject, trend.kind)
    good = np.isfinite(values)
    if good.sum() < 2:
        return None
    years = np.array([_year(content.dates[run]) for run in content.ids])
    scale, unit = (1e6, "µε") if "strain" in trend.kind else (1e3, "mm")
    attrs: dict[str, Any] = {"subject": subject, "kind": trend.kind, "unit": unit, "limit_name": trend.limit_name}
    attrs |= {
        key: float(trend[key]) * scale for key in ("rate_per_year", "rate_low_per_year", "rate_high_per_year", "limit_value")
    }
    attrs["last_value"] = float(trend.last_value) * scale
    data = {"value": ("run", values[good] * scale), "sigma": ("run", sigmas[good] * scale), "year": ("run", years[good])}
    return xr.Dataset(data, coords={"run": np.array(content.ids)[good]}, attrs=attrs)


def _dent_values(content: Content, subject: str) -> tuple[np.ndarray, np.ndarray]:
    table = content.tables["dents"]
    table = table[table.dent_id == subject].drop_duplicates("run").set_index("run")
    depth, sigma = (np.array([float(table[c].get(run, np.nan)) for run in content.ids]) for c in ("depth_m", "depth_sigma_m"))
    return depth, sigma


def _zone_values(content: Content, subject: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    zone = content.tables["zones"][content.tables["zones"].zone_id == subject]
    n = len(content.ids)
    values, sigmas = np.full(n, np.nan), np.full(n, np.nan)
    if zone.empty or content.comparison is None:
        return values, sigmas
    inside = content.comparison.sel(chainage=slice(float(zone.start_m.iloc[0]), float(zone.end_m.iloc[0])))
    names = ["bending_strain_change_horizontal", "bending_strain_change_vertical"]
    if "strain" not in kind:
        names = ["displacement_east", "displacement_north", "displacement_up"]
    names = [name for name in names if name in inside]
    if not names or not inside.sizes["chainage"]:
        return values, sigmas
    size = np.sqrt(sum(np.nan_to_num(inside[name].values) ** 2 for name in names))
    apex = int(np.argmax(size.max(axis=0)))
    epochs = [str(name) for name in inside["epoch"].values]
    for k, run in enumerate(content.ids):
        if run in epochs:
            i = epochs.index(run)
            values[k] = size[i, apex]
            partners = [inside[f"{name}_sigma"].values[i, apex] for name in names if f"{name}_sigma" in inside]
            sigmas[k] = float(np.nanmax(partners)) if partners else np.nan
    return values, sigmas


def _year(date: str) -> float:
    stamp = pd.Timestamp(date)
    return stamp.year + (stamp.day_of_year - 1) / 365.25
