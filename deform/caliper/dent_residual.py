"""What dense arms read beside the smooth shape in, the depth corrected by it out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deform.caliper.dent_shape import LN10, DentFit, wrap

_REACH = 0.22  # of length and width: the apex lies this near to that of the smooth shape, where that shape is true
_WIDE = 0.55  # likewise, where it is not: two apexes, an edge, a floor that tilts
_MARGIN = 1.6  # readings are taken from this much further
_CELL = 0.059  # of the length: readings of one arm within it are averaged
_STRAYS = 0.02  # of the depth: how far the wall strays from the best smooth shape, before it is seen
_UNTRUE = 0.04  # of the depth: a wall that strays further has another shape
_SCALES = ((0.2, 0.75), (0.08, 0.25))  # of length and width: over which it strays in one way, and the share of each
_SIZE_STRAYS = 0.02  # of length and width, likewise
_SURE = 2.0  # sigma, by which the wall beside the apex must be deeper to be the deepest
_MOST_POINTS = 400
_GRID, _PITCH, _MOST_ALONG = 13, 0.05, 61
_DRAWS = 300


def corrected(
    fit: DentFit, place: np.ndarray, clock: np.ndarray, excess: np.ndarray, sigma: np.ndarray, extent: float = 0.0
) -> DentFit:
    """Return the fit with the depth of the deepest wall that the arms tell of, and the sigmas of a real dent.

    Parameters
    ----------
    fit : the smooth shape.
    place, clock : (n,), (n, arms) of the readings about the centre (m, rad).
    excess, sigma : (n, arms) m, how far each stands inward of the shape, and its noise.
    extent : m, stretch in which the wall stood in at first sight; the shape may have taken one of two apexes.

    Notes
    -----
    The excess is a random field over the dent: two hundredths of the depth, or as large as the readings say, and alike over a
    fifth of the dent's size. Near the apex its best estimate (kriging) is added to the shape, and what stays unknown of it to
    the sigma: little where arms are dense, all of it between two arms. A sharp apex with raised shoulders, as rocks make it,
    is found. Where the readings stray by more than four hundredths of the depth no smooth shape is true: walls that agree with
    all readings are drawn, and the depth is the mean of their greatest depths, its sigma their scatter and what two arms may
    hide of an apex between them.
    """
    along, around = (place - fit.centre)[:, None] / fit.length, wrap(clock - fit.clock) * fit.outer_radius / fit.width
    known = np.isfinite(excess) & np.isfinite(sigma)
    reach = max(_WIDE, 0.5 * extent / fit.length)
    wide = _points(along, around, excess, sigma, known & (np.abs(along) < reach) & (np.abs(around) < _WIDE))
    if wide is not None and np.mean(wide[2] ** 2 - wide[3]) > (_UNTRUE * fit.depth) ** 2:
        depth, spread = _deepest_drawn(fit, wide, reach)
        spread = float(np.hypot(spread, depth * _hidden(2 * np.pi / clock.shape[1] * fit.outer_radius / fit.width)))
    else:
        near = known & (np.abs(along) < _MARGIN * _REACH) & (np.abs(around) < _MARGIN * _REACH)
        points = _points(along, around, excess, sigma, near)
        if points is None:
            return fit
        depth, spread = _deepest_near(fit, points)
    return replace(
        fit,
        depth=max(depth, 0.0),
        depth_sigma=float(np.hypot(fit.depth_sigma, spread)),
        length_sigma=float(np.hypot(fit.length_sigma, _SIZE_STRAYS * fit.length)),
        width_sigma=float(np.hypot(fit.width_sigma, _SIZE_STRAYS * fit.width)),
    )


def _deepest_near(fit: DentFit, points: tuple[np.ndarray, ...]) -> tuple[float, float]:
    """Depth at the apex, or at deeper wall near it of which the readings are sure, and the sigma of the field there (m)."""
    x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(-_REACH, _REACH, _GRID)] * 2, indexing="ij"))
    total, share, towards, field2 = _estimate(fit, points, x, y)
    left = np.sqrt(np.maximum(field2 - np.einsum("kj,kj->k", share, towards), 0.0))
    middle, best = x.size // 2, int(np.argmax(total))
    if total[best] - total[middle] < _SURE * np.hypot(left[best], left[middle]):
        best = middle
    return float(total[best]), float(left[best])


def _deepest_drawn(fit: DentFit, points: tuple[np.ndarray, ...], reach: float) -> tuple[float, float]:
    """Mean and scatter of the greatest depth (m) of walls drawn from all that agree with the readings."""
    sides = (np.linspace(-r, r, min(_MOST_ALONG, 2 * round(r / _PITCH) + 1)) for r in (reach, _WIDE))
    x, y = (v.ravel() for v in np.meshgrid(*sides, indexing="ij"))
    total, share, towards, field2 = _estimate(fit, points, x, y)
    covariance = field2 * _alike(x, y, x, y) - share @ towards.T
    root = np.linalg.cholesky(covariance + 1e-6 * field2 * np.eye(x.size))
    drawn = total[:, None] + root @ np.random.default_rng(1).normal(size=(x.size, _DRAWS))
    deepest = drawn.max(axis=0)
    return float(deepest.mean()), float(deepest.std())


def _hidden(spacing: float) -> float:
    """Share of a bell's depth (rms) that arms hide which stand ``spacing`` of its width apart, its apex anywhere between them."""
    aside = np.linspace(0.0, 0.5 * spacing, 50)
    return float(np.sqrt(np.mean((1.0 - np.exp(-LN10 * (2.0 * aside) ** 2)) ** 2)))


def _estimate(fit: DentFit, points: tuple[np.ndarray, ...], x: np.ndarray, y: np.ndarray):
    """Depth (m) at places (of the length, of the width) by shape and field; shares and covariances of the points, variance."""
    s, t, value, noise2 = points
    field2 = max((_STRAYS * fit.depth) ** 2, float(np.mean(value**2 - noise2)))
    towards = field2 * _alike(x, y, s, t)
    share = np.linalg.solve(field2 * _alike(s, t, s, t) + np.diag(noise2), towards.T).T
    depth = fit.at(fit.centre + x * fit.length, fit.clock + y * fit.width / fit.outer_radius) + share @ value
    return depth, share, towards, field2


def _points(along: np.ndarray, around: np.ndarray, excess: np.ndarray, sigma: np.ndarray, pick: np.ndarray):
    """Picked readings of one arm averaged over short pieces of the dent: place, side, excess, variance; None for too few."""
    if pick.sum() < 8:
        return None
    s, t, value, arm = np.broadcast_to(along, pick.shape)[pick], around[pick], excess[pick], np.nonzero(pick)[1]
    cell = np.floor((s - s.min()) / _CELL).astype(np.int64)
    _, index = np.unique(arm * (cell.max() + 1) + cell, return_inverse=True)
    weight = 1.0 / sigma[pick] ** 2
    total = np.bincount(index, weight)
    s, t, value = (np.bincount(index, weight * v) / total for v in (s, t, value))
    if value.size > _MOST_POINTS:
        pick = np.argsort(np.hypot(s, t))[:_MOST_POINTS]
        return s[pick], t[pick], value[pick], 1.0 / total[pick]
    return s, t, value, 1.0 / total


def _alike(x: np.ndarray, y: np.ndarray, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    apart2 = (x[:, None] - s[None, :]) ** 2 + (y[:, None] - t[None, :]) ** 2
    return sum(share * np.exp(-0.5 * apart2 / scale**2) for scale, share in _SCALES)
