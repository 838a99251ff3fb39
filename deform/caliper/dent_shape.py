"""Sizes of a dent in, its smooth shape and the shape's derivatives out.

Notes
-----
    u(s, w) = depth * exp(-ln 10 * (|2 s / length|^p + |2 w / width|^q)),

inward, with s along the pipe and w around it at the middle of the dent, so that length and width are the full extents at a
tenth of the depth; p and q are the fullness along and around (2 is a bell, larger is fuller).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gamma
from typing import ClassVar

import numpy as np

LN10 = np.log(10.0)
DEPTH, PLACE, CLOCK, LENGTH, WIDTH, ALONG, AROUND = range(7)  # unknowns: log m, m, rad, log m, log rad, 1, 1
LEAST_FULL, MOST_FULL = 1.05, 8.0  # fullness: a cone, or nearly a box


@dataclass(frozen=True)
class DentFit:
    """A fitted dent; m and rad. The width is an arc on the outside of the pipe, as a ruler in the ditch finds it.

    Attributes
    ----------
    centre, clock : of the apex.
    depth, length, width : below the undamaged section; full extents at a tenth of the depth.
    along_power, around_power : fullness of the smooth shape.
    outer_radius : of the pipe.
    settled : false where the fit still moved in its last round; the sigmas then hold that step.
    """

    NUMBERS: ClassVar[tuple[str, ...]] = (
        "centre", "clock", "depth", "length", "width", "clock_sigma", "depth_sigma", "length_sigma", "width_sigma",
        "area", "slope",
    )  # fmt: skip
    centre: float
    clock: float
    depth: float
    length: float
    width: float
    clock_sigma: float
    depth_sigma: float
    length_sigma: float
    width_sigma: float
    outer_radius: float
    along_power: float = 2.0
    around_power: float = 2.0
    settled: bool = True

    def at(self, place: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """Inward departure (m) of the fitted shape at places (m) and clocks (rad), which broadcast."""
        sizes = np.array(
            [np.log(self.depth), self.centre, self.clock, np.log(self.length), np.log(self.width / self.outer_radius)]
        )
        return inward(np.append(sizes, [self.along_power, self.around_power]), np.asarray(place), np.asarray(clock))

    @property
    def area(self) -> float:
        """Area (m2) of the outside of the pipe that lies deeper than a tenth of the depth."""
        p, q = self.along_power, self.around_power
        quarter = gamma(1 + 1 / p) * gamma(1 + 1 / q) / gamma(1 + 1 / p + 1 / q)
        return self.length * self.width * quarter

    @property
    def slope(self) -> float:
        """Steepest slope of the shape (m per m), along or around the pipe through its apex."""
        steepest = []
        for size, power in ((self.length, self.along_power), (self.width, self.around_power)):
            x = ((power - 1.0) / (power * LN10)) ** (1.0 / power) if power > 1.0 else 0.0
            steepest.append(2.0 * self.depth / size * LN10 * power * x ** (power - 1.0) * np.exp(-LN10 * x**power))
        return float(max(steepest))


def relief(fits: Sequence[DentFit], place: np.ndarray, clock: np.ndarray) -> np.ndarray | float:
    """Sum of the fitted dents (m, positive inward) at places (m) and clocks (rad), which broadcast."""
    return sum((fit.at(place, clock) for fit in fits), start=0.0)


def wrap(angle):
    """Angles (rad) in -pi .. pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def inward(unknowns: np.ndarray, place: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Inward departure (m) at places (m) and clocks (rad), which broadcast; the width among the unknowns is log of rad."""
    along, around = _relative(unknowns, place, clock)
    return np.exp(unknowns[DEPTH] - LN10 * (along ** unknowns[ALONG] + around ** unknowns[AROUND]))


def inward_with_slopes(unknowns: np.ndarray, place: np.ndarray, clock: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inward departure (m), and its derivatives by the seven unknowns (..., 7)."""
    along, around = _relative(unknowns, place, clock)
    along, around = np.broadcast_arrays(np.maximum(along, 1e-9), np.maximum(around, 1e-9))
    p, q = unknowns[ALONG], unknowns[AROUND]
    first, second = along**p, around**q
    u = np.exp(unknowns[DEPTH] - LN10 * (first + second))
    slopes = np.empty((*u.shape, 7))
    slopes[..., DEPTH] = 1.0
    slopes[..., PLACE] = LN10 * p * first / along * 2.0 * np.sign(place - unknowns[PLACE]) / np.exp(unknowns[LENGTH])
    slopes[..., CLOCK] = LN10 * q * second / around * 2.0 * np.sign(wrap(clock - unknowns[CLOCK])) / np.exp(unknowns[WIDTH])
    slopes[..., LENGTH] = LN10 * p * first
    slopes[..., WIDTH] = LN10 * q * second
    slopes[..., ALONG] = -LN10 * first * np.log(along)
    slopes[..., AROUND] = -LN10 * second * np.log(around)
    slopes *= u[..., None]
    return u, slopes


def _relative(unknowns: np.ndarray, place: np.ndarray, clock: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the apex along and around, in halves of the length and of the width."""
    along = np.abs(place - unknowns[PLACE]) * (2.0 / np.exp(unknowns[LENGTH]))
    around = np.abs(wrap(clock - unknowns[CLOCK])) * (2.0 / np.exp(unknowns[WIDTH]))
    return along, around
