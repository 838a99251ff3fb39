"""Changes of curvature about a movement in, where the movement begins and ends out, each with its sigma."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial, legendre
from numpy.typing import NDArray

from deform.change import _kernels

Floats = NDArray[Any]
_LEAST, _MOST = 3, 10  # coefficients of a movement
_NODES = 80  # places over a window half as wide as it is looked at
_WIDEST = 700.0  # m, farthest that an end is looked for from the seed
_SHORTEST = 6.0  # m
_GRID = 16  # steps over half a window in the first look
_NEED = 12.0  # gain in chi-square beyond its coefficients that a step must bring
_LEFT_OVER = 0.6  # least part of the largest displacement that stays behind a step
_SHAPE = 0.015  # sigma of an end in parts of the length, for shapes that are not tried: seen on flat-topped bumps without noise
_SOFTNESS = (2, 3, 4)  # powers with which a movement may set in
_STEP = Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])  # from 0 to 1, level and unbent at both ends


@dataclass(frozen=True)
class Support:
    """Where a movement lies.

    Attributes
    ----------
    start, end : its ends (m). start_sigma, end_sigma : their standard deviations (m). evidence : chi-square that the movement
    explains. worth : the same less what its coefficients cost. closed : false for a step, whose two sides lie apart for good.
    """

    start: float
    end: float
    start_sigma: float
    end_sigma: float
    evidence: float
    worth: float
    closed: bool


def find_support(place: Floats, change: Floats, sigma: Floats, start: float, end: float) -> Support | None:
    """Return the stretch whose movement explains a change of curvature best, None where no curvature is known.

    Parameters
    ----------
    place : (n,) regular axis (m).
    change : (n, 2) change of horizontal and vertical curvature (1/m), NaN where it may not be used.
    sigma : (n, 2) its standard deviation, so that neighbouring places may be taken as independent (1/m).
    start, end : stretch that moved for sure, as a first guess (m).

    Notes
    -----
    A movement of a pipe is compact: displacement, slope and bending vanish at both ends. On a stretch [a, b] it is taken as
    w = [x (1 - x)]^p times a polynomial of x = (s - a) / (b - a), and w'' is fitted to the changes of curvature, both components
    at once; what it explains, in chi-square, is twice the log likelihood of [a, b]. The best stretch is looked for on grids of
    several widths, then refined, with p = 3; the number of coefficients is the least that the data ask
    for. Ends and sigmas are the moments of the likelihood about it, over p = 2, 3, 4: how softly a movement sets in is not known.
    The noise is that of the residuals where the shape fits worse than the noise allows; a part of the length is added to the
    sigmas for shapes that are none of these. A step (one side moved against the other, as at the edge of a wide slide) is tried
    as well, must explain clearly more, and must leave its two sides apart.
    """
    closed, step = (_Fit.about(place, change, sigma, start, end, kind) for kind in (True, False))
    if closed is None or step is None:
        return None
    better = step.worth - closed.worth > _NEED * closed.misfit and step.left_over > _LEFT_OVER
    return (step if better else closed).support()


class _Fit:
    """Search for the best stretch with one kind of shape."""

    def __init__(self, nodes: tuple[Floats, Floats, Floats], seed: tuple[float, float], reach: float, closed: bool):
        self.place, self.change, self.weight = nodes
        self.seed, self.reach, self.closed = seed, reach, closed
        self.step = float(self.place[1] - self.place[0])
        self.count = _LEAST + 2
        self.best = (-1.0, *seed)

    @classmethod
    def about(cls, place, change, sigma, start, end, closed) -> _Fit | None:
        """The best fit over windows of several widths."""
        best: _Fit | None = None
        reach = max(40.0, 1.5 * (end - start))
        while reach <= _WIDEST:
            nodes = _nodes(place, change, sigma, 0.5 * (start + end), reach)
            if nodes is None:
                break
            fit = cls(nodes, (start, end), reach, closed)
            fit._look_around()
            fit._choose_count()
            if best is None or fit.worth > best.worth:
                best = fit
            elif best.reach < 0.45 * reach:
                break  # twice as wide as the best one and no better
            reach *= 2.0
        if best is not None:
            best._refine()
        return best

    @property
    def worth(self) -> float:
        """Evidence less what its coefficients cost (Bayesian information criterion)."""
        return self.best[0] - self._cost(self.count)

    def _cost(self, count: int) -> float:
        return 2.0 * count * np.log(max(self.place.size, 8))

    def _evidence(self, starts: Floats, ends: Floats, softness: int = 3) -> Floats:
        out = np.empty((starts.size, ends.size))
        shapes = _shapes(self.count, self.closed, softness)
        _kernels.explained(self.place, self.change, self.weight, starts, ends, _SHORTEST, shapes, out)
        return out

    def _look_around(self) -> None:
        middle, h = 0.5 * sum(self.seed), self.reach / _GRID
        starts = np.arange(self.seed[0] + 0.25 * (self.seed[1] - self.seed[0]), middle - self.reach - 1e-9, -h)[::-1]
        ends = np.arange(self.seed[1] - 0.25 * (self.seed[1] - self.seed[0]), middle + self.reach + 1e-9, h)
        self._take(starts, ends)

    def _take(self, starts: Floats, ends: Floats) -> Floats:
        found = self._evidence(starts, ends)
        i, j = np.unravel_index(int(np.argmax(found)), found.shape)
        if found[i, j] > self.best[0]:
            self.best = float(found[i, j]), float(starts[i]), float(ends[j])
        return found

    def _choose_count(self) -> None:
        """Take as many coefficients as pay for themselves."""
        worth = []
        for count in range(_LEAST, _MOST + 1):
            self.count = count
            _, start, end = self.best
            near = np.linspace(-0.1, 0.1, 5) * (end - start)
            worth.append(self._evidence(start + near, end + near).max() - self._cost(count))
        self.count = _LEAST + int(np.argmax(worth))
        _, start, end = self.best
        self.best = (-1.0, start, end)
        near = np.linspace(-0.1, 0.1, 5) * (end - start)
        self._take(start + near, end + near)

    def _refine(self) -> None:
        h = max(self.reach / _GRID, 0.1 * (self.best[2] - self.best[1]))
        while h > 0.4 * self.step:
            near = h * np.linspace(-1.5, 1.5, 7)
            self._take(self.best[1] + near, self.best[2] + near)
            h *= 0.6

    @property
    def misfit(self) -> float:
        """Mean square of the residuals inside the best stretch over the noise, 1 at least."""
        top, start, end = self.best
        inside = (self.place > start) & (self.place < end)
        total = float(np.sum((self.change * self.weight)[inside] ** 2))
        return max((total - top) / max(2 * (int(inside.sum()) - self.count), 1), 1.0)

    @property
    def left_over(self) -> float:
        """Displacement that stays behind the best stretch, in parts of the largest one."""
        _, start, end = self.best
        inside = (self.place > start) & (self.place < end)
        shapes = _shapes(self.count, self.closed, 3)
        x, fine = (self.place[inside] - start) / (end - start), np.linspace(0.0, 1.0, 201)
        rows, curve = (np.vander(v, shapes.shape[1], increasing=True) @ shapes.T for v in (x, fine))
        moved = []
        for c in range(2):
            weight = self.weight[inside, c]
            solution, *_ = np.linalg.lstsq(rows * weight[:, None], self.change[inside, c] * weight, rcond=1e-9)
            slope = np.cumsum(curve @ solution)
            moved.append(np.cumsum(slope))
        size = np.hypot(*moved)
        return float(size[-1] / size.max()) if size.max() > 0 else 0.0

    def support(self) -> Support:
        """The best stretch with the spread of the likelihood about it."""
        top, start, end = self.best
        reach, misfit = 0.06 * (end - start) + 2.0 * self.step, self.misfit
        while True:
            near = reach * np.linspace(-1.0, 1.0, 17)
            found = np.stack([self._evidence(start + near, end + near, softness) for softness in _SOFTNESS])
            chance = np.exp(np.clip(0.5 * (found - found.max()) / misfit, -700.0, 0.0))
            sides = [chance.sum(axis=axis) / chance.sum() for axis in ((0, 2), (0, 1))]
            middles = [float(side @ near) for side in sides]
            spreads = [float(np.sqrt(side @ (near - middle) ** 2)) for side, middle in zip(sides, middles, strict=True)]
            if max(spreads) < 0.4 * reach or reach > 0.4 * (end - start):
                break
            reach *= 1.6
        sigmas = [float(np.sqrt(v**2 + self.step**2 / 12.0 + (_SHAPE * (end - start)) ** 2)) for v in spreads]
        return Support(start + middles[0], end + middles[1], sigmas[0], sigmas[1], top, self.worth, self.closed)


def _nodes(place, change, sigma, middle, reach) -> tuple[Floats, Floats, Floats] | None:
    """Means over equal stretches of a window, and the square roots of their weights; None where nothing is known."""
    first, last = np.searchsorted(place, middle - reach, side="right"), np.searchsorted(place, middle + reach)
    if last - first < 8:
        return None
    size = max(int(2.0 * reach / _NODES / (place[1] - place[0]) / 2.0), 1)
    count = int(last - first) // size
    window = slice(first, first + count * size)
    columns = np.column_stack([place[window], change[window], sigma[window]])
    known = np.isfinite(columns[:, 1:3]) & (columns[:, 3:5] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.where(known, columns[:, 3:5] ** -2.0, 0.0).reshape(count, size, 2).sum(axis=1)
        moments = np.where(known, columns[:, 1:3] * columns[:, 3:5] ** -2.0, 0.0).reshape(count, size, 2).sum(axis=1)
        value = np.where(each > 0, moments / each, 0.0)
    if not (each > 0).any():
        return None
    return columns[:, 0].reshape(count, size).mean(axis=1), value, np.sqrt(each)


@lru_cache(maxsize=256)
def _shapes(count: int, closed: bool, softness: int) -> Floats:
    """Coefficients (count, powers) of the second derivatives of the shapes, each of mean square one; powers rise."""
    envelope = Polynomial([0.0, 1.0, -1.0]) ** softness
    shapes = [envelope * Polynomial(legendre.leg2poly(np.eye(count)[k]))(Polynomial([-1.0, 2.0])) for k in range(count)]
    if not closed:
        shapes[-1] = _STEP
    x, w = legendre.leggauss(64)
    out = np.zeros((count, max(2 * softness + count - 2, 6)))
    for row, shape in zip(out, shapes, strict=True):
        second = shape.deriv(2)
        row[: second.coef.size] = second.coef / np.sqrt(np.sum(w * second(0.5 * (x + 1.0)) ** 2) / 2.0)
    return out
