"""Time and memory of the caliper room on a long run: 10 mm × 64 arms, streamed from the netCDF files of a raw run folder.

Run with ``python -m benchmarks.caliper_streaming [km ...]``. Each length is written to disk by one process, and read (as
``deform run`` reads it) and measured by another, so that the printed memory is that of the product alone. The bar is 100 km in
600 s and 2 GB on two cores; two lengths give the slope by which the memory grows.
"""

from __future__ import annotations

import datetime
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks._caliper_line import even_trajectory
from deform.caliper.measure import Measurement, measure
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.readers.raw_folder import read_raw_folder
from deform.synthetic import arms, files, imu

ARMS, STEP, SPEED, JOINT = 64, 0.01, 1.5, 12.2  # arms, m, m/s, m
BLOCK = 50_000  # scans, or samples, that are written together
TOOL = ToolOptions(arms=ARMS, ring_offset_m=(0.0,), caliper_rate_hz=SPEED / STEP, wheels=1, speed_m_per_s=SPEED)
LAUNCH = (np.array([60.0]), np.array([10.0]), np.array([0.0]))


def write_run(folder: Path, length: float) -> None:
    """Write a raw run of so many metres: a straight pipe at even speed, a weld each joint, a dent each kilometre."""
    run = RunOptions(id="long", date=datetime.date(2020, 1, 1))
    route = RouteOptions(length_m=length, outside_diameter_m=0.508, wall_m=0.0127, joint_m=JOINT)
    options = SimulateOptions(line="long", route=route, tool=TOOL, runs=(run,))
    seconds, grade = length / SPEED, imu.grade_of(TOOL)
    files.write_header(folder / "run.toml", options, run, TOOL, (LAUNCH, 0.0))
    files.write_imu(folder / "imu.nc", shaken(seconds, grade), grade, imu.rate_of(TOOL), run.id)
    tick = np.arange(0.0, seconds, 1.0 / TOOL.wheel_rate_hz)
    files.write_odometer(folder / "odometer.nc", tick, np.int64(tick * SPEED / TOOL.wheel_pulse_m)[:, None], TOOL, run.id)
    files.write_caliper(folder / "caliper.nc", scans(length), arms.arm_angles(TOOL), TOOL, run.id)


def scans(length: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Time and packed ranges: a round pipe with a bead at each weld, a dent each kilometre, noise and a tool that wanders."""
    angle = arms.arm_angles(TOOL)
    noise = np.random.default_rng(1).normal(0, TOOL.arm_noise_m, (BLOCK, ARMS))
    for first in range(0, int(length / STEP), BLOCK):
        place = np.arange(first, min(first + BLOCK, int(length / STEP))) * STEP
        size = 0.2413 + 2e-3 * np.cos(angle - 0.001 * place[:, None]) + np.roll(noise, first, axis=0)[: place.size]
        size -= 1e-3 * (np.abs((place + JOINT / 2) % JOINT - JOINT / 2) < 0.012)[:, None]
        along = (place + 500.0) % 1000.0 - 500.0 - 7.0
        size -= 0.012 * np.exp(-2.3 * (along / 0.15) ** 2)[:, None] * np.exp(-2.3 * ((angle - 2.0) / 0.4) ** 2)
        yield place / SPEED, np.round(size / arms.PACKING_M).astype(np.uint16)[:, None]


def shaken(seconds: float, grade: imu.Grade) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time, gyro and accelerometer counts of a level tool that the welds shake."""
    rng, rate = np.random.default_rng(2), imu.rate_of(TOOL)
    weight = 9.81 / rate / grade.accel_pulse_m_per_s
    for first in range(1, int(seconds * rate), BLOCK):
        time = np.arange(first, min(first + BLOCK, int(seconds * rate))) / rate
        counts = rng.integers(-9, 9, (2, time.size, 3), dtype=np.int32)
        counts[1, :, 2] += int(weight)
        after = (time * SPEED) % JOINT / SPEED
        counts[1, after < 0.06, 1] += rng.integers(-150, 150, int((after < 0.06).sum()), dtype=np.int32)
        yield time, counts[0], counts[1]


def peak() -> float:
    """Largest memory that this process has held (GB)."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def measured(folder: Path) -> None:
    """Read and measure the run of a folder; print time, and the peak of memory after each stage."""
    peaks = {"imports": peak()}
    start, work = time.perf_counter(), time.process_time()
    raw = read_raw_folder(folder)
    passed = even_trajectory(float(raw.imu["time"][-1]), SPEED, 0.1)
    peaks["inertial unit and trajectory"] = peak()

    def stage(fraction: float) -> None:
        if fraction > 0.05:
            peaks["pass" if fraction < 0.84 else "dents, sections, welds" if fraction < 1.0 else "wall"] = peak()

    m: Measurement = measure(raw, passed, progress=stage)
    wall, work = time.perf_counter() - start, time.process_time() - work
    found = f"{m.dents.sizes['dent']} dents, {int((m.welds.probability.values >= 0.5).sum())} welds"
    words = ", ".join(f"{name} {size:.2f}" for name, size in peaks.items())
    print(
        f"{passed.chainage.values[-1] / 1e3:6.1f} km: {wall:6.1f} s ({work:.1f} s of processors), peak {peak():.2f} GB; {found}\n"
        f"           largest so far after {words} GB",
        flush=True,
    )


def main() -> None:
    if len(sys.argv) == 4 and sys.argv[1] == "--write":
        write_run(Path(sys.argv[2]), float(sys.argv[3]) * 1000.0)
    elif len(sys.argv) == 3 and sys.argv[1] == "--measure":
        measured(Path(sys.argv[2]))
    else:
        for km in sys.argv[1:] or ["2", "10"]:
            with tempfile.TemporaryDirectory() as folder:
                for task in (["--write", folder, km], ["--measure", folder]):
                    subprocess.run([sys.executable, "-m", "benchmarks.caliper_streaming", *task], check=True)


if __name__ == "__main__":
    main()
