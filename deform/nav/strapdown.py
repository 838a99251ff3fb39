"""Counts of the inertial unit in, increments per epoch and mechanized positions, velocities and attitudes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels
from deform.nav._kernels import COLUMNS
from deform.nav.profile import Profile

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Counts:
    """What the kernels need of an inertial unit.

    Parameters
    ----------
    time : (sample,) end of each interval (s).
    gyro, accel : (sample, 3) pulses since the sample before.
    gyro_pulse, accel_pulse : radian and m/s of one pulse.
    table : (15, 3) from `compensation.compensation_table`.
    step : usual interval (s); well beyond it samples are missing.
    """

    time: Floats
    gyro: NDArray[np.int32]
    accel: NDArray[np.int32]
    gyro_pulse: float
    accel_pulse: float
    table: Floats
    step: float

    @property
    def arguments(self) -> tuple:
        """Leading arguments of the kernels."""
        return self.time, self.gyro, self.accel, self.gyro_pulse, self.accel_pulse, self.table


@dataclass(frozen=True)
class Epochs:
    """Integrals between successive bounds.

    Parameters
    ----------
    bounds : (epoch + 1,) sample indices.
    time : (epoch + 1,) their times (s).
    table : (epoch, COLUMNS) integrals, see `_kernels`.
    """

    bounds: NDArray[np.int64]
    time: Floats
    table: Floats

    @property
    def duration(self) -> Floats:
        """Duration of each epoch (s)."""
        return self.table[:, _kernels.DURATION]

    @property
    def travel(self) -> Floats:
        """Odometer distance in each epoch (m)."""
        return self.table[:, _kernels.TRAVEL]

    @property
    def gap(self) -> Floats:
        """Time without samples in each epoch (s)."""
        return self.table[:, _kernels.GAP]

    @property
    def side_force(self) -> Floats:
        """Acceleration across the track in each epoch (m/s²): speed times rate of the turn about other axes than the forward."""
        turn = self.table[:, _kernels.TURN : _kernels.TURN + 9].reshape(-1, 3, 3)
        across = 0.5 * np.hypot(turn[:, 2, 1] - turn[:, 1, 2], turn[:, 1, 0] - turn[:, 0, 1])
        return np.abs(self.travel) * across / self.duration**2


def epoch_bounds(time: Floats, interval: float, extra: Floats | None = None) -> NDArray[np.int64]:
    """Return sample indices about ``interval`` apart, first, last and the samples next to the times ``extra`` among them."""
    grid = np.arange(time[0] + interval, time[-1], interval)
    if extra is not None and len(extra):
        inside = extra[(extra > time[0]) & (extra < time[-1])]
        near = (
            np.abs(grid[np.clip(np.searchsorted(grid, inside), 0, max(grid.size - 1, 0))] - inside)
            if grid.size
            else inside * np.inf
        )
        grid = np.sort(np.concatenate([grid, inside[near > 1e-3]]))
    right = np.clip(np.searchsorted(time, grid), 1, time.size - 1)
    index = np.where(time[right] - grid < grid - time[right - 1], right, right - 1)
    return np.unique(np.concatenate([[0], index, [time.size - 1]])).astype(np.int64)


def preintegrate(counts: Counts, travel: Profile | Floats, bounds: NDArray[np.int64]) -> Epochs:
    """Integrate the counts between the bounds in body axes: turn, velocity, position, their Jacobians, and the travel.

    Parameters
    ----------
    travel : the odometer's profile, of which the distance is taken; or distances (sample,) of samples at regular times (m).
    bounds : (epoch + 1,) sample indices, from `epoch_bounds`.

    Notes
    -----
    Counts are integrals in rotating axes. With g, a the angular and velocity increments of a sample and p, b those of the one
    before: rotation vector g + (1/12) p × g (coning), velocity a + ½ g × a + (1/6) g × (g × a) + (1/12)(p × a + b × g)
    (rotation, sculling).
    The integrals are in the axes of the epoch's beginning, frozen in inertial space: nothing of the navigation state is in them,
    so that filter, smoother and reverse pass run over epochs alone.

    References
    ----------
    Savage (1998), J. Guidance 21, 19-28 and 208-221; Porter (1990), eq. 3-37; CN103727938A, step 3 (filter at 1 s, transition
    accumulated at the navigation rate).
    """
    profile = travel if isinstance(travel, Profile) else Profile.through(counts.time, travel)
    table = np.empty((bounds.size - 1, COLUMNS))
    arguments = (*counts.arguments, *profile.arguments, bounds, counts.step, table)
    _kernels.preintegrate(*arguments)
    return Epochs(bounds, counts.time[bounds], table)


def mechanize(epochs: Epochs, place: Floats, velocity: Floats, attitude: Floats) -> tuple[Floats, Floats, Floats]:
    """Integrate the local-level mechanization over the epochs, without any aid.

    Parameters
    ----------
    place : latitude, longitude (radian), height (m) at the first bound.
    velocity : east, north, up (m/s).
    attitude : matrix (3, 3), body to east, north, up.

    Returns
    -------
    places (epoch + 1, 3), velocities (epoch + 1, 3), attitudes (epoch + 1, 3, 3).

    References
    ----------
    Porter (1990), eq. 3-22 to 3-37.
    """
    n = len(epochs.table)
    places, velocities, attitudes = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3, 3))
    places[0], velocities[0], attitudes[0] = place, velocity, attitude
    for k in range(n):
        _kernels.advance(
            epochs.table[k], places[k], velocities[k], attitudes[k], places[k + 1], velocities[k + 1], attitudes[k + 1]
        )
    return places, velocities, attitudes
