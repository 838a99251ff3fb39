"""A filter's problem in; the same run through backwards in time, and how both directions agree, out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels as k
from deform.nav import _kernels_state as kernels
from deform.nav.aiding import SpanAid
from deform.nav.filter import Filtered, Problem, Start, run_forward
from deform.nav.smoother import Smoothed
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

PLACES = 40  # at which both directions are compared
LIMIT_SIGMA = 4.5
WIDENED = 10.0  # times the smoothed sigma: what the backward run is told of its begin
LEAST_SIGMA_M = 10.0


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
    out[:, k.TRAVEL], out[:, k.GAP_TRAVEL] = -table[:, k.TRAVEL], -table[:, k.GAP_TRAVEL]
    expected = table[:, k.GAP_EXPECTED : k.GAP_EXPECTED + 3]
    out[:, k.GAP_EXPECTED : k.GAP_EXPECTED + 3] = -np.einsum("nji,nj->ni", turn, expected)
    out[:, k.SENSE] = -table[:, k.SENSE]
    last = epochs.bounds[-1]
    return Epochs(last - epochs.bounds[::-1], epochs.time[-1] - epochs.time[::-1], out)


def reversed_problem(problem: Problem, end: Floats, variance: Floats) -> Problem:
    """Return the problem as it is when time runs backwards, begun at a state at the last bound.

    ``variance`` (9,) is that of its place, velocity and attitude; the instruments begin as before any data.
    """
    n = problem.epochs.bounds.size - 1
    travel, marks = problem.travel, problem.marks
    state = end.copy()
    state[3:6] *= -1.0
    state[kernels.GYRO_BIAS : kernels.GYRO_BIAS + 3] *= -1.0
    covariance = problem.model.first_covariance()
    covariance[:9, :9] = np.diag(variance)
    return replace(
        problem,
        epochs=reversed_epochs(problem.epochs),
        travel=replace(travel, speeds=-travel.speeds[::-1], variance=travel.variance[::-1].copy(),
                       stationary=travel.stationary[::-1],
                       along_shape=travel.along_shape[::-1], doubt=travel.doubt[::-1],
                       travel=travel.travel[::-1], tilt=travel.tilt[::-1].copy()),
        marks=replace(marks, index=marks.index[::-1], epoch=(n - marks.epoch[::-1]).copy(), place=marks.place[::-1].copy(),
                      variance=marks.variance[::-1], late=-marks.late[::-1], weight=marks.weight[::-1]),
        spans=SpanAid(resting=problem.spans.resting[::-1].copy()),  # the backward run checks the forward one without the others
        about=_reversed_states(problem.about),
        start=Start(state, covariance),
    )  # fmt: skip


def _reversed_states(states: Floats) -> Floats:
    """Return states at the bounds as they are when time runs backwards."""
    out = states[::-1].copy()
    out[:, 3:6] *= -1.0
    out[:, kernels.GYRO_BIAS : kernels.GYRO_BIAS + 3] *= -1.0
    wobble, sway = (slice(c, c + 2 * kernels.WAVES) for c in (kernels.WOBBLE, kernels.SWAY))
    out[:, sway] = 2.0 * out[:, wobble] - out[:, sway]  # what drives a component is ahead of it in either direction
    return out


@dataclass(frozen=True)
class Agreement:
    """Forward and backward run at the same places, neither with the data of the other.

    Parameters
    ----------
    time : (place,) s.
    difference : (place, 4) backward minus forward: east, north, up (m), azimuth (radian).
    sigma : (place, 4) of the difference.
    """

    time: Floats
    difference: Floats
    sigma: Floats

    @property
    def square(self) -> float:
        """Mean square of the differences over their sigmas, about 1 when all sigmas are honest."""
        return float(np.mean((self.difference / self.sigma) ** 2))

    def remark(self) -> str:
        """Say where both contradict each other; empty when they agree."""
        size = np.abs(self.difference) / self.sigma
        place, what = np.unravel_index(int(np.argmax(size)), size.shape)
        if size[place, what] < LIMIT_SIGMA:
            return ""
        far = np.linalg.norm(self.difference[place, :3])
        turned = math.degrees(self.difference[place, 3])
        return (
            f"forward and backward processing differ by {far:.2f} m and {turned:.3f} degree at t={self.time[place]:.1f} s, "
            f"{size[place, what]:.1f} sigma: an aid or a sensor is worse there than its sigma says"
        )


def compared(problem: Problem) -> list[int]:
    """Return the bounds at which both directions are compared, rising."""
    n = problem.epochs.bounds.size - 1
    return np.unique(np.linspace(0, n, PLACES + 2).round().astype(int)[1:-1]).tolist()


def agreement(problem: Problem, filtered: Filtered, smoothed: Smoothed) -> Agreement:
    """Run backwards from the end and compare with the forward run on the way.

    Parameters
    ----------
    problem : with learned noise and final weights of the marks.
    filtered : its forward pass, with the states at the bounds `compared`.
    smoothed : gives the place and attitude about which the backward run begins, with ten times their sigma.

    Notes
    -----
    The forward run up to a bound and the backward run down to it share no measurement, only what was known beforehand of the
    instruments, so that their difference must lie within the root of the sum of both variances. Instruments begin at what the
    maker says, in both.

    References
    ----------
    CN103727938A, step 4.
    """
    n, bounds = problem.epochs.bounds.size - 1, compared(problem)
    back = reversed_problem(problem, *_end(problem, smoothed))
    behind = run_forward(back, at=[n - bound for bound in bounds[::-1]])
    rows = []
    for (x, P), (y, Q) in zip(filtered.passed, behind.passed[::-1], strict=True):
        turn = turning_error(y, x)
        rows.append((*k.place_difference(y[0:3], x[0:3]), turn[2], *np.sqrt(np.diag(P + Q)[[0, 1, 2, 8]])))
    table = np.array(rows).reshape(-1, 8)
    return Agreement(problem.epochs.time[bounds], table[:, :4], table[:, 4:])


def turning_error(state: Floats, other: Floats) -> Floats:
    """Return the turn about east, north, up (radian) from the attitude of another state to that of a state."""
    D = state[6:15].reshape(3, 3) @ other[6:15].reshape(3, 3).T
    return 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])


def _end(problem: Problem, smoothed: Smoothed) -> tuple[Floats, Floats]:
    """Begin of the backward run: place, velocity and attitude of the smoothed end, widely; instruments as before any data."""
    state = problem.start.state.copy()
    state[:15] = smoothed.states[-1, :15]
    variance, sigma = np.empty(9), smoothed.sigma[-1]
    speed = float(np.linalg.norm(state[3:6]))
    variance[0:3] = np.maximum(WIDENED * sigma[0:3], LEAST_SIGMA_M) ** 2
    variance[3:6] = (0.05 + 0.1 * speed) ** 2
    variance[6:9] = np.minimum(WIDENED * sigma[6:9], [0.2, 0.2, 1.0]) ** 2
    return state, variance


def run_backward(problem: Problem, end: Floats, variance: Floats) -> Reversed:
    """Filter the run backwards from a state at its end.

    Parameters
    ----------
    problem : the forward problem.
    end : state at the last bound, from a source of its own (the receiver's place, a levelling at rest there).
    variance : (9,) of the errors of its place (m²), velocity, attitude (radian²); instruments begin as before any data.

    Notes
    -----
    The instruments' parameters keep their meaning: their Jacobians are turned with the epochs, the gyro bias's sign with it.
    """
    back = reversed_problem(problem, end, variance)
    filtered = run_forward(back)
    x = filtered.end.copy()
    x[3:6] *= -1.0
    x[kernels.GYRO_BIAS : kernels.GYRO_BIAS + 3] *= -1.0
    first = problem.start.state
    place = k.place_difference(x[0:3], first[0:3])
    turn = turning_error(x, first)
    sigma = np.sqrt(np.diag(filtered.covariance + problem.start.covariance)[:9])
    return Reversed(filtered, x, np.concatenate([place, x[3:6] - first[3:6], turn]), sigma)
