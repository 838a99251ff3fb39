"""The maker's figures and the wanted model in, the error state with its noise, composed of named blocks, out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_lyapunov

from deform.errors import OptionError
from deform.nav import _kernels_state as kernels
from deform.nav.compensation import STANDARD_GRAVITY
from deform.run.raw import RunHeader

Floats = NDArray[np.float64]

WOBBLE_LENGTHS_M = (3.0, 6.0, 12.0)  # of the components of the wobble; a corner lies at 2 pi times its length
# Sigma of each before the data have spoken. Of the sets of lengths tried these gave simulated and demonstration runs the greatest
# likelihood.
WOBBLE_DEG = (0.05, 0.05, 0.05)
# The pipe guides the tool: over this length, which the data correct, the wobble is about zero in the mean (what stays is sag and
# mounting, states of their own). Beyond 2 pi times this its spectrum falls with the square of the wavelength.
MEAN_M = 300.0
SWAY_VARIANCE = 2.0  # of what drives a component of the wobble, against the component's own
SHEAR_RAD = 1e-4  # askewness of a triad's axes that makers do not state
SCALE_WALK = 3e-6  # of the odometer's scale per root metre, where wheels do not tell it (`nav.wheel_scale.wander`)
LEVER_M = 1.0  # of the unit before the point that keeps to the line: the middle between a tool's cups, the rear axle of a car
LEAN_RAD = 5e-3  # per m/s² of specific force: by how much springs and tyres, or cups, let the axis give way
GAP_PUSH = 0.3  # m/s per root second of a gap: what the tool may gain in speed unseen
BIAS_CORRELATION_S = 8e4  # an hour then takes a bias away by three tenths of its sigma

NAVIGATED = ("position", "velocity", "attitude")


@dataclass(frozen=True)
class Block:
    """A part of the error state behind position, velocity and attitude.

    Parameters
    ----------
    name : one of `SLOTS`.
    size : number of states.
    sigma : first standard deviation, of a Gauss-Markov state also its steady one.
    correlation_s : correlation time of a Gauss-Markov state (s), 0 for a constant.
    walk : random walk per root metre of travel.
    """

    name: str
    size: int
    sigma: float
    correlation_s: float = 0.0
    walk: float = 0.0


SLOTS = {
    "gyro_bias": kernels.B_GYRO_BIAS,
    "accel_bias": kernels.B_ACCEL_BIAS,
    "gyro_scale": kernels.B_GYRO_SCALE,
    "accel_scale": kernels.B_ACCEL_SCALE,
    "gyro_shear": kernels.B_GYRO_SHEAR,
    "accel_shear": kernels.B_ACCEL_SHEAR,
    "mounting": kernels.B_MOUNTING,
    "scale": kernels.B_SCALE,
    "delay": kernels.B_DELAY,
    "sag": kernels.B_SAG,
    "wobble": kernels.B_WOBBLE,
    "sway": kernels.B_SWAY,
    "mean": kernels.B_MEAN,
    "tilt": kernels.B_TILT,
    "distance": kernels.B_DISTANCE,
    "course": kernels.B_COURSE,
    "lever": kernels.B_LEVER,
    "lean": kernels.B_LEAN,
}
# wobble: direction of the pipe against the tool's axis, to the right and up, for each component; sway: what drives each of these;
# mean: running mean of the wobble, which is taken off it
# gyro_shear: what the forward gyro sees of turns about right and up, the right one of that about up; what the others see of the
# roll works as a mounting does
# accel_shear: what those right and up see of each other's force, the forward one of right and up, those of the forward one's
# tilt: share of the tilt seen by the caliper's arms, to the right and up, that is true, for each band of waves
# distance: along the pipe since the last weld; course: azimuth of the straight stretch the tool is in
# lever: of the unit before the point that keeps to the line of the pipe; lean: direction of travel in the tool to the right per
# specific force from the right, up per force along

# The configurations: blocks, and whether the position is dead-reckoned by the odometer instead of integrated from velocity.
MODELS: dict[str, tuple[tuple[str, ...], bool]] = {
    "inertial": (("gyro_bias", "accel_bias"), False),
    "odometer": (("gyro_bias", "accel_bias", "mounting", "scale", "delay"), True),
    "full": (
        (
            *("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "gyro_shear", "accel_shear"),
            *("mounting", "scale", "delay", "sag", "wobble", "sway", "mean", "tilt"),
        ),
        False,
    ),
}


@dataclass(frozen=True)
class ErrorModel:
    """The composed error state.

    Parameters
    ----------
    name : name of the configuration.
    blocks : behind the nine of position (east, north, up), velocity, attitude (turning error about east, north, up).
    reckoned : the position follows the odometer, not the velocity.
    at : (slot,) index of the first state of each slot, -1 when absent.
    variance : (n,) first variance of each state behind the nine, zero in the nine.
    walk, travel_walk : (n,) variance per second, per metre.
    tau, reach : (n,) correlation time (s) and length (m), 0 for none.
    steady : (n,) steady variance of Gauss-Markov states, 0 elsewhere.
    unknown : variance per second of gap of the velocity, and per radian of turn of the attitude.
    """

    name: str
    blocks: tuple[Block, ...]
    reckoned: bool
    at: NDArray[np.int64]
    variance: Floats
    walk: Floats
    travel_walk: Floats
    tau: Floats
    reach: Floats
    steady: Floats
    unknown: Floats

    @property
    def size(self) -> int:
        """Number of error states."""
        return self.walk.size

    def index(self, name: str) -> slice:
        """Where a block, or one of the navigated three, stands in the error state."""
        if name in NAVIGATED:
            return slice(3 * NAVIGATED.index(name), 3 * NAVIGATED.index(name) + 3)
        first = int(self.at[SLOTS[name]])
        return slice(first, first + kernels.SIZE_OF[SLOTS[name]]) if first >= 0 else slice(0, 0)

    def with_wobble(self, variance: Floats) -> ErrorModel:
        """Return the model with other variances of the wobble (component, right and up) in radian²."""
        first, steady = self.variance.copy(), self.steady.copy()
        for name, factor in (("wobble", 1.0), ("sway", SWAY_VARIANCE)):
            first[self.index(name)] = steady[self.index(name)] = factor * np.ravel(variance)
        return replace(self, variance=first, steady=steady)

    def first_covariance(self) -> Floats:
        """Return the first covariance (n, n) of the states behind the nine, in the nine zero."""
        P = np.diag(self.variance)
        for axis in (0, 1) if self.index("wobble").stop else ():
            here = self.ride_states(axis)
            P[np.ix_(here, here)] = self.ride_covariance(axis)
        return P

    def ride_states(self, axis: int) -> NDArray[np.int64]:
        """Return where wobble, sway and mean of an axis (0 right, 1 up) stand in the error state."""
        index = np.arange(self.size)
        return np.concatenate([index[self.index(name)][axis::2] for name in ("wobble", "sway", "mean")])

    def ride_system(self, axis: int) -> Floats:
        """Return the system matrix (1/m) of the states of `ride_states`: the mean follows the wobble, each component its sway."""
        n, rate = kernels.WAVES, 1.0 / self.reach[self.ride_states(axis)]
        A = -np.diag(rate)
        A[:n, n : 2 * n] = np.diag(rate[:n])
        A[-1, :n] = rate[-1]
        return A

    def ride_covariance(self, axis: int, component: int | None = None) -> Floats:
        """Return the long run's covariance of the states of `ride_states`, or what one component alone adds to it."""
        n, here, A = kernels.WAVES, self.ride_states(axis), self.ride_system(axis)
        push = np.zeros_like(A)
        for c in range(n) if component is None else (component,):
            push[n + c, n + c] = 2.0 * SWAY_VARIANCE * self.variance[here[c]] / self.reach[here[c]]
        return solve_continuous_lyapunov(A, -push)

    def ride_slope(self, axis: int) -> Floats:
        """Return the slope of that covariance to the logarithm of the length of the mean."""
        A, P = self.ride_system(axis), self.ride_covariance(axis)
        change = np.zeros_like(A)
        change[-1] = -A[-1]
        return solve_continuous_lyapunov(A, -(change @ P + P @ change.T))

    def with_mean(self, length_m: Floats) -> ErrorModel:
        """Return the model with other lengths (2,) of the mean of the wobble (m), right and up."""
        reach = self.reach.copy()
        reach[self.index("mean")] = length_m
        return replace(self, reach=reach)

    def with_wander(self, walk: float) -> ErrorModel:
        """Return the model with another random walk of the odometer's scale, per root metre of travel."""
        travel_walk = self.travel_walk.copy()
        travel_walk[self.index("scale")] = walk**2
        return replace(self, travel_walk=travel_walk)

    def with_biases(self, correlation_s: Floats) -> ErrorModel:
        """Return the model with other correlation times of gyro and accelerometer bias (s)."""
        tau = self.tau.copy()
        tau[self.index("gyro_bias")], tau[self.index("accel_bias")] = correlation_s
        return replace(self, tau=tau)

    @property
    def arguments(self) -> tuple:
        """Noise arguments of the kernels."""
        return self.at, self.reckoned, self.walk, self.travel_walk, self.tau, self.reach, self.steady, self.unknown


