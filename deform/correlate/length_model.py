"""Weld lists in, the model of their joint lengths out: densities of the lengths, noise, rates of the moves, local scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from deform.correlate._kernel_moves import PEAK
from deform.correlate._kernel_path import CUT, REROUTE
from deform.correlate._kernel_types import BIN, LONGEST_CUT, Lists, Rates
from deform.geometry.resample import robust_sigma

_UNIFORM = 0.03  # share of the density that is spread over all lengths
_WIDTHS = 0.1, 0.5  # metre, over which a sparse part of the density is smoothed
_ENOUGH = 4.0  # joints about a length from which on they say more than their wider surroundings
_T3_SIGMA = np.sqrt(3.0) * 0.75  # what 1 scale of t3 is as a working standard deviation: its central part, not its tails
_KNOWN = 30.0  # new joints that outweigh what is believed of new pipe beforehand
_LONGEST = 60.0  # metre; a listed joint beyond it is a hole in the list
_DEPARTS, _ROUNDS = 5.0, 2  # sigma from which on a joint has no part in the local scale; how often that is formed anew
_LEAST_SIGMA, _MOST_SIGMA = 0.004, 0.5  # metre
_FIT = 0.05  # metre, to which the length of a cut-out is kept
_SCALE_ERROR = 0.001  # of the local scale over a cut-out
_CLOSING = 60.0  # metre, bound of one over the density of a piece that was cut to fit


@dataclass(frozen=True)
class LengthModel:
    """What two runs of one line have in common, and how they differ.

    Attributes
    ----------
    rates : noise of a joint's length difference and weights of the moves.
    density : density of listed joint lengths (1/m) in bins of 1 cm from zero, one joint's own part in it left out.
    shared : the same of the mean of two listings of one joint: that of the joints themselves, less blurred by noise.
    fresh : density of the joint lengths of new pipe (1/m), as far as cut-outs have shown it.
    """

    rates: Rates
    density: np.ndarray
    shared: np.ndarray
    fresh: np.ndarray

    @property
    def length_sigma(self) -> float:
        """Standard deviation of a joint's length difference, metre: of the central part where the tails are heavy."""
        freedom = 2.0 ** (self.rates.shape + 1) - 1.0
        return self.rates.sigma * (float(np.sqrt(freedom / (freedom - 2.0))) if freedom > 3 else _T3_SIGMA)

    def lists(self, x: np.ndarray, y: np.ndarray) -> Lists:
        """Two weld lists on one scale, made ready for the kernels."""
        inv_a, inv_b = _inverse(self.density, x), _inverse(self.density, y)
        piece = _inverse(self.fresh, y)
        fresh, closing = np.cumsum(np.log(inv_b / piece)), np.cumsum(np.minimum(piece, _CLOSING))
        joints = np.arange(2 * LONGEST_CUT + 1)
        typical = float(np.median(np.diff(x))) if x.size > 1 else 12.0
        spread = self.rates.sigma**2 * 0.5 * joints + _FIT**2 + (_SCALE_ERROR * typical * 0.5 * joints) ** 2
        return Lists(x, y, inv_a, inv_b, fresh, closing, self.density, self.shared, np.sqrt(spread))


def _inverse(density: np.ndarray, places: np.ndarray) -> np.ndarray:
    """One over the density at the joint that ends at each weld (metre); 1 at the first weld."""
    inverse = np.ones(places.size)
    inverse[1:] = 1.0 / density[np.minimum((np.diff(places) / BIN).astype(int), density.size - 1)]
    return inverse


def first_rates(sigma: float = 0.05, missed: float = 0.01, false: float = 0.01, joint: float = 12.0) -> Rates:
    """Rates before any data were seen: a cut-out in 3000 joints (40 km), of some 7 joints, a re-route in 20000.

    Parameters
    ----------
    sigma : noise, metre.
    missed, false : per weld.
    joint : mean length of a joint, metre.
    """
    return _whole(
        Rates(
            sigma=sigma,
            shape=1,
            same=1.0,
            missed_a=missed,
            missed_b=missed,
            again=0.1,
            false_a=false / joint,
            false_b=false / joint,
            shifted=1e-3,
            shift_m=0.4,
            cut=3e-4,
            cut_more=0.85,
            reroute=5e-9,  # 5e-5 per joint, times the chance to end at this joint of each run
            reroute_more=0.99,
            ends=1e-3,
        ),
        joint,
    )


