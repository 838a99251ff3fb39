"""The content of an output folder in, datasets of trends and of detection limits out: what their figures are drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import Content
from deform.report.quantities import OF_TREND, quantity


def limit_dataset(content: Content) -> xr.Dataset | None:
    """Return the detection limits (``tables/limits.csv``) as a dataset over ``row``; None without any."""
    table = content.tables.get("limits", pd.DataFrame())
    if not {"wavelength_m", "limit_displacement_m"} <= set(table.columns):
        return None
    rows = table[table.wavelength_m.notna() & table.limit_displacement_m.notna()].reset_index(drop=True)
    return None if rows.empty else rows.rename_axis("row").to_xarray()


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
    years = np.array([_year(content.dates[run]) for run in content.ids])
    good = np.isfinite(values) & np.isfinite(years)
    if good.sum() < 2:
        return None
    of = quantity(OF_TREND.get(str(trend.kind), "displacement"))
    attrs: dict[str, Any] = {"subject": subject, "kind": trend.kind, "unit": of.unit, "decimals": of.decimals}
    attrs |= {"limit_name": str(trend.limit_name), "remark": str(trend.remark)}
    for key in ("rate_per_year", "rate_low_per_year", "rate_high_per_year", "limit_value", "last_value"):
        attrs[key] = float(trend[key]) * of.factor
    data = {
        "value": ("run", values[good] * of.factor),
        "sigma": ("run", sigmas[good] * of.factor),
        "year": ("run", years[good]),
        "epoch": ("run", np.flatnonzero(good)),
    }
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
    for k, run in enumerate(content.ids):
        if run in content.epochs:
            i = content.epochs.index(run)
            values[k] = size[i, apex]
            partners = [inside[f"{name}_sigma"].values[i, apex] for name in names if f"{name}_sigma" in inside]
            sigmas[k] = float(np.nanmax(partners)) if partners else np.nan
    return values, sigmas


def _year(date: str) -> float:
    stamp = pd.to_datetime(date, errors="coerce")
    return np.nan if pd.isna(stamp) else stamp.year + (stamp.day_of_year - 1) / 365.25
