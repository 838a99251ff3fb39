"""Arrays of two weld lists in, scores, paths and posteriors of their alignment out: the jitted pieces of the matching.

Everything is in linear weights (ratios of densities) with one normaliser per row, so that no logarithm stands in a loop.
A cell (i, j) means: weld i of run A and weld j of run B. Four states: M the two are one weld, D/A/B inside a replaced stretch
that has consumed a joint of both, of A alone, of B alone; the order D, then A or B, makes every stretch one path, of a joint at
least on either side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_T3 = 2.0 / (np.pi * np.sqrt(3.0))  # peak of Student's t with three degrees of freedom
_REACH = 15.0  # sigma; a sum of joints that differs more is not the same pipe with a weld missed
_STRAY = 0.02  # of the replaced stretches end where no anchor around has its offset
_HUGE = 1e18
BIN = 0.01  # metre, of the density of joint lengths


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
    open_both: float
    extend: float  # D goes on
    switch: float  # D to A, or to B
    close: float  # D to M
    extend_one: float  # A or B goes on
    close_one: float


class Lists(NamedTuple):
    """Two weld lists on one scale, with the density of the line's joint lengths.

    ``x`` (n) and ``y`` (m) are metre, rising; ``inv_a``, ``inv_b`` one over the density at the joint that ends at each weld
    (metre), ``root_a``, ``root_b`` their square roots; ``density`` (1/m) in bins of 1 cm; ``offset`` (n, 4) is what the
    anchors around show as offset of B against A, and ``margin`` (n) how far it holds, metre.
    """

    x: np.ndarray
    y: np.ndarray
    inv_a: np.ndarray
    inv_b: np.ndarray
    root_a: np.ndarray
    root_b: np.ndarray
    density: np.ndarray
    offset: np.ndarray
    margin: np.ndarray


class Band(NamedTuple):
    """First and last column of each row (n), and where each row begins in the flat arrays (n + 1)."""

    low: np.ndarray
    high: np.ndarray
    offset: np.ndarray


class Evidence(NamedTuple):
    """What speaks for or against two joints, or two welds, being one beside the lengths; empty arrays where there is nothing."""

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
    seam_sigma: float  # degree
    lock_a: np.ndarray  # weld of B locked to each weld of A, -1 free
    lock_b: np.ndarray
    forbid_start: np.ndarray  # (n + 1) where each weld's forbidden partners begin in `forbid`
    forbid: np.ndarray


@njit(cache=True, error_model="numpy")
def evidence(i, j, ev):
    """Weight of the cell (i, j) from locked and forbidden pairs."""
    if not ev.lock_a.size:
        return 1.0
    if ev.lock_a[i] != j and (ev.lock_a[i] >= 0 or ev.lock_b[j] >= 0):
        return 0.0
    for k in range(ev.forbid_start[i], ev.forbid_start[i + 1]):
        if ev.forbid[k] == j:
            return 0.0
    return _HUGE if ev.lock_a[i] == j else 1.0


@njit(cache=True, error_model="numpy")
def traits(i, j, ev):
    """Likelihood ratio, from everything but the length, of the joints that begin at weld i of A and weld j of B being one."""
    if not ev.used:
        return 1.0
    w = ev.ratio[ev.class_a[i], ev.class_b[j]]
    if ev.label_a.size and ev.label_a[i] >= 0 and ev.label_b[j] >= 0:
        w *= ev.label_same if ev.label_a[i] == ev.label_b[j] else ev.label_other
    if ev.seam_a.size:
        d = abs(ev.seam_a[i] - ev.seam_b[j])
        if d == d:
            d = min(d, 360.0 - d)
            w *= 0.1 + 0.9 * 180.0 * 2.0 * _density(d, *noise(ev.seam_sigma))  # against any angle of 0..180
    return w


@njit(cache=True, error_model="numpy")
def noise(sigma):
    """Student's t with three degrees of freedom and this scale: the factor of its square, and its peak."""
    return 1.0 / (3.0 * sigma * sigma), _T3 / sigma


