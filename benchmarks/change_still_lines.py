"""False alarms on raw data: ten lines of 20 km on which nothing moves, simulated, navigated and searched.

    python -m benchmarks.change_still_lines [--folder DIR] [--rates 0.1 10] [LINE ...]

Two runs of each line, ten lines are 200 km. Runs and truth are kept in the folder and raw data deleted, so that a study that was
stopped goes on where it was, and a line that is searched again is not navigated again.
"""

from __future__ import annotations

import argparse
import datetime
import logging
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from deform.change.joint_change import Elongation
from deform.change.pair import PairSearch
from deform.change.stack import layer, reference_axis, tangents
from deform.correlate.weld_matching import match_runs
from deform.options import ChangeOptions, RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.processing import process
from deform.run import store
from deform.synthetic.simulate import simulate

# Outside diameter and wall (m); speed (m/s), arms and wobble (degree) of the tool; pitch of the hills and latitude (degree).
PIPES = (
    (0.3239, 0.00635, 1.2, 24, 0.14, 4.0, 61.0),
    (0.2191, 0.0064, 2.0, 40, 0.10, 2.0, 45.0),
    (0.508, 0.0079, 0.8, 24, 0.20, 8.0, 55.0),
    (0.6096, 0.0095, 1.5, 48, 0.14, 5.0, 52.0),
    (0.9144, 0.0127, 3.0, 64, 0.05, 3.0, 48.0),
)
LENGTH_M, YEARS = 20_000.0, (2015, 2019)
LINES = tuple(f"still{k}" for k in range(2 * len(PIPES)))
RATES = (0.1, 10.0)  # false alarms in 100 km
FOLDER = Path(tempfile.gettempdir()) / "still-lines"


def line_of(name: str) -> SimulateOptions:
    """Options of one line: each pipe twice, with 12 to 48 induction bends of 8 to 90 degree and four to thirteen bend fields."""
    k = LINES.index(name)
    diameter, wall, speed, arms, wobble, hills, latitude = PIPES[k % len(PIPES)]
    rng, count = np.random.default_rng(1000 + k), 12 + 4 * k
    bends = tuple(float(b) for b in rng.choice([-1, 1], count) * rng.uniform(8, 90, count))
    route = RouteOptions(
        length_m=LENGTH_M, outside_diameter_m=diameter, wall_m=wall, heavy_wall_m=1.4 * wall, induction_bends_deg=bends,
        bend_fields=4 + k, crossings=3, hill_pitch_deg=hills, latitude_deg=latitude, azimuth_deg=60.0 * k,
    )  # fmt: skip
    tool = ToolOptions(speed_m_per_s=speed, stops=3, arms=arms, wobble_deg=wobble, static_start_s=600, static_end_s=300)
    runs = tuple(RunOptions(id=f"r{year}", date=datetime.date(year, 6, 1)) for year in YEARS)
    return SimulateOptions(line=name, seed=300 + k, route=route, tool=tool, runs=runs)


def runs_of(name: str, folder: Path) -> list[xr.DataTree]:
    """Runs of a line from the folder; simulated and navigated where they are not there."""
    options = line_of(name)
    paths = [folder / name / f"{run.id}.nc" for run in options.runs]
    if not all(path.is_file() for path in paths):
        with tempfile.TemporaryDirectory(dir=folder) as place:
            raw = Path(place)
            for path, run in zip(paths, simulate(options, raw), strict=True):
                written = store.write_run(process(raw / run), raw / path.name)
                path.parent.mkdir(exist_ok=True)
                written.rename(path)
            shutil.copytree(raw / "truth", folder / name / "truth", dirs_exist_ok=True)
    return [store.read_run(path) for path in paths]


def search_of(runs: list[xr.DataTree], rate: float) -> PairSearch:
    """The second run searched for what changed since the first, as `deform run` does it."""
    matching = match_runs(runs)
    axis = reference_axis(runs[0], ChangeOptions().axis_step_m)
    before, after = (layer(run, matching.maps[run.attrs["id"]], axis) for run in runs)
    longer = Elongation(matching.joints, after.run)
    options = ChangeOptions(false_alarms_per_100_km=rate)
    search = PairSearch(before, after, axis, tangents(before, axis), options, elongation=longer)
    search.run()
    return search


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lines", nargs="*", metavar="LINE", default=LINES, help=f"default {LINES[0]} to {LINES[-1]}")
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"of the stored runs; default {FOLDER}")
    parser.add_argument("--rates", type=float, nargs="+", default=RATES, help="false alarms in 100 km; default 0.1 and 10")
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    found, length = dict.fromkeys(arguments.rates, 0), 0.0
    for name in arguments.lines:
        start = time.process_time()
        runs = runs_of(name, arguments.folder)
        for rate in arguments.rates:
            search = search_of(runs, rate)
            found[rate] += len(search.found)
            print(f"{name}, rate {rate:g}: {len(search.found)} found, threshold {search.limit:.1f}", flush=True)
            for c in search.found:
                size = ", ".join(f"{1000.0 * a:+.1f} ± {1000.0 * s:.1f}" for a, s in zip(c.amplitude, c.sigma, strict=True))
                parts = f"position {c.position_score:.1f}, curvature {c.curvature_score:.1f}, joints {c.joint_score:.1f}"
                print(f"  {c.centre:7.0f} m, wave of {c.length:.0f} m, lateral and up {size} mm: {c.statistic:.1f} ({parts})")
        length += float(search.axis[-1] - search.axis[0]) / 1000.0
        print(f"{name}: {time.process_time() - start:.0f} s", flush=True)
    for rate, number in found.items():
        print(f"{length:.0f} km, rate {rate:g} in 100 km: {number} found, {rate * length / 100.0:.2g} stated")


if __name__ == "__main__":
    main()
