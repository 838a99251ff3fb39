"""Values of a surface in, colours out, and the ends of the scale that the sidecar tells."""

from __future__ import annotations

import numpy as np

from deform.palette import CHANGE, DEPTH, DEPTH_LEAST, paint


def colours(value: np.ndarray, *, diverging: bool = False) -> np.ndarray:
    """Return colours (n, 3) in 0 … 1 of values (n,); unknown values are grey.

    A diverging scale is white at zero and ends at the largest size. The other one is white at zero as well, darkest at the
    greatest value, and amber below zero.
    """
    value = np.asarray(value, float)
    low, high = scale_ends(value, diverging=diverging)
    return paint(np.clip((value - low) / max(high - low, 1e-12), 0, 1), CHANGE if diverging else DEPTH)


def scale_ends(value: np.ndarray, *, diverging: bool = False) -> tuple[float, float]:
    """Return the values at which the colour scale begins and ends."""
    finite = np.asarray(value, float)[np.isfinite(value)]
    if diverging:
        most = float(np.abs(finite).max(initial=0.0))
        return -most, most
    most = float(finite.max(initial=0.0))
    return DEPTH_LEAST * most, most
