"""What dense arms read beside the smooth shape in, the depth corrected by it out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deform.caliper.dent_shape import DentFit, wrap

_REACH = 0.22  # of length and width: the apex lies this near to that of the smooth shape
_CELLS_ALONG = 12
_STRAYS = 0.02  # of the depth: how far the wall strays from the best smooth shape, before it is seen
_SCALES = ((0.2, 0.75), (0.08, 0.25))  # of length and width: over which it strays in one way, and the share of each
_SIZE_STRAYS = 0.02  # of length and width, likewise
_SURE = 2.0  # sigma, by which the wall beside the apex must be deeper to be the deepest
_MOST_POINTS = 400
_GRID = 13


def corrected(fit: DentFit, place: np.ndarray, clock: np.ndarray, excess: np.ndarray, sigma: np.ndarray) -> DentFit:
    """Return the fit with the depth of the deepest wall that the arms found near its apex, and the sigmas of a real dent.

    Parameters
    ----------
    fit : the smooth shape.
    place, clock : (n,), (n, arms) of the readings about the centre (m, rad).
    excess, sigma : (n, arms) m, how far each stands inward of the shape, and its noise.

    Notes
    -----
    The excess is a random field over the dent's core: two hundredths of the depth, or as large as the readings say, and alike
    over a fifth of the dent's size. Its best estimate (kriging) is added to the shape, and what stays unknown of it to the
    sigma: little where arms are dense, all of it between two arms. A sharp apex with raised shoulders, as rocks make it,
    is found.
    """
    along, around = (place - fit.centre)[:, None] / fit.length, wrap(clock - fit.clock) * fit.outer_radius / fit.width
    near = (np.abs(along) < 1.6 * _REACH) & (np.abs(around) < 1.6 * _REACH) & np.isfinite(excess) & np.isfinite(sigma)
    points = _points(np.broadcast_to(along, clock.shape)[near], around[near], excess[near], sigma[near], np.nonzero(near)[1])
    if points is None:
        return fit
    s, t, value, noise2 = points
    field2 = max((_STRAYS * fit.depth) ** 2, float(np.mean(value**2 - noise2)))
    covariance = field2 * _alike(s, t, s, t) + np.diag(noise2)
    x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(-_REACH, _REACH, _GRID)] * 2, indexing="ij"))
    towards = field2 * _alike(x, y, s, t)
    share = np.linalg.solve(covariance, towards.T).T
    found = share @ value
    total = fit.at(fit.centre + x * fit.length, fit.clock + y * fit.width / fit.outer_radius) + found
    left = np.sqrt(np.maximum(field2 - np.einsum("kj,kj->k", share, towards), 0.0))
    middle, best = x.size // 2, int(np.argmax(total))
    if total[best] - total[middle] < _SURE * np.hypot(left[best], left[middle]):
        best = middle
    return replace(
        fit,
        depth=float(max(total[best], 0.0)),
        depth_sigma=float(np.hypot(fit.depth_sigma, left[best])),
        length_sigma=float(np.hypot(fit.length_sigma, _SIZE_STRAYS * fit.length)),
        width_sigma=float(np.hypot(fit.width_sigma, _SIZE_STRAYS * fit.width)),
    )


def _points(s: np.ndarray, t: np.ndarray, value: np.ndarray, sigma: np.ndarray, arm: np.ndarray):
    """Readings of one arm averaged over short pieces of the dent: place, side, excess, variance; None for too few."""
    if value.size < 8:
        return None
    cell = np.floor((s + 1.6 * _REACH) / (3.2 * _REACH) * _CELLS_ALONG).astype(np.int64)
    key = arm * (_CELLS_ALONG + 1) + np.clip(cell, 0, _CELLS_ALONG)
    _, index = np.unique(key, return_inverse=True)
    weight = 1.0 / sigma**2
    total = np.bincount(index, weight)
    s, t, value = (np.bincount(index, weight * v) / total for v in (s, t, value))
    if value.size > _MOST_POINTS:
        pick = np.argsort(np.hypot(s, t))[:_MOST_POINTS]
        return s[pick], t[pick], value[pick], 1.0 / total[pick]
    return s, t, value, 1.0 / total


def _alike(x: np.ndarray, y: np.ndarray, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    apart2 = (x[:, None] - s[None, :]) ** 2 + (y[:, None] - t[None, :]) ** 2
    return sum(share * np.exp(-0.5 * apart2 / scale**2) for scale, share in _SCALES)
