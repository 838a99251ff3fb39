"""The known errors of an inertial unit in, the table of coefficients that the kernels take off each count out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels
from deform.run.raw import Compensation, ImuHeader

PER_HOUR = math.radians(1.0) / 3600.0
STANDARD_GRAVITY = 9.80665


def compensation_table(imu: ImuHeader) -> NDArray[np.float64]:
    """Return the table of compensation (15, 3) for the kernels: sensor errors per axis, then the mounting of both triads.

    Parameters
    ----------
    imu : with the table ``[imu.compensation]`` of the run's header, where it has one.

    Notes
    -----
    Per sensor axis, the accelerometers first because the gyros' mass unbalance needs them:
    Δf' = Δf - b Δt - Δf sf - |Δf| sfb, and Δθ' = Δθ - d Δt - Δθ sf - |Δθ| sfb - Δf' mus - Δf'_spin mui;
    then body = sensor_to_body @ sensor.

    References
    ----------
    Porter (1990), section 3.4.1 and eq. 3-21, 3-31.
    """
    c = imu.compensation or Compensation()
    per_g = PER_HOUR / STANDARD_GRAVITY
    rows = (
        np.multiply(c.gyro_drift_deg_per_h, PER_HOUR),
        np.multiply(c.gyro_scale_ppm, 1e-6),
        np.multiply(c.gyro_scale_asymmetry_ppm, 1e-6),
        np.multiply(c.mass_unbalance_spin_deg_per_h_per_g, per_g),
        np.multiply(c.mass_unbalance_input_deg_per_h_per_g, per_g),
        c.spin_axis,
        np.multiply(c.accel_bias_ug, 1e-6 * STANDARD_GRAVITY),
        np.multiply(c.accel_scale_ppm, 1e-6),
        np.multiply(c.accel_scale_asymmetry_ppm, 1e-6),
    )
    return np.vstack([np.array(rows, float), imu.mounting, imu.mounting])


def compensated_increments(gyro_count, accel_count, gyro_pulse, accel_pulse, dt, table) -> tuple[NDArray, NDArray]:
    """Return angular (radian) and velocity (m/s) increments in body axes, (sample, 3) each, of counts and intervals (s)."""
    gyro, accel, dt = np.asarray(gyro_count), np.asarray(accel_count), np.asarray(dt, float)
    out = np.empty((len(dt), 6))
    for i, step in enumerate(dt):
        out[i] = _kernels.increments(gyro, accel, float(gyro_pulse), float(accel_pulse), table, i, step)
    return out[:, :3], out[:, 3:]
