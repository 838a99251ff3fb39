"""A tiny raw run, written by code: 40 s, 8 m of straight pipe, every file of the format and all of them consistent."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

RATE = 50.0
DURATION = 40.0
STATIC = 10.0
SPEED = 0.4
PULSE_M = 0.002
GYRO_PULSE = 2e-7
ACCEL_PULSE = 2e-5
EARTH_RATE = 7.292115e-5
LATITUDE, LONGITUDE = 61.0, -121.0
INNER_RADIUS = 0.3239 / 2 - 0.00635

HEADER = f"""
[run]
id = "tiny"
line = "line"
date = 2020-01-02
direction = "downstream"
[pipe]
outside_diameter_m = 0.3239
nominal_wall_m = 0.00635
[launch]
latitude_deg = {LATITUDE}
longitude_deg = {LONGITUDE}
height_m = 100.0
static_s = {STATIC}
[imu]
rate_hz = {RATE}
sensor_to_body = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
[odometer]
wheels = 2
lever_arm_m = [0.0, -1.1, 0.0]
[caliper]
arms = 6
ring_offset_m = [-0.6]
"""


def imu() -> xr.Dataset:
    """Counts of a tool that lies level and heads north: earth rate and gravity, remainder carried."""
    n = int(DURATION * RATE)
    time = (np.arange(n) + 1) / RATE
    latitude = np.radians(LATITUDE)
    rate = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)]) / GYRO_PULSE
    force = np.array([0.0, 0.0, 9.82]) / ACCEL_PULSE
    counts = [np.diff(np.round(v[None] * np.append(0.0, time)[:, None]), axis=0).astype(np.int32) for v in (rate, force)]
    return xr.Dataset(
        {"time": ("sample", time), "gyro_count": (("sample", "axis"), counts[0]), "accel_count": (("sample", "axis"), counts[1])},
        attrs={"gyro_pulse_rad": GYRO_PULSE, "accel_pulse_m_per_s": ACCEL_PULSE},
    )


def odometer() -> xr.Dataset:
    """Return two wheels that count a stop and then a steady speed."""
    time = np.arange(int(DURATION * 20) + 1) / 20.0
    travel = SPEED * np.clip(time - STATIC, 0, 20.0)
    count = np.floor(np.stack([travel, 1.002 * travel], axis=1) / PULSE_M).astype(np.int64)
    return xr.Dataset({"time": ("sample", time), "count": (("sample", "wheel"), count)}, attrs={"pulse_m": PULSE_M})


def caliper() -> xr.Dataset:
    """Return six arms that feel a round pipe."""
    time = np.arange(int(DURATION * 10)) / 10.0
    angle = np.arange(6) * np.pi / 3
    radius = np.round(np.full((time.size, 6), INNER_RADIUS) / 1e-4).astype(np.uint16)
    ds = xr.Dataset({"time": ("scan", time), "arm_angle": ("arm", angle, {"units": "radian"})})
    ds["radius"] = (
        ("scan", "arm"),
        radius,
        {"units": "m", "scale_factor": 1e-4, "add_offset": 0.0, "_FillValue": np.uint16(65535)},
    )
    return ds


def markers() -> list[list]:
    """Return rows of markers.csv: launcher, one marker, receiver."""
    north = [0.0, 4.0, 8.0]
    place = [LATITUDE + metres / 111_400.0 for metres in north]
    return [
        ["LAUNCHER", "launcher", 10.0, place[0], LONGITUDE, 100.0, 0.05, 0.05],
        ["AGM1", "agm", 20.0, place[1], LONGITUDE, 100.0, 0.3, 0.3],
        ["RECEIVER", "receiver", 30.0, place[2], LONGITUDE, 100.0, 0.05, 0.05],
    ]


MARKER_HEADER = ["name", "kind", "time_s", "latitude_deg", "longitude_deg", "height_m", "sigma_horizontal_m", "sigma_vertical_m"]
WELDS = [["12.5", "1.0"], ["17.5", "0.8"], ["25.0", "1.1"]]


def write_csv(path: Path, header: list[str], rows: list[list]) -> None:
    """Write a plain CSV."""
    path.write_text("\n".join(",".join(map(str, line)) for line in [header, *rows]) + "\n", encoding="utf-8")


def write_nc(path: Path, ds: xr.Dataset) -> None:
    """Write counts as they are: attributes of packing stay attributes, so that the file holds what the dataset holds."""
    with netCDF4.Dataset(path, "w") as file:
        for dim, size in ds.sizes.items():
            file.createDimension(dim, size)
        for name, variable in ds.variables.items():
            attrs = dict(variable.attrs)
            target = file.createVariable(name, variable.dtype, variable.dims, fill_value=attrs.pop("_FillValue", None))
            target.set_auto_maskandscale(False)
            target.setncatts(attrs)
            target[...] = variable.values
        file.setncatts(ds.attrs)


def write_raw(folder: Path, **parts) -> Path:
    """Write a raw run; ``imu``, ``odometer``, ``caliper``, ``header``, ``markers``, ``welds`` replace a part, None drops it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, default in (("imu", imu), ("odometer", odometer), ("caliper", caliper)):
        ds = parts.get(name, ...)
        if ds is not None:
            write_nc(folder / f"{name}.nc", default() if ds is ... else ds)
    if parts.get("header", HEADER) is not None:
        (folder / "run.toml").write_text(parts.get("header", HEADER), encoding="utf-8")
    if parts.get("markers", ...) is not None:
        rows = parts.get("markers", ...)
        write_csv(folder / "markers.csv", MARKER_HEADER, markers() if rows is ... else rows)
    if parts.get("welds", ...) is not None:
        rows = parts.get("welds", ...)
        write_csv(folder / "welds.csv", ["time_s", "amplitude"], WELDS if rows is ... else rows)
    return folder
