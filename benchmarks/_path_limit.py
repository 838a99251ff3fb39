"""The least sigma of a path between markers, by one who knows all statistics of the sensors: the limit of `repeatability`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deform.synthetic import imu
from deform.synthetic.imu import DEG_PER_H, DEG_PER_SQRT_H, MICRO_G
from deform.synthetic.motion import TRAP_M
from deform.synthetic.simulate import Passage

STEP_M = 75.0
FREE_RAD, FREE_M = 0.1, 10.0  # sigma of what only the markers tell: first azimuth, first place
GRAVITY = 9.81
ROLL = 15  # column of `Motion.states`: roll of the tool


@dataclass(frozen=True)
class Limit:
    """Least standard deviations along, to the right and up (n, 3) at places (n,) along the pipe, in m."""

    places: np.ndarray
    sigma: np.ndarray


def path_limit(passage: Passage, grade: imu.Grade, markers: np.ndarray, marker_sigma: float) -> Limit:
    """Return the posterior of a path about which markers and sensors tell, by Gaussian prediction.

    Parameters
    ----------
    passage : gives time and roll at the places, and the tool's figures.
    grade : of the inertial unit, with its true noise.
    markers : chainages of the markers between the traps (m), each with ``marker_sigma`` in each axis.

    Notes
    -----
    To the right the path is the integral of the azimuth: a free first value, mounting that turns with the roll, random walk and
    biases (constant and wandering part) of the two gyros that roll about the vertical. Up it is that of the pitch as the
    forward accelerometer levels it, and the same mounting. Along it is the odometer's: the mean scale of the wheels and its wear.
    The wobble, pulses, slips, the random walk of the accelerometers and axes askew are left out, and so is what the earth's
    rotation tells of the azimuth: all of them are small beside these over a kilometre.
    """
    length, tool = passage.line.length, passage.tool
    places = np.arange(TRAP_M, length - TRAP_M, STEP_M)
    places = np.append(places, length - TRAP_M)
    time = passage.motion.passage(places)
    time[-1] = passage.motion.end
    roll = np.interp(time, *_roll(passage, time))
    n, way, seconds = places.size, np.diff(places), np.diff(time)
    along, over_time = _integral(way), _integral(seconds)
    turns = np.column_stack([np.cos(roll), np.sin(roll)])
    bias = _bias(time, grade, DEG_PER_H * grade.gyro_bias_deg_per_h)
    gyro = sum(over_time @ (np.outer(c, c) * bias) @ over_time.T for c in turns.T)
    azimuth = (
        FREE_RAD**2
        + gyro
        + (DEG_PER_SQRT_H * grade.gyro_random_walk_deg_per_sqrt_h) ** 2 * (np.minimum.outer(time, time) - time[0])
    )
    pitch = _bias(time, grade, MICRO_G * grade.accel_bias_ug) / GRAVITY**2
    aside, rise = along @ turns, along @ (turns[:, ::-1] * [-1.0, 1.0])  # mounting in azimuth and in pitch, as the tool rolls
    both = np.zeros((2 * n, 2 * n))
    both[:n, :n], both[n:, n:] = along @ azimuth @ along.T, along @ pitch @ along.T
    mounting = np.vstack([aside, rise])
    both += np.radians(tool.mounting_deg) ** 2 * mounting @ mounting.T
    both[:n, :n] += FREE_M**2
    both[n:, n:] += FREE_M**2
    run = places - places[0]
    wear = 0.5 * run**2 * tool.wheel_wear_per_km / 1000.0
    ahead = FREE_M**2 + tool.wheel_scale**2 / tool.wheels * np.outer(run, run) + np.outer(wear, wear)
    at = np.searchsorted(places, markers)
    at = np.concatenate([[0], at, [n - 1]])
    R = np.full(at.size, marker_sigma**2)
    R[[0, -1]] = tool.trap_noise_m**2
    timed = np.full(at.size, (tool.speed_m_per_s * tool.marker_time_noise_s) ** 2)
    timed[[0, -1]] = 0.0
    level = _posterior(both, np.concatenate([at, n + at]), np.concatenate([R, R]))
    return Limit(places, np.sqrt(np.column_stack([_posterior(ahead, at, R + timed), level[:n], level[n:]])))


def _roll(passage: Passage, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roll of the tool (radian), unwrapped, on a grid fine enough for it."""
    fine = np.arange(time[0], time[-1] + 10.0, 10.0)
    return fine, np.unwrap(passage.motion.states(fine)[:, ROLL])


def _integral(steps: np.ndarray) -> np.ndarray:
    """Matrix of the trapezoidal integral from the first place on."""
    n = steps.size + 1
    whole = np.tril(np.ones((n, n)), -1)[:, :-1] * steps
    return 0.5 * (np.pad(whole, ((0, 0), (0, 1))) + np.pad(whole, ((0, 0), (1, 0))))


def _bias(time: np.ndarray, grade: imu.Grade, sigma: float) -> np.ndarray:
    """Covariance of one sensor's bias: what it has at turn-on, and what wanders."""
    apart = np.abs(np.subtract.outer(time, time))
    return sigma**2 * (1.0 + grade.wander_part**2 * np.exp(-apart / grade.wander_s))


def _posterior(prior: np.ndarray, at: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Variance at all places, given measurements of variance R at some."""
    cross = prior[:, at]
    gain = np.linalg.solve(cross[at] + np.diag(R), cross.T).T
    return np.maximum(np.diag(prior) - np.einsum("ij,ij->i", gain, cross), 0.0)