def compose(name: str, header: RunHeader, joints: bool = False, straight: bool = False, corners: bool = False) -> ErrorModel:
    """Return an error model for a tool.

    Parameters
    ----------
    name : ``inertial`` (Porter's 15 states), ``odometer`` (the 19 of CN103727938A) or ``full`` (the 19, with scale and skew of
        the sensors, the sag and wobble of the tool in the pipe, position by the inertial unit).
    header : the maker's one-sigma figures.
    joints, straight : with a state for the distance since the last weld, for the azimuth of a straight stretch.
    corners : with states for the lever and the lean of a vehicle that is pushed aside in its turns.

    References
    ----------
    Porter (1990), eq. 3-51; CN103727938A, step 1.

    Raises
    ------
    OptionError
        When the name is unknown, or joints are wanted of a model whose position follows the odometer.
    """
    if name not in MODELS:
        raise OptionError(f"error model {name!r} is unknown; known are {', '.join(MODELS)}")
    names, reckoned = MODELS[name]
    if joints and reckoned:
        raise OptionError(f"error model {name!r} reckons by the odometer: lengths of joints can tell it nothing; use 'full'")
    wanted = (("distance",) if joints else (), names, ("course",) if straight else (), ("lever", "lean") if corners else ())
    names = tuple(chain.from_iterable(wanted))
    return assemble(name, blocks_of(header, names), reckoned, header)


