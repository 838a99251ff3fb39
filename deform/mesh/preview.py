"""The depths round a dent in, a shaded picture that looks at the dent out; no graphics card is asked."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.ndimage import gaussian_filter, zoom

from deform.mesh.colours import colours

_HALF_WIDTH_DEG = 75.0
_LIGHT = np.array([-0.45, 0.55, 0.70])
_RELIEF = 4.0


def preview(depth: xr.DataArray, width: int = 720) -> np.ndarray:
    """Return a picture (rows, width, 3) of 8-bit colours: the wall seen from inside, the dent in the middle, shaded from above.

    Parameters
    ----------
    depth : ``depth(distance, clock)`` in metre, positive inward; attributes ``radius_m`` and, when known, ``clock_deg``.
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
    fine = gaussian_filter(
        zoom(values, (rows / values.shape[0], width / values.shape[1]), order=1, mode="nearest", grid_mode=True), 2
    )
    slope_down, slope_along = np.gradient(fine * _RELIEF, high / rows, long / width)
    normal = np.stack([-slope_along, slope_down, np.ones_like(fine)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    shade = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.15, 1.0)
    paint = colours(fine.ravel()).reshape(*fine.shape, 3)
    return np.ascontiguousarray(np.rint(255 * np.clip(paint * (0.35 + 0.75 * shade[..., None]), 0, 1)).astype(np.uint8))
