"""Odometer, rests, markers and control points in; measurements on the epochs with their variances out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]

REST_SIGMA_M = 2e-4  # displacement of a tool at rest within one epoch
WOBBLE_RAD, WOBBLE_LENGTH_M = (
    math.radians(0.2),
    1.0,
)  # before the data have spoken: direction of travel in the body, and over what length
LEAST_DENSITY = 1e-8  # m² per m


@dataclass(frozen=True)
class TravelAid:
    """Displacement by the odometer along the tool: one measurement in three components per epoch.

    Parameters
    ----------
    speeds : (epoch + 1,) speed at the bounds (m/s).
    variance : (epoch, 3) along, to the right, up (m²); 0 = no measurement.
    stationary : (epoch,) the tool stands still: zero displacement.
    along_shape : (epoch,) variance along from the odometer's own sigma (m²).
    """

    speeds: Floats
    variance: Floats
    stationary: NDArray[np.bool_]
    along_shape: Floats


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

    def weighted(self, weight: Floats) -> MarkAid:
        """Return the same marks with other weights."""
        return replace(self, weight=weight)

    @property
    def used_variance(self) -> Floats:
        """Variance over weight."""
        return self.variance / self.weight[:, None]


def travel_aid(
    epochs: Epochs, speed: Floats, speed_sigma: Floats, stationary: NDArray[np.bool_], usable_gap_s: float = 0.0
) -> TravelAid:
    """Return the travel measurements with variances as they are before the data have spoken (`learn_noise` in `filter`).

    Parameters
    ----------
    speed, speed_sigma, stationary : on the samples, from `odometer.combine`.

    Notes
    -----
    The tool wobbles in the pipe: its axis leaves the pipe's by a random angle of sigma w that forgets itself over a length l.
    Summed over a distance s much longer than l, the path walks off with variance 2 w² l s: that density per metre, not w² per
    epoch, is what a filter with white noise needs. The same holds along the pipe for a speed error that lasts.
    """
    begin = epochs.bounds[:-1] + 1
    size = np.diff(epochs.bounds)
    still = np.add.reduceat(stationary[: epochs.bounds[-1] + 1].astype(np.int32), begin) == size
    sigma = np.add.reduceat(speed_sigma[: epochs.bounds[-1] + 1], begin) / size
    travel, seconds = np.abs(epochs.travel), epochs.duration
    along_shape = sigma**2 * seconds * np.maximum(1.0, seconds)
    cross = 2.0 * WOBBLE_RAD**2 * WOBBLE_LENGTH_M * travel + REST_SIGMA_M**2 + (0.02 * sigma * seconds) ** 2
    variance = np.column_stack([along_shape + REST_SIGMA_M**2, cross, cross])
    variance[still] = REST_SIGMA_M**2
    variance[epochs.gap > usable_gap_s] = 0.0
    return TravelAid(speed[epochs.bounds].astype(float), variance, still, along_shape)


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
