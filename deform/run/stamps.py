"""Time stamps of a recording in, its usual step and the samples that are missing between two stamps out: one rule for all."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

LOST_IN_STEPS = 1.5  # usual steps beyond which a sample is missing
MOST_BRIDGED = 5  # missing samples over which rate and force are taken to go on; more of them are a gap
_STEPS_LOOKED_AT = 100_000


def usual_step(time: NDArray[Any]) -> float:
    """Return the median step of stamps (s); of a long recording that of steps spread over it, NaN of less than two stamps.

    Examples
    --------
    >>> usual_step(np.array([0.0, 0.5, 1.0, 3.0]))
    0.5
    """
    if time.size < 2:
        return float("nan")
    if time.size <= _STEPS_LOOKED_AT:
        return float(np.median(np.diff(time)))
    places = np.linspace(0, time.size - 2, _STEPS_LOOKED_AT).astype(np.int64)
    return float(np.median(time[places + 1] - time[places]))


@njit(cache=True, error_model="numpy")
def lost_before(time, i, usual):
    """Number of samples that are missing before sample i: its step is too long, and neither neighbour's is short for it.

    A late stamp is followed, or preceded, by a step that is as much too short: nothing is lost there.
    """
    dt = time[i] - time[i - 1]
    if dt <= LOST_IN_STEPS * usual:
        return 0
    if i + 1 < time.size and time[i + 1] - time[i - 1] <= (LOST_IN_STEPS + 1.0) * usual:
        return 0
    if i > 1 and time[i] - time[i - 2] <= (LOST_IN_STEPS + 1.0) * usual:
        return 0
    return max(round(dt / usual) - 1, 1)


def losses(time: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the samples before which others are missing, and how many.

    Examples
    --------
    >>> at, lost = losses(np.array([0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 17.0, 18.0]))
    >>> at.tolist(), lost.tolist()
    ([4, 7], [1, 9])
    """
    time = np.ascontiguousarray(time, float)
    usual = usual_step(time)
    long = np.flatnonzero(np.diff(time) > LOST_IN_STEPS * usual) + 1
    lost = np.array([lost_before(time, i, usual) for i in long], np.int64)
    return long[lost > 0], lost[lost > 0]
