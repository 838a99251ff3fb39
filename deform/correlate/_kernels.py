"""Arrays of two weld lists in, scores, paths and posteriors of their alignment out: the jitted pieces of the matching.

Everything is in linear weights (ratios of densities) with one normaliser per row, so that no logarithm stands in a loop.
A cell (i, j) means: weld i of run A and weld j of run B. Four states: M the two are one weld, D/A/B inside a replaced stretch
that has consumed a joint of both, of A alone, of B alone; the order D, then A or B, makes every stretch one path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_T3 = 2.0 / (np.pi * np.sqrt(3.0))  # peak of Student's t with three degrees of freedom
_HUGE = 1e18
_STRAY = 50.0  # metre; a shift of a weld beyond this cannot be


class Rates(NamedTuple):
    """Weights of the moves: noise (metre) and probabilities."""

    sigma: float
    same: float
    missed_a: float
    missed_b: float
    false_a: float
    false_b: float
    shifted: float
    shift_m: float
    middle: float
    open_both: float
    open_one: float
    extend: float
    switch: float
    close: float


class Evidence(NamedTuple):
    """What speaks for or against a weld of A being a weld of B beside the lengths; empty arrays where there is nothing."""

    used: bool
    class_a: np.ndarray
    class_b: np.ndarray
    ratio: np.ndarray  # (class of A, class of B) likelihood ratio
    label_a: np.ndarray
    label_b: np.ndarray
    label_same: float
    label_other: float
    seam_a: np.ndarray  # degree, NaN unknown
    seam_b: np.ndarray
    seam_tolerance: float  # degree
    lock_a: np.ndarray  # weld of B locked to each weld of A, -1 free
    lock_b: np.ndarray
    forbid_start: np.ndarray  # (n + 1) where each weld's forbidden partners begin in `forbid`
    forbid: np.ndarray


@njit(cache=True, error_model="numpy")
def evidence(i, j, ev):
    """Likelihood ratio of the cell (i, j) from everything but the lengths."""
    if not ev.used:
        return 1.0
    w = ev.ratio[ev.class_a[i], ev.class_b[j]]
    if ev.label_a.size and ev.label_a[i] >= 0 and ev.label_b[j] >= 0:
        w *= ev.label_same if ev.label_a[i] == ev.label_b[j] else ev.label_other
    if ev.seam_a.size:
        d = abs(ev.seam_a[i] - ev.seam_b[j])
        if d == d:
            d = min(d, 360.0 - d) / ev.seam_tolerance
            w *= 0.1 + 0.9 * (180.0 / ev.seam_tolerance) * _T3 * 2.0 / (1.0 + d * d / 3.0) ** 2
    if ev.lock_a.size:
        if ev.lock_a[i] == j:
            w *= _HUGE
        elif ev.lock_a[i] >= 0 or ev.lock_b[j] >= 0:
            return 0.0
        for k in range(ev.forbid_start[i], ev.forbid_start[i + 1]):
            if ev.forbid[k] == j:
                return 0.0
    return w


@njit(cache=True, error_model="numpy", inline="always")
def _density(r, sigma):
    z2 = (r / sigma) ** 2 / 3.0
    return _T3 / (sigma * (1.0 + z2) * (1.0 + z2))


@njit(cache=True, error_model="numpy", inline="always")
def _one_two(whole, r, inv_whole, inv_1, inv_2, p_missed, p_false, sigma):
    """One joint against two: a weld missed on the one side, or a false one on the other."""
    return _density(r, sigma) * (p_missed * inv_whole + p_false / whole * inv_1 * inv_2)


@njit(cache=True, error_model="numpy", inline="always")
def _one_three(whole, r, inv_whole, inv_1, inv_2, inv_3, p_missed, p_false, sigma):
    """One joint against three."""
    return _density(r, sigma) * (p_missed**2 * inv_whole + 2.0 * (p_false / whole) ** 2 * inv_1 * inv_2 * inv_3)


@njit(cache=True, error_model="numpy", inline="always")
def _shift(shift, r, product, rates):
    """Two joints against two with the weld between them displaced: the share in which it is the same weld."""
    z = shift / rates.shift_m
    return _density(r, rates.sigma) * rates.shifted * product / (np.pi * rates.shift_m * (1.0 + z * z))


@njit(cache=True, error_model="numpy", inline="always")
def _strangers(r, product, rates):
    """Two joints against two whose middle welds have nothing to do with each other."""
    return _density(r, rates.sigma) * (rates.missed_a + rates.false_b) * (rates.missed_b + rates.false_a) * rates.middle * product


@njit(cache=True, error_model="numpy")
def fill(x, y, inv_a, inv_b, low, high, offset, rates, ev):
    """Best path to every cell of the band.

    Parameters
    ----------
    x, y : weld places (n), (m) on one scale, metre, rising.
    inv_a, inv_b : one over the line's density of joint lengths at the joint that ends at each weld, metre.
    low, high : first and last column of each row of the band (n).
    offset : place of each row in the flat arrays (n + 1).

    Returns
    -------
    best : (4, cells) weights in units of their row.
    back : (4, cells) uint8 moves taken.
    log_scale : (n) logarithm of the unit of each row.
    """
    n, m = x.size, y.size
    best = np.zeros((4, offset[n]))
    back = np.zeros((4, offset[n]), np.uint8)
    log_scale = np.zeros(n)
    ra, rb = np.sqrt(inv_a), np.sqrt(inv_b)
    c1 = c2 = 1.0
    for i in range(n):
        q2, q3 = 1.0 / c1, 1.0 / (c1 * c2)
        top = 0.0
        o0 = offset[i] - low[i]
        o1 = offset[i - 1] - low[i - 1] if i > 0 else 0
        o2 = offset[i - 2] - low[i - 2] if i > 1 else 0
        o3 = offset[i - 3] - low[i - 3] if i > 2 else 0
        l1, h1 = (low[i - 1], high[i - 1]) if i > 0 else (1, 0)
        l2, h2 = (low[i - 2], high[i - 2]) if i > 1 else (1, 0)
        l3, h3 = (low[i - 3], high[i - 3]) if i > 2 else (1, 0)
        for j in range(low[i], high[i] + 1):
            k = o0 + j
            edge = i == 0 or j == 0
            v_m, t_m = (1.0, 0) if edge else (0.0, 0)
            v_d, t_d = (rates.open_both, 0) if edge else (0.0, 0)
            v_a, t_a, v_b, t_b = 0.0, 0, 0.0, 0
            if i > 0 and j >= l1 and j <= h1:
                p = o1 + j
                v_a, t_a = best[0, p] * rates.open_one, 1
                if best[1, p] * rates.switch > v_a:
                    v_a, t_a = best[1, p] * rates.switch, 2
                if best[2, p] * rates.extend > v_a:
                    v_a, t_a = best[2, p] * rates.extend, 3
            if j > low[i]:
                p = k - 1
                v_b, t_b = best[0, p] * rates.open_one, 1
                if best[1, p] * rates.switch > v_b:
                    v_b, t_b = best[1, p] * rates.switch, 2
                if best[3, p] * rates.extend > v_b:
                    v_b, t_b = best[3, p] * rates.extend, 4
            if i > 0 and j > 0 and j - 1 >= l1 and j - 1 <= h1:
                p = o1 + j - 1
                w = best[0, p] * rates.open_both
                if w > v_d:
                    v_d, t_d = w, 1
                w = best[1, p] * rates.extend
                if w > v_d:
                    v_d, t_d = w, 2
                w = best[0, p] * rates.same * _density(y[j] - y[j - 1] - x[i] + x[i - 1], rates.sigma) * ra[i] * rb[j]
                if w > v_m:
                    v_m, t_m = w, 11
            if i > 0 and j > 1 and j - 2 >= l1 and j - 2 <= h1:
                r = y[j] - y[j - 2] - x[i] + x[i - 1]
                w = best[0, o1 + j - 2] * _one_two(
                    x[i] - x[i - 1], r, inv_a[i], inv_b[j], inv_b[j - 1], rates.missed_a, rates.false_b, rates.sigma
                )
                if w > v_m:
                    v_m, t_m = w, 12
            if i > 0 and j > 2 and j - 3 >= l1 and j - 3 <= h1:
                r = y[j] - y[j - 3] - x[i] + x[i - 1]
                w = best[0, o1 + j - 3] * _one_three(
                    x[i] - x[i - 1], r, inv_a[i], inv_b[j], inv_b[j - 1], inv_b[j - 2], rates.missed_a, rates.false_b, rates.sigma
                )
                if w > v_m:
                    v_m, t_m = w, 13
            if i > 1 and j > 0 and j - 1 >= l2 and j - 1 <= h2:
                r = y[j] - y[j - 1] - x[i] + x[i - 2]
                w = best[0, o2 + j - 1] * q2 * _one_two(
                    y[j] - y[j - 1], r, inv_b[j], inv_a[i], inv_a[i - 1], rates.missed_b, rates.false_a, rates.sigma
                )
                if w > v_m:
                    v_m, t_m = w, 21
            if i > 1 and j > 1 and j - 2 >= l2 and j - 2 <= h2:
                r = y[j] - y[j - 2] - x[i] + x[i - 2]
                shift = y[j - 1] - y[j - 2] - x[i - 1] + x[i - 2]
                product = ra[i] * ra[i - 1] * rb[j] * rb[j - 1]
                w = best[0, o2 + j - 2] * q2 * (_shift(shift, r, product, rates) * evidence(i - 1, j - 1, ev) + _strangers(r, product, rates))
                if w > v_m:
                    v_m, t_m = w, 22
            if i > 2 and j > 0 and j - 1 >= l3 and j - 1 <= h3:
                r = y[j] - y[j - 1] - x[i] + x[i - 3]
                w = best[0, o3 + j - 1] * q3 * _one_three(
                    y[j] - y[j - 1], r, inv_b[j], inv_a[i], inv_a[i - 1], inv_a[i - 2], rates.missed_b, rates.false_a, rates.sigma
                )
                if w > v_m:
                    v_m, t_m = w, 31
            if v_d * rates.close > v_m:
                v_m, t_m = v_d * rates.close, 2
            if v_a * rates.close > v_m:
                v_m, t_m = v_a * rates.close, 3
            if v_b * rates.close > v_m:
                v_m, t_m = v_b * rates.close, 4
            v_m *= evidence(i, j, ev)
            best[0, k], best[1, k], best[2, k], best[3, k] = v_m, v_d, v_a, v_b
            back[0, k], back[1, k], back[2, k], back[3, k] = t_m, t_d, t_a, t_b
            top = max(top, v_m, v_d, v_a, v_b)
        if top <= 0.0:
            top = 1.0
        for k in range(offset[i], offset[i + 1]):
            for s in range(4):
                best[s, k] /= top
        log_scale[i] = np.log(top) + (log_scale[i - 1] if i > 0 else 0.0)
        c2, c1 = c1, top
    return best, back, log_scale


@njit(cache=True, error_model="numpy")
def trace_back(best, back, log_scale, low, high, offset, m):
    """Best path: partner of each weld of A (-1 none), the move that led to it, its log weight, and the least way to the band's edge."""
    n = low.size
    partner = np.full(n, -1, np.int64)
    move = np.zeros(n, np.int64)
    top, i, j, state = -np.inf, n - 1, m - 1, 0
    for r in range(n):
        for c in range(low[r], high[r] + 1):
            if r == n - 1 or c == m - 1:
                for s in range(4):
                    v = best[s, offset[r] + c - low[r]]
                    if v > 0.0 and np.log(v) + log_scale[r] > top:
                        top, i, j, state = np.log(v) + log_scale[r], r, c, s
    slack = m
    while i >= 0 and j >= 0 and top > -np.inf:
        t = back[state, offset[i] + j - low[i]]
        if low[i] > 0:
            slack = min(slack, j - low[i])
        if high[i] < m - 1:
            slack = min(slack, high[i] - j)
        if state == 0:
            partner[i], move[i] = j, t
            if t >= 11:
                i, j = i - t // 10, j - t % 10
            elif t == 0:
                break
            else:
                state = t - 1
                partner[i], move[i] = j, t
        elif t == 0:
            break
        else:
            if state == 1:
                i, j = i - 1, j - 1
            elif state == 2:
                i -= 1
            else:
                j -= 1
            state = t - 1
    return partner, move, top, slack


