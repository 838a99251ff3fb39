"""Time and peak memory of a comparison of stored runs of 100 km, five epochs, and of the change of curvature of 1e8 samples."""

from __future__ import annotations

import argparse
import logging
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from deform.change.compare import compare
from deform.change.curvature_change import curvature_change
from deform.change.stack import Layer
from deform.options import ChangeOptions
from deform.run.store import read_run, write_run

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "change"))
import change_lines as lines


def store_runs(folder: Path, kilometres: float, epochs: int) -> list[Path]:
    line = lines.make_line(1000.0 * kilometres, seed=1, bends_per_km=3.0, step=0.1)
    way = lines.bump(line.chainage, 500.0 * kilometres, 120.0, 0.2)
    paths = []
    for k in range(epochs):
        run = lines.make_run(lines.moved(line, lateral=k * way), f"r{k}", f"201{k}-07-01", seed=k)
        paths.append(write_run(run, folder / f"r{k}.nc"))
    return paths


def comparison(kilometres: float, epochs: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        paths = store_runs(Path(folder), kilometres, epochs)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start, busy = time.perf_counter(), time.process_time()
        runs = [read_run(path) for path in paths]
        result = compare(runs, lines.identity_matching(runs), ChangeOptions())
        took, worked = time.perf_counter() - start, time.process_time() - busy
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"{kilometres:g} km, {epochs} epochs: {took:.1f} s ({worked:.1f} s of processor), peak {peak:.2f} GB"
        f" ({before / 1e6:.2f} GB before), {len(result.zones)} zones"
    )


def curvature(samples: int) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 1e-4, (2, 1_000_000)).astype(float)
    fill = samples // 1_000_000
    layers = []
    for k in range(2):
        values = {"curvature_horizontal": np.tile(noise[k], fill), "curvature_horizontal_sigma": np.full(samples, 1e-4)}
        layers.append(Layer(f"r{k}", 0.0, np.empty(0), np.zeros(samples), np.empty(0), values, 2.0, 0.3))
    speeds = np.full(samples, 20, np.uint8), np.full(samples, 24, np.uint8)
    stable = np.ones(samples, bool)
    small = [
        Layer(r.run, 0.0, np.empty(0), np.zeros(10_000), np.empty(0), {n: v[:10_000] for n, v in r.values.items()}, 2.0, 0.3)
        for r in layers
    ]
    curvature_change(small[0], small[1], "horizontal", 0.1, (speeds[0][:10_000], speeds[1][:10_000]), stable[:10_000])
    start = time.perf_counter()
    curvature_change(layers[0], layers[1], "horizontal", 0.1, speeds, stable)
    print(f"change of curvature with sigma, {samples:.0e} samples: {time.perf_counter() - start:.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kilometres", type=float, default=100.0)
    parser.add_argument("--epochs", type=int, default=5)
    parser.add_argument("--samples", type=float, default=1e8)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if arguments.samples:
        curvature(int(arguments.samples))
    if arguments.kilometres:  # peak memory is that of the whole process: take --samples 0 to read it
        comparison(arguments.kilometres, arguments.epochs)


if __name__ == "__main__":
    main()
