"""Welds as the arms saw them and as the other channels heard them in, the error of the scan clock and of the rings' place out."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import xarray as xr

from deform.caliper.weld_channels import DETECTOR, Channel

logger = logging.getLogger(__name__)

_REACH_S = 3.0  # clocks further apart than this are another run's
_RATES = np.linspace(-600e-6, 600e-6, 241)
_BIN_S = 0.025
_RINGS_S = 0.1  # a tool rings no longer after a weld
_FEW, _SHARE = 12, 0.4  # pairs that a clock error must explain, at least, and the share of the rarer channel's welds
_WORTH_M = 0.015  # an error that moves no scan by more than this is left alone
_MISPLACED_M = 0.05  # less of a constant shift is taken out of the weld log alone
_SURE = 6.0
_MIXED_SPEED = 0.1  # spread of the speed over its mean, from which on a late clock and a misplaced ring can be told apart


@dataclass(frozen=True)
class ClockError:
    """What the scans' clock and the rings' place want: time = scan time - late - rate * (scan time - middle), place + ahead.

    Attributes
    ----------
    late : s, at the middle of the run.
    rate : s per s.
    middle : s.
    ahead : m, to be added to each ring's distance from the inertial unit.
    pairs : welds that tell.
    """

    late: float
    rate: float
    middle: float
    ahead: float
    pairs: int

    def right(self, time: np.ndarray) -> np.ndarray:
        """Scan times (s) on the clock of the inertial unit."""
        return time - self.late - self.rate * (time - self.middle)


def clock_error(arms: Channel, heard: list[Channel], trajectory: xr.Dataset, sign: int) -> ClockError | None:
    """Return the error of the scan clock against the inertial unit's, or None where there is none to speak of.

    Parameters
    ----------
    arms : welds as one ring saw them, at the chainage that the scans have by their own clock.
    heard : the other channels, on the clock of the inertial unit.
    trajectory : group ``trajectory``.
    sign : +1 for a run downstream.

    Notes
    -----
    A late or drifting clock moves what the arms see by speed times error; a misplaced ring by a constant. The line through
    the differences of time that most pairs of events lie on is looked for among rates of up to 600 ppm, then adjusted.
    Where the speed hardly changes a constant error cannot be told from a misplaced ring: it is then taken for the ring's.
    Where the detector can tell, its word is taken. A tool rings after it was hit, so that the accelerometers hear a weld late by
    a constant time that is not known: of an error against them only what is larger than that is believed.
    """
    for channel in sorted(heard, key=lambda c: c.name != DETECTOR):
        told, found = _line(arms, channel, trajectory, sign)
        if told:
            return found
    return None


def _line(arms: Channel, channel: Channel, trajectory: xr.Dataset, sign: int) -> tuple[bool, ClockError | None]:
    """Whether two channels share enough welds to tell the error, and the error that is worth a word."""
    time, speed = _at(arms.place, trajectory, sign)
    other, _ = _at(channel.place, trajectory, sign)
    order = np.argsort(other)
    first, last = np.searchsorted(other[order], time - _REACH_S), np.searchsorted(other[order], time + _REACH_S)
    index = np.repeat(np.arange(time.size), last - first)
    if index.size < _FEW:
        return False, None
    partner = order[np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])]
    apart = time[index] - other[partner]
    middle = 0.5 * float(trajectory["time"].values[0] + trajectory["time"].values[-1])
    since = time[index] - middle
    rate, late, pairs = _most(since, apart)
    if pairs < max(_FEW, _SHARE * min(time.size, channel.place.size)):
        logger.warning("welds: %s and %s share no clock: only %d events fit together", arms.name, channel.name, pairs)
        return False, None
    near = np.abs(apart - late - rate * since) < 2 * _BIN_S
    rings = 0.0 if channel.name == DETECTOR else _RINGS_S
    return True, _adjusted(since[near], apart[near], speed[index][near], middle, rings)


def _at(place: np.ndarray, trajectory: xr.Dataset, sign: int) -> tuple[np.ndarray, np.ndarray]:
    """Time at which the inertial unit is at places (m), and its speed there (m/s)."""
    chainage, time = sign * trajectory["chainage"].values, trajectory["time"].values
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(chainage)) > 0])
    return np.interp(sign * place, chainage[keep], time[keep]), np.interp(
        sign * place, chainage[keep], trajectory["speed"].values[keep]
    )


def _most(since: np.ndarray, apart: np.ndarray) -> tuple[float, float, int]:
    """Rate and lateness of the line on which most pairs lie, and how many."""
    best = (0.0, 0.0, 0)
    bins = np.arange(-_REACH_S, _REACH_S + _BIN_S, _BIN_S)
    for rate in _RATES:
        count, _ = np.histogram(apart - rate * since, bins)
        both = count[1:] + count[:-1]
        k = int(np.argmax(both))
        if both[k] > best[2]:
            best = (float(rate), float(bins[k + 1]), int(both[k]))
    return best


def _adjusted(since: np.ndarray, apart: np.ndarray, speed: np.ndarray, middle: float, rings: float) -> ClockError | None:
    """Least squares on the pairs, in metres, outliers down-weighted; constant parts below ``rings`` (s) are no error."""
    mixed = float(np.std(speed)) > _MIXED_SPEED * float(np.mean(speed))
    columns = [speed * since, np.ones_like(speed)] + ([speed] if mixed else [])
    design, moved = np.stack(columns, axis=1), speed * apart
    weight = np.ones(moved.size)
    solution = np.zeros(design.shape[1])
    for _ in range(10):
        root = np.sqrt(weight)
        solution, *_ = np.linalg.lstsq(design * root[:, None], moved * root, rcond=None)
        left = moved - design @ solution
        sigma = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
        weight = np.clip(1.0 - (left / (5.0 * sigma)) ** 2, 0.0, None) ** 2
    covariance = np.linalg.inv(design.T @ (weight[:, None] * design)) * sigma**2
    constants = np.array([1.0] + [float(np.mean(speed))] * mixed) * solution[1:]
    solution[1:][np.abs(constants) < rings * float(np.mean(speed))] = 0.0
    late = solution[2] if mixed else 0.0
    worst = float(np.max(np.abs(design @ solution)))
    drift = abs(solution[0]) * float(np.mean(speed)) * float(np.ptp(since))
    sure = abs(solution[0]) > _SURE * np.sqrt(covariance[0, 0]) and drift > _WORTH_M
    if mixed and abs(late) > _SURE * np.sqrt(covariance[2, 2]) and abs(late) * float(np.mean(speed)) > _WORTH_M:
        sure = True
    sure |= abs(solution[1]) > max(_MISPLACED_M, _SURE * float(np.sqrt(covariance[1, 1])))
    if not sure or worst < _WORTH_M:
        return None
    return ClockError(float(late), float(solution[0]), middle, float(-solution[1]), int((weight > 0.2).sum()))