@njit(cache=True, error_model="numpy")
def _density(r, square, peak):
    z2 = 1.0 + square * r * r
    return peak / (z2 * z2)


@njit(cache=True, error_model="numpy")
def move_11(i, j, x, y, root_a, root_b, t, square, peak):
    """Weight of one joint against one, both ending at (i, j): noise over the density of such a length."""
    return t.same * _density(y[j] - y[j - 1] - x[i] + x[i - 1], square, peak) * root_a[i] * root_b[j]


@njit(cache=True, error_model="numpy")
def move_12(i, j, x, y, inv_a, inv_b, t, square, peak):
    """One joint of A against two of B: a weld missed in A, or a false one in B anywhere in the joint."""
    whole = x[i] - x[i - 1]
    r = y[j] - y[j - 2] - whole
    if abs(r) > _REACH * t.sigma:
        return 0.0
    return _density(r, square, peak) * (t.missed_a * inv_a[i] + t.false_b / whole * inv_b[j] * inv_b[j - 1])


@njit(cache=True, error_model="numpy")
def move_21(i, j, x, y, inv_a, inv_b, t, square, peak):
    """Two joints of A against one of B."""
    whole = y[j] - y[j - 1]
    r = whole - x[i] + x[i - 2]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    return _density(r, square, peak) * (t.missed_b * inv_b[j] + t.false_a / whole * inv_a[i] * inv_a[i - 1])


@njit(cache=True, error_model="numpy")
def move_13(i, j, x, y, inv_a, inv_b, t, square, peak):
    """One joint of A against three of B."""
    whole = x[i] - x[i - 1]
    r = y[j] - y[j - 3] - whole
    if abs(r) > _REACH * t.sigma:
        return 0.0
    f = t.false_b / whole
    mixed = t.missed_a * f * inv_a[i] * (inv_b[j] + inv_b[j - 2])
    return _density(r, square, peak) * (t.missed_a**2 * inv_a[i] + mixed + 2.0 * f * f * inv_b[j] * inv_b[j - 1] * inv_b[j - 2])


@njit(cache=True, error_model="numpy")
def move_31(i, j, x, y, inv_a, inv_b, t, square, peak):
    """Three joints of A against one of B."""
    whole = y[j] - y[j - 1]
    r = whole - x[i] + x[i - 3]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    f = t.false_a / whole
    mixed = t.missed_b * f * inv_b[j] * (inv_a[i] + inv_a[i - 2])
    return _density(r, square, peak) * (t.missed_b**2 * inv_b[j] + mixed + 2.0 * f * f * inv_a[i] * inv_a[i - 1] * inv_a[i - 2])


@njit(cache=True, error_model="numpy")
def move_22(i, j, x, y, inv_a, inv_b, root_a, root_b, density, t, square, peak):
    """Two joints against two: weight with the weld between them one displaced weld, and with two welds that are strangers.

    Strangers are: each run missed the other's weld, each weld is false, or one is false and the other was missed.
    """
    whole = x[i] - x[i - 2]
    r = y[j] - y[j - 2] - whole
    if abs(r) > _REACH * t.sigma:
        return 0.0, 0.0
    f = _density(r, square, peak)
    shift = y[j - 1] - y[j - 2] - x[i - 1] + x[i - 2]
    z = shift / t.shift_m
    pair_a, pair_b = inv_a[i] * inv_a[i - 1], inv_b[j] * inv_b[j - 1]
    same = f * t.shifted * root_a[i] * root_a[i - 1] * root_b[j] * root_b[j - 1] / (np.pi * t.shift_m * (1.0 + z * z))
    between = density[min(int(abs(shift) / BIN), density.size - 1)]
    ends = inv_a[i] * inv_b[j - 1] if shift > 0 else inv_a[i - 1] * inv_b[j]
    strangers = t.missed_a * t.missed_b * between * ends
    strangers += (t.missed_a * t.false_a * pair_a + t.missed_b * t.false_b * pair_b) / whole
    strangers += t.false_a * t.false_b / whole**2 * pair_a * pair_b * density[min(int(whole / BIN), density.size - 1)]
    return same, f * strangers


