"""Differences of two runs on the scan axis in, what the search for waves reads of them out: means over pieces, weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels

Floats = NDArray[Any]


@dataclass(frozen=True)
class Signals:
    """What the search for movement looks at, on the scan axis.

    Attributes
    ----------
    place : (n,) regular scan axis (m).
    difference : (n, 3) run minus reference, east, north, up (m); NaN where unknown.
    right, lift : (n, 3) axes of the reference pipe.
    curvature : (n, 2) change of horizontal and vertical curvature (1/m), NaN where unknown.
    curvature_sigma : (n, 2) its standard deviation.
    gauge_length : of the curvature (m).
    """

    place: Floats
    difference: Floats
    right: Floats
    lift: Floats
    curvature: Floats
    curvature_sigma: Floats
    gauge_length: float

    @property
    def step(self) -> float:
        """Spacing of the scan axis (m)."""
        return float(self.place[1] - self.place[0])

    @cached_property
    def curvature_weight(self) -> Floats:
        """(n, 2) inverse variance of the change of curvature (m²), zero where it is not known."""
        known = np.isfinite(self.curvature) & (self.curvature_sigma > 0)
        return 1.0 / np.where(known, self.curvature_sigma, np.inf) ** 2

    @cached_property
    def usual_weight(self) -> Floats:
        """(2,) median of the weights of the known curvature, infinite where none is known."""
        columns = (column[column > 0] for column in self.curvature_weight.T)
        return np.array([np.median(known) if known.size else np.inf for known in columns])

    @cached_property
    def weighted_curvature(self) -> Floats:
        """(n, 2) change of curvature times its weight, zero where it is not known."""
        return np.where(self.curvature_weight > 0, self.curvature, 0.0) * self.curvature_weight


@dataclass(frozen=True)
class Nodes:
    """Means of the signals over pieces of equal length of the scan axis.

    Attributes
    ----------
    size, step : places of a piece, and its length (m).
    place : (m,) middles of the pieces (m).
    still : (m,) true where the whole piece may serve for the noise floor.
    unknown : (m,) true where a difference is not known.
    value : (3, m) differences east, north, up, zero where unknown.
    shift : (3, m) what one metre along the pipe of one run is at the other, across the reference pipe (1).
    right, lift : (m, 3) unit vectors across the reference pipe, to the right and up.
    """

    size: int
    step: float
    place: Floats
    still: Floats
    unknown: Floats
    value: Floats
    shift: Floats
    right: Floats
    lift: Floats

    @classmethod
    def of(cls, signals: Signals, quiet: Floats, size: int) -> Nodes:
        """The signals over pieces of so many places; ``quiet`` (n,) is true where the pipe may serve for the noise floor."""
        count = signals.place.size // size
        difference, right, lift = (_means(part, size) for part in (signals.difference, signals.right, signals.lift))
        right /= np.maximum(np.sqrt(np.einsum("ij,ij->i", right, right)), 1e-9)[:, None]
        value, shift = (np.ascontiguousarray(np.nan_to_num(part).T) for part in (difference, np.cross(lift, right)))
        unknown = np.asarray(~np.isfinite(difference).all(axis=1))
        unknown[:1] = unknown[-1:] = True
        place, still = (part[: count * size].reshape(count, size) for part in (signals.place, np.asarray(quiet)))
        return cls(
            size, size * signals.step, place.mean(axis=1), np.asarray(still.all(axis=1)), unknown, value, shift, right, lift
        )


def _means(values: Floats, size: int) -> Floats:
    """Means of the rows of so many places (m, columns), NaN where fewer than half are known."""
    out = np.empty((len(values) // size, values.shape[1]))
    _kernels.block_means(np.ascontiguousarray(values), size, out)
    return out
