"""Values in, colours out: two colour-blind-safe scales of a few anchors, no plotting library."""

from __future__ import annotations

import numpy as np

_SEQUENTIAL = (
    np.array([[254, 232, 56], [189, 175, 110], [124, 123, 120], [65, 77, 107], [0, 32, 77]]) / 255
)  # cividis, light to dark
_DIVERGING = (
    np.array([[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]]) / 255
)  # ColorBrewer RdBu


def colours(value: np.ndarray, *, diverging: bool = False) -> np.ndarray:
    """Return colours (n, 3) in 0 … 1 of values (n,); unknown values are grey.

    A diverging scale is white at zero and ends at the largest size; the other one runs from the least to the greatest.
    """
    value = np.asarray(value, float)
    finite = np.isfinite(value)
    if not finite.any():
        return np.full((value.size, 3), 0.7)
    most = float(np.abs(value[finite]).max())
    low, high = (-most, most) if diverging else (float(value[finite].min()), float(value[finite].max()))
    place = np.clip((np.where(finite, value, low) - low) / max(high - low, 1e-12), 0, 1)
    anchors = _DIVERGING if diverging else _SEQUENTIAL
    steps = np.linspace(0, 1, len(anchors))
    paint = np.stack([np.interp(place, steps, anchors[:, k]) for k in range(3)], axis=-1)
    return np.where(finite[:, None], paint, 0.7)
