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
from deform.nav import _kernels
from deform.nav.aiding import TravelAid
from deform.nav.strapdown import Counts, Epochs
from deform.run.raw import ImuHeader, RunHeader

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)


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
    means = _kernels.running_sums(*counts.arguments, begin, end)
    rate, force, span = means[:3], means[3:6], means[6]
    check_physics(rate, force, latitude_deg, height, imu, span)
    attitude = level_and_gyrocompass(rate, force)
    g, earth_north = np.linalg.norm(force), earth.EARTH_RATE * math.cos(math.radians(latitude_deg))
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
    said = f"the earth's vertical rate at rest is {math.degrees(vertical) * 3600:.2f} °/h, it must be {math.degrees(expected) * 3600:.2f} °/h"
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


def align(counts: Counts, epochs: Epochs, travel: TravelAid, header: RunHeader) -> Alignment:
    """Return the attitude at the first bound, by the way that the data allow."""
    moving = np.flatnonzero(~travel.stationary)
    end = int(epochs.bounds[moving[0]]) if moving.size else int(epochs.bounds[-1])
    launch = header.launch
    if header.launch.static_s > 0:
        end = min(end, int(np.searchsorted(counts.time, counts.time[0] + launch.static_s)))
    return static_alignment(counts, 0, end, launch.latitude_deg, launch.height_m, header.imu)
