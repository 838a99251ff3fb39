"""Time and peak memory of a comparison of stored runs of 100 km, five epochs, and of the change of curvature of 1e8 samples.

    python -m benchmarks.change_speed [--kilometres 100] [--epochs 5] [--samples 1e8] [--folder FOLDER]

The stored runs hold every variable that a run of the toolkit holds (centreline and a wall map of 72 clocks each 0.1 m, welds,
a dent per kilometre). They are made in a process of their own and stay in FOLDER when it is given; what is measured is a second
process that does what `deform run` does after the navigation: read, match, list doglegs, compare, write. Bars: 60 s, 4 GB; 4 s.
"""

from __future__ import annotations

import argparse
import logging
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from deform import survey, vocabulary
from deform.change.curvature_change import curvature_change
from deform.change.stack import Layer
from deform.options import Options
from deform.run import build
from deform.run.store import write_run

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "change"))
import change_lines as lines

CLOCKS = 72
WARM_KM = 5.0  # the same on a short line beforehand: compiled kernels are read from their cache afterwards
SECONDS, GIGABYTES, CURVATURE_SECONDS = 60.0, 4.0, 4.0


def store_runs(folder: Path, kilometres: float, epochs: int) -> None:
    """Write runs of a line that moves by 0.2 m a year in its middle, below a folder."""
    line = lines.make_line(1000.0 * kilometres, seed=1, bends_per_km=3.0, step=0.1)
    way = lines.bump(line.chainage, 500.0 * kilometres, 120.0, 0.2)
    for k in range(epochs):
        run = lines.make_run(lines.moved(line, lateral=k * way), f"r{k}", f"201{k}-07-01", seed=k, dents=dents(kilometres, k))
        write_run(filled(run, k), folder / "runs" / f"r{k}.nc")


def dents(kilometres: float, epoch: int) -> xr.Dataset:
    rng = np.random.default_rng(100 + epoch)
    place = 500.0 + 1000.0 * np.arange(int(kilometres))
    depth = 0.006 + rng.normal(0, 0.0004, place.size)
    values = {"chainage": place + rng.normal(0, 0.01, place.size), "clock": np.full(place.size, 170.0), "depth": depth}
    return build.dataset("dents", values | {"depth_sigma": np.full(place.size, 0.0004), "sizing": ["measured"] * place.size})


def filled(run: xr.DataTree, seed: int) -> xr.DataTree:
    """The run with what else the centreline of a stored run holds, as noise, and a wall map."""
    rng = np.random.default_rng(200 + seed)
    line = run["centreline"].to_dataset()
    n = line.sizes["chainage"]
    wanted = [name for name, v in vocabulary.group("centreline").items() if v.dims == ("chainage",) and v.type == "float"]
    absent = [name for name in wanted if name not in line]
    noise = rng.normal(0.0, 1e-4, n)
    line = build.add(line, "centreline", {name: 0.25 + np.roll(noise, 17 * k) for k, name in enumerate(absent)})
    radius = np.resize(0.15 + 1e-4 * rng.standard_normal((1000, CLOCKS)), (n, CLOCKS))  # repeated, so that writing is quick
    wall = {"chainage": line["chainage"].values, "clock": np.arange(CLOCKS) * 360.0 / CLOCKS, "radius": radius}
    groups = {name: node.to_dataset() for name, node in run.children.items() if name != "centreline"}
    return build.run_tree(run.attrs, centreline=line, caliper=build.dataset("caliper", wall), **groups)


def compare_stored(folder: Path) -> None:
    """What `deform run` does with stored runs, with the time of each part and the peak memory of the process."""
    total, busy = time.perf_counter(), time.process_time()
    options, parts = Options(), []

    def timed(name: str, work: Callable[..., Any], *given: Any, **named: Any) -> Any:
        start, used = time.perf_counter(), time.process_time()
        result = work(*given, **named)
        parts.append(f"{name} {time.perf_counter() - start:.1f} ({time.process_time() - used:.1f})")
        return result

    runs = timed("read", survey.stored_runs, folder)
    matching = timed("match", survey.match, runs, options, folder=folder)
    timed("doglegs", survey.write_doglegs, runs, options, folder)
    timed("compare and write", survey.compare, runs, matching, options, folder)
    took, worked = time.perf_counter() - total, time.process_time() - busy
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    kilometres = float(runs[0]["centreline"]["chainage"].values[-1]) / 1000.0
    print(
        f"{kilometres:.0f} km, {len(runs)} epochs: {took:.1f} s, {worked:.1f} s of processor (bar {SECONDS:g}),"
        f" peak {peak:.2f} GB (bar {GIGABYTES:g}); s of the clock (of processor): {', '.join(parts)}",
        flush=True,
    )


def comparison(folder: Path, kilometres: float, epochs: int) -> None:
    for length in (WARM_KM, kilometres):
        place = folder / f"line-{length:g}-{epochs}"
        if not (place / "runs" / f"r{epochs - 1}.nc").exists():
            made = ["--make", str(place), "--kilometres", str(length), "--epochs", str(epochs)]
            subprocess.run([sys.executable, __file__, *made], check=True)
        subprocess.run([sys.executable, __file__, "--compare", str(place)], check=True)


def curvature(samples: int) -> None:
    """Time the change of curvature with its sigma as it is called by the comparison, in pieces that fit into memory.

    The seconds of processor are what a loaded machine can tell; the plain copy of as many bytes in the same run is the limit.
    """
    piece = min(samples, 10_000_000)
    rng = np.random.default_rng(0)
    speeds = np.full(piece, 20, np.uint8), np.full(piece, 24, np.uint8)
    stable, still = np.ones(piece, bool), np.zeros(piece)
    layers = []
    for k in range(2):
        noise = rng.normal(0, 1e-4, piece)
        values = {"curvature_horizontal": noise, "curvature_horizontal_sigma": np.full(piece, 1e-4)}
        layers.append(Layer(f"r{k}", 0.0, still, still, stable, values, 2.0, 0.3))
    curvature_change(*layers, "horizontal", 0.1, speeds, stable)
    start, busy = time.perf_counter(), time.process_time()
    for _ in range(samples // piece):
        curvature_change(*layers, "horizontal", 0.1, speeds, stable)
    took, worked = time.perf_counter() - start, time.process_time() - busy
    start = time.process_time()
    for _ in range(samples // piece):
        for array in (*layers[0].values.values(), *layers[1].values.values(), still):
            array.copy()
    copied = time.process_time() - start
    print(
        f"change of curvature with sigma, {samples:.0e} samples: {took:.2f} s (bar {CURVATURE_SECONDS:g}), {worked:.2f} s of"
        f" processor on all cores; a plain copy of what is read {copied:.2f} s",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kilometres", type=float, default=100.0)
    parser.add_argument("--epochs", type=int, default=5)
    parser.add_argument("--samples", type=float, default=1e8)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--make", type=Path, default=None, help=argparse.SUPPRESS)
    parser.add_argument("--compare", type=Path, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    warnings.filterwarnings("ignore")
    if arguments.make:
        return store_runs(arguments.make, arguments.kilometres, arguments.epochs)
    if arguments.compare:
        return compare_stored(arguments.compare)
    if arguments.samples:
        curvature(int(arguments.samples))
    if arguments.folder:
        return comparison(arguments.folder, arguments.kilometres, arguments.epochs)
    with tempfile.TemporaryDirectory() as folder:
        return comparison(Path(folder), arguments.kilometres, arguments.epochs)


if __name__ == "__main__":
    main()
