"""The maker's figures and the wanted model in, the error state with its noise, composed of named blocks, out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.errors import OptionError
from deform.nav import _kernels_filter as kernels
from deform.run.raw import RunHeader

Floats = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665

WOBBLE_DEG, WOBBLE_M = 0.15, 10.0  # before the data have spoken: the tool's axis against the pipe's, and over what length

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
    correlation_m : correlation length of a Gauss-Markov state along the pipe (m), 0 for a constant.
    """

    name: str
    size: int
    sigma: float
    correlation_s: float = 0.0
    walk: float = 0.0
    correlation_m: float = 0.0


SLOTS = {
    "gyro_bias": kernels.B_GYRO_BIAS,
    "accel_bias": kernels.B_ACCEL_BIAS,
    "gyro_scale": kernels.B_GYRO_SCALE,
    "accel_scale": kernels.B_ACCEL_SCALE,
    "mounting": kernels.B_MOUNTING,
    "scale": kernels.B_SCALE,
    "delay": kernels.B_DELAY,
    "sag": kernels.B_SAG,
    "wobble": kernels.B_WOBBLE,
    "tilt": kernels.B_TILT,
}
# wobble: direction of travel in the pipe against the tool's axis, to the right and up, and the slopes of both along the pipe
# tilt: share of the tilt seen by the caliper's arms, to the right and up, that is true
SIZES = {
    "gyro_bias": 3,
    "accel_bias": 3,
    "gyro_scale": 3,
    "accel_scale": 3,
    "mounting": 2,
    "scale": 1,
    "delay": 1,
    "sag": 1,
    "wobble": 4,
    "tilt": 2,
}

# The configurations: blocks, and whether the position is dead-reckoned by the odometer instead of integrated from velocity.
MODELS: dict[str, tuple[tuple[str, ...], bool]] = {
    "inertial": (("gyro_bias", "accel_bias"), False),
    "odometer": (("gyro_bias", "accel_bias", "mounting", "scale", "delay"), True),
    "full": (
        ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "mounting", "scale", "delay", "sag", "wobble", "tilt"),
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
    unknown : variance per second of gap of the attitude, of the velocity, and per radian of turn of the attitude.
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
        return slice(first, first + SIZES[name]) if first >= 0 else slice(0, 0)

    def with_wobble(self, right: float, up: float, reach: float) -> ErrorModel:
        """Return the model with another wobble: sigma to the right and up (radian), correlation length (m)."""
        here = self.index("wobble")
        variance, steady, length = self.variance.copy(), self.steady.copy(), self.reach.copy()
        variance[here] = steady[here] = right**2, up**2, (right / reach) ** 2, (up / reach) ** 2
        length[here] = reach
        return replace(self, variance=variance, steady=steady, reach=length)

    @property
    def arguments(self) -> tuple:
        """Noise arguments of the kernels."""
        return self.walk, self.travel_walk, self.tau, self.reach, self.steady, self.unknown


def compose(name: str, header: RunHeader, bias_correlation_s: float = 3600.0, scale_walk: float = 3e-6) -> ErrorModel:
    """Return an error model for a tool.

    Parameters
    ----------
    name : ``inertial`` (Porter's 15 states), ``odometer`` (the 19 of CN103727938A) or ``full`` (the 19, with scale factors of the
        sensors and the sag of the tool in the pipe, position by the inertial unit).
    header : the maker's one-sigma figures.
    bias_correlation_s : correlation time of the biases.
    scale_walk : wander of the odometer's scale per root metre.

    References
    ----------
    Porter (1990), eq. 3-51; CN103727938A, step 1.

    Raises
    ------
    OptionError
        When the name is unknown.
    """
    if name not in MODELS:
        raise OptionError(f"error model {name!r} is unknown; known are {', '.join(MODELS)}")
    names, reckoned = MODELS[name]
    return assemble(name, blocks_of(header, names, bias_correlation_s, scale_walk), reckoned, header)


def blocks_of(header: RunHeader, names: Sequence[str], bias_correlation_s: float, scale_walk: float) -> tuple[Block, ...]:
    """Return the named blocks with the figures of the header."""
    imu = header.imu
    figures = {
        "gyro_bias": (max(math.radians(imu.gyro_bias_deg_per_h) / 3600.0, 1e-12), bias_correlation_s, 0.0),
        "accel_bias": (max(imu.accel_bias_ug, 1e-3) * 1e-6 * STANDARD_GRAVITY, bias_correlation_s, 0.0),
        "gyro_scale": (max(imu.gyro_scale_ppm, 1e-3) * 1e-6, 0.0, 0.0),
        "accel_scale": (max(imu.accel_scale_ppm, 1e-3) * 1e-6, 0.0, 0.0),
        "mounting": (math.radians(0.5), 0.0, 0.0),
        "scale": (max(header.odometer.scale_error, 1e-4), 0.0, scale_walk),
        "delay": (0.05, 0.0, 0.0),
        "sag": (math.radians(0.1), 0.0, 0.0),
        "wobble": (math.radians(WOBBLE_DEG), 0.0, 0.0, WOBBLE_M),
        "tilt": (1.0, 0.0, 0.0),
    }
    return tuple(Block(name, SIZES[name], *figures[name]) for name in names)


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
        reach[here] = block.correlation_m
        steady[here] = block.sigma**2 if block.correlation_s > 0 or block.correlation_m > 0 else 0.0
        if block.name == "wobble":  # sigma of its slope along the pipe
            variance[first + 2 : first + 4] = steady[first + 2 : first + 4] = (block.sigma / block.correlation_m) ** 2
        first += block.size
    unknown = np.array([math.radians(2.0) ** 2, 0.1**2, (3.0 * imu.gyro_scale_ppm * 1e-6) ** 2])
    return ErrorModel(name, tuple(blocks), reckoned, at, variance, walk, travel_walk, tau, reach, steady, unknown)
