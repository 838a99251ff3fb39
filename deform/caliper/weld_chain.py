"""Candidates with odds in, posterior probabilities out: the joints between welds have the lengths of this line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import logsumexp

_CELL_M = 0.01
_BAND_M = 0.05  # width of the kernel of the length density
_ANY = 0.1  # share of joints of any length (pups, cut joints)
_SHORTEST_M = 0.6  # pups that are laid; a piece is rarely cut shorter than the pipe is wide
_STUB = 1e-3  # share of pieces shorter than that
_GAP = 1e-4  # share of stretches longer than any joint: welds that no channel saw
_LOOK_BACK = 12  # candidates
_SURE = 0.95
_FEWEST = 8  # lengths below which nothing is known about them


def with_joint_lengths(place: np.ndarray, probability: np.ndarray, nominal_joint: float) -> np.ndarray:
    """Return the probabilities after the lengths between the welds had their say.

    Parameters
    ----------
    place : (n,) m, rising.
    probability : (n,) from the channels alone, under welds that fall at random.
    nominal_joint : m.

    Notes
    -----
    Welds form a renewal chain: between neighbours stands p(L) / (rho exp(-rho L)), the density of joint lengths learned from
    the sure welds of this run over the one that random welds would have; pieces shorter than any pup are not learned, and
    are given a thousandth of all joints. Forward and backward sums over all subsets of the candidates give the posterior of
    each. A false event splits a joint into two unlikely ones; a doubtful weld that divides a stretch of twice the usual
    length is believed.
    """
    n = place.size
    sure = np.flatnonzero(probability > _SURE)
    lengths = np.diff(place[sure])
    lengths = lengths[(lengths > _SHORTEST_M) & (lengths < 1.6 * nominal_joint)]
    if n < 3 or lengths.size < _FEWEST:
        return probability
    odds = np.log(np.clip(probability, 1e-12, 1 - 1e-9)) - np.log1p(-np.clip(probability, 1e-12, 1 - 1e-9))
    score = _length_score(lengths, max(float(lengths.max()), nominal_joint))
    links = [score(place[j] - place[max(0, j - _LOOK_BACK) : j]) for j in range(n)]
    forward, backward = np.zeros(n), np.zeros(n)
    for j in range(n):
        first = max(0, j - _LOOK_BACK)
        begin = [0.0] if j < _LOOK_BACK else []
        forward[j] = odds[j] + logsumexp(np.concatenate([begin, forward[first:j] + links[j]]))
    for i in range(n - 1, -1, -1):
        later = [odds[j] + links[j][i - max(0, j - _LOOK_BACK)] + backward[j] for j in range(i + 1, min(n, i + _LOOK_BACK + 1))]
        end = [0.0] if i >= n - _LOOK_BACK else []
        backward[i] = logsumexp(np.array(end + later))
    total = logsumexp(forward[max(0, n - _LOOK_BACK) :])
    return np.clip(np.exp(forward + backward - total), 0.0, 1.0)


def _length_score(lengths: np.ndarray, longest: float) -> Callable[[np.ndarray], np.ndarray]:
    """Log of the density of joint lengths over that of random welds, as a function of length (m), tabled every centimetre."""
    rate = 1.0 / float(lengths.mean())
    cells = int(np.ceil(1.2 * longest / _CELL_M))
    count = np.bincount(np.minimum((lengths / _CELL_M).astype(int), cells - 1), minlength=cells).astype(float)
    near = gaussian_filter1d(count, _BAND_M / _CELL_M, mode="constant") / (count.sum() * _CELL_M)

    def score(length: np.ndarray) -> np.ndarray:
        cell = (length / _CELL_M).astype(int)
        known = np.where(cell < cells, near[np.minimum(cell, cells - 1)], 0.0)
        inside = (length > _SHORTEST_M) & (length <= 1.05 * longest)
        random = rate * np.exp(-rate * length)
        known = np.where(length > _SHORTEST_M, known, 0.0)
        stub = _STUB * (length <= _SHORTEST_M) / _SHORTEST_M
        density = (1.0 - _ANY - _STUB - _GAP) * known + _ANY * inside / longest + stub + _GAP * random
        return np.log(density) - np.log(random)

    return score
