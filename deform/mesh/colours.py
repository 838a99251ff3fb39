"""Values of a surface in, colours out, and the ends of the scale that the sidecar tells."""

from __future__ import annotations

from typing import Any

import numpy as np

from deform.palette import CHANGE, DEPTH, DEPTH_LEAST, paint


def colours(value: np.ndarray, shows: str, top: float | None = None) -> np.ndarray:
    """Return colours (n, 3) in 0 … 1 of values (n,); unknown values are grey.

    The scale of a ``change`` is white at zero and ends at the largest size. That of anything else is white at zero as well,
    darkest at ``top`` (default the greatest value), and amber below zero.
    """
    value = np.asarray(value, float)
    low, high = scale_ends(value, shows, top)
    if high <= low:  # nothing stands out: zero is white all the same
        low, high = scale_ends(np.ones(1), shows)
    return paint(np.clip((value - low) / (high - low), 0, 1), CHANGE if shows == "change" else DEPTH)


def scale_ends(value: np.ndarray, shows: str, top: float | None = None) -> tuple[float, float]:
    """Return the values at which the colour scale begins and ends."""
    finite = np.asarray(value, float)[np.isfinite(value)]
    if shows == "change":
        most = float(np.abs(finite).max(initial=0.0))
        return -most, most
    most = float(finite.max(initial=0.0)) if top is None else top
    return DEPTH_LEAST * most, most


def legend(value: np.ndarray, shows: str, unit: str) -> dict[str, Any]:
    """Return what a sidecar says of the colours: what they show, its unit, and the values at both ends of the scale."""
    low, high = scale_ends(value, shows) if np.isfinite(value).any() else (None, None)
    return {"shows": shows, "unit": unit, "low": low, "high": high}