def _whole(rates: Rates, joint: float) -> Rates:
    others = rates.missed_a + rates.missed_b + (rates.false_a + rates.false_b) * joint + rates.shifted + rates.cut
    return rates._replace(same=max(1.0 - others, 0.5))


def alone(places: np.ndarray) -> LengthModel:
    """Model of a line that one run alone shows."""
    return first_model(0.05, places)


def first_model(sigma: float, *places: np.ndarray) -> LengthModel:
    """Model before any pair of welds is known."""
    density = length_density(*(np.diff(p) for p in places), narrow=0.35 * sigma, copies=1.33)
    rates = first_rates(sigma, joint=mean_joint(*places))
    return LengthModel(rates, density, without_merged(density), _fresh(density, np.empty(0), sigma))


def without_merged(density: np.ndarray) -> np.ndarray:
    """Density of lengths less that of two joints listed as one where their weld was missed.

    Two runs seldom miss the same weld: that both list a joint of twice the mill length is no mark of one place. The share of
    missed welds is read where the density is least above that of the sum of two joints.
    """
    sums = fftconvolve(density, density)[: density.size] * BIN
    there = sums > 0.2 * sums.max()
    missed = float(np.clip(np.quantile(density[there] / sums[there], 0.25), 0.0, 0.1))
    return np.maximum(density - missed * sums, 0.02 * density)


def _fresh(density: np.ndarray, new: np.ndarray, sigma: float) -> np.ndarray:
    """Density of the lengths of new pipe: half that of the line, half the same smeared, until new joints show their own."""
    before = 0.5 * density + 0.5 * _smooth(density, _WIDTHS[1])
    shown = length_density(new, narrow=0.35 * sigma, copies=1.0)
    shown = np.pad(shown, (0, max(density.size - shown.size, 0)), mode="edge")[: density.size]
    return (_KNOWN * before + new.size * shown) / (_KNOWN + new.size)


def mean_joint(*places: np.ndarray) -> float:
    """Mean length of the listed joints, metre, holes in the list left out."""
    lengths = np.concatenate([np.diff(p) for p in places])
    lengths = lengths[lengths < _LONGEST]
    return float(lengths.mean()) if lengths.size else 12.0


def length_density(*lengths: np.ndarray, narrow: float, copies: float) -> np.ndarray:
    """Density of lengths (1/m) in bins of 1 cm, each length's own part in it left out.

    Parameters
    ----------
    lengths : metre.
    narrow : finest smoothing, metre.
    copies : how many times over a joint is in the data near its own length.

    Notes
    -----
    Three smoothings (narrow, 0.1 m, 0.5 m) and a uniform part; where few joints lie about a length, the wider one is drawn on,
    by the number of joints that the narrower one has there beside the joint itself. A pup whose length is found nowhere else thus
    has the density of its wider surroundings, and a mill length its own sharp peak.
    """
    v = np.concatenate(lengths) if lengths else np.empty(0)
    v = v[(v > 0) & (v < _LONGEST)]
    most = max(30.0, float(v.max(initial=0.0)) * 1.2)
    counts = np.bincount((v / BIN).astype(int), minlength=int(most / BIN) + 1).astype(float)
    n = max(v.size, 1)
    density = np.full(counts.size, 1.0 / most)
    for width, own in ((_WIDTHS[1], 2.0), (_WIDTHS[0], 2.0), (max(narrow, 0.5 * BIN), copies)):
        others = np.maximum(_smooth(counts, width) - own * BIN / (width * np.sqrt(2.0 * np.pi)) * (counts > 0), 0.0)
        about = others / BIN * 2.0 * np.sqrt(np.pi) * width  # joints that carry the estimate
        trust = about / (about + _ENOUGH)
        density = trust * others / n / BIN + (1.0 - trust) * density
    return (1.0 - _UNIFORM) * density + _UNIFORM / most