@njit(cache=True, error_model="numpy")
def forward(x, y, inv_a, inv_b, low, high, offset, rates, ev):
    """Sum over all paths to every cell of the band, in units of the row: (4, cells), row normalisers (n), log of the total."""
    n, m = x.size, y.size
    total = np.zeros((4, offset[n]), np.float64)
    norm = np.ones(n)
    log_scale = np.zeros(n)
    ra, rb = np.sqrt(inv_a), np.sqrt(inv_b)
    c1 = c2 = 1.0
    for i in range(n):
        q2, q3 = 1.0 / c1, 1.0 / (c1 * c2)
        top = 0.0
        o0 = offset[i] - low[i]
        o1 = offset[i - 1] - low[i - 1] if i > 0 else 0
        o2 = offset[i - 2] - low[i - 2] if i > 1 else 0
        o3 = offset[i - 3] - low[i - 3] if i > 2 else 0
        l1, h1 = (low[i - 1], high[i - 1]) if i > 0 else (1, 0)
        l2, h2 = (low[i - 2], high[i - 2]) if i > 1 else (1, 0)
        l3, h3 = (low[i - 3], high[i - 3]) if i > 2 else (1, 0)
        for j in range(low[i], high[i] + 1):
            k = o0 + j
            edge = i == 0 or j == 0
            v_m = 1.0 if edge else 0.0
            v_d = rates.open_both if edge else 0.0
            v_a = v_b = 0.0
            if i > 0 and j >= l1 and j <= h1:
                p = o1 + j
                v_a = total[0, p] * rates.open_one + total[1, p] * rates.switch + total[2, p] * rates.extend
            if j > low[i]:
                p = k - 1
                v_b = total[0, p] * rates.open_one + total[1, p] * rates.switch + total[3, p] * rates.extend
            if i > 0 and j > 0 and j - 1 >= l1 and j - 1 <= h1:
                p = o1 + j - 1
                v_d += total[0, p] * rates.open_both + total[1, p] * rates.extend
                v_m += total[0, p] * rates.same * _density(y[j] - y[j - 1] - x[i] + x[i - 1], rates.sigma) * ra[i] * rb[j]
            if i > 0 and j > 1 and j - 2 >= l1 and j - 2 <= h1:
                r = y[j] - y[j - 2] - x[i] + x[i - 1]
                v_m += total[0, o1 + j - 2] * _one_two(
                    x[i] - x[i - 1], r, inv_a[i], inv_b[j], inv_b[j - 1], rates.missed_a, rates.false_b, rates.sigma
                )
            if i > 0 and j > 2 and j - 3 >= l1 and j - 3 <= h1:
                r = y[j] - y[j - 3] - x[i] + x[i - 1]
                v_m += total[0, o1 + j - 3] * _one_three(
                    x[i] - x[i - 1], r, inv_a[i], inv_b[j], inv_b[j - 1], inv_b[j - 2], rates.missed_a, rates.false_b, rates.sigma
                )
            if i > 1 and j > 0 and j - 1 >= l2 and j - 1 <= h2:
                r = y[j] - y[j - 1] - x[i] + x[i - 2]
                v_m += total[0, o2 + j - 1] * q2 * _one_two(
                    y[j] - y[j - 1], r, inv_b[j], inv_a[i], inv_a[i - 1], rates.missed_b, rates.false_a, rates.sigma
                )
            if i > 1 and j > 1 and j - 2 >= l2 and j - 2 <= h2:
                r = y[j] - y[j - 2] - x[i] + x[i - 2]
                shift = y[j - 1] - y[j - 2] - x[i - 1] + x[i - 2]
                product = ra[i] * ra[i - 1] * rb[j] * rb[j - 1]
                v_m += total[0, o2 + j - 2] * q2 * (_shift(shift, r, product, rates) * evidence(i - 1, j - 1, ev) + _strangers(r, product, rates))
            if i > 2 and j > 0 and j - 1 >= l3 and j - 1 <= h3:
                r = y[j] - y[j - 1] - x[i] + x[i - 3]
                v_m += total[0, o3 + j - 1] * q3 * _one_three(
                    y[j] - y[j - 1], r, inv_b[j], inv_a[i], inv_a[i - 1], inv_a[i - 2], rates.missed_b, rates.false_a, rates.sigma
                )
            v_m = (v_m + rates.close * (v_d + v_a + v_b)) * evidence(i, j, ev)
            total[0, k], total[1, k], total[2, k], total[3, k] = v_m, v_d, v_a, v_b
            top = max(top, v_m, v_d, v_a, v_b)
        if top <= 0.0:
            top = 1.0
        for s in range(4):
            for k in range(offset[i], offset[i + 1]):
                total[s, k] /= top
        norm[i] = top
        log_scale[i] = np.log(top) + (log_scale[i - 1] if i > 0 else 0.0)
        c2, c1 = c1, top
    return total, norm, log_scale, _log_total(total, log_scale, low, high, offset, m)


