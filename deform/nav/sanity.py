"""Epochs, odometer and alignment in; faults of mounting that motion shows out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry.earth import earth_rate
from deform.nav import _kernels, _kernels_reckoning
from deform.nav.aiding import TravelAid
from deform.nav.alignment import Alignment
from deform.nav.profile import Profile
from deform.nav.strapdown import Counts, Epochs, preintegrate
from deform.run.raw import RunHeader

Floats = NDArray[np.float64]

LOOK_S = 1200.0  # stretch of motion that is looked at
LARGEST_TILT_DEG = 3.0  # of good gyros
DRIFT_SIGMAS = 3.0  # of the gyros' bias, by which the vertical of coarse ones may drift off besides
AXES = ("x (right)", "y (forward)", "z (up)")


def check_motion(
    counts: Counts, profile: Profile, epochs: Epochs, travel: TravelAid, aligned: Alignment, header: RunHeader
) -> None:
    """Hold gyros against accelerometers, and accelerometers against the odometer, while the tool moves.

    Notes
    -----
    Turned by the gyros, and with the Earth (15 degree an hour at the equator), the first vertical must stay where the
    accelerometers feel it: after a roll or a bend a reversed axis puts it degrees off, beyond what the maker's bias may turn it
    until the middle of the stretch. And the force along the tool, less that of gravity, must be the change of the odometer's
    speed.

    Raises
    ------
    InputError
        Naming the axis that, turned about, mends the contradiction.
    """
    moving = np.flatnonzero(~travel.stationary)
    if not moving.size:
        return
    last = min(int(np.searchsorted(epochs.time, epochs.time[moving[0]] + LOOK_S)), len(epochs.table))
    up, earth = aligned.attitude[2], aligned.attitude.T @ earth_rate(header.launch.latitude_deg)
    tilt = gravity_error_deg(epochs.table[:last], up, earth)
    drift = header.imu.gyro_bias_deg_per_h * 0.5 * (epochs.time[last] - epochs.time[0]) / 3600.0
    if tilt > LARGEST_TILT_DEG + DRIFT_SIGMAS * drift:
        raise InputError(_reversed_axis(counts, profile, epochs.bounds[: last + 1], up, earth, tilt))
    slope = speed_slope(epochs.table[:last], travel.speeds[: last + 1], up, earth)
    if slope is not None and slope < 0.0:
        rule = f"the force along {AXES[1]} falls where the odometer's speed rises (slope {slope:.2f}, it must be near 1)"
        raise InputError(Fault("imu.nc", f"axis {AXES[1]}", rule, "this axis looks reversed: check sensor_to_body"))


def gravity_error_deg(table: Floats, up: Floats, earth: Floats) -> float:
    """Return the middle angle (degree) between the vertical as the gyros lead it on and the force of each epoch.

    Vertical and rate of the Earth (rad/s) are those of the beginning, in body axes.
    """
    vertical = _turned(table, up, earth)
    force = table[:, _kernels.VELOCITY : _kernels.VELOCITY + 3]
    size = np.linalg.norm(force, axis=1)
    cosine = np.sum(vertical * force, axis=1)[size > 0] / size[size > 0]
    return float(np.degrees(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))) if cosine.size else 0.0


def speed_slope(table: Floats, speeds: Floats, up: Floats, earth: Floats) -> float | None:
    """Return the slope of force along the tool, free of gravity, over change of speed; None when that changes too little."""
    vertical = _turned(table, up, earth)
    change = np.diff(speeds)
    force = table[:, _kernels.VELOCITY : _kernels.VELOCITY + 3]
    along = force[:, 1] - 9.81 * table[:, _kernels.DURATION] * vertical[:, 1]
    along -= np.median(along)
    strong = np.abs(change) > 0.05
    if strong.sum() < 5 or np.sum(change[strong] ** 2) < 0.1:
        return None
    slope = float(np.sum(change[strong] * along[strong]) / np.sum(change[strong] ** 2))
    return slope if abs(slope) > 0.4 else None


def _turned(table: Floats, up: Floats, earth: Floats) -> Floats:
    """The vertical in the body axes of the beginning of each epoch: turned by the gyros, and with the Earth."""
    out = np.empty((len(table), 3))
    _kernels_reckoning.led_vertical(np.ascontiguousarray(table), np.asarray(up, float), np.asarray(earth, float), out)
    return out


def _reversed_axis(counts: Counts, profile: Profile, bounds: NDArray, up: Floats, earth: Floats, tilt: float) -> Fault:
    """Try each gyro axis, and each accelerometer axis, the other way round."""
    said = f"gyros and accelerometers disagree on the vertical by {tilt:.1f} degree in motion"
    found: list[tuple[float, str, str]] = []
    for axis in range(3):
        for triad, rows, field in (
            ("gyro", _kernels.GYRO_MOUNTING, "gyro_count"),
            ("accelerometer", _kernels.ACCEL_MOUNTING, "accel_count"),
        ):
            table = counts.table.copy()
            table[rows + axis] *= -1.0
            first = up * np.where(np.arange(3) == axis, -1.0, 1.0) if triad == "accelerometer" else up
            turned = preintegrate(_with_table(counts, table), profile, bounds)
            found.append((gravity_error_deg(turned.table, first, earth), f"{triad} axis {AXES[axis]}", field))
    best = min(found)
    if best[0] < 0.3 * tilt:
        return Fault("imu.nc", f"{best[2]}, {best[1]}", f"{said}; {best[1]} looks reversed", "check sensor_to_body")
    return Fault("imu.nc", "gyro_count, accel_count", said, "check sensor_to_body and the pulse weights")


def _with_table(counts: Counts, table: Floats) -> Counts:
    return Counts(counts.time, counts.gyro, counts.accel, counts.gyro_pulse, counts.accel_pulse, table, counts.step)
