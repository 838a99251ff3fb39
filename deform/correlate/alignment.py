"""Two weld lists in, their alignment out: direction, scale, posterior of every pair of welds, edits."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from deform.correlate import _kernels
from deform.correlate._kernels import Evidence
from deform.correlate.length_model import LengthModel, first_rates, length_density, local_scale, noise, reestimate, warp
from deform.correlate.seeds import Seeds, band, find_seeds
from deform.errors import Fault, WrongLineError
from deform.options import MatchOptions

_log = logging.getLogger(__name__)
_FULL = 4_000_000  # cells up to which a whole matrix is filled when no seed is found
_KEPT = 1e-3  # posterior below this is not kept


@dataclass(frozen=True)
class PairAlignment:
    """Alignment of run B with run A.

    Attributes
    ----------
    direction : +1, or -1 when B is turned; ``j`` below counts welds of B as given, never turned.
    scale : B over A, median.
    i, j, posterior, shifted : pairs with a posterior above 0.001, and the part of it in which the weld is displaced.
    partner : weld of B for each weld of A where the posterior exceeds one half, else -1.
    model : noise and rates.
    evidence_nats : log of the total weight of all alignments against none at all.
    local : local scale at each weld of A.
    """

    direction: int
    scale: float
    i: np.ndarray
    j: np.ndarray
    posterior: np.ndarray
    shifted: np.ndarray
    partner: np.ndarray
    model: LengthModel
    evidence_nats: float
    local: np.ndarray


def no_evidence() -> Evidence:
    """Nothing but the lengths."""
    i, f = np.empty(0, np.int64), np.empty(0)
    return Evidence(False, i, i, np.ones((1, 1)), i, i, 1.0, 1.0, f, f, 1.0, i, i, i, i)


def align(x: np.ndarray, y: np.ndarray, options: MatchOptions, names: tuple[str, str] = ("A", "B"), make_evidence=None, directions=(1, -1)) -> PairAlignment:
    """Align the welds of run B with those of run A.

    Parameters
    ----------
    x, y : weld places of A (n) and B (m), metre, rising.
    make_evidence : called with the direction, returns the `Evidence` on B as turned; None for lengths alone.

    Raises
    ------
    WrongLineError
        When the lengths of the two runs have no more in common than those of two different lines; with the numbers.
    """
    trials = _starts(x, y, options, directions)
    best = None
    for direction, unit, seeds in trials:
        b = (y if direction > 0 else -y[::-1]) / unit
        ev = make_evidence(direction) if make_evidence else no_evidence()
        result = _align_one_way(x, b, seeds, options, ev, direction, unit)
        if best is None or result.evidence_nats > best.evidence_nats:
            best = result
    _check_same_line(best, x, y, names, options)
    if abs(best.scale - 1.0) > options.scale_range * 1.2:
        _log.warning("%s is %.4f times as long as %s: its unit is not the metre (feet?); it was matched all the same", names[1], best.scale, names[0])
    return best


def _starts(x, y, options, directions):
    """Directions, units and seeds to try: one where the seeds decide, all where there are none and the matrix is small."""
    for unit in (1.0, 1 / 0.3048, 0.3048):
        seeds = find_seeds(x, y / unit, options.scale_range, directions)
        if seeds is not None and seeds.support[0] > 25.0 + seeds.support[1]:
            return [(seeds.direction, unit, seeds)]
    if x.size * y.size > _FULL:
        seeds = [find_seeds(x, y, options.scale_range, (d,)) for d in directions]
        return [(d, 1.0, s) for d, s in zip(directions, seeds, strict=True) if s is not None] or [(1, 1.0, None)]
    return [(d, 1.0, None) for d in directions]


def _align_one_way(x, b, seeds: Seeds | None, options, ev, direction, unit):
    n, m = x.size, b.size
    b = b - b[0]
    if seeds is None:
        warped, i, j = _by_scale_grid(x, b, options, ev)
    else:
        i, j = seeds.i, seeds.j
        local = _smooth(seeds.local)
        warped = warp(x, x[i] + 1e-9, local)
        warped += np.median(b[j] - warped[i])
    rates = first_rates(sigma=0.06)
    model = LengthModel(rates, *length_density(warped, b, sigma=0.05))
    half = options.band_half_width
    partner = moves = None
    for _ in range(2):
        while True:
            strip = band(n, m, i, j, half)
            filled = _kernels.fill(model.lists(warped, b), strip, model.rates, ev)
            partner, moves, _, slack = _kernels.trace_back(*filled, strip, m)
            if slack > 0 or half > 256 or not i.size:
                break
            half *= 2
        warped, model = _learn(x, b, warped, partner, moves, model)
        good = np.flatnonzero(partner >= 0)
        if seeds is None and good.size:
            i, j = good, partner[good]
            half = max(half, 12)
    strip, both = band(n, m, i, j, half), model.lists(warped, b)
    forward = _kernels.forward(both, strip, model.rates, ev)
    match, shifted = _kernels.backward(both, strip, model.rates, ev, *forward)
    kept = np.flatnonzero(match > _KEPT)
    row = np.searchsorted(strip.offset, kept, side="right") - 1
    col = strip.low[row] + kept - strip.offset[row]
    col_given = col if direction > 0 else m - 1 - col
    decided = np.full(n, -1, np.int64)
    sure = match[kept] > 0.5
    decided[row[sure]] = col_given[sure]
    local = np.gradient(warped, x) * unit if n > 2 else np.full(n, unit)
    return PairAlignment(
        direction=direction,
        scale=float(np.median(np.diff(warped) / np.diff(x))) * unit,
        i=row,
        j=col_given,
        posterior=match[kept].astype(float),
        shifted=shifted[kept].astype(float),
        partner=decided,
        model=model,
        evidence_nats=float(forward[3]),
        local=local,
    )


def _smooth(values: np.ndarray, half: int = 5) -> np.ndarray:
    """Running median of the local scale of the anchors."""
    if values.size <= 2:
        return np.full(values.size, float(np.median(values)))
    half = min(half, (values.size - 1) // 2)
    padded = np.pad(values, half, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)


def _by_scale_grid(x, b, options, ev):
    """Without seeds: the scale of a grid whose whole-matrix alignment weighs most."""
    n, m = x.size, b.size
    empty = np.empty(0, np.int64)
    strip = band(n, m, empty, empty, 0)
    rates = first_rates(sigma=0.08)
    best, kept = -np.inf, x - x[0]
    cells = max(n * m, 1)
    steps = int(np.clip(40_000_000 // cells, 5, 41))
    for scale in 1.0 + np.linspace(-options.scale_range, options.scale_range, steps | 1):
        warped = (x - x[0]) * scale
        model = LengthModel(rates, *length_density(warped, b, sigma=0.05))
        weight = _kernels.forward(model.lists(warped, b), strip, rates, ev)[3]
        if weight > best:
            best, kept = weight, warped
    return kept, empty, empty


def _learn(x, b, warped, partner, moves, model):
    """Local scale, noise and rates anew from the best path."""
    at = np.flatnonzero(moves == 11)
    at = at[at > 0]
    if at.size < 5:
        return warped, model
    dx, dy = x[at] - x[at - 1], b[partner[at]] - b[partner[at] - 1]
    scale = local_scale(dx, dy, x[at])
    new = warp(x, 0.5 * (x[at] + x[at - 1]), scale)
    new += np.median(b[partner[at]] - new[at])
    residual = dy - (new[at] - new[at - 1])
    edits = int(np.count_nonzero((moves >= 1) & (moves <= 4)))
    sigma = noise(residual)
    smooth = max(sigma if np.isfinite(sigma) else 0.05, 0.01)
    density, own, floor = length_density(new, b, sigma=smooth)
    return new, replace(reestimate(model, residual, moves, edits), density=density, own=own, floor=floor)


def _check_same_line(result: PairAlignment, x, y, names, options) -> None:
    needed = options.least_evidence_nats + np.log(float(x.size) * y.size)
    found = int(np.count_nonzero(result.partner >= 0))
    if result.evidence_nats < needed:
        rule = (
            f"{found} of {min(x.size, y.size)} welds find a partner; the joint lengths speak for one line with {result.evidence_nats:.1f} nats, "
            f"{needed:.1f} are needed ({x.size} and {y.size} welds, {np.ptp(x):.0f} and {np.ptp(y):.0f} m)"
        )
        raise WrongLineError(Fault(f"{names[0]} and {names[1]}", "welds", rule, "these are runs of two lines, or one list lacks most of its welds"))
