"""Odometer, rests, markers and control points in; measurements on the epochs with their variances out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]

REST_SIGMA_M = 2e-4  # displacement of a tool at rest within one epoch
RIDE_DENSITY = 2e-7  # m² per m: what is left of the ride across the pipe when the wobble is a state


@dataclass(frozen=True)
class TravelAid:
    """Displacement by the odometer along the tool: one measurement in three components per epoch.

    Parameters
    ----------
    speeds : (epoch + 1,) speed at the bounds (m/s).
    variance : (epoch, 3) along, to the right, up (m²); 0 = no measurement.
    stationary : (epoch,) the tool stands still: zero displacement.
    along_shape : (epoch,) variance along from the odometer's own sigma (m²).
    travel : (epoch,) odometer distance (m).
    tilt : (epoch, 2) direction of the pipe in the tool by the caliper's arms, to the right and up (radian), zero where unknown.
    """

    speeds: Floats
    variance: Floats
    stationary: NDArray[np.bool_]
    along_shape: Floats
    travel: Floats
    tilt: Floats

    def with_noise(self, along: float, right: float, up: float) -> TravelAid:
        """Return the aid with a factor on the odometer's own variance along, and densities (m² per m) to the right and up."""
        moving = ~self.stationary & (self.variance[:, 0] > 0)
        variance = self.variance.copy()
        variance[moving, 0] = along * self.along_shape[moving] + REST_SIGMA_M**2
        slip = 0.02**2 * self.along_shape[moving]
        variance[moving, 1] = right * self.travel[moving] + slip + REST_SIGMA_M**2
        variance[moving, 2] = up * self.travel[moving] + slip + REST_SIGMA_M**2
        return replace(self, variance=variance)


@dataclass(frozen=True)
class MarkAid:
    """Passages of points with known coordinates.

    Parameters
    ----------
    index : (mark,) row in the table the mark comes from.
    epoch : (mark,) bound at which it was passed, rising.
    place : (mark, 3) latitude, longitude (radian), height (m).
    variance : (mark, 3) along the horizontal track, across, up (m²).
    late : (mark,) time of the passage minus time of the bound (s).
    weight : (mark,) 1, or less for one that the others contradict.
    """

    index: NDArray[np.int64]
    epoch: NDArray[np.int64]
    place: Floats
    variance: Floats
    late: Floats
    weight: Floats

    def only(self, keep: NDArray[np.bool_]) -> MarkAid:
        """Return the marks that a mask keeps."""
        return MarkAid(*(getattr(self, name)[keep] for name in ("index", "epoch", "place", "variance", "late", "weight")))

    def weighted(self, weight: Floats) -> MarkAid:
        """Return the same marks with other weights."""
        return replace(self, weight=weight)

    @property
    def used_variance(self) -> Floats:
        """Variance over weight."""
        return self.variance / self.weight[:, None]


def travel_aid(
    epochs: Epochs, speed: Floats, speed_sigma: Floats, stationary: NDArray[np.bool_], across: float = RIDE_DENSITY
) -> TravelAid:
    """Return the travel measurements with variances as they are before the data have spoken (`noise.learn`).

    Parameters
    ----------
    speed, speed_sigma, stationary : on the samples, from `odometer.combine`.
    across : density of the noise across the pipe (m² per m).

    Notes
    -----
    The tool wobbles in the pipe: its axis leaves the pipe's by a random angle of sigma w that forgets itself over a length l.
    Summed over a distance s much longer than l, the path walks off with variance 2 w² l s. A model that holds the wobble as
    a state needs little noise besides; one that does not needs the density 2 w² l, not w² per epoch.
    """
    begin = epochs.bounds[:-1] + 1
    size = np.diff(epochs.bounds)
    still = np.add.reduceat(stationary[: epochs.bounds[-1] + 1].astype(np.int32), begin) == size
    sigma = np.add.reduceat(speed_sigma[: epochs.bounds[-1] + 1], begin) / size
    travel, seconds = np.abs(epochs.travel), epochs.duration
    along_shape = sigma**2 * seconds * np.maximum(1.0, seconds)
    variance = np.full((len(travel), 3), REST_SIGMA_M**2)
    variance[epochs.gap > 0] = 0.0
    aid = TravelAid(speed[epochs.bounds].astype(float), variance, still, along_shape, travel, np.zeros((len(travel), 2)))
    return aid.with_noise(1.0, across, across)


def mark_aid(epochs: Epochs, time: Floats, place: Floats, sigma: Floats, time_sigma_s: float) -> MarkAid:
    """Return the passages that lie on the run.

    Parameters
    ----------
    time : (mark,) s, NaN for a passage not heard.
    place : (mark, 3) latitude, longitude (radian), height (m).
    sigma : (mark, 2) horizontal, vertical (m).
    time_sigma_s : error of a passage's time; it works along the track by the speed of the moment.
    """
    inside = np.isfinite(time) & (time >= epochs.time[0] - 0.5) & (time <= epochs.time[-1] + 0.5) & np.isfinite(place).all(axis=1)
    index = np.flatnonzero(inside)
    index = index[np.argsort(time[index], kind="stable")]
    t = time[index]
    right = np.clip(np.searchsorted(epochs.time, t), 1, epochs.time.size - 1)
    epoch = np.where(epochs.time[right] - t < t - epochs.time[right - 1], right, right - 1).astype(np.int64)
    before = np.clip(epoch - 1, 0, None)
    after = np.clip(epoch, None, len(epochs.table) - 1)
    speed = (epochs.travel[before] + epochs.travel[after]) / (epochs.duration[before] + epochs.duration[after])
    horizontal, vertical = sigma[index, 0] ** 2, sigma[index, 1] ** 2
    variance = np.column_stack([horizontal + (speed * time_sigma_s) ** 2, horizontal, vertical])
    return MarkAid(index, epoch, place[index], variance, t - epochs.time[epoch], np.ones(index.size))
