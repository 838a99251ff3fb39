"""A recording of a unit that is laid at rest in several orientations in; mean force and rate of each set with sigmas out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.nav import _kernels
from deform.nav.compensation import STANDARD_GRAVITY
from deform.nav.strapdown import Counts
from deform.run.raw import ImuHeader

Floats = NDArray[np.float64]

LEAST_REST_S, MARGIN_S = 60.0, 5.0
MOVING_DEG_PER_S = 0.05  # rate, beyond the one that is there most of the time, at which a unit is being laid over
MOVING_SHARE = 0.002  # of gravity by which the force may change at rest


@dataclass(frozen=True)
class RestSets:
    """Means over rests.

    Parameters
    ----------
    force, rate : (k, 3) body axes (m/s², rad/s).
    force_sigma, rate_sigma : (k,) of a mean: random walk, pulse, and of the force the scale errors that gravity meets.
    spans : (k, 2) begin and end (s).
    bias_sigma : the maker's one-sigma figures of accelerometer bias (m/s²) and gyro drift (rad/s).
    """

    force: Floats
    rate: Floats
    force_sigma: Floats
    rate_sigma: Floats
    spans: Floats
    bias_sigma: tuple[float, float]

    def __add__(self, other: RestSets) -> RestSets:
        """Sets of two recordings under the same power-up."""
        force, rate, force_sigma, rate_sigma, spans = (
            np.concatenate([getattr(s, name) for s in (self, other)])
            for name in ("force", "rate", "force_sigma", "rate_sigma", "spans")
        )
        return RestSets(force, rate, force_sigma, rate_sigma, spans, self.bias_sigma)


def rest_sets(counts: Counts, imu: ImuHeader, spans: Sequence[tuple[float, float]] | None = None) -> RestSets:
    """Return the means of each rest.

    Parameters
    ----------
    counts : of the recording, from `navigate.counts_of`.
    imu : the maker's figures.
    spans : (begin, end) of each rest (s); None finds them: no turn and no change of force for a minute or more.

    Raises
    ------
    InputError
        When a span holds no data, or no rest is found.
    """
    spans = find_rests(counts) if spans is None else list(spans)
    if not spans:
        rule = f"holds no rest of {LEAST_REST_S:.0f} s"
        raise InputError(Fault("imu.nc", "gyro_count, accel_count", rule, "a calibration needs the unit laid at rest"))
    means, faults = [], []
    for begin, end in spans:
        first, last = np.searchsorted(counts.time, [begin, end])
        last = min(int(last), counts.time.size - 1)
        if last - first < 2 or counts.time[last] - counts.time[first] < 0.5 * (end - begin):
            faults.append(Fault("imu.nc", "time", f"has no data for the rest from {begin:g} to {end:g} s"))
            continue
        means.append(_means(counts, int(first), last))
    if faults:
        raise InputError(faults)
    table = np.array(means)
    force_sigma, rate_sigma = _sigmas(counts, imu, table[:, 6])
    bias = imu.accel_bias_ug * 1e-6 * STANDARD_GRAVITY, math.radians(imu.gyro_bias_deg_per_h) / 3600.0
    return RestSets(table[:, 3:6], table[:, :3], force_sigma, rate_sigma, np.array(spans, float), bias)


def find_rests(counts: Counts) -> list[tuple[float, float]]:
    """Return begin and end (s) of the rests in a recording, without the seconds next to a movement."""
    time = counts.time
    edges = np.searchsorted(time, np.arange(time[0], time[-1], 1.0))
    edges = np.unique(np.append(edges, time.size - 1))
    rows = np.array([_means(counts, int(a), int(b)) for a, b in pairwise(edges)])
    usual = np.median(rows[:, :3], axis=0)
    still = np.linalg.norm(rows[:, :3] - usual, axis=1) < math.radians(MOVING_DEG_PER_S)
    change = np.linalg.norm(np.diff(rows[:, 3:6], axis=0, prepend=rows[:1, 3:6]), axis=1)
    still &= change < MOVING_SHARE * STANDARD_GRAVITY
    ends = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))).reshape(-1, 2)
    found = [(float(time[edges[a]]) + MARGIN_S, float(time[edges[b]]) - MARGIN_S) for a, b in ends]
    return [(begin, end) for begin, end in found if end - begin >= LEAST_REST_S - 2.0 * MARGIN_S]


def _means(counts: Counts, first: int, last: int) -> Floats:
    arguments = (*counts.arguments, counts.step, first, last)
    return _kernels.running_sums(*arguments)


def _sigmas(counts: Counts, imu: ImuHeader, seconds: Floats) -> tuple[Floats, Floats]:
    walk = math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 / np.sqrt(seconds)
    push = imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 * STANDARD_GRAVITY / np.sqrt(seconds)
    scale = imu.accel_scale_ppm * 1e-6 * STANDARD_GRAVITY
    pulse = 1.0 / math.sqrt(6.0) / seconds  # of a sum of pulses with the remainder carried, both ends uneven
    return np.sqrt(push**2 + scale**2 + (pulse * counts.accel_pulse) ** 2), np.hypot(walk, pulse * counts.gyro_pulse)
