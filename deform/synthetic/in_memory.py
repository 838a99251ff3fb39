"""A simulated passage in, the raw run that a reader would give of its files out, without files."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import TypeAdapter

from deform.options import SimulateOptions
from deform.run import build
from deform.run.raw import RawRun, RunHeader
from deform.synthetic import arms, imu, wheels
from deform.synthetic.motion import TRAP_M
from deform.synthetic.route import stream
from deform.synthetic.simulate import Passage, heard_markers

_PIPE = {"outside_diameter": "outside_diameter", "nominal_wall": "wall", "nominal_joint": "joint"}  # header and route


def raw_run(passage: Passage, options: SimulateOptions, errors: imu.Errors | None = None, noise: str = "") -> RawRun:
    """Return the raw run of a passage: inertial unit, odometer, weld detector and markers, no arms.

    Parameters
    ----------
    passage : from `simulate.ride`.
    options : of the simulation that the passage is of.
    errors : turn-on errors of the unit; None draws those that `simulate.simulate` gives this run.
    noise : name of another draw of the unit's noise, for runs that share one turn-on.

    Examples
    --------
    >>> options = SimulateOptions.demo()
    >>> raw_run(ride(options), options).id  # doctest: +SKIP
    'demo-2019'
    """
    run, tool, motion = passage.run, passage.tool, passage.motion
    grade = imu.grade_of(tool)
    errors = errors or imu.draw_errors(grade, stream(options.seed, run.id, "imu errors"))
    blocks = list(imu.counts(motion, tool, errors, options.seed, run.id + noise))
    time, gyro, accel = (np.concatenate(part) for part in zip(*blocks, strict=True))
    inertial = build.dataset("imu", {"time": time, "gyro_count": gyro, "accel_count": accel})
    inertial = inertial.assign_attrs(gyro_pulse_rad=grade.gyro_pulse_rad, accel_pulse_m_per_s=grade.accel_pulse_m_per_s)
    at, count, _scale, _slips = wheels.roll_wheels(motion, tool, options.seed, run.id)
    odometer = build.dataset("odometer", {"time": at, "count": count}).assign_attrs(pulse_m=tool.wheel_pulse_m)
    events = arms.detect_welds(motion, tool, options.seed, run.id)[0]
    return RawRun(
        header_of(passage, options),
        inertial,
        odometer,
        weld_events=build.dataset("weld_events", {"time": events.time_s, "amplitude": events.amplitude}),
        passages=passages_of(passage, options),
    )


def passages_of(passage: Passage, options: SimulateOptions) -> xr.Dataset:
    """Return the markers of a passage as heard and surveyed; another seed of the options draws other errors."""
    heard = heard_markers(passage, options)
    values = {"name": heard.name, "kind": heard.kind, "time": heard.time_s}
    values |= {v: heard[f"{v}_{unit}"] for v, unit in (("latitude", "deg"), ("longitude", "deg"), ("height", "m"))}
    values |= {v: heard[f"{v}_m"] for v in ("sigma_horizontal", "sigma_vertical")}
    return build.dataset("passages", values)


def header_of(passage: Passage, options: SimulateOptions) -> RunHeader:
    """Return what ``run.toml`` says of a passage."""
    run, tool, route = passage.run, passage.tool, options.route
    grade = imu.grade_of(tool)
    latitude, longitude, height = (float(v[0]) for v in passage.motion.line.position([TRAP_M]))
    figures = {name: getattr(grade, name) for name in imu.FIGURES}
    pipe = {f"{name}_m": getattr(route, f"{own}_m") for name, own in _PIPE.items()}
    content = {
        "run": {"id": run.id, "line": options.line, "date": run.date, "direction": run.direction},
        "pipe": pipe,
        "launch": {"latitude_deg": latitude, "longitude_deg": longitude, "height_m": height, "static_s": tool.static_start_s},
        "imu": {"rate_hz": imu.rate_of(tool), "sensor_to_body": tool.sensor_to_body, **figures},
        "odometer": {"wheels": tool.wheels, "scale_error": tool.wheel_scale, "lever_arm_m": [0.0, tool.wheel_lever_m, 0.0]},
    }
    return TypeAdapter(RunHeader).validate_python(content)
