"""The maker's figures of an inertial unit in, the table of coefficients that the kernels take off each count out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels
from deform.run.raw import ImuHeader, Triple

ZERO: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Coefficients:
    """Known errors of the six sensors, per sensor axis; all zero when the maker gives none.

    Parameters
    ----------
    gyro_drift : rad/s.
    gyro_scale, accel_scale : dimensionless.
    gyro_scale_asymmetry, accel_scale_asymmetry : dimensionless, of the absolute value.
    mass_unbalance_spin, mass_unbalance_input : rad/s per m/s², along the spin axis and along the input axis.
    spin_axis : index of the sensor axis along which the rotor of each gyro spins (mechanical gyros only).
    accel_bias : m/s².
    """

    gyro_drift: Triple = ZERO
    gyro_scale: Triple = ZERO
    gyro_scale_asymmetry: Triple = ZERO
    mass_unbalance_spin: Triple = ZERO
    mass_unbalance_input: Triple = ZERO
    spin_axis: tuple[int, int, int] = (0, 1, 2)
    accel_bias: Triple = ZERO
    accel_scale: Triple = ZERO
    accel_scale_asymmetry: Triple = ZERO


def compensation_table(imu: ImuHeader, coefficients: Coefficients | None = None) -> NDArray[np.float64]:
    """Return the table of compensation (15, 3) for the kernels: sensor errors per axis, then the mounting of both triads.

    Notes
    -----
    Per sensor axis, the accelerometers first because the gyros' mass unbalance needs them:
    Δf' = Δf - b Δt - Δf sf - |Δf| sfb, and Δθ' = Δθ - d Δt - Δθ sf - |Δθ| sfb - Δf' mus - Δf'_spin mui;
    then body = sensor_to_body @ sensor.

    References
    ----------
    Porter (1990), section 3.4.1 and eq. 3-21, 3-31.
    """
    c = coefficients or Coefficients()
    rows = (
        c.gyro_drift,
        c.gyro_scale,
        c.gyro_scale_asymmetry,
        c.mass_unbalance_spin,
        c.mass_unbalance_input,
        c.spin_axis,
        c.accel_bias,
        c.accel_scale,
        c.accel_scale_asymmetry,
    )
    return np.vstack([np.array(rows, float), imu.mounting, imu.mounting])


def compensated_increments(gyro_count, accel_count, gyro_pulse, accel_pulse, dt, table) -> tuple[NDArray, NDArray]:
    """Return angular (radian) and velocity (m/s) increments in body axes, (sample, 3) each, of counts and intervals (s)."""
    gyro, accel, dt = np.asarray(gyro_count), np.asarray(accel_count), np.asarray(dt, float)
    out = np.empty((len(dt), 6))
    for i, step in enumerate(dt):
        out[i] = _kernels.increments(gyro, accel, float(gyro_pulse), float(accel_pulse), table, i, step)
    return out[:, :3], out[:, 3:]
