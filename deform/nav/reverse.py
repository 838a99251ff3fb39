"""A filter's problem in; the same run through backwards in time, and how both directions agree, out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels as k
from deform.nav import _kernels_state as kernels
from deform.nav.filter import Filtered, Problem, Start, run_forward
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reversed:
    """Result of the reverse pass, taken to forward time.

    Parameters
    ----------
    state : at the first bound, from all data behind it.
    difference : reverse minus forward start: position east, north, up (m), velocity, turning error (radian).
    sigma : of the difference.
    """

    filtered: Filtered
    state: Floats
    difference: Floats
    sigma: Floats


def reversed_epochs(epochs: Epochs) -> Epochs:
    """Return the epochs as they are when time runs backwards, the last first.

    Notes
    -----
    In the body axes of the epoch's end, with R, V, P, A, G the turn, velocity, position, time and travel integrals:
    R' = Rᵀ, V' = RᵀV, P' = Rᵀ(V T - P), A' = RᵀA, G' = -RᵀG. Velocity, earth rate and gyro bias change sign, force and
    gravity do not.

    References
    ----------
    CN103727938A, step 4 (he turns force and gravity instead of the velocity, which is the same).
    """
    table = epochs.table[::-1]
    out = table.copy()
    turn = table[:, :9].reshape(-1, 3, 3)
    T = table[:, k.DURATION, None]
    velocity, position = table[:, k.VELOCITY : k.VELOCITY + 3], table[:, k.POSITION : k.POSITION + 3]
    out[:, :9] = turn.transpose(0, 2, 1).reshape(-1, 9)
    out[:, k.VELOCITY : k.VELOCITY + 3] = np.einsum("nji,nj->ni", turn, velocity)
    out[:, k.POSITION : k.POSITION + 3] = np.einsum("nji,nj->ni", turn, velocity * T - position)
    for start, width, sign in ((k.ATTITUDE_TIME, 3, 1.0), (k.ATTITUDE_TRAVEL, 3, -1.0), (k.TURN_BY_AXIS, 3, -1.0),
                               (k.FORCE_BY_AXIS, 3, 1.0), (k.TURN_BY_SHEAR, 3, -1.0), (k.FORCE_BY_SHEAR, 5, 1.0)):  # fmt: skip
        block = table[:, start : start + 3 * width].reshape(-1, 3, width)
        out[:, start : start + 3 * width] = sign * (turn.transpose(0, 2, 1) @ block).reshape(-1, 3 * width)
    out[:, k.TRAVEL] = -table[:, k.TRAVEL]
    out[:, k.SENSE] = -table[:, k.SENSE]
    last = epochs.bounds[-1]
    return Epochs(last - epochs.bounds[::-1], epochs.time[-1] - epochs.time[::-1], out)


def run_backward(problem: Problem, end: Floats, variance: Floats) -> Reversed:
    """Filter the run backwards from a state at its end.

    Parameters
    ----------
    problem : the forward problem.
    end : state at the last bound, from a source of its own (the receiver's place, a levelling at rest there).
    variance : of its errors.

    Notes
    -----
    The instruments' parameters keep their meaning: their Jacobians are turned with the epochs, the gyro bias's sign with it.
    """
    n = problem.epochs.bounds.size - 1
    travel, marks = problem.travel, problem.marks
    state = end.copy()
    state[3:6] *= -1.0
    state[kernels.GYRO_BIAS : kernels.GYRO_BIAS + 3] *= -1.0
    back = replace(
        problem,
        epochs=reversed_epochs(problem.epochs),
        travel=replace(travel, speeds=-travel.speeds[::-1], variance=travel.variance[::-1].copy(),
                       stationary=travel.stationary[::-1],
                       along_shape=travel.along_shape[::-1], travel=travel.travel[::-1], tilt=travel.tilt[::-1].copy()),
        marks=replace(marks, index=marks.index[::-1], epoch=(n - marks.epoch[::-1]).copy(), place=marks.place[::-1].copy(),
                      variance=marks.variance[::-1], late=-marks.late[::-1], weight=marks.weight[::-1]),
        start=Start(state, np.diag(variance)),
    )  # fmt: skip
    filtered = run_forward(back)
    x = filtered.end.copy()
    x[3:6] *= -1.0
    x[kernels.GYRO_BIAS : kernels.GYRO_BIAS + 3] *= -1.0
    first = problem.start.state
    place = k.place_difference(x[0:3], first[0:3])
    D = x[6:15].reshape(3, 3) @ first[6:15].reshape(3, 3).T
    turn = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    sigma = np.sqrt(np.diag(filtered.covariance + problem.start.covariance)[:9])
    return Reversed(filtered, x, np.concatenate([place, x[3:6] - first[3:6], turn]), sigma)
