"""A long raw run folder, made light: simulated motion and sensors, no caliper, no truth."""

from __future__ import annotations

import datetime
from pathlib import Path

from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.synthetic import arms, files, imu, wheels
from deform.synthetic.motion import TRAP_M
from deform.synthetic.route import stream
from deform.synthetic.simulate import heard_markers, ride

SPEED = 1.2  # m/s


def write_long_run(folder: Path, hours: float, marker_spacing_m: float = 2000.0) -> Path:
    """Write a raw run of about this many hours at 200 Hz (Li 2014, table 1) below a folder; return the run's folder.

    A run that is there already is taken as it is.
    """
    run = folder / f"long-{hours:g}"
    if (run / "run.toml").is_file():
        return run
    tool = ToolOptions(imu="li-2014", speed_m_per_s=SPEED, caliper=False, stops=max(int(hours), 1))
    length = max(SPEED * 3600.0 * (hours - 0.25 - 0.02 * hours), 300.0)
    route = RouteOptions(length_m=length, marker_spacing_m=marker_spacing_m)
    runs = (RunOptions(id=run.name, date=datetime.date(2020, 1, 1)),)
    options = SimulateOptions(line="long", route=route, tool=tool, runs=runs)
    passage = ride(options)
    grade, motion = imu.grade_of(tool), passage.motion
    run.mkdir(parents=True, exist_ok=True)
    errors = imu.draw_errors(grade, stream(options.seed, run.name, "imu errors"))
    files.write_imu(run / "imu.nc", imu.counts(motion, tool, errors, options.seed, run.name), grade, imu.rate_of(tool), run.name)
    time, count, _, _ = wheels.roll_wheels(motion, tool, options.seed, run.name)
    files.write_odometer(run / "odometer.nc", time, count, tool, run.name)
    files.write_table(
        run / "welds.csv", arms.detect_welds(motion, tool, options.seed, run.name)[0], {"time_s": 4, "amplitude": 3}
    )
    files.write_markers(run / "markers.csv", heard_markers(passage, options))
    files.write_header(run / "run.toml", options, runs[0], tool, (motion.line.position([TRAP_M]), tool.static_start_s))
    return run
