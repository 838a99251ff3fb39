"""Differences over stable pipe in, the noise floor of a pair of runs by speed class out."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from deform.geometry.resample import robust_sigma

Floats = NDArray[Any]
SPEED_EDGES = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0)  # m/s
_LEAST_SHARE = 0.02  # a class below this share of the pipe takes the floor of the whole


def speed_class(speed: Floats | None, n: int) -> Floats:
    """Return the number of the speed class at each place (0 = below 0.5 m/s), -1 where the speed is not known."""
    if speed is None:
        return np.full(n, -1)
    return np.where(np.isfinite(speed), np.searchsorted(SPEED_EDGES, np.nan_to_num(speed), side="right"), -1)


def class_name(number: int) -> str:
    """Words for a speed class."""
    if number < 0:
        return "all speeds"
    low = 0.0 if number == 0 else SPEED_EDGES[number - 1]
    return f"{low:g} to {SPEED_EDGES[number]:g} m/s" if number < len(SPEED_EDGES) else f"above {low:g} m/s"


def spread(values: Floats) -> float:
    """Return a sigma about zero that is honest for the bulk and for the 95 % bound: the larger of both.

    Notes
    -----
    1.4826 median |v|, and the 95 % point of |v| over 1.96: equal for a normal variable; heavy tails show in the second.
    """
    size = np.abs(values[np.isfinite(values)])
    if size.size < 8:
        return float("nan")
    return float(max(1.4826022185056018 * np.median(size), np.quantile(size, 0.95) / 1.959964))


def floor_by_class(values: Floats, classes: Floats, stable: Floats) -> tuple[Floats, dict[int, float]]:
    """Return the noise floor at each place from the spread over the stable pipe of its class, and the floor of each class.

    Parameters
    ----------
    values : (n,) differences, or differences over their formal sigma.
    classes : (n,) class of each place.
    stable : (n,) true where the pipe did not change.
    """
    good = stable & np.isfinite(values)
    whole = spread(values[good])
    floors = {-1: whole}
    out = np.full(values.shape, whole)
    for number in np.unique(classes[good]) if good.any() else ():
        chosen = good & (classes == number)
        if number >= 0 and chosen.sum() > max(_LEAST_SHARE * good.sum(), 50):
            floors[int(number)] = spread(values[chosen])
            out[classes == number] = floors[int(number)]
    return out, floors


def bend_terms(change: Floats, base: Floats, curvature: Floats, slope: Floats, stable: Floats) -> tuple[float, float]:
    """Return what bends add to the noise of a curvature change: a fraction of the curvature, and a shift along the pipe (m).

    Parameters
    ----------
    change : (n,) curvature change (1/m).
    base : (n,) its sigma on straight pipe (1/m).
    curvature : (n,) curvature of the reference run (1/m).
    slope : (n,) its change along the pipe (1/m²).
    stable : (n,) true where the pipe did not change.

    Notes
    -----
    σ² = base² + (a k)² + (b dk/ds)². The squares are robust (1.4826² median of the squared change) over cells of equal
    curvature and equal slope; a, b ≥ 0 by non-negative least squares on the cells, weighted by their size. Without bends both
    are zero.
    """
    good = stable & np.isfinite(change) & np.isfinite(curvature) & np.isfinite(slope)
    bent = good & ((np.abs(curvature) > 5.0 * base) | (np.abs(slope) * 0.05 > base))
    if bent.sum() < 40:
        return 0.0, 0.0
    size, steep, square = np.abs(curvature[bent]), np.abs(slope[bent]), change[bent] ** 2 - base[bent] ** 2
    rows, right = [], []
    for low, high in _quantile_cells(size):
        inside = (size >= low) & (size <= high)
        for flat, sharp in _quantile_cells(steep[inside]):
            cell = inside & (steep >= flat) & (steep <= sharp)
            if cell.sum() < 8:
                continue
            robust = 1.4826022185056018**2 * np.median(change[bent][cell] ** 2) - np.median(base[bent][cell] ** 2)
            worth = np.sqrt(cell.sum()) / max(np.median(square[cell] + base[bent][cell] ** 2), 1e-18)
            rows.append(worth * np.array([np.median(size[cell] ** 2), np.median(steep[cell] ** 2)]))
            right.append(worth * max(robust, 0.0))
    if len(rows) < 3:
        return 0.0, 0.0
    solution, _ = nnls(np.array(rows), np.array(right))
    return float(np.sqrt(solution[0])), float(np.sqrt(solution[1]))


def _quantile_cells(values: Floats) -> list[tuple[float, float]]:
    edges = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0]) if values.size else np.array([])
    return list(pairwise(edges))


__all__ = ["SPEED_EDGES", "bend_terms", "class_name", "floor_by_class", "robust_sigma", "speed_class", "spread"]
