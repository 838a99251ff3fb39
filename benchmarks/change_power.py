"""False alarms and power of the search for movement, against what the toolkit states: simulated lines, no movement and known
movement.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

import numpy as np

from deform.change import zones
from deform.change.detection_limit import detectable
from deform.change.pair import PairChange, pair_change
from deform.change.stack import layer, tangents
from deform.change.wavelength import wavelengths
from deform.options import ChangeOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "change"))
import change_lines as lines

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
    return pair_change(ground, other, axis, tangents(ground, axis), options)


def false_alarms(kilometres: float, rate: float, errors: lines.Errors, seed: int = 0) -> tuple[int, float]:
    """Return the number of candidates on pipe that did not move, and the number that the stated rate allows."""
    found, done, length = 0, 0.0, 20.0
    while done < kilometres - 1e-9:
        line = lines.make_line(1000.0 * length, seed=seed + int(done), bends_per_km=4.0, step=0.5)
        pair = pair_of(line, line, errors, seed + 31 * int(done) + 7, ChangeOptions(false_alarms_per_100_km=rate))
        found += len(pair.candidates)
        done += length
    return found, rate * done / 100.0


def power(length: float, amplitude: float, errors: lines.Errors, repeats: int, seed: int = 0) -> tuple[float, float]:
    """Return the share of movements of a length and amplitude that are found, and the predicted share."""
    options = ChangeOptions()
    hits, total, predicted = 0, 0, []
    rng = np.random.default_rng(seed)
    while total < repeats:
        line = lines.make_line(40000.0, seed=seed + total, bends_per_km=1.0, step=0.5)
        centres = np.arange(2000.0, 38500.0, max(12.0 * length, 2000.0)) + rng.uniform(-400, 400)
        way = sum(lines.bump(line.chainage, c, length, amplitude) for c in centres)
        moved = lines.moved(line, lateral=way) if total % 2 else lines.moved(line, up=way)
        pair = pair_of(line, moved, errors, seed + 17 * total + 3, options)
        m = 0 if total % 2 else 1
        sigma = _sigma_at(pair, length, m)
        predicted.append(_sure(amplitude / sigma, pair.limit))
        hits += sum(any(c.start < at < c.end for c in pair.candidates) for at in centres)
        total += centres.size
    return hits / total, float(np.mean(predicted))


def _sigma_at(pair: PairChange, length: float, component: int) -> float:
    """Sigma of the amplitude of a movement of a length between the wavelengths that were searched."""
    known = [(w.length, np.nanmedian(w.sigma[:, component])) for w in pair.waves]
    return float(np.exp(np.interp(np.log(length), *np.log(np.array(known).T))))


def _sure(size: float, limit: float) -> float:
    """Chance that a movement of so many sigma exceeds the threshold."""
    from scipy.stats import ncx2

    return float(ncx2.sf(limit, 2, size**2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kilometres", type=float, default=200.0)
    parser.add_argument("--rate", type=float, default=ChangeOptions().false_alarms_per_100_km)
    parser.add_argument("--repeats", type=int, default=60)
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    for name, errors in TOOLS.items():
        for rate in (arguments.rate, 100.0 * arguments.rate, 1000.0 * arguments.rate):
            found, allowed = false_alarms(arguments.kilometres, rate, errors)
            print(f"{name}: {arguments.kilometres:g} km, rate {rate:g} in 100 km: {found} false alarms, {allowed:g} allowed")
    rows = []
    for length in (30.0, 60.0, 120.0, 240.0):
        for amplitude in (0.1, 0.2, 0.5):
            share, predicted = power(length, amplitude, TOOLS["navigation grade"], arguments.repeats)
            rows.append((length, amplitude, share, predicted))
            print(f"{amplitude:g} m over {length:g} m: found {share:.2f}, predicted {predicted:.2f}")
    if arguments.figure:
        _draw(rows, arguments.figure)


def _draw(rows: list[tuple[float, float, float, float]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 5))
    axes.plot([0, 1], [0, 1], "k:")
    for length, amplitude, share, predicted in rows:
        axes.plot(predicted, share, "o")
        axes.annotate(f"{amplitude:g} m / {length:g} m", (predicted, share), fontsize=7)
    axes.set_xlabel("predicted probability of detection")
    axes.set_ylabel("found")
    figure.savefig(path, dpi=120)


__all__ = ["detectable", "false_alarms", "pair_of", "power", "wavelengths", "zones"]

if __name__ == "__main__":
    main()
