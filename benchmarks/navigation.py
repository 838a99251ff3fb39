"""Navigation of long runs at 200 Hz, each in a process of its own: time a sample, peak memory, and python-ins beside it.

``python -m benchmarks.navigation 1 10 50`` for other lengths in hours. The runs are simulated once (4 s of processor an hour)
and kept in the folder for temporary files, or in the one that DEFORM_BENCH names; DEFORM_PYINS names an interpreter that has
python-ins when this one has not.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks._long_run import write_long_run
from deform.nav import solution
from deform.nav.navigate import navigate
from deform.readers.reader import read_source

WARM_H = 0.5
PEER_SAMPLES = (12_000, 24_000)


def folder() -> Path:
    return Path(os.environ.get("DEFORM_BENCH", Path(tempfile.gettempdir()) / "deform-long-runs"))


def clocks() -> np.ndarray:
    return np.array([time.perf_counter(), time.process_time()])


def measure(hours: float) -> dict[str, float]:
    """Read and navigate one run, warm; wall and processor seconds, samples and peak memory of this process."""
    navigate(read_source(folder() / f"long-{WARM_H:g}"))  # compiles
    learning = np.zeros(2)
    learn = solution.learn

    def timed(*arguments):
        start = clocks()
        found = learn(*arguments)
        learning[:] += clocks() - start
        return found

    solution.learn = timed
    start = clocks()
    raw = read_source(folder() / f"long-{hours:g}")
    read = clocks() - start
    start = clocks()
    found = navigate(raw)
    took = clocks() - start
    error = float(np.hypot(found.trajectory["east_sigma"], found.trajectory["north_sigma"]).mean())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {"hours": hours, "samples": raw.imu.sizes["sample"], "read_s": read[1], "wall_s": took[0], "work_s": took[1],
            "learn_s": learning[1], "peak_gb": peak, "sigma_m": error}  # fmt: skip


def in_own_process(hours: float) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.navigation", "--one", f"{hours:g}"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def peer() -> list[tuple[int, float]]:
    """Samples and processor seconds of python-ins over the first stretch in motion; nothing where it is not installed."""
    raw = read_source(folder() / f"long-{WARM_H:g}")
    time_, imu = raw.imu["time"].values, raw.imu
    first = int(np.searchsorted(time_, raw.header.launch.static_s + 10.0))
    most = min(max(PEER_SAMPLES), time_.size - first - 1)
    here = slice(first + 1, first + 1 + most)
    forward_right_down = [1, 0, 2], np.array([1.0, 1.0, -1.0])
    turn, push = (
        imu[name].values[here][:, forward_right_down[0]] * forward_right_down[1] * imu.attrs[pulse]
        for name, pulse in (("gyro_count", "gyro_pulse_rad"), ("accel_count", "accel_pulse_m_per_s"))
    )
    found = navigate(raw).trajectory
    names = ("latitude", "longitude", "height", "velocity_north", "velocity_east", "velocity_up", "roll", "pitch", "azimuth")
    start = np.array([np.interp(time_[first], found["time"], found[name]) for name in names])
    start[5] *= -1.0
    speed = np.interp(time_[first : first + most + 1], found["time"], found["speed"])
    path = folder() / "stretch.npz"
    np.savez(path, time=time_[first : first + most + 1], turn=turn, push=push, start=start, speed=speed)
    command = [os.environ.get("DEFORM_PYINS", sys.executable), str(Path(__file__).with_name("_pyins_peer.py")), str(path)]
    done = subprocess.run([*command, *map(str, PEER_SAMPLES)], capture_output=True, text=True)
    if done.returncode:
        print(f"python-ins not measured: {done.stderr.strip().splitlines()[-1]}")
        return []
    return [(int(n), float(s)) for n, s in (line.split() for line in done.stdout.splitlines())]


def main(lengths: tuple[float, ...] = (1.0, 4.0)) -> None:
    """Print a row per length, the time of a further sample, and the ratio to python-ins."""
    for hours in (WARM_H, *lengths):
        write_long_run(folder(), hours)
    print("   h  samples  read   navigation: wall, processor, of which learning the noise   µs a sample without learning   peak")
    rows = [in_own_process(hours) for hours in lengths]
    for r in rows:
        each = (r["work_s"] - r["learn_s"]) / r["samples"] * 1e6
        print(f"{r['hours']:4g} {r['samples'] / 1e6:6.2f} M {r['read_s']:5.1f} s {r['wall_s']:12.1f} s {r['work_s']:8.1f} s "
              f"{r['learn_s']:10.1f} s {each:38.3f} {r['peak_gb']:17.2f} GB", flush=True)  # fmt: skip
    print("bars: 50 h within 60 s and 4 GB; a sample's time equal within 10 % at all lengths")
    longest = rows[-1]
    ours = longest["work_s"] / longest["samples"]
    for count, took in peer():
        print(f"python-ins, integration and filter without smoother: {took / count * 1e6:.1f} µs a sample over {count} samples, "
              f"{took / count / ours:.0f} times ours with everything (bar 50)")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(float(sys.argv[2]))))
    else:
        main(*([tuple(float(h) for h in sys.argv[1:])] if sys.argv[1:] else []))
