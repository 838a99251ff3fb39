"""False alarms and power of the search for movement, against what the toolkit states: made lines, no movement and known movement.

    python -m benchmarks.change_power [--kilometres 200] [--lines 40] [--tool 'tactical grade'] [--figure out.png]

Movements are of two kinds: of 0.1, 0.2 and 0.5 m, and of the sizes that are found with a chance of 0.25, 0.5 and 0.75 by the
detection limits of a pair of runs without movement (`tables/limits.csv`), so that the middle of the curve is seen. A share found
of n has the sampling error sqrt(p (1 - p) / n) at the predicted chance p.
"""

from __future__ import annotations

import argparse
import logging
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import ncx2

from deform.change.detection_limit import detectable
from deform.change.pair import PairChange, PairSearch
from deform.change.stack import layer, tangents
from deform.options import ChangeOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "change"))
import change_lines as lines

LENGTHS, AMPLITUDES, CHANCES = (30.0, 60.0, 120.0, 240.0), (0.1, 0.2, 0.5), (0.25, 0.5, 0.75)
LINE_M, APART_M = 40_000.0, 3000.0
TOOLS = {
    "navigation grade": lines.Errors(heading_deg=0.06, curvature_microstrain=10.0, position_m=0.002),
    "no slow heading error": lines.Errors(),
    "tactical grade": lines.Errors(
        heading_deg=0.1, curvature_microstrain=40.0, position_m=0.02, marker_m=1.0, marker_every_m=2000.0
    ),
}


@dataclass(frozen=True)
class Movement:
    """One movement that was made: length and amplitude (m), its name in the table, the chance predicted, whether it was found."""

    length: float
    amplitude: float
    name: str
    predicted: float
    found: bool


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


def sizes(pair: PairChange, component: int) -> list[tuple[float, float, str]]:
    """Length, amplitude and name of the movements that are made in turn, those of a middling chance twice."""
    made = [(length, a, f"{a:g} m") for length in LENGTHS for a in AMPLITUDES]
    for length in LENGTHS:
        sigma, limit = _sigma_at(pair, length, component), _limit_at(pair, length, component)
        made += 2 * [(length, detectable(sigma, limit, chance), f"chance {chance:g}") for chance in CHANCES]
    return made


def power(errors: lines.Errors, count: int, seed: int = 0) -> list[Movement]:
    """Return the movements of so many lines of 40 km, each with as many as find room, kilometres of quiet pipe between them."""
    options, rng = ChangeOptions(), np.random.default_rng(seed)
    quiet = lines.make_line(LINE_M, seed=seed + 5000, bends_per_km=1.0, step=0.5)
    pilot = pair_of(quiet, quiet, errors, seed + 5000, options)
    centres = np.arange(1500.0, LINE_M - 1000.0, APART_M)
    waiting: tuple[list, list] = [], []
    made: list[Movement] = []
    for k in range(count):
        component = k % 2
        line = lines.make_line(LINE_M, seed=seed + k, bends_per_km=1.0, step=0.5)
        while len(waiting[component]) < centres.size:
            more = sizes(pilot, component)
            waiting[component].extend(more[i] for i in rng.permutation(len(more)))
        chosen = [waiting[component].pop(0) for _ in centres]
        at = centres + rng.uniform(-400.0, 400.0, centres.size)
        way = sum(lines.bump(line.chainage, c, length, a) for c, (length, a, _) in zip(at, chosen, strict=True))
        moved = lines.moved(line, up=way) if component else lines.moved(line, lateral=way)
        pair = pair_of(line, moved, errors, seed + 17 * k + 3, options)
        for c, (length, a, name) in zip(at, chosen, strict=True):
            chance = float(ncx2.sf(_limit_at(pair, length, component), 2, (a / _sigma_at(pair, length, component)) ** 2))
            made.append(Movement(length, a, name, chance, any(z.start < c < z.end for z in pair.candidates)))
    return made


def _sigma_at(pair: PairChange, length: float, component: int) -> float:
    """Sigma of the amplitude of a movement of a length between the wavelengths that were searched, as limits.csv states it."""
    known = [(w.length, w.typical[component]) for w in pair.waves]
    return float(np.exp(np.interp(np.log(length), *np.log(np.array(known).T))))


def _limit_at(pair: PairChange, length: float, component: int) -> float:
    """Threshold at a length, with the caution for few looks and wide tails that limits.csv states too."""
    caution = np.interp(np.log(length), np.log([w.length for w in pair.waves]), [w.caution[component] for w in pair.waves])
    return float(pair.limit * caution**2)


def table(made: list[Movement]) -> list[tuple[str, float, float, float, int]]:
    """Name, mean predicted chance, share found, sampling error and number of the movements, by size and over all lengths."""
    groups: dict[str, list[Movement]] = {}
    for m in made:
        groups.setdefault(f"{m.length:g} m, {m.name}", []).append(m)
        groups.setdefault(f"all lengths, {m.name}", []).append(m)
    rows = []
    for name, members in sorted(groups.items()):
        p = np.array([m.predicted for m in members])
        share = float(np.mean([m.found for m in members]))
        rows.append((name, float(p.mean()), share, float(np.sqrt((p * (1 - p)).sum()) / p.size), p.size))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kilometres", type=float, default=200.0)
    parser.add_argument("--rate", type=float, default=ChangeOptions().false_alarms_per_100_km)
    parser.add_argument("--lines", type=int, default=40, help="lines of 40 km with movements, for each tool")
    parser.add_argument("--tool", choices=tuple(TOOLS), action="append", help="may be repeated; default all")
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    tools = arguments.tool or list(TOOLS)
    if arguments.kilometres:
        for name in tools:
            for rate in (arguments.rate, 1000.0 * arguments.rate):
                found, allowed = false_alarms(arguments.kilometres, rate, TOOLS[name])
                print(
                    f"{name}: {arguments.kilometres:g} km, rate {rate:g} in 100 km: {found} false alarms, {allowed:g} allowed",
                    flush=True,
                )
    rows = {}
    for name in [tool for tool in tools if arguments.lines and tool != "no slow heading error"]:
        rows[name] = table(power(TOOLS[name], arguments.lines))
        for size, predicted, share, error, n in rows[name]:
            print(f"{name}: {size}: found {share:.2f} of {n}, predicted {predicted:.2f} +- {error:.2f}", flush=True)
    if arguments.figure:
        _draw(rows, arguments.figure)


def _draw(rows: dict[str, list[tuple[str, float, float, float, int]]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.5, 5))
    level = np.linspace(0.0, 1.0, 50)
    axes.fill_between(level, level - 0.1, level + 0.1, color="0.9", label="within 10 %")
    axes.plot([0, 1], [0, 1], "k:")
    for (name, found), mark, colour in zip(rows.items(), "os", ("C0", "C1"), strict=False):
        for whole in (False, True):
            chosen = np.array([row[1:4] for row in found if row[0].startswith("all") == whole]).reshape(-1, 3)
            style = {"ms": 8, "mfc": colour, "label": f"{name}, all lengths"} if whole else {"ms": 4, "mfc": "none", "alpha": 0.5}
            axes.errorbar(chosen[:, 0], chosen[:, 1], chosen[:, 2], fmt=mark, color=colour, capsize=2, **style)
    axes.set(xlabel="predicted probability of detection", ylabel="share that was found", xlim=(-0.05, 1.05), ylim=(-0.05, 1.05))
    axes.legend(loc="upper left", frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
