"""A motion and a grade of inertial unit in, the counts that it delivers out, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.errors import OptionError
from deform.options import ToolOptions
from deform.synthetic import _kernels
from deform.synthetic.motion import Motion
from deform.synthetic.route import stream

Floats = NDArray[Any]

PANEL_S = 0.005  # s, longest stretch over which motion is a parabola
BLOCK = 200_000  # samples
DEG_PER_H = np.pi / 180.0 / 3600.0
DEG_PER_SQRT_H = np.pi / 180.0 / 60.0
ARCSECOND = np.pi / 180.0 / 3600.0
MICRO_G = 9.80665e-6
FIGURES = (  # of a grade that the header of a run states
    "gyro_bias_deg_per_h",
    "gyro_random_walk_deg_per_sqrt_h",
    "gyro_scale_ppm",
    "accel_bias_ug",
    "accel_random_walk_ug_per_sqrt_hz",
    "accel_scale_ppm",
)


@dataclass(frozen=True)
class Grade:
    """One-sigma figures of an inertial unit, in makers' units, and its pulses."""

    rate_hz: float
    gyro_bias_deg_per_h: float
    gyro_random_walk_deg_per_sqrt_h: float
    gyro_scale_ppm: float
    accel_bias_ug: float
    accel_random_walk_ug_per_sqrt_hz: float
    accel_scale_ppm: float
    gyro_pulse_rad: float
    accel_pulse_m_per_s: float
    misalignment_rad: float = 5e-5
    wander_part: float = 0.2  # of the bias, Gauss-Markov
    wander_s: float = 1800.0


GRADES: dict[str, Grade] = {
    "navigation": Grade(100.0, 0.01, 0.002, 10.0, 50.0, 10.0, 50.0, 0.05 * ARCSECOND, 2e-5),
    # Li et al. (2014), table 1; scale of the gyros and pulses are not given there
    "li-2014": Grade(200.0, 0.01, 0.002, 10.0, 50.0, 10.0, 50.0, 0.05 * ARCSECOND, 2e-5),
    # Li et al. (2012), section 5.1; the random walk is not given there: this one would make his scatter of 0.008 degree
    "li-2012": Grade(200.0, 0.01, 0.0005, 10.0, 50.0, 10.0, 50.0, 0.05 * ARCSECOND, 2e-5),
    "tactical": Grade(100.0, 1.0, 0.1, 150.0, 500.0, 60.0, 200.0, 0.5 * ARCSECOND, 1e-4, 2e-4),
    # Honeywell H778 in Porter (1990), table 2-1 and §3.7
    "porter-1990": Grade(16.0, 10.0, 0.1, 500.0, 1000.0, 100.0, 500.0, 25.1787 * ARCSECOND, 0.0047625, 3e-4),
    "perfect": Grade(100.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-11, 1e-9, 0.0, 0.0),
}


@dataclass(frozen=True)
class Errors:
    """What is wrong with one unit in one run: biases (rad/s, m/s²) and the matrices that scale and shear its axes."""

    gyro_bias: Floats
    accel_bias: Floats
    gyro_matrix: Floats
    accel_matrix: Floats


def grade_of(tool: ToolOptions) -> Grade:
    """Return the grade that a tool names.

    Raises
    ------
    OptionError
        When there is no such grade.
    """
    if tool.imu not in GRADES:
        raise OptionError(f"simulation: tool.imu {tool.imu!r} is no grade; known are {', '.join(GRADES)}")
    return GRADES[tool.imu]


def rate_of(tool: ToolOptions) -> float:
    """Return the sampling rate of a tool's IMU (Hz)."""
    return tool.imu_rate_hz or grade_of(tool).rate_hz


def draw_errors(grade: Grade, rng: np.random.Generator) -> Errors:
    """Return the turn-on errors of one run."""
    shear = rng.normal(0.0, 1.0, (2, 3, 3)) * grade.misalignment_rad * (1.0 - np.eye(3))
    scale = rng.normal(0.0, 1e-6, (2, 3)) * np.array([[grade.gyro_scale_ppm], [grade.accel_scale_ppm]])
    return Errors(
        gyro_bias=rng.normal(0.0, 1.0, 3) * grade.gyro_bias_deg_per_h * DEG_PER_H,
        accel_bias=rng.normal(0.0, 1.0, 3) * grade.accel_bias_ug * MICRO_G,
        gyro_matrix=np.eye(3) + shear[0] + np.diag(scale[0]),
        accel_matrix=np.eye(3) + shear[1] + np.diag(scale[1]),
    )


