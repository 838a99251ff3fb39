"""Steps of redundant wheels in; the scale of each against their mean along the run, and how far that mean may wander, out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.geometry.resample import spread_about_zero
from deform.nav.error_model import SCALE_WALK

Floats = NDArray[Any]

BLOCK_M = 100.0  # travel over which wear is followed
LEAST_BLOCKS, FAR_BLOCKS = 12, 50  # that tell how wheels wander; between two that are compared
COMMON_WANDER = 1e-6  # of what turns all wheels alike, per root metre: wear, and steel that cools by 20 K over 100 km


def ratios(step: Floats, good: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Scale of each wheel against the mean of the wheels, block by block of `BLOCK_M`, and the middle knots of the blocks."""
    whole = good.all(axis=1)
    mean = (step / (1.0 + scale)).mean(axis=1)
    along = np.cumsum(np.where(whole, mean, 0.0))
    block = np.minimum((along / BLOCK_M).astype(np.int64), max(int(along[-1] / BLOCK_M) - 1, 0))
    weight = np.bincount(block, np.where(whole, mean, 0.0))
    centre = np.bincount(block, np.where(whole, mean * np.arange(mean.size), 0.0)) / np.maximum(weight, 1e-9)
    usable = weight > 0.3 * BLOCK_M
    travel = [np.bincount(block, np.where(whole, wheel, 0.0)) for wheel in step.T]
    return (np.stack(travel, axis=1) / np.maximum(weight, 1e-9)[:, None] - 1.0)[usable], centre[usable]


def along(ratio: Floats, centre: Floats, scale: Floats, knots: int) -> Floats:
    """Relative scale of each wheel along the run (knot, wheel), linear between blocks."""
    if centre.size < 5:
        return np.broadcast_to(scale, (knots, scale.size))
    at = np.arange(knots)
    out = np.stack([np.interp(at, centre, _smooth(r, middle)) for r, middle in zip(ratio.T, scale, strict=True)], axis=1)
    return out - (out.mean(axis=1) - scale.mean())[:, None]


def wander(ratio: Floats) -> float:
    """Random walk of the wheels' mean scale, per root metre, by how far the wheels wander from each other.

    Notes
    -----
    What blocks m apart differ by more than neighbours do is the walk of a wheel against the mean of all n, of variance q m; that
    of the mean itself is the sum of all q over n (n - 1), when wheels wander on their own. What turns them all alike is not seen.
    """
    blocks, wheels = ratio.shape
    if blocks < LEAST_BLOCKS:
        return SCALE_WALK
    far = min(blocks // 4, FAR_BLOCKS)
    near, away = (np.array([spread_about_zero(r[m:] - r[:-m]) for r in ratio.T]) ** 2 for m in (1, far))
    walk = np.maximum(away - near, 0.0) / (far - 1) / BLOCK_M
    return float(np.sqrt(walk.sum() / (wheels * (wheels - 1)) + COMMON_WANDER**2))


def _smooth(values: Floats, middle: float) -> Floats:
    """Running median over five blocks, limited to 2 % about the run's scale."""
    padded = np.pad(values, 2, mode="edge")
    return np.clip(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1), middle - 0.02, middle + 0.02)