@njit(cache=True, error_model="numpy")
def ending(i, j, x, y, offset, margin):
    """Weight of a replaced stretch that ends at (i, j): it keeps the place of what follows, as the anchors know it."""
    shown = y[j] - x[i]
    for k in range(offset.shape[1]):
        if abs(shown - offset[i, k]) <= margin[i]:
            return 1.0
    return _STRAY


@njit(cache=True, error_model="numpy")
def _row(first, last, start, i):
    """First and last column of row i, and the flat place of its column 0; an empty row outside."""
    if i < 0 or i >= first.size:
        return 1, 0, 0
    return first[i], last[i], start[i] - first[i]


@njit(cache=True, error_model="numpy")
def fill(s, band, t, ev):
    """Best path to every cell of the band.

    Returns
    -------
    best : (cells, 4) weights in units of their row.
    back : (cells, 4) uint8 moves taken: 11, 12, ... a pair of joints, 1..4 from state M, D, A, B, 0 the beginning.
    log_scale : (n) logarithm of the unit of each row.
    """
    x, y, inv_a, inv_b, root_a, root_b, density, offset, margin = s
    first, last, start = band
    known, locked = ev.used, ev.lock_a.size > 0
    square, peak = noise(t.sigma)
    n = x.size
    best = np.zeros((start[n], 4))
    back = np.zeros((start[n], 4), np.uint8)
    log_scale = np.zeros(n)
    c1 = c2 = 1.0
    for i in range(n):
        q2, q3 = 1.0 / c1, 1.0 / (c1 * c2)
        begin = np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 else 1.0
        top = 0.0
        low, high, o0 = _row(first, last, start, i)
        l1, h1, o1 = _row(first, last, start, i - 1)
        l2, h2, o2 = _row(first, last, start, i - 2)
        l3, h3, o3 = _row(first, last, start, i - 3)
        for j in range(low, high + 1):
            k = o0 + j
            v_m = begin if i == 0 or j == 0 else 0.0
            v_d = v_m * t.open_both
            v_a = v_b = 0.0
            t_m = t_d = t_a = t_b = 0
            if l1 <= j <= h1:
                v_a, t_a = best[o1 + j, 1] * t.switch, 2
                if best[o1 + j, 2] * t.extend_one > v_a:
                    v_a, t_a = best[o1 + j, 2] * t.extend_one, 3
            if j > low:
                v_b, t_b = best[k - 1, 1] * t.switch, 2
                if best[k - 1, 3] * t.extend_one > v_b:
                    v_b, t_b = best[k - 1, 3] * t.extend_one, 4
            if l1 <= j - 1 <= h1:
                p = o1 + j - 1
                if best[p, 0] * t.open_both > v_d:
                    v_d, t_d = best[p, 0] * t.open_both, 1
                if best[p, 1] * t.extend > v_d:
                    v_d, t_d = best[p, 1] * t.extend, 2
                w = best[p, 0] * move_11(i, j, x, y, root_a, root_b, t, square, peak)
                if known:
                    w *= traits(i - 1, j - 1, ev)
                if w > v_m:
                    v_m, t_m = w, 11
            if l1 <= j - 2 <= h1:
                w = best[o1 + j - 2, 0] * move_12(i, j, x, y, inv_a, inv_b, t, square, peak)
                if w > v_m:
                    v_m, t_m = w, 12
            if l1 <= j - 3 <= h1:
                w = best[o1 + j - 3, 0] * move_13(i, j, x, y, inv_a, inv_b, t, square, peak)
                if w > v_m:
                    v_m, t_m = w, 13
            if l2 <= j - 1 <= h2:
                w = best[o2 + j - 1, 0] * q2 * move_21(i, j, x, y, inv_a, inv_b, t, square, peak)
                if w > v_m:
                    v_m, t_m = w, 21
            if l2 <= j - 2 <= h2:
                same, strangers = move_22(i, j, x, y, inv_a, inv_b, root_a, root_b, density, t, square, peak)
                if locked:
                    same *= evidence(i - 1, j - 1, ev)
                w = best[o2 + j - 2, 0] * q2 * (same + strangers)
                if w > v_m:
                    v_m, t_m = w, 22
            if l3 <= j - 1 <= h3:
                w = best[o3 + j - 1, 0] * q3 * move_31(i, j, x, y, inv_a, inv_b, t, square, peak)
                if w > v_m:
                    v_m, t_m = w, 31
            e = ending(i, j, x, y, offset, margin)
            if v_d * t.close * e > v_m:
                v_m, t_m = v_d * t.close * e, 2
            if v_a * t.close_one * e > v_m:
                v_m, t_m = v_a * t.close_one * e, 3
            if v_b * t.close_one * e > v_m:
                v_m, t_m = v_b * t.close_one * e, 4
            if locked:
                v_m *= evidence(i, j, ev)
            best[k, 0], best[k, 1], best[k, 2], best[k, 3] = v_m, v_d, v_a, v_b
            back[k, 0], back[k, 1], back[k, 2], back[k, 3] = t_m, t_d, t_a, t_b
            top = max(top, v_m, v_d, v_a, v_b)
        if top <= 0.0:
            top = 1.0
        for k in range(start[i], start[i + 1]):
            for q in range(4):
                best[k, q] /= top
        log_scale[i] = np.log(top) + (log_scale[i - 1] if i > 0 else 0.0)
        c2, c1 = c1, top
    return best, back, log_scale


