"""Helpers of the caliper tests: raw runs in memory, a trajectory from the truth."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import TypeAdapter

from deform.run import build
from deform.run.raw import RawRun, RunHeader


def demo_run(demo: Path, run: str) -> RawRun:
    """A raw run of the demonstration data, arms lazy and packed."""
    folder = demo / run
    header = TypeAdapter(RunHeader).validate_python(tomllib.loads((folder / "run.toml").read_text()))
    names = ("imu", "odometer", "caliper")
    imu, odometer, arms = (xr.open_dataset(folder / f"{n}.nc", mask_and_scale=False, decode_times=False) for n in names)
    events = pd.read_csv(folder / "welds.csv")
    heard = build.dataset("weld_events", {"time": events.time_s, "amplitude": events.amplitude})
    return RawRun(header, imu, odometer, arms, heard, None, folder)


def true_trajectory(demo: Path, run: str) -> xr.Dataset:
    """The trajectory that perfect navigation would give."""
    with xr.open_dataset(demo / "truth" / run / "truth.nc", decode_times=False) as t:
        t = t.load()
    values = {"time": t.time, "log_distance": t.travel, "chainage": t.chainage, "latitude": t.latitude, "longitude": t.longitude}
    values |= {"height": t.height, "azimuth": t.imu_azimuth, "pitch": t.imu_pitch, "roll": t.imu_roll, "speed": t.speed}
    arrays = {k: np.asarray(v.values, float) for k, v in values.items()}
    small = np.full(arrays["time"].size, 0.01)
    arrays |= dict.fromkeys(("east_sigma", "north_sigma", "up_sigma", "chainage_sigma"), small)
    return build.dataset("trajectory", {**arrays, "stationary": np.abs(arrays["speed"]) < 1e-3})
