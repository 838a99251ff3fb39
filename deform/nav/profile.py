"""Distance, speed and rest at regular knots in; the same at any time, and per epoch, out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_path

Floats = NDArray[Any]


@dataclass(frozen=True)
class Profile:
    """Travel of the tool as a cubic between knots: small beside the samples, whatever their rate.

    Parameters
    ----------
    start, step : time of the first knot and their spacing (s).
    distance : (knot,) metre, never falling.
    slope : (knot,) speed at the knots (m/s).
    sigma : (knot,) standard deviation of the speed (m/s).
    still : (knot,) no wheel turns and the inertial unit is quiet.
    doubt : (knot,) further standard deviation of the speed, which no experience of the wheels makes less (m/s).
    lone : one wheel alone tells it.
    """

    start: float
    step: float
    distance: Floats
    slope: Floats
    sigma: Floats
    still: NDArray[np.bool_]
    doubt: Floats
    lone: bool = False

    @classmethod
    def through(cls, time: Floats, distance: Floats, sigma: float = 2e-3) -> Profile:
        """Return the profile through distances at regular times, at rest where the distance stands."""
        step = float(time[-1] - time[0]) / max(time.size - 1, 1)
        distance = np.asarray(distance, float)
        still = np.diff(distance, append=distance[-1]) == 0.0
        slope = _kernels_path.limited_slopes(distance, step)
        return cls(float(time[0]), step, distance, slope, np.full(distance.size, sigma), still, np.zeros(distance.size))

    @property
    def arguments(self) -> tuple:
        """Arguments of the kernels: start, step, distance, slope."""
        return self.start, self.step, self.distance, self.slope

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return distance (m), speed, its sigma (m/s) and rest at times (s)."""
        times = np.ascontiguousarray(times, float)
        n = times.size + 1
        out = np.empty(n), np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, bool)
        sigma = np.hypot(self.sigma, self.doubt)
        arguments = (times, self.start, self.start, self.step, self.distance, self.slope, sigma, self.still, out)
        _kernels_path.knots_to_samples(*arguments)
        distance, speed, sigma, still = (a[1:] for a in out)
        return distance, speed, sigma, still

    def per_epoch(self, bounds: Floats) -> tuple[Floats, Floats, Floats]:
        """Return speed at the bounds (epoch + 1,), mean sigma of the speed and rest of the epochs between them (epoch,).

        Parameters
        ----------
        bounds : (epoch + 1,) s, rising.
        """
        moving = np.concatenate([[0], np.cumsum(~self.still)])
        u = np.clip((bounds - self.start) / self.step, 0.0, self.sigma.size - 1.0)
        first = np.floor(u[:-1] + 1e-6).astype(np.int64)
        last = np.minimum(np.ceil(u[1:] - 1e-6).astype(np.int64), self.still.size - 1)
        return self.at(bounds)[1], self.mean_per_epoch(self.sigma, bounds), moving[last + 1] == moving[first]

    def mean_per_epoch(self, values: Floats, bounds: Floats) -> Floats:
        """Return the means (epoch,) of values at the knots between bounds (epoch + 1,), s, rising."""
        gained = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
        u = np.clip((bounds - self.start) / self.step, 0.0, values.size - 1.0)
        return np.diff(np.interp(u, np.arange(gained.size), gained)) / np.maximum(np.diff(u), 1e-9)