def _smooth(counts: np.ndarray, sigma: float) -> np.ndarray:
    half = int(np.ceil(4.0 * sigma / BIN))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * BIN / sigma) ** 2)
    return np.convolve(counts, kernel / kernel.sum(), mode="same")


def local_scale(x: np.ndarray, y: np.ndarray, half_window: int = 25, most: float = 0.03) -> np.ndarray:
    """Scale of B against A along the line from joints that are the same in both.

    Parameters
    ----------
    x, y : lengths (k) of the same joints in A and in B, metre, in the order of the line.
    half_window : joints on each side over which the ratio of the summed lengths is formed.
    most : a joint whose ratio departs more from the median does not count.

    Returns
    -------
    scale : (k) B over A.

    Notes
    -----
    Joints whose length departs by more than five sigma (robust, over the line) from that scale have no part in it, unless the
    joints beside them give it back, as they do for a weld set wrong: where pipe moved sideways its joints are longer, and would
    make those of half a window beside them look shorter.
    """
    if not x.size:
        return np.ones(0)
    ratio = y / x
    middle = np.median(ratio)
    good = np.abs(ratio / middle - 1.0) < most
    if not good.any():
        return np.full(x.size, middle)
    scale = _running_ratio(x, y, good, half_window, middle)
    for _ in range(_ROUNDS):
        residual = np.where(good, y - scale * x, 0.0)
        least = _DEPARTS * max(float(robust_sigma(residual[good])), _LEAST_SIGMA)
        beside = np.convolve(residual, np.ones(3), "same")
        same = good & ((np.abs(residual) < least) | (residual * np.sign(beside) <= 0) | (np.abs(beside) < least))
        scale = _running_ratio(x, y, same, half_window, middle)
    return scale


def _running_ratio(x: np.ndarray, y: np.ndarray, good: np.ndarray, half_window: int, middle: float) -> np.ndarray:
    """Ratio of the sums of the good joints in a window about each (k), ``middle`` where there are none."""
    sx, sy = (np.concatenate([[0.0], np.cumsum(np.where(good, v, 0.0))]) for v in (x, y))
    k = np.arange(x.size)
    first, last = np.maximum(k - half_window, 0), np.minimum(k + half_window + 1, x.size)
    dx = sx[last] - sx[first]
    return np.where(dx > 0, (sy[last] - sy[first]) / np.maximum(dx, 1e-9), middle)


