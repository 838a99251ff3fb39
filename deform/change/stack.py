"""Runs and their chainage maps in, every run's values at the same steel on the reference chainage out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry.earth import radii
from deform.geometry.resample import interpolate, regular_grid

Floats = NDArray[Any]
POSITION = ("latitude", "longitude", "height")
CURVATURE = ("curvature_horizontal", "curvature_vertical")
_LINEAR = (*POSITION, *CURVATURE, *(f"{name}_sigma" for name in CURVATURE), "pitch", "speed", "ovality", "ovality_sigma")
READ = {  # what a comparison reads of the large groups of a run; the radii of a wall map it reads where it wants them
    "centreline": (*_LINEAR, "azimuth"),
    "caliper": ("chainage", "clock", "reference_radius"),
}


@dataclass(frozen=True)
class Layer:
    """One run on the reference chainage.

    Attributes
    ----------
    run, date : its name and date (days since 1970, NaN when not known).
    run_chainage, run_chainage_sigma : shape (n,), chainage of the same steel in the run (m).
    valid : shape (n,), true where the run holds this steel.
    values : what the run's centreline holds, by vocabulary name, each of shape (n,), NaN where invalid.
    gauge_length : length over which the curvature was formed (m), NaN without curvature.
    outside_diameter : of the pipe (m), NaN when not known.
    """

    run: str
    date: float
    run_chainage: Floats
    run_chainage_sigma: Floats
    valid: Floats
    values: dict[str, Floats] = field(default_factory=dict)
    gauge_length: float = float("nan")
    outside_diameter: float = float("nan")

    def has(self, *names: str) -> bool:
        """True when the run holds every one of the variables."""
        return all(name in self.values for name in names)

    def without(self, *names: str) -> Layer:
        """The run without some of its variables."""
        return replace(self, values={name: value for name, value in self.values.items() if name not in names})


def run_id(run: xr.DataTree) -> str:
    """Name of a run."""
    return str(run.attrs["id"])


def run_day(run: xr.DataTree) -> float:
    """Date of a run in days since 1970, NaN when it has none."""
    return day_of(run.attrs.get("date", ""))


def day_of(date: Any) -> float:
    """Days since 1970 of a date as text, NaN when it is none."""
    try:
        day = np.datetime64(str(date)[:10], "D")
    except ValueError:
        return float("nan")
    return float("nan") if np.isnat(day) else float(day.astype(int))


def reference_axis(run: xr.DataTree, step: float) -> Floats:
    """Return the regular reference chainage: that of the reference run's centreline, else from its first to its last weld.

    Raises
    ------
    InputError
        When the reference run has neither a centreline nor two welds.
    """
    if "centreline" in run.children:
        axis = np.asarray(run["centreline"]["chainage"].values, float)
        if axis.size > 1 and np.ptp(np.diff(axis)) < 1e-3 * (axis[1] - axis[0]):
            return axis
        if axis.size > 1:
            return regular_grid(axis[0], axis[-1], step)
    if "welds" in run.children and run["welds"].sizes["weld"] > 1:
        welds = np.asarray(run["welds"]["chainage"].values, float)
        return regular_grid(float(np.nanmin(welds)), float(np.nanmax(welds)), step)
    raise InputError(
        Fault(run_id(run), "centreline, welds", "has no centreline and fewer than two welds", "choose another reference")
    )


def layer(run: xr.DataTree, chain_map: Any, axis: Floats) -> Layer:
    """Return a run's values at the steel of the reference chainage.

    Parameters
    ----------
    run : the run.
    chain_map : its `correlate.chainage.ChainageMap`.
    axis : reference chainage, regular, shape (n,).
    """
    place = np.asarray(chain_map.to_run(axis), float)
    sigma = np.broadcast_to(np.asarray(chain_map.sigma(axis), float), axis.shape)
    valid = np.array(np.broadcast_to(chain_map.valid(axis), axis.shape), bool) & np.isfinite(place)
    values: dict[str, Floats] = {}
    gauge = float("nan")
    if "centreline" in run.children:
        centreline = run["centreline"].to_dataset()
        values = _resampled(centreline, np.where(valid, place, np.nan))
        if chain_map.direction < 0:
            values = _turned(values)
        gauge = (
            float(centreline["curvature_horizontal"].attrs.get("gauge_length_m", 2.0)) if CURVATURE[0] in centreline else gauge
        )
    return Layer(
        run=run_id(run),
        date=run_day(run),
        run_chainage=np.where(valid, place, np.nan),
        run_chainage_sigma=np.where(valid, sigma, np.nan),
        valid=valid,
        values=values,
        gauge_length=gauge,
        outside_diameter=float(run.attrs.get("outside_diameter_m", np.nan)),
    )


def _resampled(centreline: xr.Dataset, place: Floats) -> dict[str, Floats]:
    """Every known variable of a centreline at the places, one pass over the file."""
    names = [name for name in _LINEAR if name in centreline]
    axis = np.asarray(centreline["chainage"].values, float)
    if axis.size < 2:
        return {}
    columns = [np.asarray(centreline[name].values, float) for name in names]
    if "azimuth" in centreline:
        names.append("azimuth")
        columns.append(_unwrapped(np.asarray(centreline["azimuth"].values, float)))
    if not names:
        return {}
    found = {}
    for name, column in zip(names, columns, strict=True):
        if np.isfinite(column).any():
            found[name] = interpolate(place, axis, column)
    return found


def _turned(values: dict[str, Floats]) -> dict[str, Floats]:
    """Attitude and curvature of a run whose chainage counts against the reference, looking downstream of the reference."""
    signs = {"pitch": -1.0, "curvature_horizontal": -1.0}
    out = {name: signs.get(name, 1.0) * value for name, value in values.items()}
    if "azimuth" in out:
        out["azimuth"] = out["azimuth"] + 180.0
    return out


def _unwrapped(azimuth: Floats) -> Floats:
    """Azimuth (degree) without jumps; gaps are bridged for the purpose and stay gaps."""
    known = np.isfinite(azimuth)
    out = np.full(azimuth.shape, np.nan)
    if known.any():
        out[known] = np.unwrap(azimuth[known], period=360.0)
    return out


def tangents(reference: Layer, axis: Floats) -> tuple[Floats, Floats, Floats]:
    """Return tangent, right and lift of the reference pipe, each (n, 3) in east, north, up.

    ``right`` and ``lift`` are the changes of the tangent with azimuth and with pitch (per radian): right is level and points
    across the pipe to the right, as long as the cosine of the pitch; lift is a unit vector in the vertical plane of the pipe.
    """
    if reference.has("azimuth", "pitch"):
        azimuth, pitch = np.radians(_filled(reference.values["azimuth"])), np.radians(_filled(reference.values["pitch"]))
    else:
        azimuth, pitch = _attitude_from_position(reference, axis)
    sa, ca, sp, cp = np.sin(azimuth), np.cos(azimuth), np.sin(pitch), np.cos(pitch)
    zero = np.zeros_like(sa)
    return np.stack([sa * cp, ca * cp, sp], -1), np.stack([ca * cp, -sa * cp, zero], -1), np.stack([-sa * sp, -ca * sp, cp], -1)


def _attitude_from_position(reference: Layer, axis: Floats) -> tuple[Floats, Floats]:
    latitude, longitude, height = (_filled(reference.values[name]) for name in POSITION)
    meridian, normal = radii(latitude)
    north = np.gradient(np.radians(latitude), axis) * (meridian + height)
    east = np.gradient(np.radians(longitude), axis) * (normal + height) * np.cos(np.radians(latitude))
    up = np.gradient(height, axis)
    return np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))


def _filled(values: Floats) -> Floats:
    """Gaps bridged by straight lines."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values) if not known.any() else values
    index = np.arange(values.size)
    return np.interp(index, index[known], values[known])
