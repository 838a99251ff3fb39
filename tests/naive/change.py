"""Obviously right twins of what `deform.change` and `deform.strain.doglegs` do in blocks, by counts or by convolution."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from deform.change import noise_floor as floor


def amplitude_from_positions(difference, axis, weights, i):
    """Weighted sum of the differences about a place, along the axis there."""
    half = weights.size // 2
    return sum(w * (difference[i - half + k] @ axis[i]) for k, w in enumerate(weights))


def amplitude_from_curvature(change, sigma, shape, i):
    """Least squares of a shape in the changes about a place, and its weight; what is not known has none."""
    half = shape.size // 2
    top = bottom = 0.0
    for k, s in enumerate(shape):
        j = i - half + k
        if 0 <= j < change.size and np.isfinite(change[j]) and sigma[j] > 0:
            top += s * change[j] / sigma[j] ** 2
            bottom += s**2 / sigma[j] ** 2
    return top / bottom, bottom


def speed_tables(a, b, v):
    """Variance at every speed step of each run as `noise_floor` forms it, cell by cell and place by place."""
    cells, shapes = [_cells(a), _cells(b)], [_shapes(a), _shapes(b)]
    members = [np.flatnonzero((cells[0] == p) & (cells[1] == q)) for p in range(9) for q in range(9)]
    members = [m for m in members if m.size and floor.spread(v[m]) ** 2 > 0]
    squares, sizes = np.array([floor.spread(v[m]) ** 2 for m in members]), np.array([float(m.size) for m in members])
    rows = np.array([np.concatenate([shapes[0][a[m]].mean(axis=0), shapes[1][b[m]].mean(axis=0)]) for m in members])
    order = np.argsort(squares)
    held = np.cumsum(sizes[order]) / sizes.sum()
    low, high = (squares[order][np.searchsorted(held, part - 1e-9)] for part in (0.05, 0.95))
    least, most = 0.5 * min(low, 1.0), 2.0 * high
    squares = np.minimum(squares, most)
    width = rows.shape[1]
    lean = 0.02 * np.sqrt(v.size)
    fitted = squares
    for _ in range(4):
        weight = np.sqrt(sizes / (squares * fitted))
        right = np.concatenate([weight * np.maximum(squares - least, 0.0), np.full(width, lean * (1.0 - least) / width)])
        solution, _ = nnls(np.vstack([weight[:, None] * rows, lean * np.eye(width)]), right)
        fitted = rows @ solution + least
    split = shapes[0].shape[1]
    parts = shapes[0] @ solution[:split], shapes[1] @ solution[split:]
    return [0.5 * least + np.minimum(part, most) for part in parts]


def _cells(step):
    known = step < floor.SPEEDS
    edges = np.unique(np.quantile(step[known], np.arange(1, 8) / 8)) if known.any() else []
    return np.array([np.searchsorted(edges, s, side="right") if s < floor.SPEEDS else 8 for s in step])


def _shapes(step):
    known = step[step < floor.SPEEDS].astype(int)
    if not known.size:
        return np.ones((floor.SPEEDS + 1, 1))
    at = np.clip(np.arange(floor.SPEEDS), *np.quantile(known, (0.002, 0.998)))
    ratio = 2.0 ** ((at - np.median(known)) / 10)
    powers = ratio[:, None] ** np.array([-4, -2, 0, 2, 4])
    return np.vstack([powers, powers[known].mean(axis=0)])


def jump(chainage, azimuth, pitch, place):
    """Turn to the right and up at a place by straight lines through the values of 3 m on either side, 0.3 m left out."""
    near = (chainage >= place - 3.0) & (chainage < place + 3.0)
    s, turned = chainage[near] - place, np.unwrap(azimuth[near], period=360.0)
    sides = [s >= 0.3, s <= -0.3]
    if min(side.sum() for side in sides) < 5:
        return np.nan, np.nan
    (right, up), before = ([np.polyfit(s[side], v[side], 1)[1] for v in (turned, pitch[near])] for side in sides)
    right, up = right - before[0], up - before[1]
    return np.cos(np.radians(pitch[near].mean())) * right, up


def faded(size: np.ndarray, fade: float) -> np.ndarray:
    """Greatest of the sizes at and before each place, each fading by ``fade`` from place to place."""
    at = np.arange(size.size)
    return np.array([np.max(size[: i + 1] * fade ** (i - at[: i + 1])) for i in at])
