"""How well two lists of joint lengths can be matched at all: the posterior of one who knows how the lists were made.

The oracle knows the law of the joint lengths, the noise and its law, both scales, the rates of missed and false welds, and how
cut-outs are made (2 to 12 joints replaced in place, joints laid until one piece cut to fit closes the gap). It sums over all
alignments within 20 welds of the truth. No method that reads lengths alone can have a better precision at a given recall.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.synthetic.lists import LONGEST_M, JointList, build_line, observe

_BIN = 0.01
_HALF = 20  # welds on each side of the truth
_MOST_OLD, _MOST_NEW = 15, 18  # welds of a replaced stretch as listed


def observed_density(noise: float, missed: float, false: float, equal: float, pups: float) -> np.ndarray:
    """Density (1/m) of listed joint lengths in bins of 1 cm, from a long list."""
    rng = np.random.default_rng(0)
    lengths = np.diff(observe(rng, build_line(rng, 2_000_000, equal, pups), missed, false, noise).place)
    counts = np.bincount(np.minimum((lengths / _BIN).astype(int), 5999), minlength=6000)
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)  # 2 cm
    return np.maximum(np.convolve(counts / lengths.size / _BIN, kernel / kernel.sum(), "same"), 1e-5)


@njit(cache=True)
def _gauss(r, variance):
    return np.exp(-0.5 * r * r / variance) / np.sqrt(2.0 * np.pi * variance)


@njit(cache=True)
def _both(u, v, noise, equal, pups):
    """Density of the lengths u and v of one joint in two lists."""
    var = noise * noise
    ordinary = 1.0 - equal - pups
    middle, apart = 0.5 * (u + v), _gauss(u - v, 2.0 * var)
    total = equal * _gauss(u - 12.2, var) * _gauss(v - 12.2, var)
    total += ordinary * 0.0295 * _gauss(u - LONGEST_M, var) * _gauss(v - LONGEST_M, var)
    if middle < LONGEST_M:
        total += ordinary * _gauss(middle - 11.8, 0.81 + 0.5 * var) * apart
    if 1.0 < middle < 8.0:
        total += pups / 7.0 * apart
    return total


@njit(cache=True)
def _same_pipe(i, j, a, b, x, y, g, noise, missed, false_m, equal, pups):
    """Weight of a listed joints against b of the same pipe that end at (i, j), against strangers."""
    var = noise * noise
    u, v = x[i] - x[i - a], y[j] - y[j - b]
    if abs(u - v) > 8.0 * noise * np.sqrt(2.0 + a + b):
        return 0.0
    seen = (1.0 - missed) ** 2 * np.exp(-false_m * (u + v))
    lone = missed * (1.0 - missed)
    null = 1.0
    for k in range(a):
        null *= _at(g, x[i - k] - x[i - k - 1])
    for k in range(b):
        null *= _at(g, y[j - k] - y[j - k - 1])
    total = false_m ** (a + b - 2) * _both(u, v, noise, equal, pups)
    total *= 1.0 if a < 3 else 2.0
    total *= 1.0 if b < 3 else 2.0
    if (a == 1) != (b == 1):
        pieces = 1.0
        n = max(a, b)
        for k in range(n):
            pieces *= _at(g, x[i - k] - x[i - k - 1]) if a > 1 else _at(g, y[j - k] - y[j - k - 1])
        total += lone ** (n - 1) * pieces * _gauss(u - v, (2.0 * n) * var)
        if n == 3:
            first = x[i - 2] - x[i - 3] if a > 1 else y[j - 2] - y[j - 3]
            third = x[i] - x[i - 1] if a > 1 else y[j] - y[j - 1]
            mixed = _at(g, first) * _at(g, u - first) + _at(g, third) * _at(g, u - third)
            total += lone * false_m * mixed * _gauss(u - v, 4.0 * var)
    if a == 2 and b == 2:
        first_a, first_b = x[i - 1] - x[i - 2], y[j - 1] - y[j - 2]
        between = abs(first_a - first_b)
        ends = _at(g, min(first_a, first_b)) * _at(g, u - max(first_a, first_b))
        total += lone * lone * _at(g, between) * ends * _gauss(u - v, 6.0 * var)
        total += lone * false_m * _at(g, first_a) * _at(g, u - first_a) * _gauss(u - v, 4.0 * var)
        total += lone * false_m * _at(g, first_b) * _at(g, u - first_b) * _gauss(u - v, 4.0 * var)
    return seen * total / null


@njit(cache=True)
def _at(g, length):
    return g[min(int(length / _BIN), g.size - 1)]


@njit(cache=True)
def _cut(i, j, a, b, x, y, g, noise, rate):
    """Weight of a stretch replaced in place, a listed joints by b, that ends at (i, j), against strangers."""
    r = (y[j] - y[j - b]) - (x[i] - x[i - a])
    var = (a + b) * noise * noise
    if r * r > 49.0 * var:
        return 0.0
    closing = 0.0  # any of the new joints is the piece that was cut to fit
    for c in range(b):
        k = j - c
        piece = y[k] - y[k - 1]
        before = y[k - 1] - y[k - 2] if c < b - 1 else y[j] - y[j - 1]
        last = piece < LONGEST_M + 4 * noise and (b == 1 or piece + before > LONGEST_M)
        closing += (1.0 if last else 0.05) / _at(g, piece)  # 0.05: a false weld split it, or the two before it
    return rate / 11.0 * (1.0 if 2 <= a <= 12 else 0.1) * closing / b * _gauss(r, var)


@njit(cache=True)
def _move(i, j, a, b, x, y, g, noise, missed, false_m, equal, pups, rate):
    w = 0.0
    if a <= 3 and b <= 3 and a + b <= 4:
        w = _same_pipe(i, j, a, b, x, y, g, noise, missed, false_m, equal, pups)
    if a > 1 or b > 1:
        w += _cut(i, j, a, b, x, y, g, noise, rate)
    return w


@njit(cache=True)
def _posterior(x, y, centre, g, noise, missed, false_m, equal, pups, rate):
    """Posterior (n, 2 half + 1) of every weld of B within the band about the centre."""
    n, m, width = x.size, y.size, 2 * _HALF + 1
    ahead, rest = np.zeros((n, width)), np.zeros((n, width))
    scale = np.zeros(n)
    for i in range(n):
        top = 0.0
        for q in range(width):
            j = centre[i] + q - _HALF
            if j < 0 or j >= m:
                continue
            v = np.exp(-scale[i - 1]) if i > 0 and j == 0 else (1.0 if j == 0 or i == 0 else 0.0)
            for a in range(1, min(_MOST_OLD, i) + 1):
                unit = np.exp(scale[i - a] - scale[i - 1])
                for b in range(1, min(_MOST_NEW, j) + 1):
                    p = j - b - centre[i - a] + _HALF
                    if 0 <= p < width and ahead[i - a, p] > 0.0:
                        v += ahead[i - a, p] * unit * _move(i, j, a, b, x, y, g, noise, missed, false_m, equal, pups, rate)
            ahead[i, q] = v
            top = max(top, v)
        top = top if top > 1e-60 else 1.0  # the row of a false weld may hold next to nothing
        ahead[i] /= top
        scale[i] = np.log(top) + (scale[i - 1] if i > 0 else 0.0)
    for i in range(n - 1, -1, -1):
        top = 0.0
        for q in range(width):
            j = centre[i] + q - _HALF
            if j < 0 or j >= m:
                continue
            v = np.exp(scale[i] - scale[n - 1]) if j == m - 1 or i == n - 1 else 0.0
            for a in range(1, min(_MOST_OLD, n - 1 - i) + 1):
                unit = np.exp(scale[i] - scale[i + a])
                for b in range(1, min(_MOST_NEW, m - 1 - j) + 1):
                    p = j + b - centre[i + a] + _HALF
                    if 0 <= p < width and rest[i + a, p] > 0.0:
                        w = _move(i + a, j + b, a, b, x, y, g, noise, missed, false_m, equal, pups, rate)
                        v += rest[i + a, p] * unit * w
            rest[i, q] = v
    post = ahead * rest
    total = 0.0
    for q in range(width):
        total += ahead[n - 1, q] * rest[n - 1, q]
    for i in range(n - 1):
        if centre[i] + _HALF >= m - 1:
            q = m - 1 - centre[i] + _HALF
            if 0 <= q < width:
                total += ahead[i, q] * np.exp(scale[i] - scale[n - 1])
    return post / total


def oracle(a: JointList, b: JointList, *, noise, missed, false, rate, density, equal=0.35, pups=0.05):
    """Pairs (i, j, posterior above 0.001) of two lists of scale one that run the same way."""
    known = np.flatnonzero((a.weld >= 0) & np.isin(a.weld, b.weld))
    where = {int(w): k for k, w in enumerate(b.weld)}
    partner = np.asarray([where[int(w)] for w in a.weld[known]])
    centre = np.round(np.interp(np.arange(a.n), known, partner)).astype(np.int64)
    false_m = false / float(np.mean(np.diff(a.place)))
    post = _posterior(a.place, b.place, centre, density, noise, missed, false_m, equal, pups, rate)
    i, q = np.nonzero(post > 1e-3)
    return i, centre[i] + q - _HALF, post[i, q]
