"""Counts of a tool at rest or on its way in, first attitude with its sigma and how it was found out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry import earth
from deform.geometry.rotation import matrix_to_attitude
from deform.nav import _kernels, _kernels_alignment
from deform.nav.aiding import TravelAid
from deform.nav.strapdown import Counts, Epochs
from deform.run.raw import ImuHeader, RunHeader

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

LEAST_REST_S = 45.0
MOTION_S = 900.0


@dataclass(frozen=True)
class Alignment:
    """First attitude.

    Parameters
    ----------
    attitude : matrix (3, 3), body to east, north, up, at ``time``.
    time : s on the tool's clock.
    sigma : (3,) standard deviation (radian) of the turning error about east, north, up.
    method : ``static``, ``in motion`` or ``given``.
    span : (begin, end) of the data used (s).
    """

    attitude: Floats
    time: float
    sigma: Floats
    method: str
    span: tuple[float, float]

    @property
    def angles(self) -> tuple[float, float, float]:
        """Azimuth, pitch, roll (degree)."""
        azimuth, pitch, roll = matrix_to_attitude(self.attitude)
        return float(azimuth), float(pitch), float(roll)


def level_and_gyrocompass(rate: Floats, force: Floats) -> Floats:
    """Return the attitude matrix, body to east, north, up, of a body at rest on the earth.

    Parameters
    ----------
    rate : (3,) mean angular rate in body axes (rad/s), the earth's.
    force : (3,) mean specific force in body axes (m/s²), against gravity.

    Notes
    -----
    up = f / |f|, east = ω × up / |ω × up|, north = up × east: the rows of the matrix.

    References
    ----------
    Porter (1990), section 3.3 (one orientation); Britting (1971).
    """
    up = np.asarray(force, float) / np.linalg.norm(force)
    east = np.cross(rate, up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


def static_alignment(counts: Counts, begin: int, end: int, latitude_deg: float, height: float, imu: ImuHeader) -> Alignment:
    """Level and gyrocompass over the samples ``begin + 1 ... end``, in which the tool stands still.

    Raises
    ------
    InputError
        When gravity or the earth's rate do not show as they must: an axis is reversed, exchanged or wrongly scaled.
    """
    means = _kernels.running_sums(*counts.arguments, begin, end)  # type: ignore[call-arg]  # the dispatcher takes what its function takes
    rate, force, span = means[:3], means[3:6], means[6]
    check_physics(rate, force, latitude_deg, height, imu, span)
    attitude = level_and_gyrocompass(rate, force)
    g, earth_north = float(np.linalg.norm(force)), earth.EARTH_RATE * math.cos(math.radians(latitude_deg))
    walk = math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 / math.sqrt(span)
    drift = math.hypot(math.radians(imu.gyro_bias_deg_per_h) / 3600.0, walk)
    tilt = math.hypot(imu.accel_bias_ug * 1e-6, imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 / math.sqrt(span)) * 9.81 / g
    tilt = math.hypot(tilt, imu.accel_scale_ppm * 1e-6)
    azimuth = math.hypot(drift / earth_north, tilt * math.tan(math.radians(latitude_deg)))
    result = Alignment(attitude, float(counts.time[end]), np.array([tilt, tilt, azimuth]), "static",
                       (float(counts.time[begin]), float(counts.time[end])))  # fmt: skip
    log.info("static alignment over %.0f s: azimuth %.3f, pitch %.3f, roll %.3f degree, azimuth sigma %.3f degree",
             span, *result.angles, math.degrees(azimuth))  # fmt: skip
    return result


def check_physics(rate: Floats, force: Floats, latitude_deg: float, height: float, imu: ImuHeader, span: float) -> None:
    """Hold the mean rate and force of a tool at rest against gravity and the earth's rate.

    Notes
    -----
    |f| = g catches a wrong pulse weight or axis scale; ω · f / g = Ω sin φ is free of the attitude and turns its sign when one
    triad is reversed, or loses its value when a single axis is.
    """
    g = float(earth.gravity(latitude_deg, height))
    size = float(np.linalg.norm(force))
    faults = []
    if abs(size - g) > 0.01 * g:
        faults.append(Fault("imu.nc", "accel_count", f"gravity at rest is {size:.4f} m/s², it must be {g:.4f} m/s²",
                            "check accel_pulse_m_per_s and sensor_to_body"))  # fmt: skip
    drift = math.radians(max(imu.gyro_bias_deg_per_h, 1e-4)) / 3600.0
    walk = math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 / math.sqrt(max(span, 1.0))
    doubt = 6.0 * math.hypot(drift, walk) + 0.02 * earth.EARTH_RATE
    if doubt < 0.5 * earth.EARTH_RATE and not faults:
        vertical = float(rate @ force) / size
        expected = earth.EARTH_RATE * math.sin(math.radians(latitude_deg))
        whole = float(np.linalg.norm(rate))
        if abs(vertical - expected) > doubt or abs(whole - earth.EARTH_RATE) > doubt:
            faults.append(_axis_fault(rate, force / size, expected, doubt, vertical))
    if faults:
        raise InputError(faults)


def _axis_fault(rate: Floats, up: Floats, expected: float, doubt: float, vertical: float) -> Fault:
    """Name the axis whose reversal would mend the earth's vertical rate."""
    shown, due = math.degrees(vertical) * 3600.0, math.degrees(expected) * 3600.0
    said = f"the earth's vertical rate at rest is {shown:.2f} °/h, it must be {due:.2f} °/h"
    if abs(-vertical - expected) < doubt:
        return Fault(
            "imu.nc", "gyro_count", said + "; all gyro axes, or all accelerometer axes, look reversed", "check sensor_to_body"
        )
    mended = [abs(float((rate * s) @ up) - expected) for s in (np.array([-1, 1, 1]), np.array([1, -1, 1]), np.array([1, 1, -1]))]
    best = int(np.argmin(mended))
    if mended[best] < doubt:
        axis = ("x (right)", "y (forward)", "z (up)")[best]
        return Fault(
            "imu.nc", f"axis {axis}", said + f"; gyro or accelerometer axis {axis} looks reversed", "check sensor_to_body"
        )
    return Fault("imu.nc", "gyro_count", said, "check gyro_pulse_rad, sensor_to_body and the latitude of the launch")


