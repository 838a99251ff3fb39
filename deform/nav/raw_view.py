"""A raw run in; what its sensors recorded, thinned, and the free navigation over its rest out, as datasets for figures."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.errors import InputError
from deform.geometry import earth
from deform.nav.alignment import align, first_epochs
from deform.nav.navigate import aid_of, counts_of
from deform.nav.odometer import combine
from deform.nav.strapdown import epoch_bounds, mechanize, preintegrate
from deform.options import NavigationOptions
from deform.run.raw import RawRun
from deform.run.stamps import usual_step

Floats = NDArray[np.float64]
AXES = ["right", "forward", "up"]
LEAST_REST_EPOCHS = 30


def raw_dataset(raw: RawRun, columns: int = 1500) -> xr.Dataset:
    """Return what the sensors recorded, for a picture: least and largest sample of every stretch of time.

    Returns
    -------
    dataset : dim ``time`` (s, two rows a stretch): ``gyro_rate`` (time, axis; degree per second), ``specific_force`` (time, axis;
        m/s²), both about and along the sensor axes, not compensated; ``wheel_speed`` (time; m/s), the mean of the wheels over the
        stretch. Attribute ``run``.
    """
    imu, time = raw.imu, raw.imu["time"].values
    first = np.unique(np.linspace(0, time.size - 1, columns + 1).astype(int)[:-1])
    step = usual_step(time)
    values: dict[str, tuple] = {}
    for name, counts, weight in (("gyro_rate", "gyro_count", np.degrees(imu.attrs["gyro_pulse_rad"])),
                                 ("specific_force", "accel_count", imu.attrs["accel_pulse_m_per_s"])):  # fmt: skip
        whole = imu[counts].values
        ends = np.stack([np.minimum.reduceat(whole, first), np.maximum.reduceat(whole, first)], axis=1)
        values[name] = ("time", "axis"), ends.reshape(-1, whole.shape[1]) * weight / step
    wheel = raw.odometer
    travel = wheel["count"].values.mean(axis=1) * wheel.attrs["pulse_m"]
    bounds = np.append(time[first], time[-1])
    speed = np.diff(np.interp(bounds, wheel["time"].values, travel)) / np.diff(bounds)
    values["wheel_speed"] = ("time",), np.repeat(speed, 2)
    return xr.Dataset(values, {"time": np.repeat(time[first], 2), "axis": AXES}, {"run": raw.id})


def rest_dataset(raw: RawRun) -> xr.Dataset:
    """Return what free navigation makes of the rest before the launch: a tool that stands should get no velocity and no place.

    Returns
    -------
    dataset : dim ``time`` (s): ``velocity_error`` (time, axis; m/s), ``position_error`` (time, axis; m), east, north, up, from
        the attitude of the alignment on, without any aid. Attributes ``run`` and ``alignment_method``.

    Raises
    ------
    InputError
        When the recording does not begin with a rest.

    References
    ----------
    Porter (1990), Fig. 4-1 to 4-3.
    """
    counts, options, launch = counts_of(raw), NavigationOptions(), raw.header.launch
    wheels = combine(raw, options)
    epochs = preintegrate(counts, wheels.profile, epoch_bounds(counts.time, options.filter_interval_s))
    travel = aid_of(epochs, wheels.profile)
    aligned = align(counts, epochs, travel, raw.header)
    moving = np.flatnonzero(~travel.stationary)
    still = int(moving[0]) if moving.size else len(epochs.table)
    if still < LEAST_REST_EPOCHS:
        raise InputError(f"run {raw.id} does not begin with a rest: its alignment cannot be shown by free navigation over one")
    place = np.array([np.radians(launch.latitude_deg), np.radians(launch.longitude_deg), launch.height_m])
    places, velocities, _ = mechanize(first_epochs(epochs, still), place, np.zeros(3), aligned.attitude)
    there = np.degrees(places[:, 0]), np.degrees(places[:, 1]), places[:, 2]
    off = np.column_stack(earth.enu_difference(*there, launch.latitude_deg, launch.longitude_deg, launch.height_m))
    values = {"velocity_error": (("time", "axis"), velocities), "position_error": (("time", "axis"), off)}
    axes = {"time": epochs.time[: still + 1], "axis": ["east", "north", "up"]}
    return xr.Dataset(values, axes, {"run": raw.id, "alignment_method": aligned.method})
