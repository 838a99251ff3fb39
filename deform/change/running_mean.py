"""Values along the pipe with gaps in, their mean over a length about each place out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]


def running_mean(values: Floats, width: int, least: float = 0.0) -> Floats:
    """Return the mean of the known values in a window about each place.

    Parameters
    ----------
    values : (..., n) along the last axis, NaN where unknown.
    width : places of the window, made odd; at the ends it holds what there is.
    least : NaN where no more than this part of the window is known.
    """
    half = width // 2
    known = np.isfinite(values)
    at = np.arange(values.shape[-1])
    low, high = np.maximum(at - half, 0), np.minimum(at + half + 1, values.shape[-1])
    total, count = (_summed(part, low, high) for part in (np.where(known, values, 0.0), known.astype(float)))
    return np.where(count > least * (2 * half + 1), total / np.maximum(count, 1.0), np.nan)


def _summed(values: Floats, low: Floats, high: Floats) -> Floats:
    """Sum from one place to before another, along the last axis."""
    summed = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
    return summed[..., high] - summed[..., low]