def warp(places: np.ndarray, at: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Places of A on the scale of B: the integral of the local scale (given at places ``at`` of A), from the first weld."""
    if not at.size:
        return places - places[0]
    middle = 0.5 * (places[1:] + places[:-1])
    return np.concatenate([[0.0], np.cumsum(np.diff(places) * np.interp(middle, at, scale))])


def noise(residuals: np.ndarray) -> tuple[float, int]:
    """Scale (metre) and shape (see `Rates`) of Student's t from residuals of joint lengths; NaN scale from fewer than five.

    Notes
    -----
    The scale by expectation maximisation for 3, 7 and 15 degrees of freedom; the shape is that of the largest likelihood, 3 where
    fewer than 200 residuals could not tell.
    """
    r = residuals[np.isfinite(residuals)]
    if r.size < 5:
        return np.nan, 1
    best, found = -np.inf, (np.nan, 1)
    for shape in (1, 2, 3) if r.size >= 200 else (1,):
        nu = 2.0 ** (shape + 1) - 1.0
        sigma = max(float(np.median(np.abs(r))) / 0.72, _LEAST_SIGMA)
        for _ in range(12):
            weight = (nu + 1.0) / (nu + (r / sigma) ** 2)
            sigma = min(max(float(np.sqrt(np.mean(weight * r**2))), _LEAST_SIGMA), _MOST_SIGMA)
        weight = float(np.mean(np.log(PEAK[shape] / sigma) - 0.5 * (nu + 1.0) * np.log1p((r / sigma) ** 2 / nu)))
        if weight > best:
            best, found = weight, (sigma, shape)
    return found


def reestimate(model: LengthModel, lists: Lists, residuals: np.ndarray, partner: np.ndarray, move: np.ndarray) -> LengthModel:
    """Noise, rates and densities anew from the best path (each rate drawn towards its prior by a few counts).

    Notes
    -----
    A weld that one run alone shows inside a joint of the other was missed there or is false here: it counts for each by the
    share that the lengths of the pieces give it.
    """
    x, y = lists.x, lists.y
    old, joint = model.rates, mean_joint(x, y)
    count = {code: int(np.count_nonzero(move == code)) for code in (11, 12, 21, 13, 31, 22, CUT, REROUTE)}
    joints = float(count[11] + 2 * (count[12] + count[21] + count[22]) + 3 * (count[13] + count[31]))
    missed_a, false_b = _missed_or_false(lists.inv_a, lists.inv_b, old.missed_a, old.false_b, *_lone(partner, move, 12))
    missed_b, false_a = _missed_or_false(lists.inv_b, lists.inv_a, old.missed_b, old.false_a, *_lone(partner, move, 21)[::-1])
    cut_joints = _cut_joints(partner, move)
    sigma, shape = noise(residuals)

    def share(n: float, before: float, prior: float = 200.0, most: float = 0.15) -> float:
        return float(np.clip((n + prior * before) / (joints + prior), 1e-5, most))

    rates = old._replace(
        sigma=old.sigma if np.isnan(sigma) else sigma,
        shape=old.shape if np.isnan(sigma) else shape,
        missed_a=share(missed_a + count[13], old.missed_a),
        missed_b=share(missed_b + count[31], old.missed_b),
        again=(count[13] + count[31] + 0.5) / (missed_a + missed_b + count[13] + count[31] + 5.0),
        false_a=share(false_a + count[31], old.false_a * joint) / joint,
        false_b=share(false_b + count[13], old.false_b * joint) / joint,
        shifted=share(count[22], old.shifted, most=0.02),
        cut=share(count[CUT], 3e-4, 500.0, 0.05),
        cut_more=float(np.clip(1.0 - (count[CUT] + 5.0) / (cut_joints + 33.0), 0.5, 0.95)),
        reroute=1e-4 * float(np.clip((count[REROUTE] + 1.0) / (joints + 20_000.0), 1e-6, 1e-3)),
    )
    density = length_density(np.diff(x), np.diff(y), narrow=0.35 * rates.sigma, copies=1.33)
    at = np.flatnonzero(move == 11)
    shared = density
    if at.size >= 50:
        mean = 0.5 * (x[at] - x[at - 1] + y[partner[at]] - y[partner[at] - 1])
        shared = length_density(mean, narrow=0.25 * rates.sigma, copies=1.0)
        shared = np.pad(shared, (0, max(density.size - shared.size, 0)), mode="edge")
    new = _new_joints(y, partner, move)
    return LengthModel(_whole(rates, joint), density, shared, _fresh(density, new, rates.sigma))


def _lone(partner: np.ndarray, move: np.ndarray, code: int):
    at = np.flatnonzero(move == code)
    return at, partner[at]


def _missed_or_false(whole, pieces, missed: float, false: float, at: np.ndarray, of: np.ndarray) -> tuple[float, float]:
    """How many of the welds inside whole joints (that end at ``at``) the one run missed, and how many the other made up."""
    real = missed * whole[at]
    made_up = false * pieces[of] * pieces[of - 1]
    share = float((real / (real + made_up)).sum())
    return share, at.size - share


def _new_joints(y: np.ndarray, partner: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Lengths of the joints of B in the cut-outs of a path, metre."""
    held = np.flatnonzero(partner >= 0)
    ends = np.flatnonzero(move[held] == CUT)
    inside = np.zeros(y.size + 1, np.int64)
    np.add.at(inside, partner[held[ends - 1]], 1)
    np.add.at(inside, partner[held[ends]], -1)
    return np.diff(y)[np.cumsum(inside)[: y.size - 1] > 0]


def _cut_joints(partner: np.ndarray, move: np.ndarray) -> float:
    """Joints of the cut-outs, mean of both runs."""
    held = np.flatnonzero(partner >= 0)
    ends = np.flatnonzero(move[held] == CUT)
    before, after = held[ends - 1], held[ends]
    return float(0.5 * (after - before + partner[after] - partner[before]).sum())
