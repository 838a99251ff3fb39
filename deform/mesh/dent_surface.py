"""The wall map of a run in, the closed surface of the pipe round a dent out, in the same frame in every year."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.mesh.colours import legend
from deform.mesh.surface import Surface, steel
from deform.options import MeshOptions

FRAME = "x downstream from the apex, y to the right looking downstream, z up; origin on the pipe's axis at the apex"
_UNITS = {"depth": "m", "change": "m", "strain": "1"}
_POSITIVE = {
    "depth": "inward",
    "change": "deeper than in the first run",
    "strain": "effective strain, of inner and outer wall the larger",
}


def half_length(length_m: float, options: MeshOptions) -> float:
    """Return half the axial extent (m) of the surface of a dent of this length (m)."""
    longest = length_m if np.isfinite(length_m) else 0.0
    return float(np.clip(1.5 * longest, options.least_half_length_m, options.most_half_length_m))


def dent_surface(
    depth: xr.DataArray,
    *,
    wall_thickness: float,
    options: MeshOptions,
    before: xr.DataArray | None = None,
    strain: xr.DataArray | None = None,
) -> Surface:
    """Return the pipe round a dent as a closed surface.

    Parameters
    ----------
    depth : ``depth(distance, clock)`` from `depth_grid`.
    wall_thickness : of the steel, metre; the outer wall is the inner one moved outward by it.
    options : colour and exaggeration.
    before : depths of an earlier run, on any such grid: the change since then becomes a field and may give the colour.
    strain : effective strain on the same grid (`strain_field.strain_grid`), likewise.

    Notes
    -----
    With an exaggeration of q the drawn radius is reference - q · depth; the sidecar says so. Fields and bounds of the colour are
    in true size.
    """
    distance, clock = depth["distance"].values, np.radians(depth["clock"].values)
    reference = float(depth.attrs["radius_m"])
    inner = reference - options.exaggeration * depth.values
    points = [_ring_points(distance, clock, radius) for radius in (inner, inner + wall_thickness)]
    fields = {"radius_m": reference - depth.values, "depth_m": depth.values, "change_m": np.full(depth.shape, np.nan)}
    if before is not None:
        fields["change_m"] = depth.values - on_grid(before, depth).values
    fields["strain"] = np.full(depth.shape, np.nan) if strain is None else strain.values
    value = {"depth": fields["depth_m"], "change": fields["change_m"], "strain": fields["strain"]}[options.colour]
    meaning = {
        "unit": "m",
        "frame": FRAME,
        "clock": "0 at the top (z), clockwise looking downstream (towards y)",
        "apex_chainage_m": float(depth.attrs["chainage_m"]),
        "reference_radius_m": reference,
        "wall_thickness_m": float(wall_thickness),
        "depth_exaggeration": float(options.exaggeration),
        "colour": legend(value, options.colour, _UNITS[options.colour]) | {"positive": _POSITIVE[options.colour]},
    }
    known = {name: values for name, values in fields.items() if np.isfinite(values).any()}
    return steel(points[0], points[1], value, meaning, known)


def depth_grid(window: xr.Dataset, chainage: float, half: float, options: MeshOptions) -> xr.DataArray:
    """Return ``depth(distance, clock)`` (m, positive inward) on a regular grid; scans and arms that gave nothing are bridged.

    Parameters
    ----------
    window : ``radius(scan, clock)`` and ``chainage(scan)`` in metre, from `run.store.read_wall`.
    chainage : of the apex in this run, metre.
    half : half the axial extent, metre.
    options : steps.

    Notes
    -----
    Depth is the undamaged radius (``reference_radius``, else the median of the window) minus the radius.
    """
    values = np.asarray(window["radius"].transpose("scan", "clock").values, float)
    clock = (
        np.asarray(window["clock"].values, float) if "clock" in window else np.arange(values.shape[1]) * 360.0 / values.shape[1]
    )
    places = np.asarray(window["chainage"].values, float)
    around = max(values.shape[1], options.least_points_around)
    wanted = np.arange(around) * 360.0 / around
    rings = np.stack([_around(clock, row, wanted) for row in values])
    good = np.isfinite(rings).all(1)
    rows = max(round(2 * half / options.step_m) + 1, options.least_rows)
    distance = np.linspace(max(-half, places[good][0] - chainage), min(half, places[good][-1] - chainage), rows)
    grid = np.stack([np.interp(chainage + distance, places[good], column) for column in rings[good].T], axis=1)
    reference = float(np.nanmedian(window["reference_radius"].values)) if "reference_radius" in window else float(np.median(grid))
    attrs = {"radius_m": reference, "units": "m", "chainage_m": float(chainage)}
    return xr.DataArray(reference - grid, {"distance": distance, "clock": wanted}, ("distance", "clock"), attrs=attrs)


def on_grid(field: xr.DataArray, grid: xr.DataArray) -> xr.DataArray:
    """Return a field on the places of another grid; NaN where it does not reach."""
    if field.shape == grid.shape and np.array_equal(field["distance"], grid["distance"]):
        return field
    wrapped = xr.concat([field.assign_coords(clock=field["clock"] + turn) for turn in (-360.0, 0.0, 360.0)], "clock")
    return wrapped.interp(distance=grid["distance"], clock=grid["clock"])


def _around(clock: np.ndarray, row: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    good = np.isfinite(row)
    if good.sum() < 3:
        return np.full(wanted.size, np.nan)
    return np.interp(wanted, clock[good], row[good], period=360.0)


def _ring_points(distance: np.ndarray, clock: np.ndarray, radius: np.ndarray) -> np.ndarray:
    x = np.broadcast_to(distance[:, None], radius.shape)
    return np.stack([x, radius * np.sin(clock), radius * np.cos(clock)], axis=-1)
