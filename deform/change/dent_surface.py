"""Wall maps of runs in, the depth at a place and the difference of two surfaces out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.geometry.resample import robust_sigma
from deform.run import store
from deform.units import wrap_degree

Floats = NDArray[Any]
_HALF_LENGTH, _HALF_CLOCK = 0.15, 15.0  # m, degree: where an apex may lie about its place in another run
_FLANK = 1.0  # m: pipe on either side that gives the undamaged radius at the same clock


def patch(
    run: xr.DataTree, chainage: float, clock: float, half_length: float, half_clock: float
) -> tuple[Floats, Floats, Floats]:
    """Return a piece of the wall: distance along the pipe (m), clock from the centre (degree), depth inward (m, (scan, clock)).

    Depth is the undamaged radius minus the radius, less the median of the pipe beside it at the same clock, so that ovality
    and the tool's place in the pipe are no depth. Empty arrays where the run has no wall map.
    A run that was read without its radii gives them from its file.
    """
    empty = np.empty(0), np.empty(0), np.empty((0, 0))
    if "caliper" not in run.children or "clock" not in run["caliper"].to_dataset().variables:
        return empty
    wall = run["caliper"].to_dataset()
    reach = half_length + _FLANK
    window = slice(*np.searchsorted(wall["chainage"].values, [chainage - reach, chainage + reach]))
    wall = wall.isel(scan=window) if "radius" in wall else store.read_scans(Path(wall.encoding["source"]), window)
    along = np.asarray(wall["chainage"].values, float) - chainage
    near = np.abs(along) <= half_length
    beside = ~near
    turn = wrap_degree(np.asarray(wall["clock"].values, float) - clock)
    order = np.argsort(turn)
    order = order[np.abs(turn[order]) <= half_clock]
    if not near.any() or not order.size:
        return empty
    depth = _depth(wall, near, order)
    if beside.sum() >= 5:
        with np.errstate(invalid="ignore"):
            depth = depth - np.nan_to_num(np.nanmedian(_depth(wall, beside, order), axis=0))
    return along[near], turn[order], depth


def _depth(wall: xr.Dataset, rows: Floats, columns: Floats) -> Floats:
    radius = np.asarray(wall["radius"].values[np.flatnonzero(rows)][:, columns], float)
    if "reference_radius" in wall:
        return np.asarray(wall["reference_radius"].values, float)[rows][:, None] - radius
    return np.nanmedian(radius) - radius


def depth_at(run: xr.DataTree, chainage: float, clock: float) -> tuple[float, float]:
    """Return the greatest depth near a place in a run's wall map and its sigma (m); NaN without a map there."""
    depth = patch(run, chainage, clock, _HALF_LENGTH, _HALF_CLOCK)[2]
    if np.isfinite(depth).sum() < 9:
        return float("nan"), float("nan")
    smooth = _averaged(depth)
    noise = float(robust_sigma(np.diff(depth, axis=0))) / np.sqrt(2.0)
    return float(max(np.nanmax(smooth), 0.0)), float(max(noise, 2e-4)) * 1.5


def surface_difference(
    run: xr.DataTree,
    chainage: float,
    clock: float,
    earlier: xr.DataTree,
    earlier_chainage: float,
    earlier_clock: float,
    half_length: float = 0.3,
    half_clock: float = 45.0,
) -> tuple[Floats, Floats, Floats]:
    """Return how much deeper the wall of a run is than that of an earlier one at the same dent.

    Returns
    -------
    along (m), turn (degree) from the apex, and the change of depth (m, (along, turn)), positive = deeper; empty without both
    maps.
    """
    along, turn, depth = patch(run, chainage, clock, half_length, half_clock)
    old_along, old_turn, old = patch(earlier, earlier_chainage, earlier_clock, half_length, half_clock)
    if not depth.size or not old.size:
        return np.empty(0), np.empty(0), np.empty((0, 0))
    across = np.array([np.interp(turn, old_turn, row) for row in old])
    moved = np.array([np.interp(along, old_along, across[:, k]) for k in range(turn.size)]).T
    return along, turn, depth - moved


def _averaged(depth: Floats) -> Floats:
    """Mean over three scans, NaN left out."""
    padded = np.pad(depth, ((1, 1), (0, 0)), mode="edge")
    with np.errstate(invalid="ignore"):
        return np.nanmean(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0)