def blocks_of(header: RunHeader, names: Sequence[str]) -> tuple[Block, ...]:
    """Return the named blocks with the figures of the header."""
    imu = header.imu
    figures = {
        "gyro_bias": (max(math.radians(imu.gyro_bias_deg_per_h) / 3600.0, 1e-12), BIAS_CORRELATION_S, 0.0),
        "accel_bias": (max(imu.accel_bias_ug, 1e-3) * 1e-6 * STANDARD_GRAVITY, BIAS_CORRELATION_S, 0.0),
        "gyro_scale": (max(imu.gyro_scale_ppm, 1e-3) * 1e-6, 0.0, 0.0),
        "accel_scale": (max(imu.accel_scale_ppm, 1e-3) * 1e-6, 0.0, 0.0),
        "gyro_shear": (max(imu.gyro_scale_ppm * 1e-6, SHEAR_RAD), 0.0, 0.0),
        "accel_shear": (max(imu.accel_scale_ppm * 1e-6, SHEAR_RAD), 0.0, 0.0),
        "mounting": (math.radians(0.5), 0.0, 0.0),
        "scale": (max(header.odometer.scale_error, 1e-4), 0.0, SCALE_WALK),
        "delay": (0.05, 0.0, 0.0),
        "sag": (math.radians(0.1), 0.0, 0.0),
        "wobble": (0.0, 0.0, 0.0),
        "sway": (0.0, 0.0, 0.0),
        "mean": (0.0, 0.0, 0.0),
        "tilt": (1.0, 0.0, 0.0),
        "distance": (0.0, 0.0, 0.0),
        "course": (math.pi, 0.0, 0.0),
        "lever": (LEVER_M, 0.0, 0.0),
        "lean": (LEAN_RAD, 0.0, 0.0),
    }
    return tuple(Block(name, kernels.SIZE_OF[SLOTS[name]], *figures[name]) for name in names)


def assemble(name: str, blocks: Sequence[Block], reckoned: bool, header: RunHeader) -> ErrorModel:
    """Lay the blocks one behind the other."""
    n = 9 + sum(b.size for b in blocks)
    at = np.full(kernels.BLOCKS, -1, np.int64)
    variance, walk, travel_walk, tau, reach, steady = (np.zeros(n) for _ in range(6))
    imu = header.imu
    walk[3:6] = (imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 * STANDARD_GRAVITY) ** 2
    walk[6:9] = (math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0) ** 2
    first = 9
    for block in blocks:
        here = slice(first, first + block.size)
        at[SLOTS[block.name]] = first
        variance[here], tau[here], travel_walk[here] = block.sigma**2, block.correlation_s, block.walk**2
        if block.name in ("wobble", "sway"):
            factor = SWAY_VARIANCE if block.name == "sway" else 1.0
            variance[here], reach[here] = factor * np.repeat(np.radians(WOBBLE_DEG) ** 2, 2), np.repeat(WOBBLE_LENGTHS_M, 2)
        if block.name == "mean":
            reach[here] = MEAN_M
        steady[here] = variance[here] * ((tau[here] > 0) | (reach[here] > 0))
        first += block.size
    known = at[SLOTS["gyro_scale"]] >= 0 and at[SLOTS["gyro_shear"]] >= 0
    turn = 0.0 if known else 3.0 * max(imu.gyro_scale_ppm * 1e-6, SHEAR_RAD)  # radian per root radian
    unknown = np.array([GAP_PUSH**2, turn**2])
    return ErrorModel(name, tuple(blocks), reckoned, at, variance, walk, travel_walk, tau, reach, steady, unknown)