@njit(cache=True, error_model="numpy")
def trace_back(best, back, log_scale, band, m):
    """Best path: partner of each weld of A (-1 none), the move to it, its log weight, its least way to the band's edge."""
    first, last, start = band
    n = first.size
    partner = np.full(n, -1, np.int64)
    move = np.zeros(n, np.int64)
    top, i, j, state = -np.inf, -1, -1, 0
    for r in range(n):
        for c in range(first[r] if r == n - 1 else max(m - 1, first[r]), last[r] + 1):
            for q in range(4):
                v = best[start[r] + c - first[r], q]
                if v > 0.0 and np.log(v) + log_scale[r] > top:
                    top, i, j, state = np.log(v) + log_scale[r], r, c, q
    slack = m
    while i >= 0 and j >= 0:
        t = back[start[i] + j - first[i], state]
        if first[i] > 0:
            slack = min(slack, j - first[i])
        if last[i] < m - 1:
            slack = min(slack, last[i] - j)
        if state == 0:
            partner[i], move[i] = j, t
            if t == 0:
                break
            if t >= 11:
                i, j = i - t // 10, j - t % 10
            else:
                state = t - 1
        elif t == 0:
            break
        else:
            i, j = i - (state != 3), j - (state != 2)
            state = t - 1
    return partner, move, top, slack


