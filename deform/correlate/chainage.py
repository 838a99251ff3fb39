"""Welds matched between the reference and a run in, the map between their chainages out, with sigma and where it holds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from deform.errors import Fault, InputError


@dataclass(frozen=True)
class ChainageMap:
    """Monotone map between reference chainage and a run's own chainage, linear from weld to weld.

    Attributes
    ----------
    run : id of the run.
    reference, own : chainage of the welds that both have (n), metre; ``reference`` rises, ``own`` rises, or falls for a run
        whose listing counts against the reference.
    node_sigma : standard deviation of the map at the welds, metre.
    broken : stretches of the reference chainage (k, 2) where the pipe was replaced or re-routed between the two runs.
    residual : departure of each weld from the line through its neighbours, metre (what a wrong or displaced weld would show).
    """

    run: str
    reference: np.ndarray
    own: np.ndarray
    node_sigma: float = 0.03
    broken: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))

    def __post_init__(self) -> None:
        """Refuse nodes that are not monotone."""
        step = np.diff(self.own)
        if self.reference.size < 2 or (np.diff(self.reference) <= 0).any() or not ((step > 0).all() or (step < 0).all()):
            rule = f"{self.reference.size} welds that do not run in one direction; a map needs two at least, in order"
            raise InputError(Fault(self.run, "chainage map", rule))

    @property
    def direction(self) -> int:
        """+1 when the run's chainage rises with the reference's, -1 when it falls."""
        return 1 if self.own[-1] > self.own[0] else -1

    @property
    def start(self) -> float:
        """Reference chainage of the first common weld (metre)."""
        return float(self.reference[0])

    @property
    def end(self) -> float:
        """Reference chainage of the last common weld (metre)."""
        return float(self.reference[-1])

    @property
    def residual(self) -> np.ndarray:
        """Departure of each inner weld from the line through its two neighbours (n - 2), metre."""
        share = (self.reference[1:-1] - self.reference[:-2]) / (self.reference[2:] - self.reference[:-2])
        return self.own[1:-1] - (self.own[:-2] + share * (self.own[2:] - self.own[:-2]))

    def to_run(self, chainage):
        """Chainage in the run (metre) of reference chainages; beyond the ends the mean scale goes on, and `valid` is false."""
        return _piecewise(np.asarray(chainage, float), self.reference, self.own)

    def to_reference(self, chainage):
        """Reference chainage (metre) of chainages of the run; the inverse of `to_run`."""
        sign = self.direction
        return _piecewise(np.asarray(chainage, float) * sign, self.own * sign, self.reference)

    def sigma(self, chainage):
        """Standard deviation (metre) of `to_run`: that of the welds, growing away from them where the map does not hold.

        Notes
        -----
        Inside a replaced stretch a place has no partner: a tenth of the distance to the next common weld is added. Beyond the
        ends half a percent of the distance is added, the scale error of a run that no weld controls.
        """
        s = np.asarray(chainage, float)
        beyond = np.maximum(self.start - s, 0.0) + np.maximum(s - self.end, 0.0)
        inside = np.zeros(s.shape)
        for first, last in self.broken:
            inside = np.maximum(inside, np.where((s > first) & (s < last), np.minimum(s - first, last - s), 0.0))
        return np.sqrt(self.node_sigma**2 + (0.005 * beyond) ** 2 + (0.1 * inside) ** 2)

    def valid(self, chainage):
        """True where the map holds: between the outermost common welds and outside replaced or re-routed stretches."""
        s = np.asarray(chainage, float)
        good = (s >= self.start - 1e-9) & (s <= self.end + 1e-9)
        for first, last in self.broken:
            good &= ~((s > first) & (s < last))
        return good


def identity_map(run: str, places: np.ndarray, sigma: float = 0.0) -> ChainageMap:
    """Map of the reference run into itself."""
    places = np.unique(np.asarray(places, float))
    return ChainageMap(run, places, places.copy(), sigma)


def _piecewise(s: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Linear interpolation; beyond the ends the mean slope of the whole."""
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    inside = np.interp(s, x, y)
    inside = np.where(s < x[0], y[0] + slope * (s - x[0]), inside)
    return np.where(s > x[-1], y[-1] + slope * (s - x[-1]), inside)
