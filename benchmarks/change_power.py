"""False alarms and power of the search for movement, against what the toolkit states: simulated lines, no movement and known
movement.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

import numpy as np

from deform.change.pair import PairChange, PairSearch
from deform.change.stack import layer, tangents
from deform.options import ChangeOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "change"))
import change_lines as lines

Row = tuple[float, float, float, float, int]
LENGTHS, AMPLITUDES = (30.0, 60.0, 120.0, 240.0), (0.1, 0.2, 0.5)
TOOLS = {
    "navigation grade": lines.Errors(heading_deg=0.06, curvature_microstrain=10.0, position_m=0.002),
    "no slow heading error": lines.Errors(),
    "tactical grade": lines.Errors(
        heading_deg=0.1, curvature_microstrain=40.0, position_m=0.02, marker_m=1.0, marker_every_m=2000.0
    ),
}


def pair_of(before: lines.Line, after: lines.Line, errors: lines.Errors, seed: int, options: ChangeOptions) -> PairChange:
    runs = [
        lines.make_run(at, f"r{k}", f"202{k}-01-01", seed=2 * seed + k, errors=errors) for k, at in enumerate((before, after))
    ]
    matching = lines.identity_matching(runs)
    axis = before.chainage
    ground, other = (layer(run, matching.maps[run.attrs["id"]], axis) for run in runs)
    search = PairSearch(ground, other, axis, tangents(ground, axis), options)
    search.run()
    return search.finish()


def false_alarms(kilometres: float, rate: float, errors: lines.Errors, seed: int = 0) -> tuple[int, float]:
    """Return the number of candidates on pipe that did not move, and the number that the stated rate allows."""
    found, done, length = 0, 0.0, 20.0
    while done < kilometres - 1e-9:
        line = lines.make_line(1000.0 * length, seed=seed + int(done), bends_per_km=4.0, step=0.5)
        pair = pair_of(line, line, errors, seed + 31 * int(done) + 7, ChangeOptions(false_alarms_per_100_km=rate))
        found += len(pair.candidates)
        done += length
    return found, rate * done / 100.0


def power(length: float, amplitudes: tuple[float, ...], errors: lines.Errors, repeats: int, seed: int = 0) -> list[Row]:
    """Return the share of movements of a length and several amplitudes that are found, and the predicted share.

    Each line of 40 km carries movements of all the amplitudes in turn, so far apart that each has quiet pipe on either side.
    """
    options = ChangeOptions()
    hits, predicted = ({a: [] for a in amplitudes} for _ in range(2))
    rng = np.random.default_rng(seed)
    for repeat in range(repeats):
        line = lines.make_line(40000.0, seed=seed + repeat, bends_per_km=1.0, step=0.5)
        centres = np.arange(2000.0, 38500.0, max(8.0 * length, 1200.0)) + rng.uniform(-400, 400)
        sizes = np.resize(amplitudes, centres.size)
        way = sum(lines.bump(line.chainage, c, length, a) for c, a in zip(centres, sizes, strict=True))
        moved = lines.moved(line, lateral=way) if repeat % 2 else lines.moved(line, up=way)
        pair = pair_of(line, moved, errors, seed + 17 * repeat + 3, options)
        sigma, limit = _sigma_at(pair, length, 0 if repeat % 2 else 1), _limit_at(pair, length, 0 if repeat % 2 else 1)
        for at, size in zip(centres, sizes, strict=True):
            hits[size].append(any(c.start < at < c.end for c in pair.candidates))
            predicted[size].append(_sure(size / sigma, limit))
    return [(length, a, float(np.mean(hits[a])), float(np.mean(predicted[a])), len(hits[a])) for a in amplitudes]


def _sigma_at(pair: PairChange, length: float, component: int) -> float:
    """Sigma of the amplitude of a movement of a length between the wavelengths that were searched."""
    known = [(w.length, np.nanmedian(w.sigma[:, component])) for w in pair.waves]
    return float(np.exp(np.interp(np.log(length), *np.log(np.array(known).T))))


def _limit_at(pair: PairChange, length: float, component: int) -> float:
    """Threshold at a length, with the caution for few looks and wide tails that limits.csv states too."""
    caution = np.interp(np.log(length), np.log([w.length for w in pair.waves]), [w.caution[component] for w in pair.waves])
    return float(pair.limit * caution**2)


def _sure(size: float, limit: float) -> float:
    """Chance that a movement of so many sigma exceeds the threshold."""
    from scipy.stats import ncx2

    return float(ncx2.sf(limit, 2, size**2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kilometres", type=float, default=200.0)
    parser.add_argument("--rate", type=float, default=ChangeOptions().false_alarms_per_100_km)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    for name, errors in TOOLS.items():
        for rate in (arguments.rate, 100.0 * arguments.rate, 1000.0 * arguments.rate):
            found, allowed = false_alarms(arguments.kilometres, rate, errors)
            print(f"{name}: {arguments.kilometres:g} km, rate {rate:g} in 100 km: {found} false alarms, {allowed:g} allowed")
    rows = {}
    for name in ("navigation grade", "tactical grade"):
        rows[name] = [row for length in LENGTHS for row in power(length, AMPLITUDES, TOOLS[name], arguments.repeats)]
        for length, amplitude, share, predicted, n in rows[name]:
            print(f"{name}: {amplitude:g} m over {length:g} m: found {share:.2f} of {n}, predicted {predicted:.2f}")
    if arguments.figure:
        _draw(rows, arguments.figure)


def _draw(rows: dict[str, list[Row]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.5, 5))
    level = np.linspace(0.0, 1.0, 50)
    axes.fill_between(level, level - 0.1, level + 0.1, color="0.9", label="within 10 %")
    axes.plot([0, 1], [0, 1], "k:")
    for (name, found), mark in zip(rows.items(), "os", strict=False):
        y, x, n = np.array(found)[:, 2:].T
        axes.errorbar(x, y, np.sqrt(np.maximum(x * (1 - x), 0.01) / n), fmt=mark, mfc="none", capsize=2, label=name)
    axes.set(xlabel="predicted probability of detection", ylabel="share that was found", xlim=(-0.05, 1.05), ylim=(-0.05, 1.05))
    axes.legend(loc="upper left", frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