@njit(cache=True, error_model="numpy")
def forward(s, band, t, ev):
    """Sum over all paths to every cell of the band.

    Returns
    -------
    total : (cells, 4) in units of the row.
    norm : (n) unit of each row in units of the row before.
    log_scale : (n) logarithm of the unit of each row.
    log_total : logarithm of the weight of all alignments; that of none at all, both runs strangers, is 0.
    """
    x, y, inv_a, inv_b, root_a, root_b, density, offset, margin = s
    first, last, start = band
    known, locked = ev.used, ev.lock_a.size > 0
    square, peak = noise(t.sigma)
    n, m = x.size, y.size
    total = np.zeros((start[n], 4))
    norm = np.ones(n)
    log_scale = np.zeros(n)
    c1 = c2 = 1.0
    for i in range(n):
        q2, q3 = 1.0 / c1, 1.0 / (c1 * c2)
        begin = np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 else 1.0
        top = 0.0
        low, high, o0 = _row(first, last, start, i)
        l1, h1, o1 = _row(first, last, start, i - 1)
        l2, h2, o2 = _row(first, last, start, i - 2)
        l3, h3, o3 = _row(first, last, start, i - 3)
        for j in range(low, high + 1):
            k = o0 + j
            v_m = begin if i == 0 or j == 0 else 0.0
            v_d = v_m * t.open_both
            v_a = v_b = 0.0
            if l1 <= j <= h1:
                v_a = total[o1 + j, 1] * t.switch + total[o1 + j, 2] * t.extend_one
            if j > low:
                v_b = total[k - 1, 1] * t.switch + total[k - 1, 3] * t.extend_one
            if l1 <= j - 1 <= h1:
                p = o1 + j - 1
                v_d += total[p, 0] * t.open_both + total[p, 1] * t.extend
                w = total[p, 0] * move_11(i, j, x, y, root_a, root_b, t, square, peak)
                v_m += w * traits(i - 1, j - 1, ev) if known else w
            if l1 <= j - 2 <= h1:
                v_m += total[o1 + j - 2, 0] * move_12(i, j, x, y, inv_a, inv_b, t, square, peak)
            if l1 <= j - 3 <= h1:
                v_m += total[o1 + j - 3, 0] * move_13(i, j, x, y, inv_a, inv_b, t, square, peak)
            if l2 <= j - 1 <= h2:
                v_m += total[o2 + j - 1, 0] * q2 * move_21(i, j, x, y, inv_a, inv_b, t, square, peak)
            if l2 <= j - 2 <= h2:
                same, strangers = move_22(i, j, x, y, inv_a, inv_b, root_a, root_b, density, t, square, peak)
                if locked:
                    same *= evidence(i - 1, j - 1, ev)
                v_m += total[o2 + j - 2, 0] * q2 * (same + strangers)
            if l3 <= j - 1 <= h3:
                v_m += total[o3 + j - 1, 0] * q3 * move_31(i, j, x, y, inv_a, inv_b, t, square, peak)
            v_m += ending(i, j, x, y, offset, margin) * (t.close * v_d + t.close_one * (v_a + v_b))
            if locked:
                v_m *= evidence(i, j, ev)
            total[k, 0], total[k, 1], total[k, 2], total[k, 3] = v_m, v_d, v_a, v_b
            top = max(top, v_m, v_d, v_a, v_b)
        if top <= 0.0:
            top = 1.0
        for k in range(start[i], start[i + 1]):
            for q in range(4):
                total[k, q] /= top
        norm[i] = top
        log_scale[i] = np.log(top) + (log_scale[i - 1] if i > 0 else 0.0)
        c2, c1 = c1, top
    return total, norm, log_scale, _log_total(total, log_scale, band, m)


@njit(cache=True, error_model="numpy")
def _log_total(total, log_scale, band, m):
    """Logarithm of the sum over all cells and states in which an alignment may end."""
    first, last, start = band
    n = first.size
    top, rest = -np.inf, 0.0
    for i in range(n):
        v = 0.0
        for j in range(first[i] if i == n - 1 else max(m - 1, first[i]), last[i] + 1):
            for q in range(4):
                v += total[start[i] + j - first[i], q]
        if v <= 0.0:
            continue
        v = np.log(v) + log_scale[i]
        if v > top:
            rest, top = rest * np.exp(top - v) + 1.0, v
        else:
            rest += np.exp(v - top)
    return top + np.log(rest)


