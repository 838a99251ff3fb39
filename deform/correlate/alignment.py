"""Two weld lists in, their alignment out: direction, scale, posterior of every pair of welds, edits."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import numpy as np

from deform.correlate._kernel_evidence import LOCKED
from deform.correlate._kernel_path import CUT, REROUTE, trace_back
from deform.correlate._kernel_sweeps import ahead, behind
from deform.correlate._kernel_types import Band, Evidence, Lists, Rates
from deform.correlate.evidence import Hints, Locks, Traits, from_locks, learn, over_band
from deform.correlate.length_model import LengthModel, first_model, local_scale, reestimate, warp
from deform.correlate.seeds import Seeds, band, find_seeds
from deform.errors import Fault, InputError, WrongLineError
from deform.options import MatchOptions

_log = logging.getLogger(__name__)
_FULL = 60_000  # cells up to which a whole matrix is filled when no seed is found
_NARROW = 4  # welds on each side of the best path in which its rivals are summed
_AROUND = 30  # further welds on each side where the best path touched the edge of its band
_FIRM = 20  # welds of a stretch between two replaced ones that is no chance
_LARGE = 20_000  # welds from which on one path is enough to learn from
_ADVICE = "these are runs of two lines, or one list lacks most of its welds"
_KEPT = 1e-3  # posterior below this is not kept


@dataclass(frozen=True)
class Frame:
    """What the posteriors of a pair were formed on: lists on one scale (B turned where it runs the other way), band, evidence."""

    lists: Lists
    strip: Band
    evidence: Evidence
    rates: Rates


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
    frame : what the posteriors were formed on.
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
    frame: Frame = field(repr=False)


def align(
    x: np.ndarray,
    y: np.ndarray,
    options: MatchOptions,
    names: tuple[str, str] = ("A", "B"),
    traits: tuple[Traits, Traits] | None = None,
    locks: Locks | None = None,
    directions: tuple[int, ...] = (1, -1),
) -> PairAlignment:
    """Align the welds of run B with those of run A.

    Parameters
    ----------
    x, y : weld places of A (n) and B (m), metre, rising.
    traits : what is known of the joints of A and of B beside their lengths; None for lengths alone.
    locks : pairs that must, or must not, be one weld.
    directions : directions of B that may be.

    Raises
    ------
    WrongLineError
        When the lengths of the two runs have no more in common than those of two different lines; with the numbers.
    """
    trials = _starts(x, y, options, directions)
    if not trials:
        extent = f"{x.size} and {y.size} welds, {np.ptp(x):.0f} and {np.ptp(y):.0f} m"
        rule = f"no sequence of joint lengths is in both ({extent}, scale 1 ± {options.scale_range:g})"
        raise WrongLineError(Fault(f"{names[0]} and {names[1]}", "welds", rule, _ADVICE))
    results = []
    for direction, unit, seeds in trials:
        b = (y if direction > 0 else -y[::-1]) / unit
        turned = traits and (traits[0], traits[1] if direction > 0 else traits[1].turned())
        held = locks if locks is None or direction > 0 else locks.turned(y.size)
        results.append(_align_one_way(x, b, seeds, options, turned, held, direction, unit))
    best = max(results, key=lambda r: r.evidence_nats)
    _check_locks(best, locks, names)  # first: locks that cannot hold would leave two runs of one line without a match
    _check_same_line(best, x, y, names, options)
    if abs(best.scale - 1.0) > options.scale_range * 1.2:
        text = "%s is %.4f times as long as %s: its unit is not the metre (feet?); it was matched all the same"
        _log.warning(text, names[1], best.scale, names[0])
    return best


def _check_locks(result: PairAlignment, locks: Locks | None, names) -> None:
    if locks is not None:
        open_ = [(i, j) for i, j in locks.locked if result.partner[i] != j]
        if open_:
            text = ", ".join(f"{i} and {j}" for i, j in open_[:5])
            rule = (
                f"places {text} cannot be one weld each: locked pairs cross each other, or lie against the direction of the runs"
            )
            raise InputError(Fault("locks", f"{names[0]} and {names[1]}", rule))


def _starts(x, y, options, directions):
    """Directions, units and seeds to try: one where the seeds decide, all where there are none and the matrix is small."""
    for unit in (1.0, 1 / 0.3048, 0.3048):
        seeds = find_seeds(x, y / unit, options.scale_range, directions)
        if seeds is not None and seeds.support[0] > 25.0 + seeds.support[1]:
            return [(seeds.direction, unit, seeds)]
    if x.size * y.size > _FULL:
        found = [(d, 1.0, find_seeds(x, y, options.scale_range, (d,))) for d in directions]
        return [t for t in found if t[2] is not None]
    return [(d, 1.0, None) for d in directions]


def _align_one_way(x, b, seeds: Seeds | None, options, traits, locks, direction, unit):
    n, m = x.size, b.size
    locked = from_locks(locks, n, m)
    b = b - b[0]
    half = options.band_half_width
    if seeds is None:
        warped, i, j = _by_scale_grid(x, b, options, locked)
    else:
        i, j = _with_locks(seeds.i, seeds.j, locks)
        warped = warp(x, x[seeds.i] + 1e-9, _smooth(seeds.local))
        warped += np.median(b[j] - warped[i])
    model = first_model(0.06 if seeds is None else seeds.noise, warped, b)
    hints = locked
    for again in (True, False):
        partner, move, wider = _best_path(warped, b, i, j, half, model, hints)
        before = model.rates.sigma
        warped, model = _learn(x, b, warped, partner, move, model)
        hints = learn(locked, traits[0], traits[1], warped, b, partner) if traits else locked
        i, j = _firm(partner, move) if (partner >= 0).any() else (i, j)
        half = (_NARROW if seeds is not None else max(options.band_half_width, 12)) + wider
        steady = 0.67 < model.rates.sigma / before < 1.5 and hints is locked
        if again and steady and n > _LARGE:
            break
    return _posterior(x, b, warped, i, j, half, model, hints, direction, unit)


def _with_locks(i, j, locks: Locks | None):
    """Anchors with the locked pairs among them, and without those that cross a locked pair."""
    if locks is None or not locks.locked.size:
        return i, j
    at, of = locks.locked[:, 0], locks.locked[:, 1]
    order = np.argsort(at)
    at, of = at[order], of[order]
    k = np.searchsorted(at, i)
    kept = ((k == 0) | (j > of[np.maximum(k - 1, 0)])) & ((k == at.size) | (j < of[np.minimum(k, at.size - 1)]))
    i, j = np.concatenate([i[kept], at]), np.concatenate([j[kept], of])
    order = np.argsort(i)
    return i[order], j[order]


def _posterior(x, b, warped, i, j, half, model: LengthModel, hints: Hints, direction, unit) -> PairAlignment:
    """Sum over all alignments within the band about the anchors."""
    n, m = x.size, b.size
    strip, both = band(n, m, i, j, half), model.lists(warped, b)
    ev = over_band(hints, strip, b)
    total, norm, log_scale, log_total = ahead(both, strip, model.rates, ev, False)
    match, shifted = behind(both, strip, model.rates, ev, total, norm, log_scale, log_total, False)
    kept = np.flatnonzero(match > _KEPT)
    row = np.searchsorted(strip.offset, kept, side="right") - 1
    col = strip.low[row] + kept - strip.offset[row]
    col_given = col if direction > 0 else m - 1 - col
    decided = np.full(n, -1, np.int64)
    sure = match[kept] > 0.5
    honoured = int((hints.lock_a[row[sure]] == col[sure]).sum()) if hints.lock_a.size else 0
    decided[row[sure]] = col_given[sure]
    local = np.gradient(warped, x) * unit if n > 2 else np.full(n, unit)
    return PairAlignment(
        direction=direction,
        scale=float(np.median(np.diff(warped) / np.diff(x))) * unit,
        i=row,
        j=col_given,
        posterior=match[kept],
        shifted=shifted[kept].astype(float),
        partner=decided,
        model=model,
        evidence_nats=float(log_total) - np.log(LOCKED) * honoured,  # a lock is a wish, no evidence
        local=local,
        frame=Frame(both, strip, ev, model.rates),
    )


def _firm(partner, move):
    """Pairs of the best path without the short stretches between two replaced ones, which may be chance."""
    at = np.flatnonzero(partner >= 0)
    stretch = np.cumsum((move[at] == CUT) | (move[at] == REROUTE))
    long = np.bincount(stretch)[stretch] >= _FIRM
    at = at[long] if long.any() else at
    return at, partner[at]


def _best_path(warped, b, i, j, half, model, hints):
    """Partner and move of each weld of A on the best path, and how much wider than usual the band about it must be (n).

    Where the path touches the edge of its band, the band is laid anew about the path, and wider each time. In a long list a few
    such places need no new sweep: the band in which the posteriors are formed is made wide there.
    """
    lists = model.lists(warped, b)
    about = _NARROW
    while True:
        strip = band(warped.size, b.size, i, j, half)
        ev = over_band(hints, strip, b)
        best, norm, log_scale, _ = ahead(lists, strip, model.rates, ev, True)
        partner, move, slack = trace_back(lists, strip, model.rates, ev, best, norm, log_scale)
        touched = np.flatnonzero(slack <= 0)
        if not touched.size or np.max(half) > 256 or not i.size or touched.size * 500 < warped.size - _LARGE:
            return partner, move, _near(touched, warped.size) * _AROUND
        i = np.flatnonzero(partner >= 0)
        j = partner[i]
        about = about + 1 if about < 16 else 2 * about
        half = about


def _near(rows: np.ndarray, n: int, reach: int = 40) -> np.ndarray:
    """1 within so many rows of the given ones, else 0 (n)."""
    edge = np.zeros(n + 1, np.int64)
    np.add.at(edge, np.maximum(rows - reach, 0), 1)
    np.add.at(edge, np.minimum(rows + reach, n), -1)
    return np.minimum(np.cumsum(edge)[:n], 1)


def _smooth(values: np.ndarray, half: int = 5) -> np.ndarray:
    """Running median of the local scale of the anchors."""
    if values.size <= 2:
        return np.full(values.size, float(np.median(values)))
    half = min(half, (values.size - 1) // 2)
    padded = np.pad(values, half, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)


def _by_scale_grid(x, b, options, hints):
    """Without seeds: the scale of a grid whose whole-matrix alignment weighs most."""
    n, m = x.size, b.size
    empty = np.empty(0, np.int64)
    strip = band(n, m, empty, empty, 0)
    ev = over_band(hints, strip, b)
    best, kept, model = -np.inf, x - x[0], first_model(0.08, x - x[0], b)
    steps = int(np.clip(40_000_000 // max(n * m, 1), 5, 41))
    for scale in 1.0 + np.linspace(-options.scale_range, options.scale_range, steps | 1):
        warped = (x - x[0]) * scale
        weight = ahead(model.lists(warped, b), strip, model.rates, ev, False)[3]
        if weight > best:
            best, kept = weight, warped
    return kept, empty, empty


def _learn(x, b, warped, partner, move, model: LengthModel):
    """Local scale, noise, rates and densities anew from the best path."""
    at = np.flatnonzero(move == 11)
    at = at[at > 0]
    if at.size < 5:
        return warped, model
    dx, dy = x[at] - x[at - 1], b[partner[at]] - b[partner[at] - 1]
    scale = local_scale(dx, dy)
    new = warp(x, 0.5 * (x[at] + x[at - 1]), scale)
    new += np.median(b[partner[at]] - new[at])
    residual = dy - (new[at] - new[at - 1])
    return new, reestimate(model, model.lists(new, b), residual, partner, move)


def _check_same_line(result: PairAlignment, x, y, names, options) -> None:
    needed = options.least_evidence_nats + np.log(float(x.size) * y.size)
    found = int(np.count_nonzero(result.partner >= 0))
    if result.evidence_nats < needed:
        extent = f"{x.size} and {y.size} welds, {np.ptp(x):.0f} and {np.ptp(y):.0f} m"
        rule = (
            f"{found} of {min(x.size, y.size)} welds find a partner; the joint lengths speak for one line with "
            f"{result.evidence_nats:.1f} nats, {needed:.1f} are needed ({extent})"
        )
        raise WrongLineError(Fault(f"{names[0]} and {names[1]}", "welds", rule, _ADVICE))
