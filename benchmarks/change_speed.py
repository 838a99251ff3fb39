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
        f"change of curvature with sigma, {samples:.0e} samples: {took:.2f} s, {worked:.2f} s of processor on all cores;"
        f" a plain copy of what is read {copied:.2f} s"
    )


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