@njit(cache=True, error_model="numpy")
def backward(s, band, t, ev, total, norm, log_scale, log_total):
    """Posterior of every cell of the band.

    Returns
    -------
    match : (cells) probability that weld i of A and weld j of B are one, a displaced weld included.
    shifted : (cells) the part of it in which the weld is displaced.
    """
    x, y, inv_a, inv_b, root_a, root_b, density, offset, margin = s
    first, last, start = band
    known, locked = ev.used, ev.lock_a.size > 0
    square, peak = noise(t.sigma)
    n, m = x.size, y.size
    match = np.zeros(start[n], np.float32)
    shifted = np.zeros(start[n], np.float32)
    rest = np.zeros((4, (last - first).max() + 1, 4))  # row modulo 4, column, state
    for i in range(n - 1, -1, -1):
        now, r1, r2, r3 = i % 4, (i + 1) % 4, (i + 2) % 4, (i + 3) % 4
        q1 = 1.0 / norm[i + 1] if i + 1 < n else 0.0
        q2 = q1 / norm[i + 2] if i + 2 < n else 0.0
        q3 = q2 / norm[i + 3] if i + 3 < n else 0.0
        low, high, o0 = _row(first, last, start, i)
        l1, h1, o1 = _row(first, last, start, i + 1)
        l2, h2, _ = _row(first, last, start, i + 2)
        l3, h3, _ = _row(first, last, start, i + 3)
        stop = np.exp(min(log_scale[i] - log_total, 600.0))
        for j in range(high, low - 1, -1):
            k = o0 + j
            end = stop if i == n - 1 or j == m - 1 else 0.0
            v_m, v_d, v_a, v_b = end, end, end, end
            if l1 <= j <= h1:
                w = rest[r1, j - l1, 2] * q1
                v_d += w * t.switch
                v_a += w * t.extend_one
            if j < high:
                w = rest[now, j + 1 - low, 3]
                v_d += w * t.switch
                v_b += w * t.extend_one
            if l1 <= j + 1 <= h1:
                w = rest[r1, j + 1 - l1, 1] * q1
                v_m += w * t.open_both
                v_d += w * t.extend
                w = rest[r1, j + 1 - l1, 0] * q1 * move_11(i + 1, j + 1, x, y, root_a, root_b, t, square, peak)
                v_m += w * traits(i, j, ev) if known else w
            if l1 <= j + 2 <= h1:
                v_m += rest[r1, j + 2 - l1, 0] * q1 * move_12(i + 1, j + 2, x, y, inv_a, inv_b, t, square, peak)
            if l1 <= j + 3 <= h1:
                v_m += rest[r1, j + 3 - l1, 0] * q1 * move_13(i + 1, j + 3, x, y, inv_a, inv_b, t, square, peak)
            if l2 <= j + 1 <= h2:
                v_m += rest[r2, j + 1 - l2, 0] * q2 * move_21(i + 2, j + 1, x, y, inv_a, inv_b, t, square, peak)
            if l2 <= j + 2 <= h2:
                w = rest[r2, j + 2 - l2, 0] * q2
                same, strangers = move_22(i + 2, j + 2, x, y, inv_a, inv_b, root_a, root_b, density, t, square, peak)
                if locked:
                    same *= evidence(i + 1, j + 1, ev)
                v_m += w * (same + strangers)
                if l1 <= j + 1 <= h1:
                    shifted[o1 + j + 1] += np.float32(total[k, 0] * w * same)
            if l3 <= j + 1 <= h3:
                v_m += rest[r3, j + 1 - l3, 0] * q3 * move_31(i + 3, j + 1, x, y, inv_a, inv_b, t, square, peak)
            match[k] = total[k, 0] * v_m
            # weight of everything behind the cell, its own evidence and the end of a replaced stretch counted
            after = v_m * evidence(i, j, ev) if locked else v_m
            c = j - low
            e = ending(i, j, x, y, offset, margin) * after
            rest[now, c, 0], rest[now, c, 1] = after, v_d + t.close * e
            rest[now, c, 2], rest[now, c, 3] = v_a + t.close_one * e, v_b + t.close_one * e
    for k in range(start[n]):
        match[k] = min(match[k] + shifted[k], 1.0)
    return match, shifted
