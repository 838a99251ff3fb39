"""Weld matching against its bars: speed and memory, precision and calibration, ends of cut-outs, direction, strangers, epochs.

    python -m benchmarks.matching [--joints 10000 100000 1000000] [--lines 10] [--pairs 1000] [--oracle 4] [--quick]

Lines are simulated (`deform.synthetic.lists`): 35 % of the joints of one mill length within 10 mm, 5 % pups; 2 % missed and 2 %
false welds, a cut-out in 200 joints, 5 cm noise (of a length difference between two runs), scale 1 +- 3 % that wanders by 1 %,
either direction. Times are processor time of the whole alignment of two runs on one core, after compilation.
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.matching_limit import observed_density, oracle  # the path above comes first
from deform.correlate import alignment as alignments
from deform.correlate import match_runs
from deform.correlate.alignment import align
from deform.errors import WrongLineError
from deform.options import MatchOptions
from deform.synthetic.lists import Seen
from tests.correlate.lines import build_line, cut_out_ends, cut_outs, observe, run_of, score, traits_of

OPTIONS = MatchOptions()
EVIDENCE = {
    "lengths alone": (),
    "with walls": ("wall",),
    "with walls, bends, fittings": ("wall", "bend", "fitting"),
    "with seams": ("seam",),
    "with all of these": ("wall", "bend", "fitting", "seam"),
}


def pair(seed: int, joints: int, noise: float = 0.035, same_mill: bool = True, traits: Seen | None = None):
    """Two runs, the ends of the cut-outs between them, and whether the second was made in the other direction."""
    rng = np.random.default_rng(seed)
    first = build_line(rng, joints)
    later, ends = cut_outs(rng, first, joints // 200, same_mill=same_mill)
    reverse = bool(seed % 2)
    a = observe(rng, first, noise=noise, wander=0.01, traits=traits)
    rolled = replace(traits, roll=rng.uniform(0, 360)) if traits else None
    b = observe(rng, later, noise=noise, wander=0.01, scale=rng.uniform(0.97, 1.03), reverse=reverse, traits=rolled)
    return a, b, ends, reverse


def speed(sizes: list[int]) -> None:
    """Processor time of path and posteriors and peak memory, by size."""
    a, b, *_ = pair(0, 2000)
    align(a.place, b.place, OPTIONS)  # compiled
    spent, plain = [0.0], alignments._posterior

    def timed(*args):
        start = time.process_time()
        result = plain(*args)
        spent[0] += time.process_time() - start
        return result

    alignments._posterior = timed
    print(f"{'joints':>9} {'path s':>8} {'with posteriors s':>18} {'recall':>8} {'precision':>10} {'peak MB':>8}")
    for joints in sizes:
        a, b, *_ = pair(1, joints)
        times = []
        for _ in range(3 if joints <= 100_000 else 1):
            spent[0] = 0.0
            start = time.process_time()
            found = align(a.place, b.place, OPTIONS)
            total = time.process_time() - start
            times.append((total, total - spent[0]))
        total, path = min(times)
        tracemalloc.start()
        align(a.place, b.place, OPTIONS)
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        recall, precision, _ = score(found.partner, a, b)
        print(f"{joints:9d} {path:8.3f} {total:18.3f} {recall:8.4f} {precision:10.5f} {peak:8.0f}", flush=True)
    alignments._posterior = plain
    print("bars: 1e5 path 0.5 s, 1e6 path 5 s, with posteriors at most twice that; memory linear")


def _kept(traits, names):
    """Traits of a list with the named ones alone."""
    nothing = np.full(traits.wall.size, np.nan)
    blank = {"wall": nothing, "seam": nothing, "bend": nothing, "fitting": np.full(traits.wall.size, "", object)}
    return replace(traits, **{k: v for k, v in blank.items() if k not in names})


class Tally:
    """Claims of many lines with their probability, and what can be read off them."""

    def __init__(self) -> None:
        self.claimed, self.right, self.true, self.ends = [], [], 0, np.zeros(2, int)

    def add(self, i, j, probability, a, b) -> None:
        self.claimed.append(probability)
        self.right.append((a.weld[i] >= 0) & (a.weld[i] == b.weld[j]))
        self.true += np.intersect1d(a.weld[a.weld >= 0], b.weld[b.weld >= 0]).size

    def row(self, name: str) -> None:
        p, right = np.concatenate(self.claimed), np.concatenate(self.right)
        bins = np.minimum((p * 10).astype(int), 9)
        error = sum(abs((p - right)[bins == k].sum()) for k in range(10)) / p.size
        order = np.argsort(-p)
        good = np.cumsum(right[order])
        precision, recall = good / np.arange(1, p.size + 1), good / self.true
        at = min(int(np.searchsorted(recall, 0.995)), p.size - 1)
        sure, half, nine = p > 0.99, p > 0.5, p > 0.9
        ends = f"{self.ends[0] / self.ends[1]:.3f}" if self.ends[1] else "-"
        print(
            f"{name:34s} {right[half].sum() / self.true:.4f}/{right[half].mean():.5f}  {right[nine].sum() / self.true:.4f}/"
            f"{right[nine].mean():.5f}  {precision[at]:.5f}  {(~right[sure]).sum():3d} of {sure.sum():6d}  {error:.5f}  {ends}",
            flush=True,
        )


_HEAD = f"{'':34s} {'p > 0.5':15s}  {'p > 0.9':15s}  at 0.995  sure but wrong  ECE      ends"


def honesty(lines: int, joints: int = 10_000, noise: float = 0.035, same_mill: bool = True, how: Seen | None = None) -> None:
    """Recall/precision, precision where recall is 0.995, calibration and ends of cut-outs, by evidence."""
    mill = "the same" if same_mill else "another"
    print(f"{lines} lines of {joints} joints, noise {noise * np.sqrt(2):.3f} m, new pipe of {mill} mill")
    print(_HEAD)
    tallies = {name: Tally() for name in EVIDENCE}
    for seed in range(lines):
        a, b, ends, _ = pair(1000 + seed, joints, noise, same_mill, how or Seen())
        both = traits_of(a), traits_of(b)
        for name, names in EVIDENCE.items():
            found = align(a.place, b.place, OPTIONS, traits=tuple(_kept(t, names) for t in both) if names else None)
            tallies[name].add(found.i, found.j, found.posterior, a, b)
            tallies[name].ends += cut_out_ends(found.partner, a, b, ends)
    for name, tally in tallies.items():
        tally.row(name)


def limit(lines: int, joints: int = 10_000, noise: float = 0.035) -> None:
    """The same from lengths alone by one who knows how the lists were made, on lists of scale one."""
    print(f"Bayes limit from lengths alone, {lines} lines of {joints} joints, scale known")
    print(_HEAD)
    density = observed_density(noise, 0.02, 0.02, 0.35, 0.05)
    best, mine = Tally(), Tally()
    for seed in range(lines):
        rng = np.random.default_rng(2000 + seed)
        first = build_line(rng, joints)
        later, ends = cut_outs(rng, first, joints // 200)
        a, b = observe(rng, first, noise=noise), observe(rng, later, noise=noise)
        i, j, p = oracle(a, b, noise=noise, missed=0.02, false=0.02, rate=1 / 200, density=density)
        best.add(i, j, p, a, b)
        partner = np.full(a.n, -1)
        partner[i[p > 0.5]] = j[p > 0.5]
        best.ends += cut_out_ends(partner, a, b, ends)
        found = align(a.place, b.place, OPTIONS)
        mine.add(found.i, found.j, found.posterior, a, b)
        mine.ends += cut_out_ends(found.partner, a, b, ends)
    best.row("the oracle")
    mine.row("this toolkit, which knows nothing")


def direction_and_strangers(pairs: int, joints: int = 400) -> None:
    """Direction of so many lines, refusal of so many pairs of different lines (a third of them of seven tenths equal joints)."""
    right = refused = 0
    for seed in range(pairs):
        rng = np.random.default_rng(50_000 + seed)
        true = build_line(rng, joints)
        reverse = bool(seed % 2)
        a, b = observe(rng, true, wander=0.01), observe(rng, true, wander=0.01, scale=rng.uniform(0.97, 1.03), reverse=reverse)
        right += align(a.place, b.place, OPTIONS).direction == (-1 if reverse else 1)
        equal = 0.7 if seed % 3 == 0 else 0.35
        try:
            align(*(observe(rng, build_line(rng, joints, equal=equal), wander=0.01).place for _ in range(2)), OPTIONS)
        except WrongLineError:
            refused += 1
    print(f"direction right in {right} of {pairs} lines; {refused} of {pairs} pairs of different lines refused", flush=True)


def epochs(lines: int, runs: int = 8, joints: int = 300) -> None:
    """Eight epochs with a cut-out in every second, the middle one missing 15 % of its welds: does every cycle close?"""
    doubled = mixed = split = welds = 0
    for seed in range(lines):
        rng = np.random.default_rng(7000 + seed)
        true, seen = build_line(rng, joints, equal=0.1), []
        for k in range(runs):
            true = cut_outs(rng, true, 1)[0] if k % 2 else true
            missed = 0.15 if k == runs // 2 else 0.02
            seen.append(observe(rng, true, noise=0.02, missed=missed, scale=rng.uniform(0.98, 1.02), reverse=k == 3))
        rows = match_runs([run_of(f"r{k}", s) for k, s in enumerate(seen)]).welds
        rows = rows[rows["index"].notna() & (rows["status"] != "false")]
        true_weld = [seen[int(r[1:])].weld[int(k)] for r, k in zip(rows["run"], rows["index"], strict=True)]
        rows = rows.assign(true=true_weld)
        doubled += int(rows.duplicated(["weld_id", "run"]).sum())
        rows = rows[rows["true"] >= 0]
        mixed += int((rows.groupby("weld_id")["true"].nunique() > 1).sum())
        split += int((rows.groupby("true")["weld_id"].nunique() > 1).sum())
        welds += rows["true"].nunique()
    closed = f"{doubled} ids twice in a run, {mixed} ids for two welds, {split} welds of two ids"
    print(f"{lines} lines of {runs} epochs, {welds} welds: {closed}")


def peer(joints: int = 10_000) -> None:
    """The same pair by dynamic time warping of the joint lengths (dtw-python), when it is installed."""
    try:
        from dtw import dtw
    except ImportError:
        print("dtw-python is not installed: no peer")
        return
    a, b, *_ = pair(2, joints)
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
    parser.add_argument("--joints", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--lines", type=int, default=10)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--oracle", type=int, default=4)
    parser.add_argument("--quick", action="store_true", help="speed and a single line each")
    args = parser.parse_args()
    speed(args.joints[:2] if args.quick else args.joints)
    peer()
    lines = 1 if args.quick else args.lines
    honesty(lines)
    honesty(lines, same_mill=False)
    if args.quick:
        return
    honesty(max(lines // 3, 1), noise=0.05)
    limit(args.oracle)
    epochs(4)
    direction_and_strangers(args.pairs)


if __name__ == "__main__":
    main()
