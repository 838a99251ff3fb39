"""Readings around a dent in, the undamaged section under it out: radius and oval smooth along the pipe, tool offset free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_KNOT_M = 0.3  # beside the dent the section bends no faster than straight pieces of this length can follow
_ROUGH_M = (3e-5, 1e-4, 3e-4, 1e-3)  # tried: how far (m) a knot stands off the straight line between its neighbours


@dataclass(frozen=True)
class SectionModel:
    """Linear model of the undamaged section: columns of a design, and what their smoothness is worth.

    The unknowns are radius, oval_cos and oval_sin at knots along the pipe, joined by straight lines; across the dent there is
    no knot, for what bends there is the dent. Where the wall steps from pipe to pipe each has a jump more. The tool's offset
    in each scan is no unknown here: it is projected out (`Projector`).

    Attributes
    ----------
    hats : (n, k) share of each knot in each scan, the last column the jump where there is one.
    penalty : (3 k, 3 k) inverse covariance of the unknowns by their smoothness.
    under : m, standard deviation of the section under the dent's apex, for it need not be straight there.
    """

    hats: np.ndarray
    penalty: np.ndarray
    under: float

    @classmethod
    def build(cls, place: np.ndarray, hole: tuple[float, float], step: float | None, rough: float) -> SectionModel:
        """Model for scans at places (m), straight across ``hole`` (m), with a jump at ``step`` (m) or none.

        ``rough`` (m): how far a knot stands off the line between its neighbours.
        """
        knots = _knots(float(place.min()), float(place.max()), hole)
        eye = np.eye(knots.size)
        hats = np.stack([np.interp(place, knots, row) for row in eye], axis=1)
        if step is not None:
            hats = np.column_stack([hats, place > step])
        k = hats.shape[1]
        one = np.zeros((k, k))
        if knots.size > 2:
            slope = np.diff(eye, axis=0) / np.diff(knots)[:, None]
            apart = 0.5 * (knots[2:] - knots[:-2])
            bend = np.diff(slope, axis=0) * _KNOT_M / (rough * np.sqrt(apart / _KNOT_M))[:, None]
            one[: knots.size, : knots.size] = bend.T @ bend
        wander = rough / _KNOT_M**1.5 * (hole[1] - hole[0]) ** 1.5 / 13.9  # middle of a bridge that bends at random
        return cls(hats, np.kron(np.eye(3), one), float(np.sqrt(2.0) * wander))

    def design(self, clock: np.ndarray) -> np.ndarray:
        """Derivatives (n, arms, 3 k) of the reading by the unknowns at clocks (n, arms; rad) about the centre."""
        waves = (np.ones_like(clock), np.cos(2 * clock), np.sin(2 * clock))
        return np.concatenate([wave[:, :, None] * self.hats[:, None, :] for wave in waves], axis=2)


def _knots(start: float, stop: float, hole: tuple[float, float]) -> np.ndarray:
    """Places of the knots (m): every 0.3 m or so on both sides of the hole."""
    low, high = np.clip(hole, start, stop)
    before = np.linspace(start, low, max(1, round((low - start) / _KNOT_M)) + 1)
    behind = np.linspace(high, stop, max(1, round((stop - high) / _KNOT_M)) + 1)
    knots = np.concatenate([before if low - start > 0.05 else [start], behind if stop - high > 0.05 else [stop]])
    return knots[np.concatenate([[True], np.diff(knots) > 1e-6])]


class Projector:
    """Takes the tool's offset, two unknowns per scan, out of weighted readings and of their derivatives.

    Parameters
    ----------
    clock : (n, arms) rad, about the centre of the pipe.
    root : (n, arms), square roots of the weights; 0 where an arm gave nothing.
    """

    def __init__(self, clock: np.ndarray, root: np.ndarray):
        self.root = root
        first = root * np.sin(clock)
        self._a = np.sqrt(np.maximum((first**2).sum(axis=1), 1e-12))
        self._first = first / self._a[:, None]
        second = root * np.cos(clock)
        self._mixed = (self._first * second).sum(axis=1)
        second = second - self._first * self._mixed[:, None]
        self._b = np.sqrt(np.maximum((second**2).sum(axis=1), 1e-12))
        self._second = second / self._b[:, None]

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Weighted values (n, arms) or (n, arms, m) without what an offset explains."""
        whole = values if values.ndim == 3 else values[:, :, None]
        out = whole * self.root[:, :, None]
        for q in (self._first, self._second):
            out -= q[:, :, None] * np.einsum("na,nam->nm", q, out)[:, None, :]
        return out if values.ndim == 3 else out[:, :, 0]

    def offset(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The offset (right, up; m) of each scan that explains values (n, arms) best."""
        weighted = values * self.root
        up = (self._second * weighted).sum(axis=1) / self._b
        return ((self._first * weighted).sum(axis=1) - self._mixed * up) / self._a, up


def roughness(
    place: np.ndarray, clock: np.ndarray, radius: np.ndarray, root: np.ndarray, hole: tuple[float, float], step: float | None
) -> float:
    """How fast the section bends here (m per knot): of `_ROUGH_M` the one under which the sound readings are most probable.

    Parameters
    ----------
    place, clock, radius : of the readings about the centre of the pipe; (n,), (n, arms), (n, arms).
    root : (n, arms) square roots of the weights, 0 for readings of the dent.
    hole : m, stretch of the dent.
    step : place (m) of a step of the wall, or None.
    """
    project = Projector(clock, root)
    target = project(radius).ravel()
    best = (-np.inf, _ROUGH_M[1])
    if not root.any():  # no sound reading: nothing speaks for or against
        return best[1]
    for rough in _ROUGH_M:
        model = SectionModel.build(place, hole, step, rough)
        design = project(model.design(clock)).reshape(target.size, -1)
        normal = design.T @ design
        right = design.T @ target
        whole = normal + model.penalty + 1e-12 * np.trace(normal) / len(normal) * np.eye(len(normal))
        solution = np.linalg.solve(whole, right)
        misfit = float(target @ target - right @ solution)
        bent = 3 * max(model.hats.shape[1] - 2 - (step is not None), 0)
        evidence = -0.5 * misfit - 0.5 * np.linalg.slogdet(whole)[1] - bent * np.log(rough)
        best = max(best, (evidence, rough))
    return best[1]
