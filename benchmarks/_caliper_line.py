"""A simulated passage of the caliper alone, with its truth: arms, true trajectory, detector and accelerometers."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import TypeAdapter

from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.run import build
from deform.run.raw import RawRun, RunHeader
from deform.synthetic import arms, epochs, imu, simulate, truth

FILL = np.uint16(arms.FILL)


@dataclass(frozen=True)
class CaliperLine:
    """One passage: raw run (arms in memory), trajectory as perfect navigation gives it, true joints, welds and dents."""

    raw: RawRun
    trajectory: xr.Dataset
    joints: pd.DataFrame
    dents: pd.DataFrame
    passage: simulate.Passage

    @property
    def welds(self) -> np.ndarray:
        """Chainage of the true girth welds (m)."""
        return self.joints.start_m.to_numpy()[1:]


def caliper_line(
    seed: int,
    length_m: float = 1000.0,
    route: dict | None = None,
    tool: dict | None = None,
    direction: str = "downstream",
    listening: bool = False,
    **more,
) -> CaliperLine:
    """Return one passage.

    Parameters
    ----------
    seed : of everything.
    length_m : of the line.
    route, tool : further `RouteOptions` and `ToolOptions`.
    direction : of the passage.
    listening : with the accelerometers; else the inertial unit is too short to be listened to.
    **more : dents, fittings, replacements of `SimulateOptions`.
    """
    options = SimulateOptions(
        line="caliper",
        seed=seed,
        route=RouteOptions(**{"length_m": length_m, "valve_spacing_m": 5000.0, "crossings": 0, **(route or {})}),
        tool=ToolOptions(**{"static_start_s": 2.0, "static_end_s": 2.0, "stops": 0, **(tool or {})}),
        runs=(RunOptions(id="r", date=datetime.date(2020, 1, 1), direction=direction),),
        **more,
    )
    passage = simulate.passage_of(options, simulate.built_line(options), 0)
    dents, fittings = epochs.dents_at(passage.line, options, 0), epochs.fittings_at(passage.line, options)
    scanned = list(arms.scans(passage.motion, dents, passage.tool, seed, "r", passage.upstream, fittings))
    time, packed = (np.concatenate([block[k] for block in scanned]) for k in range(2))
    events, *_ = arms.detect_welds(passage.motion, passage.tool, seed, "r")
    heard = build.dataset("weld_events", {"time": events.time_s, "amplitude": events.amplitude})
    unit = _listening(passage, seed) if listening else still()
    raw = RawRun(header(options.route, passage.tool, direction), unit, xr.Dataset(), arms_of(time, packed, passage.tool), heard)
    return CaliperLine(raw, _trajectory(passage), truth.joints_table(passage.line), dents, passage)


def header(route: RouteOptions, tool: ToolOptions, direction: str = "downstream") -> RunHeader:
    """Return the header of a passage of a tool."""
    content = {
        "run": {"id": "r", "line": "caliper", "date": "2020-01-01", "direction": direction},
        "pipe": {
            "outside_diameter_m": route.outside_diameter_m,
            "nominal_wall_m": route.wall_m,
            "nominal_joint_m": route.joint_m,
        },
        "launch": {"latitude_deg": 60.0, "longitude_deg": 10.0, "height_m": 0.0},
        "imu": {"rate_hz": 100.0},
        "odometer": {"wheels": 1},
        "caliper": {"arms": tool.arms, "ring_offset_m": list(tool.ring_offset_m), "noise_m": tool.arm_noise_m},
    }
    return TypeAdapter(RunHeader).validate_python(content)


def arms_of(time: np.ndarray, packed: np.ndarray, tool: ToolOptions) -> xr.Dataset:
    """Return packed ranges (n, ring, arm) as a raw run holds them."""
    attrs = {"scale_factor": arms.PACKING_M, "add_offset": 0.0, "_FillValue": FILL}
    dims = ("scan", "ring", "arm") if packed.shape[1] > 1 else ("scan", "arm")
    radius = packed if packed.shape[1] > 1 else packed[:, 0]
    angle = arms.arm_angles(tool)
    return xr.Dataset({"time": ("scan", time), "radius": (dims, radius, attrs), "arm_angle": ("arm", angle)})


def still() -> xr.Dataset:
    """Return an inertial unit that is too short to be listened to."""
    count = np.zeros((10, 3), np.int32)
    return xr.Dataset({"time": ("sample", np.arange(10) * 0.01), "accel_count": (("sample", "axis"), count)})


def even_trajectory(seconds: float, speed: float, roll_deg_per_s: float) -> xr.Dataset:
    """Return an even passage of a straight level pipe as navigation would give it, at 20 Hz."""
    time = np.arange(0.0, seconds, 0.05)
    zero = np.zeros_like(time)
    names = ("latitude", "longitude", "height", "east_sigma", "north_sigma", "up_sigma", "azimuth", "pitch")
    values = {"time": time, "chainage": speed * time, "log_distance": speed * time, "speed": zero + speed}
    return build.dataset("trajectory", {**dict.fromkeys(names, zero), **values, "roll": roll_deg_per_s * time})


def _listening(passage: simulate.Passage, seed: int) -> xr.Dataset:
    errors = imu.draw_errors(imu.grade_of(passage.tool), np.random.default_rng(seed))
    blocks = [(time, accel) for time, _, accel in imu.counts(passage.motion, passage.tool, errors, seed, "r")]
    time, accel = (np.concatenate([b[k] for b in blocks]) for k in range(2))
    return xr.Dataset({"time": ("sample", time), "accel_count": (("sample", "axis"), accel)})


def _trajectory(passage: simulate.Passage) -> xr.Dataset:
    t = truth.trajectory(passage, 20.0)
    names = {n: n for n in ("time", "chainage", "latitude", "longitude", "height", "speed")}
    names |= {"log_distance": "travel", "azimuth": "imu_azimuth", "pitch": "imu_pitch", "roll": "tool_roll"}
    values = {name: t[source] for name, source in names.items()}
    small = np.full(t["time"].size, 0.01)
    values |= dict.fromkeys(("east_sigma", "north_sigma", "up_sigma", "chainage_sigma"), small)
    return build.dataset("trajectory", {**values, "stationary": np.abs(t["speed"]) < 1e-3})
