"""Accelerometer counts in, short shakes out: where the tool was hit, and how far each hit stands out of its noise."""

from __future__ import annotations

import numpy as np
from scipy.linalg import toeplitz
from scipy.ndimage import maximum_filter1d

SIDES = 3  # samples on either side from which each sample is predicted
_NOISE_S = 2.0  # span over which the noise of the accelerometers is formed
_HIT_S = 0.06  # half of the time that one hit lasts at most
_STRONG = 8.0  # sigma: hits that teach the shape of a hit
_ENOUGH = 20
_EXPECTED = 1.0  # of a squared sample of unit noise


def hit_score(counts: np.ndarray, interval: float, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return score and energy of every sample.

    Parameters
    ----------
    counts : (n, 3) accelerometer counts.
    interval : s between samples.
    moving : (n,) false while the tool stands.

    Returns
    -------
    score : (n,) sigma of the noise: the energy of a hit centred here, made normal by its cube root (Wilson and Hilferty).
    energy : (n,) mean square of the three axes in units of their noise, for the centre of a hit.

    Notes
    -----
    Each axis is whitened by interpolation from both sides, which keeps a hit in its place and removes slow motion and the
    smooth vibration of the tool, and is divided by its robust noise over two seconds. A hit is a burst: its energy is summed
    over axes and lags with the weights snr / (1 + snr) of a change of variance, snr being learned from the strong hits of
    the run itself.
    """
    squares = np.stack([_white(counts[:, a].astype(float), interval, moving) ** 2 for a in range(counts.shape[1])])
    half = max(1, round(_HIT_S / interval))
    plain = np.full((squares.shape[0], 2 * half + 1), 1.0)
    score = _score(squares, plain, moving)
    strong = _peaks(score, _STRONG, 4 * half)
    weights = plain
    if strong.size >= _ENOUGH:
        inside = strong[(strong >= half) & (strong < squares.shape[1] - half)]
        lags = np.stack([np.median(squares[:, inside + lag], axis=1) for lag in range(-half, half + 1)], axis=1)
        excess = np.maximum(lags / 0.455 - _EXPECTED, 0.0)  # the median of a squared normal is 0.455
        excess = 0.5 * (excess + excess[:, ::-1])
        weights = excess / (1.0 + excess)
        weights[weights < 0.2] = 0.0
        if weights.sum() > 0.5:
            score = _score(squares, weights, moving)
    each = weights.max(axis=1)
    return score, np.tensordot(each / max(each.sum(), 1e-9), squares, axes=1)


def hit_centre(energy: np.ndarray, peak: int, interval: float, place: np.ndarray) -> float:
    """Centre of gravity of the energy around a peak, on the axis ``place``."""
    half = max(1, round(1.5 * _HIT_S / interval))
    part = slice(max(0, peak - half), peak + half + 1)
    weight = np.minimum(np.maximum(energy[part] - 4.0, 0.0), 1e4)
    return float(np.sum(weight * place[part]) / np.sum(weight)) if weight.sum() > 0 else float(place[peak])


def _white(values: np.ndarray, interval: float, moving: np.ndarray) -> np.ndarray:
    """Error of each sample against what its neighbours on both sides say, over its local robust noise."""
    use = values[moving] - np.median(values[moving])
    limit = 4.0 * 1.4826 * np.median(np.abs(use)) + 1.0
    use = np.clip(use, -limit, limit)
    lags = 2 * SIDES + 1
    covariance = np.array([np.mean(use[: use.size - k] * use[k:]) for k in range(lags)])
    covariance[0] = covariance[0] * (1.0 + 1e-6) + 0.05  # counts are rounded: a twelfth of a pulse squared, at least
    inverse = np.linalg.inv(toeplitz(covariance))
    filter_taps = inverse[SIDES] / inverse[SIDES, SIDES]
    error = np.convolve(values - np.median(values[moving]), filter_taps, mode="same")
    error[:SIDES] = error[-SIDES:] = 0.0  # the ends have neighbours on one side only, and would be taken for hits
    return error / _local_noise(np.abs(error), interval, moving)


def _local_noise(size: np.ndarray, interval: float, moving: np.ndarray) -> np.ndarray:
    """Robust noise while moving, the greatest of a stretch and its neighbours, so that starts and stops do not count as hits."""
    block = max(50, round(_NOISE_S / interval))
    blocks = -(-size.size // block)
    padded = np.full(blocks * block, np.nan)
    padded[: size.size] = np.where(moving, size, np.nan)
    table = padded.reshape(blocks, block)
    noise = np.full(blocks, np.nan)
    enough = np.isfinite(table).sum(axis=1) >= 25
    noise[enough] = 1.4826 * np.nanmedian(table[enough], axis=1)
    usual = float(np.nanmedian(noise)) if enough.any() else 1.0
    noise = np.where(np.isfinite(noise), noise, usual)
    noise = maximum_filter1d(noise, 3)
    return np.repeat(np.maximum(noise, max(0.3 * usual, 0.3)), block)[: size.size]


def _score(squares: np.ndarray, weights: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Weighted sum over axes and lags, cube root, in robust sigma; zero while the tool stands."""
    total = np.zeros(squares.shape[1])
    for axis in range(squares.shape[0]):
        total += np.convolve(squares[axis], weights[axis][::-1], mode="same")
    root = np.cbrt(total)
    middle = np.median(root[moving])
    spread = 1.4826 * np.median(np.abs(root[moving] - middle))
    return np.where(moving, (root - middle) / max(spread, 1e-9), 0.0)


def _peaks(score: np.ndarray, least: float, apart: int) -> np.ndarray:
    above = np.flatnonzero(score >= least)
    if not above.size:
        return above
    groups = np.split(above, np.flatnonzero(np.diff(above) > apart) + 1)
    return np.array([g[np.argmax(score[g])] for g in groups])
