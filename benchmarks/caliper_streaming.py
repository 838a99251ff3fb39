"""Time and memory of the caliper room on a long run: 10 mm × 64 arms, streamed from a netCDF file.

Run with ``python benchmarks/caliper_streaming.py [km ...]``; each length runs in a process of its own, memory is its peak.
The bar is 100 km in 600 s and 2 GB on two cores; two lengths give the slope by which the memory grows.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr
from pydantic import TypeAdapter

from deform.caliper.measure import measure
from deform.run import build
from deform.run.raw import RawRun, RunHeader

ARMS, STEP, SPEED, JOINT = 64, 0.01, 1.5, 12.2


def write_arms(path: Path, length: float) -> None:
    """A round pipe with a bead at each weld, a dent each kilometre, noise and a tool that wanders."""
    rng, scans, block = np.random.default_rng(1), int(length / STEP), 50_000
    angle = np.arange(ARMS) * 2 * np.pi / ARMS
    noise = rng.normal(0, 3e-4, (block, ARMS))
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("scan", scans)
        file.createDimension("arm", ARMS)
        clock = file.createVariable("time", "f8", ("scan",))
        radius = file.createVariable(
            "radius", "u2", ("scan", "arm"), zlib=True, complevel=1, fill_value=65535, chunksizes=(4096, ARMS)
        )
        radius.scale_factor, radius.add_offset = 1e-4, 0.0
        radius.set_auto_maskandscale(False)
        file.createVariable("arm_angle", "f8", ("arm",))[:] = angle
        for first in range(0, scans, block):
            place = np.arange(first, min(first + block, scans)) * STEP
            size = 0.2413 + 2e-3 * np.cos(angle - 0.001 * place[:, None]) + noise[: place.size]
            size -= 1e-3 * (np.abs((place + JOINT / 2) % JOINT - JOINT / 2) < 0.012)[:, None]
            along = (place + 500.0) % 1000.0 - 500.0 - 7.0
            size -= 0.012 * np.exp(-2.3 * (along / 0.15) ** 2)[:, None] * np.exp(-2.3 * ((angle - 2.0) / 0.4) ** 2)
            radius[first : first + place.size] = np.round(size / 1e-4).astype(np.uint16)
            clock[first : first + place.size] = place / SPEED


def raw_run(path: Path, length: float) -> tuple[RawRun, xr.Dataset]:
    seconds = length / SPEED
    header = {
        "run": {"id": "long", "line": "l", "date": "2020-01-01"},
        "pipe": {"outside_diameter_m": 0.508, "nominal_wall_m": 0.0127, "nominal_joint_m": JOINT},
        "launch": {"latitude_deg": 60.0, "longitude_deg": 10.0, "height_m": 0.0},
        "imu": {"rate_hz": 100.0},
        "odometer": {"wheels": 1},
        "caliper": {"arms": ARMS, "ring_offset_m": [0.0], "noise_m": 3e-4},
    }
    samples = int(seconds * 100)
    counts = np.random.default_rng(2).integers(-9, 9, (samples, 3), dtype=np.int32)
    hits = np.searchsorted(np.arange(samples) * 0.01, np.arange(JOINT, length, JOINT) / SPEED)
    for lag in range(-3, 4):
        counts[np.clip(hits + lag, 0, samples - 1), 1] += np.random.default_rng(lag + 9).integers(
            -150, 150, hits.size, dtype=np.int32
        )
    imu = xr.Dataset({"time": ("sample", np.arange(samples) * 0.01), "accel_count": (("sample", "axis"), counts)})
    arms = xr.open_dataset(path, mask_and_scale=False, decode_times=False)
    time_axis = np.arange(0.0, seconds + 0.05, 0.05)
    zero = np.zeros_like(time_axis)
    names = ("latitude", "longitude", "height", "east_sigma", "north_sigma", "up_sigma", "azimuth", "pitch")
    values = {"time": time_axis, "chainage": SPEED * time_axis, "log_distance": SPEED * time_axis}
    values |= {"roll": 0.1 * time_axis, "speed": zero + SPEED}
    trajectory = build.dataset("trajectory", {**dict.fromkeys(names, zero), **values})
    return RawRun(TypeAdapter(RunHeader).validate_python(header), imu, xr.Dataset(), arms), trajectory


def one(km: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "caliper.nc"
        write_arms(path, km * 1000)
        raw, trajectory = raw_run(path, km * 1000)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        start, work = time.perf_counter(), time.process_time()
        m = measure(raw, trajectory)
        wall, work = time.perf_counter() - start, time.process_time() - work
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        found = f"{m.dents.sizes['dent']} dents, {int((m.welds.probability.values >= 0.5).sum())} welds"
        print(
            f"{km:6.1f} km: {wall:7.1f} s ({work:.1f} s of processors), peak {peak:.2f} GB (input {before:.2f} GB), {found}",
            flush=True,
        )


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "--one":
        one(float(sys.argv[2]))
    else:
        for km in sys.argv[1:] or ["2", "10"]:
            subprocess.run([sys.executable, __file__, "--one", km], check=True)
