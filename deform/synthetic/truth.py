"""One simulated passage in, what the simulator knew about it out: `truth.nc` and the tables beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.geometry.earth import enu_difference
from deform.synthetic._kernels import AZIMUTH, PITCH
from deform.synthetic.files import SOURCE
from deform.synthetic.imu import Errors
from deform.synthetic.route import Line

if TYPE_CHECKING:
    from deform.synthetic.simulate import Passage

Floats = NDArray[Any]

RATE_HZ = 10.0
GRID_M = 0.1
_IN_TIME = {
    "chainage": ("m", "line chainage of the IMU: arc length along this epoch's pipe centreline from chainage 0 of the line"),
    "travel": ("m", "distance of the IMU from the launching end of this run"),
    "speed": ("m s-1", "along the pipe"),
    "latitude": ("degree", "of the IMU, WGS84"),
    "longitude": ("degree", "of the IMU"),
    "height": ("m", "of the IMU above the ellipsoid"),
    "v_east": ("m s-1", "of the IMU"),
    "v_north": ("m s-1", "of the IMU"),
    "v_up": ("m s-1", "of the IMU"),
    "imu_azimuth": ("degree", "IMU body axes (what ideal navigation of the increments gives)"),
    "imu_pitch": ("degree", "IMU body axes"),
    "imu_roll": ("degree", "IMU body axes"),
    "tool_azimuth": ("degree", "tool axis; the IMU's body differs from it by the constant mounting angles"),
    "tool_pitch": ("degree", "tool axis"),
    "tool_roll": ("degree", "tool axis"),
    "pipe_azimuth": ("degree", "pipe centreline tangent in the direction of travel"),
    "pipe_pitch": ("degree", "pipe centreline tangent in the direction of travel"),
}
_ON_GRID = {
    "grid_chainage": ("m", "chainage along this epoch's pipe"),
    "grid_epoch0_chainage": ("m", "chainage in epoch 0 of the same material point"),
    "grid_latitude": ("degree", "centreline"),
    "grid_longitude": ("degree", "centreline"),
    "grid_height": ("m", "centreline"),
    "grid_azimuth": ("degree", "downstream tangent"),
    "grid_pitch": ("degree", "downstream tangent, positive up"),
    "curvature_horizontal": ("m-1", "d(azimuth)/ds * cos(pitch), positive to the right looking downstream"),
    "curvature_vertical": ("m-1", "d(pitch)/ds, positive when the pipe turns upward"),
    "curvature_total": ("m-1", "hypot of the two"),
    "bending_strain": ("1", "outside radius times total curvature"),
    "bending_strain_horizontal": ("1", "outside radius times horizontal curvature"),
    "bending_strain_vertical": ("1", "outside radius times vertical curvature"),
    "ovality": ("1", "(Dmax-Dmin)/nominal outside diameter, without dents"),
    "displacement_east": ("m", "position minus that of the same material in epoch 0; NaN in a reroute"),
    "displacement_north": ("m", "as east"),
    "displacement_up": ("m", "as east"),
    "material": ("1", "0 pipe of epoch 0, 1 replaced in a cut-out, 2 reroute"),
    "joint_index": ("1", "row of joints_truth.csv, from 0"),
}
_KINDS = {"material": "i1", "joint_index": "i4", "ovality": "f4"}


def trajectory(passage: Passage, rate_hz: float = RATE_HZ) -> dict[str, Floats]:
    """Return the true motion of one run on the tool clock (degree, metre, m/s), by the names of `truth.nc`."""
    times = np.arange(int(passage.motion.duration * rate_hz + 1e-6) + 1) / rate_hz
    x = passage.motion.states(times)
    values = {"time": times, "chainage": passage.chainage(x[:, 6]), "travel": x[:, 6], "speed": x[:, 7]}
    values |= {"latitude": np.degrees(x[:, 0]), "longitude": np.degrees(x[:, 1]), "height": x[:, 2]}
    values |= {"v_east": x[:, 3], "v_north": x[:, 4], "v_up": x[:, 5]}
    for first, name in ((10, "imu"), (13, "tool")):
        angles = np.degrees(x[:, first : first + 3])
        values |= {f"{name}_azimuth": angles[:, 0] % 360.0, f"{name}_pitch": angles[:, 1], f"{name}_roll": angles[:, 2]}
    return values | {"pipe_azimuth": np.degrees(x[:, 8]) % 360.0, "pipe_pitch": np.degrees(x[:, 9])}


def centreline(line: Line, built: Line) -> dict[str, Floats]:
    """Return the true centreline of one epoch on a regular grid of chainage, by the names of `truth.nc`."""
    grid = np.arange(int(line.length / GRID_M + 1e-6) + 1) / round(1.0 / GRID_M)
    material = np.interp(grid, line.chainage, line.material)
    here, there = line.position(grid), built.position(material)
    horizontal, vertical = line.curvature(grid)
    replaced = line.replaced[np.searchsorted(line.chainage, grid).clip(0, line.replaced.size - 1)]
    shift = np.stack(enu_difference(*here, *there))
    shift[:, replaced == 2] = np.nan
    radius = 0.5 * line.outside_diameter
    joint = np.searchsorted(line.joints.start_m.to_numpy(), grid, side="right") - 1
    return {
        "grid_chainage": grid,
        "grid_epoch0_chainage": material,
        "grid_latitude": here[0],
        "grid_longitude": here[1],
        "grid_height": here[2],
        "grid_azimuth": np.degrees(line.at(grid, AZIMUTH)[:, 0]) % 360.0,
        "grid_pitch": np.degrees(line.at(grid, PITCH)[:, 0]),
        "curvature_horizontal": horizontal,
        "curvature_vertical": vertical,
        "curvature_total": np.hypot(horizontal, vertical),
        "bending_strain": radius * np.hypot(horizontal, vertical),
        "bending_strain_horizontal": radius * horizontal,
        "bending_strain_vertical": radius * vertical,
        "ovality": _ovality(line, grid, joint),
        "displacement_east": shift[0],
        "displacement_north": shift[1],
        "displacement_up": shift[2],
        "material": replaced,
        "joint_index": joint,
    }


def write_dataset(passage: Passage, errors: Errors, wheel_scale: Floats, path: Path) -> None:
    """Write ``truth.nc``."""
    with netCDF4.Dataset(path, "w") as file:
        moving, resting = trajectory(passage), centreline(passage.line, passage.built)
        file.createDimension("time", moving["time"].size)
        file.createDimension("grid", resting["grid_chainage"].size)
        _put(file, "time", ("time",), moving["time"], "s", "tool clock")
        for name, (units, text) in _IN_TIME.items():
            _put(file, name, ("time",), moving[name], units, text)
        for name, (units, text) in _ON_GRID.items():
            _put(file, name, ("grid",), resting[name], units, text)
        motion = passage.motion
        file.setncatts({"run": passage.run.id, "source": SOURCE, "direction": passage.run.direction})
        file.setncatts({f"mounting_{n}_deg": v for n, v in zip(("azimuth", "pitch", "roll"), motion.mounting_deg, strict=True)})
        file.setncatts({"gyro_bias_rad_per_s": errors.gyro_bias, "accel_bias_m_per_s2": errors.accel_bias})
        file.setncatts({"gyro_scale_misalignment": errors.gyro_matrix.ravel()})
        file.setncatts({"accel_scale_misalignment": errors.accel_matrix.ravel(), "odometer_scale": wheel_scale})
        file.setncatts({"line_length_m": passage.line.length, "motion_start_s": motion.begin, "motion_end_s": motion.end})
        file.setncattr("title", "truth of a simulated run")


def joints_table(line: Line) -> pd.DataFrame:
    """Return `joints_truth.csv`."""
    return line.joints[["joint_id", "start_m", "length_m", "wall_m", "kind", "bend_angle_deg", "is_replaced"]]


def welds_table(passage: Passage, passed: Floats, seen: NDArray[np.bool_]) -> pd.DataFrame:
    """Return `welds_truth.csv`: passages and detections come in the order of travel."""
    joints = passage.line.joints
    if passage.upstream:
        passed, seen = passed[::-1], seen[::-1]
    return pd.DataFrame(
        {
            "weld_id": joints.weld_id.to_numpy()[1:],
            "upstream_joint": joints.joint_id.to_numpy()[:-1],
            "downstream_joint": joints.joint_id.to_numpy()[1:],
            "chainage_m": joints.start_m.to_numpy()[1:],
            "epoch0_chainage_m": joints.material_start.to_numpy()[1:],
            "time_s": passed,
            "detected": seen.astype(int),
        }
    )


def _ovality(line: Line, grid: Floats, joint: NDArray[np.intp]) -> Floats:
    """Ovality as the arms see it: blended out over 0.5 m to the welds."""
    start = line.joints.start_m.to_numpy()
    end = np.append(start[1:], start[-1] + 100.0)
    u = np.clip(np.minimum(grid - start[joint], end[joint] - grid) / 0.5, 0.0, 1.0)
    return line.joints.ovality.to_numpy()[joint] * u * u * (3.0 - 2.0 * u)


def _put(file: netCDF4.Dataset, name: str, dims: tuple[str, ...], values: Floats, units: str, text: str) -> None:
    variable = file.createVariable(name, _KINDS.get(name, "f8"), dims, zlib=True, shuffle=True, complevel=4)
    variable.setncatts({"units": units, "long_name": text})
    variable[:] = values