@njit(cache=True, error_model="numpy")
def _log_total(total, log_scale, low, high, offset, m):
    """Logarithm of the sum over all cells and states in which an alignment may end."""
    n = low.size
    top, rest = -np.inf, 0.0
    for i in range(n):
        first = low[i] if i == n - 1 else m - 1
        if first > high[i]:
            continue
        v = 0.0
        for j in range(first, high[i] + 1):
            for s in range(4):
                v += total[s, offset[i] + j - low[i]]
        if v <= 0.0:
            continue
        v = np.log(v) + log_scale[i]
        if v > top:
            rest, top = rest * np.exp(top - v) + 1.0, v
        else:
            rest += np.exp(v - top)
    return top + np.log(rest)


@njit(cache=True, error_model="numpy")
def backward(x, y, inv_a, inv_b, low, high, offset, rates, ev, total, norm, log_scale, log_total):
    """Posterior of every cell of the band.

    Returns
    -------
    match : (cells) probability that weld i of A and weld j of B are one, a displaced weld included.
    shifted : (cells) the part of it in which the weld is displaced.
    """
    n, m = x.size, y.size
    match = np.zeros(offset[n], np.float32)
    shifted = np.zeros(offset[n], np.float32)
    width = 0
    for i in range(n):
        width = max(width, high[i] - low[i] + 1)
    rest = np.zeros((4, 4, width))  # state, row modulo 4
    ra, rb = np.sqrt(inv_a), np.sqrt(inv_b)
    for i in range(n - 1, -1, -1):
        row = i % 4
        r1, r2, r3 = (i + 1) % 4, (i + 2) % 4, (i + 3) % 4
        q1 = 1.0 / norm[i + 1] if i + 1 < n else 0.0
        q2 = q1 / norm[i + 2] if i + 2 < n else 0.0
        q3 = q2 / norm[i + 3] if i + 3 < n else 0.0
        l1, h1 = (low[i + 1], high[i + 1]) if i + 1 < n else (1, 0)
        l2, h2 = (low[i + 2], high[i + 2]) if i + 2 < n else (1, 0)
        l3, h3 = (low[i + 3], high[i + 3]) if i + 3 < n else (1, 0)
        last = np.exp(min(log_scale[i] - log_total, 600.0))
        for j in range(high[i], low[i] - 1, -1):
            c = j - low[i]
            k = offset[i] + c
            end = last if i == n - 1 or j == m - 1 else 0.0
            v_m, v_d, v_a, v_b = end, end, end, end
            if j >= l1 and j <= h1:
                w = rest[2, r1, j - l1] * q1
                v_m += w * rates.open_one
                v_d += w * rates.switch
                v_a += w * rates.extend
            if j < high[i]:
                w = rest[3, row, c + 1]
                v_m += w * rates.open_one
                v_d += w * rates.switch
                v_b += w * rates.extend
            if j + 1 >= l1 and j + 1 <= h1:
                w = rest[1, r1, j + 1 - l1] * q1
                v_m += w * rates.open_both
                v_d += w * rates.extend
                f = rates.same * _density(y[j + 1] - y[j] - x[i + 1] + x[i], rates.sigma) * ra[i + 1] * rb[j + 1]
                v_m += rest[0, r1, j + 1 - l1] * q1 * f
            if j + 2 >= l1 and j + 2 <= h1:
                r = y[j + 2] - y[j] - x[i + 1] + x[i]
                v_m += rest[0, r1, j + 2 - l1] * q1 * _one_two(
                    x[i + 1] - x[i], r, inv_a[i + 1], inv_b[j + 2], inv_b[j + 1], rates.missed_a, rates.false_b, rates.sigma
                )
            if j + 3 >= l1 and j + 3 <= h1:
                r = y[j + 3] - y[j] - x[i + 1] + x[i]
                v_m += rest[0, r1, j + 3 - l1] * q1 * _one_three(
                    x[i + 1] - x[i], r, inv_a[i + 1], inv_b[j + 3], inv_b[j + 2], inv_b[j + 1], rates.missed_a, rates.false_b, rates.sigma
                )
            if j + 1 >= l2 and j + 1 <= h2:
                r = y[j + 1] - y[j] - x[i + 2] + x[i]
                v_m += rest[0, r2, j + 1 - l2] * q2 * _one_two(
                    y[j + 1] - y[j], r, inv_b[j + 1], inv_a[i + 2], inv_a[i + 1], rates.missed_b, rates.false_a, rates.sigma
                )
            if j + 2 >= l2 and j + 2 <= h2:
                r = y[j + 2] - y[j] - x[i + 2] + x[i]
                shift = y[j + 1] - y[j] - x[i + 1] + x[i]
                product = ra[i + 2] * ra[i + 1] * rb[j + 2] * rb[j + 1]
                same = _shift(shift, r, product, rates) * evidence(i + 1, j + 1, ev)
                w = rest[0, r2, j + 2 - l2] * q2
                v_m += w * (same + _strangers(r, product, rates))
                if j + 1 >= l1 and j + 1 <= h1:
                    p = offset[i + 1] + j + 1 - l1
                    shifted[p] += np.float32(total[0, k] * w * same)
            if j + 1 >= l3 and j + 1 <= h3:
                r = y[j + 1] - y[j] - x[i + 3] + x[i]
                v_m += rest[0, r3, j + 1 - l3] * q3 * _one_three(
                    y[j + 1] - y[j], r, inv_b[j + 1], inv_a[i + 3], inv_a[i + 2], inv_a[i + 1], rates.missed_b, rates.false_a, rates.sigma
                )
            match[k] = total[0, k] * v_m
            e = evidence(i, j, ev)
            # what is kept: weight of everything after the cell, once the cell's own evidence and the closing of a gap are counted
            rest[0, row, c] = v_m * e
            rest[1, row, c] = v_d + rates.close * v_m * e
            rest[2, row, c] = v_a + rates.close * v_m * e
            rest[3, row, c] = v_b + rates.close * v_m * e
    for k in range(offset[n]):
        match[k] = min(match[k] + shifted[k], 1.0)
    return match, shifted
