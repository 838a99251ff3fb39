"""Counts of IMU and odometer in, curvature of the pipe without any navigation out: a look at the line an hour after the run."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numba import njit
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry.earth import EARTH_RATE
from deform.nav.odometer import OdometerSolution, combine
from deform.run import build
from deform.run.raw import RawRun

Floats = NDArray[Any]

_CELL_M = 0.1
_LEVEL_M = 2.0  # length over which the accelerometers are averaged to tell the vertical


def quick_look(raw: RawRun, gauge_length: float = 2.0, wheels: OdometerSolution | None = None) -> xr.Dataset:
    """Return the group ``quick_look``: curvature from the raw gyro rates over the speed, levelled by the accelerometers.

    Parameters
    ----------
    raw : the raw run; IMU and odometer are used.
    gauge_length : chord over which curvature is taken (metre).
    wheels : result of `odometer.combine` when it is there already.

    Returns
    -------
    Dataset on ``log_distance`` in steps of 0.1 m: ``curvature_total`` (1/m), ``curvature_horizontal`` (positive to the right
    looking downstream), ``curvature_vertical`` (positive sag), ``pitch`` and ``roll`` of the tool (degree, the way it runs).

    Raises
    ------
    InputError
        When the tool travelled less than the gauge length.

    Notes
    -----
    Total: 3-77, turn across the track over the chord. Components: the specific force f, averaged over 2 m with the along-track
    acceleration of the odometer taken off, is the vertical; x_n = norm(y × f) is the level axis to the right (3-82), and
    u = x_n × y stands on the pipe in the vertical plane. Then horizontal = -ω·u / v and vertical = ω·x_n / v; with u in place of
    Porter's z_n a rolling tool on a slope shows no false turn. Porter's 3-80 and 3-81 name the axes of another body frame: his
    pitch is arctan(f_y / hypot(f_x, f_z)) here. The vertical part of the earth's rate is taken off, the level part is not (the
    azimuth is unknown): 15 degree per hour, 7e-5 per metre at 1 m/s.

    References
    ----------
    Porter (1990), eq. 3-77 to 3-88.
    """
    wheels = wheels or combine(raw)
    length = float(wheels.profile.distance[-1])
    n = int(length / _CELL_M)
    if n * _CELL_M < max(gauge_length, _LEVEL_M) + _CELL_M:
        raise InputError(
            Fault(raw.id, "count", f"the tool travelled {length:.2f} m, less than the gauge length {gauge_length} m")
        )
    turn, force, seconds = _per_cell(raw, wheels, n)
    force = _level_force(force, seconds)
    up = EARTH_RATE * np.sin(np.radians(raw.header.launch.latitude_deg)) * seconds
    f = force / np.linalg.norm(force, axis=1, keepdims=True)
    right = np.stack([f[:, 2], np.zeros(n), -f[:, 0]], axis=1)  # y × f
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    pitch = np.arctan2(f[:, 1], np.hypot(f[:, 0], f[:, 2]))
    u = np.stack([-right[:, 2], np.zeros(n), right[:, 0]], axis=1)  # x_n × y
    across = -((turn * u).sum(axis=1) - up * np.cos(pitch)) * raw.header.travel_sign
    along = (turn * right).sum(axis=1)
    width = max(round(gauge_length / _CELL_M), 1)
    horizontal, vertical = _chord(across, width), _chord(along, width)
    values = {
        "log_distance": _CELL_M * (np.arange(n) + 0.5),
        "curvature_total": np.hypot(horizontal, vertical),
        "curvature_horizontal": horizontal,
        "curvature_vertical": vertical,
        "pitch": np.degrees(pitch),
        "roll": np.degrees(np.arctan2(-f[:, 0], f[:, 2])),
    }
    return build.dataset("quick_look", values, gauge_length_m=width * _CELL_M)


def _per_cell(raw: RawRun, wheels: OdometerSolution, n: int) -> tuple[Floats, Floats, Floats]:
    """Turn (rad) and velocity gathered by specific force (m/s) in body axes, and seconds, of each cell of travel."""
    turn, force, seconds = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
    pulses = float(raw.imu.attrs["gyro_pulse_rad"]), float(raw.imu.attrs["accel_pulse_m_per_s"])
    time = raw.imu["time"].values
    distance, speed, _, still = wheels.on_samples()
    _gather(
        time, raw.imu["gyro_count"].values, raw.imu["accel_count"].values, *pulses, raw.header.imu.mounting,
        distance, speed.astype(float), still, _CELL_M, turn, force, seconds,
    )  # fmt: skip
    empty = seconds <= 0
    if empty.any():
        known = np.flatnonzero(~empty)
        for columns in (turn, force, seconds[:, None]):
            for i in range(columns.shape[1]):
                columns[empty, i] = np.interp(np.flatnonzero(empty), known, columns[known, i])
    return turn, force, seconds


def _level_force(force: Floats, seconds: Floats) -> Floats:
    """Mean specific force (m/s²) about each cell over `_LEVEL_M`."""
    width = max(round(_LEVEL_M / _CELL_M), 1)
    total = np.concatenate([np.zeros((1, 4)), np.cumsum(np.column_stack([force, seconds]), axis=0)])
    n = seconds.size
    first, last = np.clip(np.arange(n) - width // 2, 0, n), np.clip(np.arange(n) + width // 2 + 1, 0, n)
    mean = total[last] - total[first]
    return mean[:, :3] / mean[:, 3:]


def _chord(turn: Floats, width: int) -> Floats:
    """Turn over the chord about each cell divided by its length; NaN where the chord leaves the line."""
    total = np.concatenate([[0.0], np.cumsum(turn)])
    middle = np.arange(turn.size) + 0.5
    a, b = middle - 0.5 * width, middle + 0.5 * width
    at = np.arange(total.size)
    out = (np.interp(b, at, total) - np.interp(a, at, total)) / (width * _CELL_M)
    out[(a < 0) | (b > turn.size)] = np.nan
    return out


@njit(cache=True, error_model="numpy")
def _gather(time, gyro, accel, gyro_pulse, accel_pulse, mounting, distance, speed, still, cell, turn, force, seconds):
    n = turn.shape[0]
    for k in range(time.shape[0]):
        if still[k] or still[k + 1]:
            continue
        c = int(0.5 * (distance[k] + distance[k + 1]) / cell)
        if c < 0 or c >= n:
            continue
        for i in range(3):
            g, a = 0.0, 0.0
            for j in range(3):
                g += mounting[i, j] * gyro[k, j]
                a += mounting[i, j] * accel[k, j]
            turn[c, i] += gyro_pulse * g
            force[c, i] += accel_pulse * a
        force[c, 1] -= speed[k + 1] - speed[k]
        seconds[c] += time[k] - time[k - 1] if k > 0 else time[1] - time[0]
