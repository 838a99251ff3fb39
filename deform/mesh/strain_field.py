"""The wall map round a dent and its sizes in, the effective strain of the wall on the grid of its surface out."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.mesh.dent_surface import on_grid
from deform.strain.dent import surface_strain

_WINDOW = 1.5  # size of the patch in sizes of the dent, as in `DentStrainOptions.windows`
_LEAST_CELLS = 12  # a spline of degree five needs at least so many cells each way
_MOST_PIECES = 8


def strain_grid(
    window: xr.Dataset,
    depth: xr.DataArray,
    *,
    clock_deg: float,
    depth_m: float,
    length_m: float,
    width_m: float,
    wall_thickness: float,
) -> xr.DataArray | None:
    """Return the larger of inside and outside effective strain on the grid of a surface; NaN away from the dent.

    Parameters
    ----------
    window : ``radius(scan, clock)``, ``chainage(scan)`` in metre, from `run.store.read_wall`.
    depth : grid on which the strain is wanted; attributes ``chainage_m`` and ``radius_m``.
    clock_deg, depth_m, length_m, width_m : of the dent, as its table says.
    wall_thickness : metre.

    Returns
    -------
    DataArray or None
        None where a size is unknown, or the wall map is too coarse for curvatures.

    Notes
    -----
    ASME B31.8 (2018) form by `deform.strain.dent.surface_strain`, over the same patch as ``strain_max`` of the dent and inside
    the same ellipse of its length and width: towards the rim of the patch a spline's second derivative means nothing.
    """
    sizes = np.array([clock_deg, depth_m, length_m, width_m], float)
    if not np.isfinite(sizes).all() or (sizes[1:] <= 0).any():
        return None
    place = window["chainage"].values - depth.attrs["chainage_m"]
    turn = (window["clock"].values - clock_deg + 180) % 360 - 180
    rows = np.flatnonzero(np.abs(place) <= 0.5 * _WINDOW * length_m)
    half = np.degrees(min(0.5 * _WINDOW * width_m / depth.attrs["radius_m"], np.pi))
    order = np.argsort(turn)
    columns = order[np.abs(turn[order]) <= half]
    if min(rows.size, columns.size) < _LEAST_CELLS:
        return None
    patch = np.asarray(window["radius"].transpose("scan", "clock").values, float)[np.ix_(rows, columns)]
    if np.isfinite(patch).mean() < 0.7:
        return None
    pieces = max(1, min(_MOST_PIECES, rows.size // 2 - 5, columns.size // 2 - 5))
    both = surface_strain(
        place[rows],
        np.radians(turn[columns]),
        patch,
        length=length_m,
        depth=depth_m,
        wall_thickness=wall_thickness,
        intervals=pieces,
    )
    clock = clock_deg + turn[columns]  # rising through the apex, may leave 0 .. 360
    across = np.radians(turn[columns]) * depth.attrs["radius_m"]
    core = (2 * place[rows] / length_m)[:, None] ** 2 + (2 * across / width_m)[None, :] ** 2 <= 1.0
    field = xr.DataArray(
        np.where(core, np.maximum(*both), np.nan), {"distance": place[rows], "clock": clock}, ("distance", "clock")
    )
    return on_grid(field, depth)
