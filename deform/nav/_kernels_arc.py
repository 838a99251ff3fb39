"""A turn of the tool in; the bend of its forward axis, and the chord of an arc that bends so, out."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def tilted(x, y, z):
    """Cosine of the angle by which a turn (rotation vector) takes the body's forward axis away from itself."""
    square = x * x + y * y + z * z
    return 1.0 - (1.0 - math.cos(math.sqrt(square))) * (x * x + z * z) / square if square > 0.0 else 1.0


@njit(cache=True, error_model="numpy")
def arc_stretch(cosine):
    """Length of a regular arc's chord over that of the mean of its end tangents, of the cosine of the angle between these."""
    half = 0.5 * math.acos(min(max(cosine, -0.9), 1.0))
    return math.tan(half) / half if half > 1e-6 else 1.0