def increments(motion: Motion, rate_hz: float, begin: float = 0.0, count: int | None = None) -> Floats:
    """Return the exact increments (n, 6) of a faultless unit in body axes: angle (rad), then velocity (m/s).

    Parameters
    ----------
    motion : the tool in the line.
    rate_hz : samples per second.
    begin : start of the first interval (second).
    count : number of samples; default to the end of the record.

    Notes
    -----
    Each is the integral over its interval of the inertial rate, or of the specific force, in the rotating axes of the body:
    coning and sculling are left in. Sample k covers begin + k / rate to begin + (k + 1) / rate.
    """
    dt = 1.0 / rate_hz
    n = int((motion.duration - begin) * rate_hz + 1e-6) if count is None else count
    out = np.empty((n, 6))
    panels = int(np.ceil(dt / PANEL_S - 1e-9))
    table, speed, step, mounting, vibration, hit_times, hit_signs = motion.tables
    _kernels.fill_increments(float(begin), dt, panels, table, speed, step, mounting, vibration, hit_times, hit_signs, out)
    return out


def counts(motion: Motion, tool: ToolOptions, errors: Errors, seed: int, name: str) -> Iterator[tuple[Floats, NDArray, NDArray]]:
    """Yield blocks of time (end of each sample), gyro counts and accelerometer counts (n, 3), int32, in sensor axes."""
    grade, rate = grade_of(tool), rate_of(tool)
    rng = stream(seed, name, "imu noise")
    to_sensor = np.array(tool.sensor_to_body, float).T
    total = int(motion.duration * rate + 1e-6)
    pulse = np.repeat([grade.gyro_pulse_rad, grade.accel_pulse_m_per_s], 3)
    remainder = np.zeros(6)
    sigma = wander_sigma(grade)
    wandering = rng.normal(0.0, 1.0, 6) * sigma
    for first in range(0, total, BLOCK):
        n = min(BLOCK, total - first)
        values = increments(motion, rate, first / rate, n)
        measured = np.empty_like(values)
        measured[:, :3] = values[:, :3] @ (errors.gyro_matrix @ to_sensor).T + errors.gyro_bias / rate
        measured[:, 3:] = values[:, 3:] @ (errors.accel_matrix @ to_sensor).T + errors.accel_bias / rate
        measured += noise(grade, rate, n, wandering, rng)
        out = np.empty((n, 6), np.int32)
        _kernels.quantize(measured, pulse, remainder, out)
        yield (first + 1 + np.arange(n)) / rate, out[:, :3], out[:, 3:]


def noise(grade: Grade, rate: float, count: int, wandering: Floats, rng: np.random.Generator) -> Floats:
    """Return the random part of increments (n, 6): random walk and wandering bias; ``wandering`` (6,) is carried on."""
    sigma = wander_sigma(grade)
    decay = np.exp(-1.0 / (rate * grade.wander_s))
    drive = rng.normal(0.0, 1.0, (count, 6)) * (sigma * np.sqrt(1.0 - decay**2))
    bias = np.empty((count, 6))
    _kernels.wander(drive, decay, wandering, bias)
    walk = np.repeat(
        [grade.gyro_random_walk_deg_per_sqrt_h * DEG_PER_SQRT_H, grade.accel_random_walk_ug_per_sqrt_hz * MICRO_G], 3
    )
    return bias / rate + rng.normal(0.0, 1.0, (count, 6)) * walk / np.sqrt(rate)


def wander_sigma(grade: Grade) -> Floats:
    """Return the standard deviation (6,) of the wandering part of the biases (rad/s, m/s²)."""
    return grade.wander_part * np.repeat([grade.gyro_bias_deg_per_h * DEG_PER_H, grade.accel_bias_ug * MICRO_G], 3)
