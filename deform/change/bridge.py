"""A datum and the pipe it rests on in, by how much its bridges over pipe without datum are worse than they claim out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change.datum import DriftModel, fit_drift

Floats = NDArray[Any]
_PHASES = 3  # sets of gaps, so that most of the pipe is tried
_PRIOR = 4.0  # gaps that say the claim is right: what few gaps say is not taken at its word
_WORST = 12.0  # squared misses beyond this are a movement that was not found, not noise
_BOUNDS = (0.7, 4.0)
_WIDTHS = 20.0 * 2.0 ** (0.5 * np.arange(10))  # m


class Bridges:
    """Honesty of a datum over stretches that carry none, learned from gaps in pipe that did not move.

    Parameters
    ----------
    place : (n,) scan axis (m).
    difference : (n, 3) run minus reference, east, north, up (m).
    axes : tangent, right, lift of the reference pipe, each (n, 3).
    quiet : (n,) true where the pipe serves as datum.
    model : statistics of the drift.
    floor : (3,) sigma of the differences about the datum, east, north, up (m).

    Notes
    -----
    Gaps as wide as a zone are cut into the stable pipe, the drift is fitted without them, and what it misses there is set against
    what it claims: short noise that is not white, and drift that is no random walk, show here and nowhere else.
    """

    def __init__(
        self,
        place: Floats,
        difference: Floats,
        axes: tuple[Floats, Floats, Floats],
        quiet: Floats,
        model: DriftModel,
        floor: Floats,
    ):
        self.place, self.difference, self.axes = place, difference, axes
        self.quiet, self.model, self.floor = quiet, model, floor
        self.known: dict[float, Floats] = {}

    def factor(self, width: float) -> Floats:
        """Return the factor on the claimed sigma of a bridge of a width (m): east, north, up (3,)."""
        width = float(_WIDTHS[np.argmin(np.abs(np.log(_WIDTHS / max(width, 1.0))))])
        if width not in self.known:
            self.known[width] = self._factor(width)
        return self.known[width]

    def _factor(self, width: float) -> Floats:
        period = max(4.0 * width, width + 120.0)
        squares = [self._misses(width, period, phase / _PHASES * period) for phase in range(_PHASES)]
        found = np.minimum(np.concatenate(squares), _WORST)
        level, up = found[:, :2].ravel(), found[:, 2]
        squared = [(part.sum() + _PRIOR) / (part.size + _PRIOR) for part in (level, level, up)]
        return np.clip(np.sqrt(squared), *_BOUNDS)

    def _misses(self, width: float, period: float, shift: float) -> Floats:
        """Mean squared miss over claim of each gap that lies in quiet pipe, (gaps, 3)."""
        along = self.place - self.place[0] - shift
        number, into = np.floor(along / period).astype(int), along % period
        gap = (into < width) & (number >= 0)
        datum = fit_drift(self.place, self.difference, self.axes, self.quiet & ~gap, self.model)
        with np.errstate(invalid="ignore"):
            ratio = (self.difference - datum.drift) ** 2 / (self.floor**2 + datum.variance)
        core = self.quiet & gap & (into > 0.25 * width) & (into < 0.75 * width) & np.isfinite(ratio).all(axis=1)
        last = number[core].max(initial=-1)
        inner = (number >= 1) & (number < last)  # at the ends of the line nothing holds the bridge from one side
        numbers, at = np.unique(number[core & inner], return_inverse=True)
        count = np.bincount(at, minlength=numbers.size)
        full = count * (self.place[1] - self.place[0]) > 0.3 * width
        sums = np.column_stack([np.bincount(at, ratio[core & inner, m], numbers.size) for m in range(3)])
        return sums[full] / count[full, None]


__all__ = ["Bridges"]
