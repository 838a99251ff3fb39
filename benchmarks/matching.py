"""Speed and honesty of the weld matching: lines of 1e4 to 1e6 joints, calibration over many lines, against dynamic time warping.

    python benchmarks/matching.py [--joints 10000 100000 1000000] [--lines 20] [--peer]

Times are of the whole alignment of two runs (direction, scale, seeds, path, learning, posteriors) on one core, after compilation.
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from deform.correlate import _kernels  # the path above comes first
from deform.correlate.alignment import align
from deform.options import MatchOptions
from tests.correlate.lines import cut_outs, line, observe, score

OPTIONS = MatchOptions()


def pair(seed: int, joints: int):
    """Two runs: 2 % missed, 2 % false, a cut-out in 200 joints, 5 cm noise, 3 % scale, 1 % wander, either direction."""
    rng = np.random.default_rng(seed)
    first = line(rng, joints)
    later, _ = cut_outs(rng, first, joints // 200)
    reverse = bool(seed % 2)
    return (
        observe(rng, first, wander=0.01),
        observe(rng, later, wander=0.01, scale=rng.uniform(0.97, 1.03), reverse=reverse),
        reverse,
    )


def speed(sizes: list[int]) -> None:
    """CPU seconds and the share of the posteriors, per size."""
    spent = {"posterior": 0.0}
    plain = {"forward": _kernels.forward, "backward": _kernels.backward}

    def timed(function):
        def call(*args):
            start = time.process_time()
            result = function(*args)
            spent["posterior"] += time.process_time() - start
            return result

        return call

    a, b, _ = pair(0, 1000)
    align(a.place, b.place, OPTIONS)
    for name, function in plain.items():
        setattr(_kernels, name, timed(function))
    print(f"{'joints':>9} {'path s':>8} {'with posteriors s':>18} {'recall':>8} {'precision':>10} {'peak MB':>8}")
    for joints in sizes:
        a, b, _ = pair(1, joints)
        times = []
        for _ in range(3 if joints <= 100_000 else 1):
            spent["posterior"] = 0.0
            start = time.process_time()
            found = align(a.place, b.place, OPTIONS)
            total = time.process_time() - start
            times.append((total - spent["posterior"], total))
        path, total = min(times)
        tracemalloc.start()
        align(a.place, b.place, OPTIONS)
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        recall, precision, _ = score(found.partner, a, b)
        print(f"{joints:9d} {path:8.3f} {total:18.3f} {recall:8.4f} {precision:10.5f} {peak:8.0f}")
    for name, function in plain.items():
        setattr(_kernels, name, function)


def honesty(lines: int, joints: int = 10_000) -> None:
    """Calibration, and what a higher bar on the probability buys, over many lines."""
    claims, truths, n_true, turned = [], [], 0, 0
    for seed in range(lines):
        a, b, reverse = pair(1000 + seed, joints)
        found = align(a.place, b.place, OPTIONS)
        turned += found.direction == (-1 if reverse else 1)
        claims.append(found.posterior)
        truths.append((a.weld[found.i] >= 0) & (a.weld[found.i] == b.weld[found.j]))
        n_true += np.intersect1d(a.weld[a.weld >= 0], b.weld[b.weld >= 0]).size
    claimed, right = np.concatenate(claims), np.concatenate(truths)
    bins = np.minimum((claimed * 10).astype(int), 9)
    error = sum(abs(claimed[bins == k].mean() - right[bins == k].mean()) * (bins == k).sum() for k in np.unique(bins))
    sure = claimed > 0.99
    print(f"direction right {turned} of {lines}; expected calibration error {error / claimed.size:.5f}")
    print(f"sure but wrong {(~right[sure]).sum()} of {sure.sum()}")
    for least in (0.5, 0.8, 0.9, 0.95, 0.99):
        kept = claimed > least
        print(f"probability > {least:4.2f}: recall {right[kept].sum() / n_true:.4f} precision {right[kept].mean():.5f}")


def peer(joints: int = 10_000) -> None:
    """The same pair by dynamic time warping of the joint lengths (dtw-python), when it is installed."""
    try:
        from dtw import dtw
    except ImportError:
        print("dtw-python is not installed: no peer")
        return
    a, b, _ = pair(2, joints)
    align(a.place, b.place, OPTIONS)  # compiled
    start = time.process_time()
    align(a.place, b.place, OPTIONS)
    mine = time.process_time() - start
    start = time.process_time()
    path = dtw(np.diff(a.place), np.diff(b.place), window_type="sakoechiba", window_args={"window_size": joints // 10})
    theirs = time.process_time() - start
    same = np.mean(a.weld[path.index1] == b.weld[path.index2])
    print(f"dtw-python {theirs:.2f} s, {same:.3f} of its pairs right; this {mine:.3f} s: {theirs / mine:.0f} times as fast")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--joints", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--lines", type=int, default=10)
    parser.add_argument("--peer", action="store_true")
    args = parser.parse_args()
    speed(args.joints)
    honesty(args.lines)
    if args.peer:
        peer()


if __name__ == "__main__":
    main()
