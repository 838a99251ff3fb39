"""Differences over stable pipe in, the noise floor of a pair of runs by the speeds of both out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from deform.geometry.resample import MAD_TO_SIGMA

Floats = NDArray[Any]
SPEED_EDGES = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)  # m/s
_SLOWEST, _PER_OCTAVE = 0.25, 10  # m/s and steps: how finely the floor follows the speed
SPEEDS = 64  # number of speed steps; step number SPEEDS stands for an unknown speed
_LEAST_SHARE = 0.02  # of the pipe: a class that holds less is not listed
_CELLS = 8  # of speed of each run
_POWERS = (-4, -2, 0, 2, 4)  # of the speed, in the variance
_REACH = (0.002, 0.998)  # quantiles of the speed beyond which the noise is not led on
_ROUNDS = 4  # of the fit, whose weights rest on itself
_SAMPLE = 300_000  # places that a floor is learned from, at most
_LEAN = 0.02  # weight of an even share, in parts of that of all cells
_LEAST_PART = 0.5  # of the variance of the quietest twentieth of the pipe: no speeds are quieter than that


def sample_step(size: int) -> int:
    """Return the step by which so many places are thinned out before a floor is learned from them."""
    return max(size // _SAMPLE, 1)


def speed_step(speed: Floats | None, n: int) -> NDArray[np.uint8]:
    """Return the step of the speed at each place on a logarithmic scale, `SPEEDS` where the speed is not known."""
    if speed is None:
        return np.full(n, SPEEDS, np.uint8)
    known = np.isfinite(speed)
    steps = _PER_OCTAVE * np.log2(np.where(known, np.maximum(speed, 1e-3), 1.0) / _SLOWEST)
    return np.where(known, np.clip(np.round(steps), 0, SPEEDS - 1), SPEEDS).astype(np.uint8)


_STEP_SPEED = _SLOWEST * 2.0 ** (np.arange(SPEEDS) / _PER_OCTAVE)
_CLASS_OF = np.append(np.searchsorted(SPEED_EDGES, _STEP_SPEED, side="right"), -1)


def class_name(number: int) -> str:
    """Words for a speed class, from its number: 0 = below 0.5 m/s, -1 = all speeds."""
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
    half, most = np.quantile(size, (0.5, 0.95))
    return float(max(MAD_TO_SIGMA * half, most / 1.959964))


@dataclass(frozen=True)
class SpeedNoise:
    """Noise of a difference as the sum of what each of two runs adds at its own speed.

    Attributes
    ----------
    reference, other : (SPEEDS + 1,) variance that each run adds, by `speed_step`.
    floors : sigma by speed class when both runs travel in it; -1 = all speeds.
    """

    reference: Floats
    other: Floats
    floors: dict[int, float]

    def at(self, reference_step: Floats, other_step: Floats) -> Floats:
        """Sigma of the difference at each place."""
        return np.sqrt(self.reference[reference_step] + self.other[other_step])


def speed_noise(values: Floats, reference_step: Floats, other_step: Floats, stable: Floats) -> SpeedNoise:
    """Return the noise floor of a difference from its spread over stable pipe, by the speeds of both runs.

    Parameters
    ----------
    values : (n,) differences, or differences over their formal sigma.
    reference_step, other_step : (n,) `speed_step` of the two runs.
    stable : (n,) true where the pipe did not change.

    Notes
    -----
    The pipe is cut into cells of equal speeds of both runs (quantiles of each). The squared `spread` of each cell is the sum of
    one function of the speed per run: powers of the speed with factors that are not negative, falling for the noise that comes
    with the time that a metre takes, rising for what the speed shakes. Powers lead the noise on to the slowest stretches, where
    it is largest and too little pipe lies to be a cell of its own. Least squares of the ratios, weighted by the number of places;
    the sum is nowhere below half the variance of the quietest twentieth of the pipe, and no part above twice that of the
    noisiest, so that a pair of speeds that few places have is taken neither for free of noise nor for worth nothing. Where the
    speeds are not known the whole is shared evenly.
    """
    some = slice(None, None, sample_step(values.size))
    values, reference_step, other_step, stable = (part[some] for part in (values, reference_step, other_step, stable))
    good = stable & np.isfinite(values)
    whole = spread(values[good])
    if not np.isfinite(whole):
        nothing = np.full(SPEEDS + 1, np.nan)
        return SpeedNoise(nothing, nothing, {-1: whole})
    steps = reference_step[good], other_step[good]
    held = [np.bincount(part, minlength=SPEEDS + 1) for part in steps]
    first, second = (whole**2 * table for table in _tables(*steps, held, values[good] / whole))
    floors = {-1: whole}
    for number in range(len(SPEED_EDGES) + 1):
        own = [np.where(number == _CLASS_OF, count, 0) for count in held]
        if min(count.sum() for count in own) > max(_LEAST_SHARE * good.sum(), 50):
            shares = (table @ count / count.sum() for table, count in zip((first, second), own, strict=True))
            floors[number] = float(np.sqrt(sum(shares)))
    return SpeedNoise(first, second, floors)


def _tables(a: Floats, b: Floats, held: list[Floats], v: Floats) -> tuple[Floats, Floats]:
    """Variance at every speed step of each run, the whole being one; ``held`` counts the places of each step of both runs."""
    cells, shapes = ([work(count) for count in held] for work in (_cells_of, _shapes))
    number = cells[0][a] * (_CELLS + 1) + cells[1][b]
    sizes = np.bincount(number, minlength=(_CELLS + 1) ** 2)
    by_cell = np.split(v[np.argsort(number, kind="stable")], np.cumsum(sizes)[:-1])
    squares = np.array([spread(members) ** 2 for members in by_cell])
    used = np.flatnonzero(squares > 0)
    squares, sizes = squares[used], sizes[used].astype(float)
    rows = np.hstack([_counts(number, part)[used] @ shapes[m] / sizes[:, None] for m, part in enumerate((a, b))])
    width = rows.shape[1]
    low, high = _ends(squares, sizes)
    least, most = _LEAST_PART * min(low, 1.0), high / _LEAST_PART
    squares = np.minimum(squares, most)
    lean = _LEAN * np.sqrt(v.size) * np.eye(width)  # what the cells leave open is shared evenly
    even = lean.diagonal() * (1.0 - least) / width
    fitted = squares
    for _ in range(_ROUNDS):  # of a ratio and of its inverse alike: either alone leans to one side
        weight = np.sqrt(sizes / (squares * fitted))
        design = np.vstack([weight[:, None] * rows, lean])
        solution, _ = nnls(design, np.concatenate([weight * np.maximum(squares - least, 0.0), even]))
        fitted = rows @ solution + least
    split = shapes[0].shape[1]
    parts = shapes[0] @ solution[:split], shapes[1] @ solution[split:]
    return 0.5 * least + np.minimum(parts[0], most), 0.5 * least + np.minimum(parts[1], most)


def _ends(squares: Floats, sizes: Floats) -> tuple[float, float]:
    """Variances of the cells at a twentieth and at nineteen twentieths of the pipe, the quietest first."""
    if not squares.size:
        return 0.0, 1.0
    order = np.argsort(squares)
    held = np.cumsum(sizes[order]) / sizes.sum()
    low, high = (float(squares[order][np.searchsorted(held, part - 1e-9)]) for part in (0.05, 0.95))
    return low, high


def _counts(number: Floats, step: Floats) -> Floats:
    """How many places each cell holds of each speed step, (cells, SPEEDS + 1)."""
    cells = (_CELLS + 1) ** 2
    return np.bincount(number * (SPEEDS + 1) + step, minlength=cells * (SPEEDS + 1)).reshape(cells, SPEEDS + 1)


def _quantiles(count: Floats, parts: ArrayLike) -> Floats:
    """Quantiles of speed steps of which so many places hold each, as `numpy.quantile` of the places gives them."""
    total = np.cumsum(count)
    at = np.asarray(parts, float) * (total[-1] - 1)
    low = np.floor(at).astype(int)
    below, above = (np.searchsorted(total, np.minimum(k, total[-1] - 1), side="right") for k in (low, low + 1))
    return below + (at - low) * (above - below)


def _cells_of(count: Floats) -> Floats:
    """Number of the quantile cell of each speed step, `_CELLS` where it is not known."""
    known = count[:SPEEDS]
    edges = np.unique(_quantiles(known, np.linspace(0, 1, _CELLS + 1)[1:-1])) if known.any() else np.array([])
    return np.append(np.searchsorted(edges, np.arange(SPEEDS), side="right"), _CELLS).astype(np.uint16)


def _shapes(count: Floats) -> Floats:
    """Powers of the speed over its median, (SPEEDS + 1, powers); an unknown speed takes their mean over the run."""
    known = count[:SPEEDS]
    if not known.any():
        return np.ones((SPEEDS + 1, 1))
    at = np.clip(np.arange(SPEEDS), *_quantiles(known, _REACH))
    ratio = 2.0 ** ((at - _quantiles(known, 0.5)) / _PER_OCTAVE)
    powers = ratio[:, None] ** np.array(_POWERS)
    return np.vstack([powers, known @ powers / known.sum()])


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
            robust = MAD_TO_SIGMA**2 * np.median(change[bent][cell] ** 2) - np.median(base[bent][cell] ** 2)
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