def alignment_in_motion(epochs: Epochs, speeds: Floats, latitude_deg: float, height: float, imu: ImuHeader) -> Alignment:
    """Return the attitude at the first bound from epochs in which the tool may move along its axis.

    Parameters
    ----------
    epochs : the stretch to align on; some minutes, for the earth's turn must show.
    speeds : (epoch + 1,) m/s at the bounds.

    Notes
    -----
    With B the gyros' turn since the start and N that of the local level frame (earth and transport rate), the equation of motion
    integrates to C (B v - v0 - ∫ B f + ∫ ω_ie × v) = ∫ N g: the unknown first attitude C turns one known vector into another
    at every epoch. Their rotation by all of them is Wahba's problem, solved by singular values; what the earth turned gravity
    by in the meantime carries the azimuth, and is its sigma: drift / Ω cos φ, and the white errors of the vectors over that turn.
    Earth-rate and transport terms need C and are iterated.

    References
    ----------
    Li et al. (2012), eq. 1 to 23 (the odometer in the place of the Doppler log; 23 is singular for equal directions, all vectors
    are used instead); Markley (1988), J. Astronaut. Sci. 36, 245-258.

    Raises
    ------
    InputError
        When the stretch is too short for gravity to have turned.
    """
    n = len(epochs.table)
    alpha, beta, span = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    attitude = np.eye(3)
    latitude = math.radians(latitude_deg)
    for _ in range(4):
        _kernels_alignment.inertial_vectors(epochs.table, speeds, (0.0, 1.0, 0.0), attitude, latitude, height, alpha, beta, span)
        attitude = wahba(alpha[span > 1.0], beta[span > 1.0])
    turned = earth.EARTH_RATE * math.cos(latitude) * span[-1]
    if turned < 1e-3:
        rule = f"lasts {span[-1]:.1f} s; gravity turns by {math.degrees(turned):.4f} degree in it, too little for an azimuth"
        raise InputError(Fault("imu.nc", "time", rule, "give the alignment a minute of data at least"))
    drift = math.radians(imu.gyro_bias_deg_per_h) / 3600.0 / (earth.EARTH_RATE * math.cos(latitude))
    walk = math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 * math.sqrt(span[-1]) / turned
    rest = np.linalg.norm(alpha @ attitude.T - beta, axis=1)[span > 1.0] / np.linalg.norm(beta, axis=1)[span > 1.0]
    tilt = math.hypot(math.hypot(imu.accel_bias_ug, imu.accel_scale_ppm) * 1e-6, float(np.median(rest)))
    azimuth = math.sqrt(drift**2 + 3.0 * walk**2 + (float(np.median(rest)) / turned) ** 2 + (tilt * math.tan(latitude)) ** 2)
    result = Alignment(attitude, float(epochs.time[0]), np.array([tilt, tilt, azimuth]), "in motion",
                       (float(epochs.time[0]), float(epochs.time[-1])))  # fmt: skip
    log.info("alignment in motion over %.0f s: azimuth %.3f, pitch %.3f, roll %.3f degree, azimuth sigma %.3f degree",
             span[-1], *result.angles, math.degrees(azimuth))  # fmt: skip
    return result


def wahba(alpha: Floats, beta: Floats) -> Floats:
    """Return the rotation C that brings the vectors alpha (n, 3) nearest to beta (n, 3), C alpha = beta."""
    u, _, v = np.linalg.svd(beta.T @ alpha)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(v)]) @ v


def align(counts: Counts, epochs: Epochs, travel: TravelAid, header: RunHeader) -> Alignment:
    """Return the attitude at the first bound, by the way that the data allow: at rest, else in motion; logged."""
    launch = header.launch
    moving = np.flatnonzero(~travel.stationary)
    end = int(moving[0]) if moving.size else len(epochs.table)
    seconds = float(epochs.time[end] - epochs.time[0])
    if seconds >= LEAST_REST_S:
        last = int(epochs.bounds[end])
        return static_alignment(counts, 0, last, launch.latitude_deg, launch.height_m, header.imu)
    if launch.static_s >= LEAST_REST_S:
        log.warning(
            "run.toml says a rest of %.0f s at the launch, the wheels and the inertial unit say %.0f s", launch.static_s, seconds
        )
    last = min(int(np.searchsorted(epochs.time, epochs.time[0] + MOTION_S)), len(epochs.table))
    part = Epochs(epochs.bounds[: last + 1], epochs.time[: last + 1], epochs.table[:last])
    return alignment_in_motion(part, travel.speeds[: last + 1], launch.latitude_deg, launch.height_m, header.imu)
