"""The caliper room over whole simulated lines with perfect navigation, against their truth.

Run with ``python -m benchmarks.caliper_lines [LINE ...]``; without names all of `benchmarks/lines` are taken. Places, counts and
errors are formed as the judge of surveys forms them (`benchmarks.surveys`), which also has the errors of navigation in them.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.surveys import LINES
from deform.caliper.measure import Measurement, measure
from deform.readers.raw_folder import read_raw_folder
from deform.run import build
from deform.survey import write_demo

WELD_M, DENT_M, DENT_DEG = 0.1, 0.3, 20.0  # what lies within these is the same


def true_trajectory(truth: Path) -> xr.Dataset:
    """The trajectory that perfect navigation would give."""
    with xr.open_dataset(truth / "truth.nc", decode_times=False) as t:
        names = {n: n for n in ("time", "chainage", "latitude", "longitude", "height", "speed")}
        names |= {"log_distance": "travel", "azimuth": "imu_azimuth", "pitch": "imu_pitch", "roll": "imu_roll"}
        values = {name: np.asarray(t[source].values, float) for name, source in names.items()}
    small = np.full(values["time"].size, 0.01)
    values |= dict.fromkeys(("east_sigma", "north_sigma", "up_sigma", "chainage_sigma"), small)
    return build.dataset("trajectory", {**values, "stationary": np.abs(values["speed"]) < 1e-3})


def welds(found: xr.Dataset, truth: Path) -> str:
    true = np.sort(pd.read_csv(truth / "welds_truth.csv").chainage_m.to_numpy())
    claimed = np.sort(found["chainage"].values[found["probability"].values >= 0.5])
    nearest = np.abs(claimed[:, None] - true[None, :]).argmin(axis=0)
    own = np.abs(claimed[:, None] - true[None, :]).argmin(axis=1)
    paired = np.flatnonzero((np.abs(claimed[nearest] - true) < WELD_M) & (own[nearest] == np.arange(true.size)))
    lost = [f"{p:.2f}" for p in np.delete(true, paired)][:4]
    false = [f"{p:.2f}" for p in np.delete(claimed, nearest[paired])][:4]
    beside = np.flatnonzero(np.diff(paired) == 1)
    error = 1e3 * (np.diff(claimed[nearest[paired]]) - np.diff(true[paired]))[beside]
    sigma = 1.4826 * np.median(np.abs(error - np.median(error)))
    lengths = f"joint length, robust sigma {sigma:.1f} mm, worst {np.abs(error).max():.0f} mm"
    rates = f"recall {paired.size / true.size:.4f}, precision {paired.size / claimed.size:.4f}"
    return f"{true.size} welds, {rates}, {lengths}; lost {lost}, false {false}"


def dents(found: xr.Dataset, truth: Path, diameter: float) -> str:
    true = pd.read_csv(truth / "dents_truth.csv")
    true = true[true.depth_m >= 0.01 * diameter].reset_index(drop=True)
    at, clock = found["chainage"].values, found["clock"].values
    apart = np.abs(at[:, None] - true.chainage_m.to_numpy()[None, :])
    side = np.abs((clock[:, None] - true.clock_deg.to_numpy()[None, :] + 180.0) % 360.0 - 180.0)
    same = (apart < DENT_M) & (side < DENT_DEG)
    words = [f"{int(same.any(axis=0).sum())} of {len(true)} dents, {int((~same.any(axis=1)).sum())} invented"]
    for j in np.flatnonzero(same.any(axis=0)):
        i = int(np.argmin(np.where(same[:, j], apart[:, j], np.inf)))
        error, sigma = found["depth"].values[i] - true.depth_m[j], found["depth_sigma"].values[i]
        length, width = (found[n].values[i] / true[f"{n}_m"][j] - 1.0 for n in ("length", "width"))
        depth = f"{true.depth_m[j] * 1e3:.1f} mm: {error * 1e3:+.2f} (sigma {sigma * 1e3:.2f}) mm"
        words.append(f"{depth}, {side[i, j]:.1f} degree, length {length:+.1%}, width {width:+.1%}")
    return "; ".join(words)


def ovality(m: Measurement, truth: Path) -> str:
    with xr.open_dataset(truth / "truth.nc", decode_times=False) as t:
        grid, true = t["grid_chainage"].values, t["ovality"].values
    error = m.sections["ovality"].values - np.interp(m.sections["chainage"].values, grid, true)
    held = np.mean(np.abs(error) < 1.96 * m.sections["ovality_sigma"].values)
    return f"ovality rms {100 * np.sqrt(np.mean(error**2)):.3f} % of the diameter, {held:.1%} within 1.96 sigma"


def main() -> None:
    for name in sys.argv[1:] or sorted(p.stem for p in LINES.glob("*.toml")):
        with tempfile.TemporaryDirectory() as folder:
            write_demo(Path(folder), options_file=LINES / f"{name}.toml")
            for truth in sorted(p for p in (Path(folder) / "truth").iterdir() if p.is_dir()):
                raw = read_raw_folder(Path(folder) / truth.name)
                m = measure(raw, true_trajectory(truth))
                print(f"{name}, {truth.name}: {welds(m.welds, truth)}", flush=True)
                if m.dents is not None:
                    print(f"    {dents(m.dents, truth, raw.header.pipe.outside_diameter_m)}\n    {ovality(m, truth)}", flush=True)


if __name__ == "__main__":
    main()
