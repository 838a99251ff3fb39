"""Counts of a tool at rest or on its way in, first attitude with its sigma and how it was found out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry import earth
from deform.geometry.rotation import matrix_to_attitude, matrix_to_rotation_vector
from deform.nav import _kernels
from deform.nav.aiding import TravelAid
from deform.nav.inertial_alignment import First, coarse, fine, record
from deform.nav.strapdown import Counts, Epochs
from deform.run.raw import ImuHeader, RunHeader

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

LEAST_REST_S = 45.0  # below it the random walk of any gyro leaves no azimuth
GOOD_REST_S = 300.0  # from it on a quiet rest is as good as anything
MOTION_S = 900.0  # of data to align on in motion; biases wander beyond
LEAST_TRAVEL_M = 0.005  # of an epoch in which a tool moves: two pulses
LEAST_TURN_RAD = 1e-3  # by which the earth must have turned gravity
QUIET_SIGMA, QUIET_PULSES = 5.0, 4.0  # random walks, and pulses of the gyros, by which a tool at rest may seem to turn


@dataclass(frozen=True)
class Alignment:
    """First attitude.

    Parameters
    ----------
    attitude : matrix (3, 3), body to east, north, up, at ``time``.
    time : s on the tool's clock.
    sigma : (3,) standard deviation (radian) of the turning error about east, north, up.
    method : ``static`` (levelling and gyrocompassing), ``zero velocity`` (filter over a rest that is not quiet), ``in motion``
        (filter over motion) or ``in motion, coarse``.
    span : (begin, end) of the data used (s).
    """

    attitude: Floats
    time: float
    sigma: Floats
    method: str
    span: tuple[float, float]

    @property
    def angle_sigma(self) -> tuple[float, float, float]:
        """Standard deviations of azimuth, pitch, roll (degree); pitch and roll turn about the level axes across and along."""
        forward = self.attitude[:2, 1] / max(float(np.hypot(*self.attitude[:2, 1])), 1e-9)
        east, north, up = np.degrees(self.sigma)
        pitch, roll = math.hypot(east * forward[1], north * forward[0]), math.hypot(east * forward[0], north * forward[1])
        return float(up), pitch, roll

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
    means = _kernels.running_sums(*counts.arguments, counts.step, begin, end)  # type: ignore[call-arg]  # the dispatcher takes what its function takes
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


def alignment_in_motion(epochs: Epochs, aid: TravelAid, header: RunHeader, method: str = "in motion") -> Alignment:
    """Return the attitude at the first bound from epochs in which the tool may move along its axis.

    Parameters
    ----------
    epochs : the stretch to align on; some minutes, for the earth's turn must show.
    aid : displacements by the odometer and rests; those of the first epochs are taken.
    header : launch and the maker's figures.
    method : what the result is called.

    Notes
    -----
    Coarse over all vectors, then the filter over the same record, back to its beginning until the attitude stands: see
    `inertial_alignment`. Should the filter end further from the coarse attitude than both can be wrong, the coarse one is kept.

    References
    ----------
    Li et al. (2012); Porter (1990), section 3.5.

    Raises
    ------
    InputError
        When the stretch is too short for gravity to have turned.
    """
    launch, imu = header.launch, header.imu
    span = float(epochs.duration.sum())
    earth_north = earth.EARTH_RATE * math.cos(math.radians(launch.latitude_deg))
    turned = earth_north * span
    if turned < LEAST_TURN_RAD:
        rule = f"lasts {span:.1f} s; gravity turns by {math.degrees(turned):.4f} degree in it, too little for an azimuth"
        raise InputError(Fault("imu.nc", "time", rule, "give the alignment a minute of data at least"))
    kept = record(epochs, aid)
    first, off = coarse(kept, launch.latitude_deg, launch.height_m)
    rough = _coarse_sigma(imu, off, span, turned, launch.latitude_deg)
    found = fine(kept, first, header)
    sigma = np.sqrt(np.diag(found.covariance))
    moved = matrix_to_rotation_vector(found.attitude @ first.T)
    if np.any(np.abs(moved) > 6.0 * np.hypot(rough, sigma)) or not np.isfinite(sigma).all():
        log.warning("the fine alignment leads %.2f degree away from the coarse one: the coarse one is used",
                    math.degrees(float(np.linalg.norm(moved))))  # fmt: skip
        result = Alignment(first, float(epochs.time[0]), np.maximum(rough, np.abs(moved)), f"{method}, coarse", _span(epochs))
    else:
        result = Alignment(found.attitude, float(epochs.time[0]), sigma, method, _span(epochs))
        _tell_of(found)
    log.info("alignment %s over %.0f s: azimuth %.3f, pitch %.3f, roll %.3f degree, azimuth sigma %.3f degree",
             result.method, span, *result.angles, math.degrees(result.sigma[2]))  # fmt: skip
    return result


def _coarse_sigma(imu: ImuHeader, off: Floats, span: float, turned: float, latitude_deg: float) -> Floats:
    """Sigma about east, north, up of the coarse attitude: drift, random walk, and what the vectors stay off over the turn."""
    drift = math.radians(imu.gyro_bias_deg_per_h) / 3600.0 / (turned / span)
    walk = math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 * math.sqrt(span) / turned
    rest = float(np.median(off))
    tilt = math.hypot(math.hypot(imu.accel_bias_ug, imu.accel_scale_ppm) * 1e-6, rest)
    tangent = math.tan(math.radians(latitude_deg))
    azimuth = math.sqrt(drift**2 + 3.0 * walk**2 + (3.0 * rest / turned) ** 2 + (tilt * tangent) ** 2)
    return np.array([tilt, tilt, azimuth])


def _tell_of(found: First) -> None:
    kinds = ("across the tool in motion", "along the tool in motion", "at rest")
    worse = [f"{kind} {math.sqrt(w):.1f} times" for kind, w in zip(kinds, found.worse, strict=True) if w > 4.0]
    if worse:
        log.info("alignment: the odometer's aid was worse than stated: %s its sigma", ", ".join(worse))


def _span(epochs: Epochs) -> tuple[float, float]:
    return float(epochs.time[0]), float(epochs.time[-1])


def is_quiet(counts: Counts, epochs: Epochs, header: RunHeader) -> bool:
    """Say whether a tool at rest does not turn against the earth.

    Notes
    -----
    The turn less its mean rate must stay within what the gyros' random walk and pulses make of it; a rocking tool leaves that
    band. The mean rate itself cannot tell, for it is the earth's rate and the gyros' drift.
    """
    matrix = epochs.table[:, _kernels.TURN : _kernels.TURN + 9].reshape(-1, 3, 3)
    turn = np.cumsum(matrix_to_rotation_vector(matrix), axis=0)  # a tool at rest turns about one axis, the earth's
    passed = np.cumsum(epochs.duration)
    left = turn - turn[-1] * (passed / passed[-1])[:, None]
    walk = math.radians(header.imu.gyro_random_walk_deg_per_sqrt_h) / 60.0 * math.sqrt(float(passed[-1]))
    return bool(np.abs(left).max() < QUIET_SIGMA * walk + QUIET_PULSES * counts.gyro_pulse)


def align(counts: Counts, epochs: Epochs, travel: TravelAid, header: RunHeader) -> Alignment:
    """Return the attitude at the first bound, by the way that the data allow; choice and result are logged.

    Notes
    -----
    A quiet rest: levelling and gyrocompassing with the mean rate, which no filter betters, for it knows that the tool does not
    turn. A rest that is not quiet: the filter with zero velocity. Short of `GOOD_REST_S` of rest the filter over rest and
    motion is tried as well, and the surer of the two azimuths is taken.
    """
    launch = header.launch
    moving = np.flatnonzero(travel.travel > LEAST_TRAVEL_M)  # a tool that is rocked at rest is not stationary, yet goes nowhere
    end = int(moving[0]) if moving.size else len(epochs.table)
    rest = float(epochs.time[end] - epochs.time[0])
    found: list[Alignment] = []
    if rest >= LEAST_REST_S:
        stretch = first_epochs(epochs, end)
        if is_quiet(counts, stretch, header):
            args = (launch.latitude_deg, launch.height_m, header.imu)
            found.append(static_alignment(counts, 0, int(epochs.bounds[end]), *args))
        else:
            log.info("the tool is rocked while it rests for %.0f s: aligned by zero velocity, not by its mean rate", rest)
            found.append(alignment_in_motion(stretch, travel, header, "zero velocity"))
    elif launch.static_s >= LEAST_REST_S:
        said = "run.toml says a rest of %.0f s at the launch, the wheels and the inertial unit say %.0f s"
        log.warning(said, launch.static_s, rest)
    if rest < GOOD_REST_S:
        last = min(int(np.searchsorted(epochs.time, epochs.time[0] + MOTION_S)), len(epochs.table))
        if not found or last > end:
            found.append(alignment_in_motion(first_epochs(epochs, last), travel, header))
    return min(found, key=lambda a: float(a.sigma[2]))


def first_epochs(epochs: Epochs, count: int) -> Epochs:
    """Return the first epochs."""
    return Epochs(epochs.bounds[: count + 1], epochs.time[: count + 1], epochs.table[:count])
