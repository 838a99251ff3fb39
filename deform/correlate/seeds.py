"""Two weld lists in, direction, scale, anchors and the band of the alignment out."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from deform.correlate._kernel_types import BIN, Band
from deform.correlate._seed_kernels import heaviest_chain, search
from deform.correlate.length_model import length_density, without_merged

_LONG = 9  # joints of a window that must be found anywhere in the other run
_SHORT = 4  # joints of a window that must be found near its expected place
_WINDOWS = 24, 64  # long windows that are looked for anywhere: first, and where so few do not decide
_DETOUR = 30.0  # nats
_SPACING = 500  # joints between long windows that are looked for near their expected place
_NOISE = 0.06  # metre, where nothing is known
_APART = 300  # columns between the diagonals of two anchors, up to which all that lies between is held
_CERTAIN = 60.0  # nats of a chain that leave no need to try the other direction
_TOLERANCE = 0.22  # metre, of one joint's length


@dataclass(frozen=True)
class Seeds:
    """How run B lies against run A before any alignment.

    Attributes
    ----------
    direction : +1, or -1 when B must be turned.
    scale : B over A.
    i, j : anchors: weld i of A is probably weld j of B (turned, where direction is -1).
    local : scale of B over A at each anchor.
    noise : scale of the differences of joint lengths at the anchors, metre.
    support : weight (nats) of the best chain of long windows in this direction, and in the other.
    """

    direction: int
    scale: float
    i: np.ndarray
    j: np.ndarray
    local: np.ndarray
    noise: float
    support: tuple[float, float]


def find_seeds(x: np.ndarray, y: np.ndarray, scale_range: float, directions: tuple[int, ...] = (1, -1)) -> Seeds | None:
    """Return direction, scale and anchors, or None when no sequence of lengths is found in both runs.

    Parameters
    ----------
    x, y : weld places of A (n) and B (m), metre, rising.
    scale_range : largest departure of the scale from one.
    directions : directions that are tried.
    """
    for windows in _WINDOWS:
        trials = []
        for direction in directions:
            b = y if direction > 0 else -y[::-1]
            chain = _long_chain(x, b, 1 - scale_range, 1 + scale_range, windows)
            trials.append((chain[0] if chain else 0.0, direction, b, chain))
            if trials[-1][0] > _CERTAIN:
                break
        trials.sort(key=lambda t: -t[0])
        weight, direction, b, chain = trials[0]
        if weight > _CERTAIN:
            break
    if chain is None:
        return None
    _, i, j, local = chain
    scale = float(np.median(local))
    if x.size > 4 * _SPACING:
        i, j = _middle_chain(x, b, i, j, scale)
    i, j = _gap_chain(x, b, i, j, scale)
    i, j, local, noise = _near_chain(x, b, i, j, scale)
    return Seeds(direction, scale, i, j, local, noise, (weight, trials[1][0] if len(trials) > 1 else 0.0))


def band(n: int, m: int, i: np.ndarray, j: np.ndarray, half_width: int | np.ndarray) -> Band:
    """Return the band of the alignment.

    Parameters
    ----------
    n, m : welds of A and of B.
    i, j : anchors, rising.
    half_width : columns on each side of an anchor's diagonal, of all rows or of each (n).

    Notes
    -----
    Between two anchors a row holds the diagonals of both, and all columns between them; it is wider where anchors are far apart.
    Where the two diagonals lie more than `_APART` columns from each other, each row holds the nearer one alone, so that the band
    stays linear in length whatever was laid anew.
    """
    if not i.size:
        low, high = np.zeros(n, np.int64), np.full(n, m - 1, np.int64)
    else:
        rows = np.arange(n)
        after = np.searchsorted(i, rows, side="right")
        left, right = np.clip(after - 1, 0, i.size - 1), np.clip(after, 0, i.size - 1)
        shift = j - i
        before, behind = np.abs(rows - i[left]), np.abs(i[right] - rows)
        half = half_width + (0.7 * np.sqrt(np.minimum(before, behind))).astype(np.int64)
        least, most = np.minimum(shift[left], shift[right]), np.maximum(shift[left], shift[right])
        own = np.where(before <= behind, shift[left], shift[right])
        apart = most - least > _APART
        low = rows + np.where(apart, own, least) - half
        high = rows + np.where(apart, own, most) + half
        low = np.where(apart, np.minimum(low, j[right] - half), low)
        high = np.where(apart, np.maximum(high, j[left] + half), high)
        low, high = np.maximum.accumulate(np.clip(low, 0, m - 1)), np.clip(high, 0, m - 1)
        high = np.maximum.accumulate(np.maximum(high, low))
    offset = np.concatenate([[0], np.cumsum(high - low + 1)])
    return Band(low.astype(np.int64), high.astype(np.int64), offset.astype(np.int64))


def _information(x: np.ndarray) -> np.ndarray:
    """Nats that each joint of A tells when its length is met again within the tolerance; a missed weld in it tells nothing."""
    density = length_density(np.diff(x), narrow=0.05, copies=1.0)
    k = np.minimum((np.diff(x) / BIN).astype(int), density.size - 1)
    again = (without_merged(density) / density)[k]
    return np.maximum(np.log(again) - np.log(np.minimum(density[k] * _TOLERANCE, 1.0)), 0.0)


def _window_starts(information: np.ndarray, k: int, blocks: int, needed: float) -> np.ndarray:
    """First weld of one window in each of so many blocks of the run.

    It is the one that tells least among those that tell enough: what tells most holds the run's own false and missed welds.
    """
    total = np.concatenate([[0.0], np.cumsum(information)])
    told = total[k:] - total[:-k]
    edges = np.unique(np.linspace(0, told.size, blocks + 1).astype(int))
    rank = np.where(told >= needed, told, 1e6 - told)
    return np.asarray([a + int(np.argmin(rank[a:b])) for a, b in itertools.pairwise(edges) if b > a], np.int64)


def _long_chain(x, y, least, most, windows):
    """Chain of windows found anywhere: weight, welds of A, welds of B, local scale."""
    k = min(_LONG, x.size - 1, y.size - 1)
    if k < 3:
        return None
    information = _information(x)
    starts = _window_starts(information, k, windows, np.log(y.size) + 10.0)
    all_b = np.full(starts.size, y.size)
    window, j, scale, misfit = search(
        x,
        y,
        starts,
        np.zeros(starts.size, np.int64),
        all_b,
        k,
        np.full(starts.size, least),
        np.full(starts.size, most),
        _TOLERANCE,
        12,
    )
    if not window.size:
        return None
    told = np.concatenate([[0.0], np.cumsum(information)])
    i = starts[window]
    often = np.bincount(window, minlength=starts.size)[window]
    weight = (told[i + k] - told[i] - _misfit_nats(misfit, k) - np.log(often) - np.log(max(y.size, 2))).clip(0.05)
    best = _scaled_chain(x, y, i, j, scale, weight)
    return None if best is None else (float(weight[best].sum()), i[best], j[best], scale[best])


def _scaled_chain(x, y, i, j, scale, weight):
    """Heaviest chain rising in both runs whose windows have one scale within 2 %: the scale is voted for first."""
    order = np.argsort(scale)
    s, w = scale[order], np.concatenate([[0.0], np.cumsum(weight[order])])
    end = np.searchsorted(s, s * 1.03, side="right")
    vote = w[end] - w[np.arange(s.size)]
    at = int(np.argmax(vote))
    kept = np.flatnonzero((scale >= s[at]) & (scale <= s[at] * 1.03))
    kept = kept[np.lexsort((-j[kept], i[kept]))]
    return kept[heaviest_chain(i[kept], j[kept], weight[kept], y.size)]


def _expected(x, y, starts, i0, j0, scale):
    """First and last weld of B where windows of A may begin, as the anchors predict it."""
    at = np.interp(x[starts], x[i0], y[j0])
    at = np.where(x[starts] < x[i0[0]], y[j0[0]] + scale * (x[starts] - x[i0[0]]), at)
    at = np.where(x[starts] > x[i0[-1]], y[j0[-1]] + scale * (x[starts] - x[i0[-1]]), at)
    right = np.clip(np.searchsorted(i0, starts), 0, i0.size - 1)
    left = np.clip(right - 1, 0, i0.size - 1)
    bridged = np.abs((y[j0[right]] - y[j0[left]]) - scale * (x[i0[right]] - x[i0[left]]))
    away = np.minimum(np.abs(x[starts] - x[i0[left]]), np.abs(x[starts] - x[i0[right]]))
    reach = (30.0 + 0.02 * away + 1.2 * np.minimum(bridged, 3000.0)) * max(scale, 0.1)
    return np.searchsorted(y, at - reach), np.searchsorted(y, at + reach)


def _middle_chain(x, y, i0, j0, scale):
    """Further long windows, one in some hundred joints, looked for near the place that the first ones predict."""
    k = _LONG
    information = _information(x)
    starts = _window_starts(information, k, x.size // _SPACING, 0.5 * np.log(y.size) + 8.0)
    first, last = _expected(x, y, starts, i0, j0, scale)
    return _with_windows(x, y, i0, j0, scale, starts, first, last, information)


def _gap_chain(x, y, i0, j0, scale):
    """Further long windows, looked for in all of B that lies between two anchors: where these do not agree, and at both ends."""
    i, j = np.concatenate([[0], i0, [x.size - 1]]), np.concatenate([[0], j0, [y.size - 1]])
    dx, dy = np.diff(x[i]), np.diff(y[j])
    apart = np.abs(dy - scale * dx) > 30.0 + 0.02 * dx
    apart[[0, -1]] = True
    information = _information(x)
    parts = []
    for g in np.flatnonzero(apart & (np.diff(i) > 3 * _LONG) & (np.diff(j) > 3 * _LONG)):
        p, q = int(i[g]), int(i[g + 1])
        blocks = min(_WINDOWS[1], (q - p) // (2 * _LONG))
        found = p + _window_starts(information[p:q], _LONG, blocks, np.log(j[g + 1] - j[g]) + 8.0)
        parts.append(np.stack([found, np.full(found.size, j[g]), np.full(found.size, j[g + 1])]))
    if not parts:
        return i0, j0
    starts, first, last = np.concatenate(parts, axis=1)
    return _with_windows(x, y, i0, j0, scale, starts, first, last, information)


def _with_windows(x, y, i0, j0, scale, starts, first, last, information):
    """Anchors, and with them the long windows that are found between first and last weld of B."""
    k = _LONG
    least = np.full(starts.size, scale * 0.975)
    window, j, _, misfit = search(x, y, starts, first, last, k, least, least * 1.05 / 0.975, _TOLERANCE, 6)
    if not window.size:
        return i0, j0
    told = np.concatenate([[0.0], np.cumsum(information), np.full(k, information.sum())])
    i, j = np.concatenate([starts[window], i0]), np.concatenate([j, j0])
    often = np.concatenate([np.bincount(window, minlength=starts.size)[window], np.ones(i0.size)])
    misfit = np.concatenate([misfit, np.full(i0.size, 0.05)])
    weight = ((told[i + k] - told[i] - _misfit_nats(misfit, k)) / often**2).clip(0.05)
    order = np.lexsort((-j, i))
    chain = order[heaviest_chain(i[order], j[order], weight[order], y.size)]
    chain = chain[_without_strays(i[chain], j[chain], weight[chain], x, y, scale)]
    return i[chain], j[chain]


def _misfit_nats(misfit: np.ndarray, k: int) -> np.ndarray:
    """What the misfit of a window of k joints (root mean square, metre) speaks against it; 0.3 since the noise is not known."""
    return 0.15 * k * (misfit / 0.05) ** 2


def _without_strays(i, j, weight, x, y, scale):
    """Places (in the chain) of the anchors that stay: pieces which lie off the others must weigh what two re-routes cost."""
    dx = np.diff(x[i])
    jump = np.abs(np.diff(y[j]) - scale * dx) > 30.0 + 0.02 * dx
    piece = np.concatenate([[0], np.cumsum(jump)])
    total = np.bincount(piece, weight)
    return np.flatnonzero(total[piece] >= min(_DETOUR, total.max()))


def _near_chain(x, y, i0, j0, scale):
    """Dense anchors: short windows looked for near the place that the long ones predict."""
    k = _SHORT
    if x.size <= k or y.size <= k:
        return i0, j0, np.full(i0.size, scale), _NOISE
    starts = np.arange(0, x.size - k, max(k, 1), dtype=np.int64)
    first, last = _expected(x, y, starts, i0, j0, scale)
    least = np.full(starts.size, scale * 0.975)
    window, j, local, misfit = search(x, y, starts, first, last, k, least, least * 1.05 / 0.975, _TOLERANCE, 6)
    if not window.size:
        return i0, j0, np.full(i0.size, scale), _NOISE
    information = _information(x)
    told = np.concatenate([[0.0], np.cumsum(information)])
    i = starts[window]
    often = np.bincount(window, minlength=starts.size)[window]
    weight = (told[i + k] - told[i]) / often**2
    kept = np.flatnonzero(weight > 1.5)
    kept = kept[np.lexsort((-j[kept], i[kept]))]
    if not kept.size:
        return i0, j0, np.full(i0.size, scale), _NOISE
    chain = kept[heaviest_chain(i[kept], j[kept], weight[kept], y.size)]
    chain = chain[_without_strays(i[chain], j[chain], weight[chain], x, y, scale)]
    # a window of k joints with one scale taken out; 0.78 from a standard deviation to the scale of t with 3 degrees of freedom
    noise = 0.78 * float(np.median(misfit[chain])) * np.sqrt(k / (k - 1))
    return i[chain], j[chain], local[chain], min(max(noise, 0.01), 0.1)
