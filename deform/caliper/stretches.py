"""Series along the pipe in, the stretches in which they stand above a limit out."""

from __future__ import annotations

import numpy as np

Row = dict[str, object]


def stretches(
    place: np.ndarray, value: np.ndarray, limit: float, length: tuple[float, float], gap: float
) -> list[tuple[float, float, float]]:
    """Start, end and median value of the runs above a limit whose length (m) is in the range; more than a gap (m) ends a run."""
    above = np.flatnonzero(np.nan_to_num(value) > limit)
    if not above.size:
        return []
    groups = np.split(above, np.flatnonzero(np.diff(place[above]) > gap) + 1)
    found = [(float(place[g[0]]), float(place[g[-1]]), float(np.median(value[g]))) for g in groups]
    return [f for f in found if length[0] <= f[1] - f[0] <= length[1]]


def running_median(values: np.ndarray, size: int) -> np.ndarray:
    """Median over about ``size`` cells, formed on a thinned grid."""
    thin = max(1, size // 25)
    coarse = values[::thin]
    half = max(1, size // thin // 2)
    padded = np.pad(coarse, half, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return np.interp(np.arange(values.size), np.arange(0, values.size, thin), middle)
