"""Weld lists in, the model of their joint lengths out: density of the line's lengths, noise, rates of the moves, local scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deform.correlate._kernels import BIN, Lists, Rates

_BROAD, _UNIFORM = 0.10, 0.03  # shares of the density that are smoothed by half a metre, and spread over all lengths
_HALF_METRE = 0.5
_LEAST_SIGMA, _MOST_SIGMA = 0.004, 0.5  # metre


@dataclass(frozen=True)
class LengthModel:
    """What two runs of one line have in common, and how they differ.

    Attributes
    ----------
    rates : noise of a joint's length difference (metre, scale of Student's t with 3 degrees of freedom) and weights of the moves.
    density : density of joint lengths (1/m) in bins of 1 cm from zero.
    own : what one joint, in both runs, adds to the density at its own length (1/m): taken off before a joint is judged by it.
    floor : broad part of the density (1/m), below which it does not fall.
    """

    rates: Rates
    density: np.ndarray
    own: float
    floor: np.ndarray

    def lists(self, x: np.ndarray, y: np.ndarray, offset: np.ndarray | None = None, margin: np.ndarray | None = None) -> Lists:
        """Two weld lists on one scale with their densities and the offsets that anchors show, for the kernels."""
        offset = np.zeros((x.size, 1)) if offset is None else offset
        margin = np.full(x.size, np.inf) if margin is None else margin
        inv_a, inv_b = self.inverse_density(x), self.inverse_density(y)
        return Lists(x, y, inv_a, inv_b, np.sqrt(inv_a), np.sqrt(inv_b), self.density, offset, margin)

    def inverse_density(self, places: np.ndarray) -> np.ndarray:
        """One over the density at the joint that ends at each weld (metre), that joint left out; 1 at the first weld."""
        inverse = np.ones(places.size)
        if places.size > 1:
            k = np.minimum((np.diff(places) / BIN).astype(int), self.density.size - 1)
            inverse[1:] = 1.0 / np.maximum(self.density[k] - self.own, self.floor[k])
        return inverse


def first_rates(sigma: float = 0.05, missed: float = 0.01, false: float = 0.01, edit: float = 2e-3) -> Rates:
    """Rates before any data were seen: one edit in 500 joints, of some 7 joints, old and new often different in number."""
    return Rates(
        sigma=sigma,
        same=0.95,
        missed_a=missed,
        missed_b=missed,
        false_a=false,
        false_b=false,
        shifted=1e-3,
        shift_m=0.4,
        open_both=edit,
        extend=0.86,
        switch=0.045,
        close=0.05,
        extend_one=0.35,
        close_one=0.65,
    )


def alone(places: np.ndarray) -> LengthModel:
    """Model of a line that one run alone shows."""
    return LengthModel(first_rates(), *length_density(places, sigma=0.05))


def length_density(*places: np.ndarray, sigma: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Density of joint lengths (1/m) of all runs in bins of 1 cm, what one joint of two runs adds to it, and its broad part.

    Notes
    -----
    The histogram is convolved with a Gaussian of the noise of one run's length, mixed with the same smoothed by half a metre
    (10 %) and with a uniform part (3 %), so that a length never seen is unlikely but not impossible.
    """
    lengths = np.concatenate([np.diff(p) for p in places]) if places else np.empty(0)
    lengths = lengths[(lengths > 0) & (lengths < 60.0)]
    most = max(30.0, float(lengths.max(initial=0.0)) * 1.2)
    counts = np.bincount((lengths / BIN).astype(int), minlength=int(most / BIN) + 1).astype(float)
    n = max(lengths.size, 1)
    narrow = (1.0 - _BROAD - _UNIFORM) / n / BIN
    floor = _BROAD / n / BIN * _smooth(counts, _HALF_METRE) + _UNIFORM / most
    return narrow * _smooth(counts, sigma) + floor, 2.0 * narrow * BIN / (sigma * np.sqrt(2.0 * np.pi)), floor


def _smooth(counts: np.ndarray, sigma: float) -> np.ndarray:
    half = int(np.ceil(4.0 * sigma / BIN))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * BIN / sigma) ** 2)
    return np.convolve(counts, kernel / kernel.sum(), mode="same")


def local_scale(x: np.ndarray, y: np.ndarray, places: np.ndarray, half_window: int = 25, most: float = 0.03) -> np.ndarray:
    """Scale of B against A along the line from joints that are the same in both.

    Parameters
    ----------
    x, y : lengths (k) of the same joints in A and in B, metre, in the order of the line.
    places : place of each joint in A (k), metre.
    half_window : joints on each side over which the ratio of the summed lengths is formed.
    most : a joint whose ratio departs more from the median does not count.

    Returns
    -------
    scale : (k) B over A.
    """
    if not x.size:
        return np.ones(0)
    ratio = y / x
    middle = np.median(ratio)
    good = np.abs(ratio / middle - 1.0) < most
    if not good.any():
        return np.full(x.size, middle)
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


def noise(residuals: np.ndarray) -> float:
    """Scale (metre) of Student's t with 3 degrees of freedom from residuals of joint lengths, robust."""
    r = residuals[np.isfinite(residuals)]
    if r.size < 5:
        return np.nan
    sigma = max(float(np.median(np.abs(r)) / 0.7649), _LEAST_SIGMA)  # 0.7649 is the median of |t3|
    for _ in range(20):
        weight = 4.0 / (3.0 + (r / sigma) ** 2)
        sigma = float(np.sqrt(np.mean(weight * r**2)))
        sigma = min(max(sigma, _LEAST_SIGMA), _MOST_SIGMA)
    return sigma


def reestimate(model: LengthModel, residuals: np.ndarray, moves: np.ndarray, n_edits: int) -> LengthModel:
    """Noise and rates anew from the moves of a path (each rate drawn towards its prior by a few counts)."""
    count = {code: int(np.count_nonzero(moves == code)) for code in (11, 12, 21, 13, 31, 22)}
    joints = count[11] + 2 * (count[12] + count[21] + count[22]) + 3 * (count[13] + count[31])
    prior = 200.0
    old = model.rates
    sigma = noise(residuals)

    def share(n: float, before: float) -> float:
        return float(np.clip((n + prior * before) / (joints + prior), 1e-4, 0.15))

    extra_b, extra_a = count[12] + 2 * count[13], count[21] + 2 * count[31]
    rates = old._replace(
        sigma=old.sigma if np.isnan(sigma) else sigma,
        missed_a=share(0.5 * extra_b, old.missed_a),
        false_b=share(0.5 * extra_b, old.false_b),
        missed_b=share(0.5 * extra_a, old.missed_b),
        false_a=share(0.5 * extra_a, old.false_a),
        shifted=float(np.clip((count[22] + prior * old.shifted) / (joints + prior), 1e-4, 0.02)),
        open_both=float(np.clip((n_edits + prior * old.open_both) / (joints + prior), 2e-4, 0.02)),
    )
    same = 1.0 - rates.missed_a - rates.missed_b - rates.false_a - rates.false_b - rates.shifted - rates.open_both
    return replace(model, rates=rates._replace(same=max(same, 0.5)))
