"""Simulated sensors in, the files of a raw run folder out, block by block, the same bytes for the same data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.options import RunOptions, SimulateOptions, ToolOptions
from deform.synthetic.arms import FILL, PACKING_M
from deform.synthetic.imu import FIGURES, Grade, grade_of, rate_of

SOURCE = "simulated data; no real pipeline or tool"
_PACKED: dict[str, Any] = {"zlib": True, "complevel": 4, "shuffle": True}


def write_imu(path: Path, blocks: Iterable[tuple[NDArray, NDArray, NDArray]], grade: Grade, rate_hz: float, run: str) -> None:
    """Write ``imu.nc``."""
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("sample", None)
        file.createDimension("axis", 3)
        time = _variable(file, "time", "f8", ("sample",), 131072, units="s", long_name="tool clock")
        names = (
            ("gyro_count", "gyro pulses since the previous sample"),
            ("accel_count", "accelerometer pulses since the previous sample"),
        )
        counts = [_variable(file, n, "i4", ("sample", "axis"), 131072, units="1", long_name=t) for n, t in names]
        pulses = {"gyro_pulse_rad": grade.gyro_pulse_rad, "accel_pulse_m_per_s": grade.accel_pulse_m_per_s}
        note = "each sample is stamped at the end of its interval; the first covers the time from zero"
        file.setncatts({"run": run, "source": SOURCE, **pulses, "rate_hz": rate_hz, "note": note})
        first = 0
        for times, gyro, accel in blocks:
            last = first + times.size
            time[first:last], counts[0][first:last], counts[1][first:last] = times, gyro, accel
            first = last


def write_odometer(path: Path, time: NDArray, count: NDArray, tool: ToolOptions, run: str) -> None:
    """Write ``odometer.nc``."""
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("sample", time.size)
        file.createDimension("wheel", count.shape[1])
        _variable(file, "time", "f8", ("sample",), 131072, units="s")[:] = time
        _variable(file, "count", "i8", ("sample", "wheel"), 131072, units="1", long_name="cumulative pulses")[:] = count
        file.setncatts({"run": run, "source": SOURCE, "pulse_m": tool.wheel_pulse_m})


def write_caliper(path: Path, blocks: Iterable[tuple[NDArray, NDArray]], angles: NDArray, tool: ToolOptions, run: str) -> None:
    """Write ``caliper.nc``; a tool with more than one ring has the dim ``ring``."""
    rings = len(tool.ring_offset_m)
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("scan", None)
        dims: tuple[str, ...] = ("scan", "arm")
        if rings > 1:
            file.createDimension("ring", rings)
            dims = ("scan", "ring", "arm")
        file.createDimension("arm", tool.arms)
        time = _variable(file, "time", "f8", ("scan",), 16384, units="s")
        where = "in the tool cross-section, 0 = tool up (z), positive clockwise looking along body y"
        _variable(file, "arm_angle", "f8", ("arm",), None, units="radian", long_name=where)[:] = angles
        radius = file.createVariable(
            "radius",
            "u2",
            dims,
            chunksizes=(16384, *(len(file.dimensions[d]) for d in dims[1:])),
            fill_value=FILL,
            **_PACKED,
        )
        radius.setncatts({"units": "m", "long_name": "tool axis to inner wall", "scale_factor": PACKING_M, "add_offset": 0.0})
        radius.set_auto_maskandscale(False)
        file.setncatts({"run": run, "source": SOURCE, "ring_offset_m": np.array(tool.ring_offset_m)})
        first = 0
        for times, packed in blocks:
            last = first + times.size
            time[first:last], radius[first:last] = times, packed if rings > 1 else packed[:, 0]
            first = last


def write_markers(path: Path, markers: pd.DataFrame) -> None:
    """Write ``markers.csv``."""
    digits = {"time_s": 3, "latitude_deg": 9, "longitude_deg": 9, "height_m": 4, "sigma_horizontal_m": 2, "sigma_vertical_m": 2}
    write_table(path, markers, digits)


def write_table(path: Path, table: pd.DataFrame, digits: Mapping[str, int] | None = None) -> None:
    """Write a CSV file; numbers with the digits given for their column, else with twelve significant ones; NaN is empty."""
    out = table.copy()
    for column in out.columns:
        if out[column].dtype.kind == "f":
            form = f"{{:.{digits[column]}f}}" if digits and column in digits else "{:.12g}"
            out[column] = [form.format(v) if np.isfinite(v) else "" for v in out[column]]
    out.to_csv(path, index=False, lineterminator="\n")


def write_header(path: Path, options: SimulateOptions, run: RunOptions, tool: ToolOptions, launch: tuple[Any, float]) -> None:
    """Write ``run.toml``; the launch is its position (arrays of one) and the time of standing."""
    route, grade = options.route, grade_of(tool)
    (latitude, longitude, height), static = launch
    matrix = [[float(v) for v in row] for row in tool.sensor_to_body]
    lines = [
        "[run]",
        f'id = "{run.id}"',
        f'line = "{options.line}"',
        f"date = {run.date.isoformat()}",
        f'direction = "{run.direction}"',
        "\n[pipe]",
        f"outside_diameter_m = {route.outside_diameter_m}",
        f"nominal_wall_m = {route.wall_m}",
        f"nominal_joint_m = {route.joint_m}",
        "\n[launch]",
        f"latitude_deg = {latitude[0]:.9f}",
        f"longitude_deg = {longitude[0]:.9f}",
        f"height_m = {height[0]:.4f}",
        f"static_s = {static}",
        "\n[imu]",
        f"rate_hz = {rate_of(tool)}",
        f"sensor_to_body = {matrix}",
        *(f"{name} = {getattr(grade, name)}" for name in FIGURES),
        "\n[odometer]",
        f"wheels = {tool.wheels}",
        f"scale_error = {tool.wheel_scale}",
        f"lever_arm_m = [0.0, {tool.wheel_lever_m}, 0.0]",
    ]
    if tool.caliper:
        rings = f"ring_offset_m = {list(tool.ring_offset_m)}"
        lines += ["\n[caliper]", f"arms = {tool.arms}", rings, f"noise_m = {tool.arm_noise_m}"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _variable(file: netCDF4.Dataset, name: str, kind: str, dims: tuple[str, ...], chunk: int | None, **attrs: str) -> Any:
    sizes = None
    if chunk is not None:
        first = file.dimensions[dims[0]]
        rows = chunk if first.isunlimited() else max(1, min(chunk, len(first)))
        sizes = (rows, *(len(file.dimensions[d]) for d in dims[1:]))
    variable = file.createVariable(name, kind, dims, chunksizes=sizes, **_PACKED)
    variable.setncatts(attrs)
    return variable
