"""The depths round a dent in, a shaded picture that looks at the dent out; no graphics card is asked."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.ndimage import gaussian_filter, zoom

from deform.mesh.colours import colours

_HALF_WIDTH_DEG = 75.0
_LIGHT = np.array([-0.45, 0.55, 0.70])
_RELIEF = 2.5
_LINES = (0.1, 0.25, 0.5, 0.75)  # of the deepest; the first is where length and width of a dent are taken
_INK = np.array([60, 66, 74]) / 255


def preview(
    depth: xr.DataArray,
    top: float | None = None,
    value: np.ndarray | None = None,
    shows: str = "depth",
    width: int = 720,
) -> np.ndarray:
    """Return a picture (rows, width, 3) of 8-bit colours: the wall seen from inside, the dent in the middle, shaded from above.

    Downstream is to the right, clockwise is downward. Lines stand at a tenth, a quarter, a half and three quarters of the depth.

    Parameters
    ----------
    depth : ``depth(distance, clock)`` in metre, positive inward; attributes ``radius_m`` and, when known, ``clock_deg``.
    top : depth at which the colours end, such as that of the deepest run; default the greatest of this one.
    value : what the colour shows in place of depth, on the same grid; grey where unknown.
    shows : its name, ``change`` or ``strain``, which choose the scale as `colours` does for the surface.
    width : of the picture, pixels along the pipe.
    """
    at = depth.attrs.get("clock_deg")
    if at is None:
        at = float(depth["clock"].values[int(np.nanargmax(depth.values)) % depth.sizes["clock"]])
    offset = (depth["clock"].values - at + 180) % 360 - 180
    order = np.argsort(offset)
    order = order[np.abs(offset[order]) <= _HALF_WIDTH_DEG]
    values = depth.values[:, order].T
    high = np.radians(offset[order][-1] - offset[order][0]) * depth.attrs["radius_m"]
    long = float(depth["distance"].values[-1] - depth["distance"].values[0])
    rows = int(np.clip(width * high / long, 120, 2 * width))
    cell = max(width / depth.sizes["distance"], rows / values.shape[0])
    fine = gaussian_filter(_enlarged(values, rows, width, 1), 0.6 * cell)
    slope_down, slope_along = np.gradient(fine * _RELIEF, high / rows, long / width)
    normal = np.stack([-slope_along, slope_down, np.ones_like(fine)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    shade = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.15, 1.0) / (_LIGHT[2] / np.linalg.norm(_LIGHT))
    if value is None:
        shown = colours(fine.ravel(), "depth", top)
    else:
        shown = colours(_enlarged(value[:, order].T, rows, width, 0).ravel(), shows)
    shown = shown.reshape(*fine.shape, 3)
    picture = np.clip(shown * (0.45 + 0.55 * shade[..., None]), 0, 1)
    picture[_edges(fine, [share * float(fine.max()) for share in _LINES])] = _INK
    return np.ascontiguousarray(np.rint(255 * picture).astype(np.uint8))


def _enlarged(values: np.ndarray, rows: int, width: int, order: int) -> np.ndarray:
    factors = (rows / values.shape[0], width / values.shape[1])
    return zoom(values, factors, order=order, mode="nearest", grid_mode=True)


def _edges(values: np.ndarray, levels: list[float]) -> np.ndarray:
    """Return where a pixel and its neighbour right or below lie on two sides of a level."""
    steps = np.digitize(values, levels)
    found = np.zeros(values.shape, bool)
    found[:, :-1] |= steps[:, :-1] != steps[:, 1:]
    found[:-1, :] |= steps[:-1, :] != steps[1:, :]
    return found
