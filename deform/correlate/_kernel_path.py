"""Weights of the best alignments up to every cell in, the best path out: partner and move of each weld."""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.correlate._kernel_moves import FIT_M, begin, cut_table, few, move_cut, noise, span
from deform.correlate._kernel_types import LONGEST_CUT, MOST_LOOSE

_ROUNDING = 1e-6  # of a weight, of places of a thousand kilometres in double precision
BEGIN, CUT, REROUTE = 0, 1, 2  # beside 11, 12, 21, 13, 31 and 22


@njit(cache=True, error_model="numpy")
def trace_back(s, band, t, ev, best, norm, log_scale):
    """Best path, each of its moves found again from the weights.

    Parameters
    ----------
    best, norm, log_scale : from `ahead` with ``best``.

    Returns
    -------
    partner : (n) weld of B, -1 none.
    move : (n) the move that ends there.
    slack : (n) way of the path to the edge of the band; large where none.
    """
    n, m = s.x.size, s.y.size
    f, table = noise(t), cut_table(s, t)
    partner, move = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    i, j = _last(best, log_scale, band, m, t)
    slack = np.full(n, m)
    while i >= 0:
        if band.low[i] > 0:
            slack[i] = min(slack[i], j - band.low[i])
        if band.high[i] < m - 1:
            slack[i] = min(slack[i], band.high[i] - j)
        partner[i] = j
        step, a, b = _move_into(i, j, s, band, t, ev, best, norm, log_scale, f, table)
        move[i] = step
        if step == BEGIN:
            break
        i, j = i - a, j - b
    return partner, move, slack


@njit(cache=True, error_model="numpy")
def _last(best, log_scale, band, m, t):
    n = band.low.size
    top, at_i, at_j = -np.inf, -1, -1
    for i in range(n):
        low, high, o = span(band, i)
        for j in range(low if n - 1 - i <= MOST_LOOSE else max(m - 1, low), high + 1):
            w = best[o + j] * begin(n - 1 - i, m - 1 - j, t)
            if w > 0.0 and np.log(w) + log_scale[i] > top:
                top, at_i, at_j = np.log(w) + log_scale[i], i, j
    return at_i, at_j


@njit(cache=True, error_model="numpy")
def _value(i, j, band, best):
    low, high, o = span(band, i)
    return best[o + j] if low <= j <= high else 0.0


@njit(cache=True, error_model="numpy")
def _move_into(i, j, s, band, t, ev, best, norm, log_scale, f, table):
    """The heaviest move into a cell: its kind, and the joints of A and of B that it consumes."""
    o = span(band, i)[2]
    value = best[o + j] * norm[i] * (1.0 - _ROUNDING)
    if ev.weld.size:
        value /= ev.weld[o + j]
    step, a_best, b_best = BEGIN, 0, 0
    top = begin(i, j, t) * (np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 else 1.0)
    unit = 1.0
    for a in range(1, min(3, i) + 1):
        for b in range(1, min(3, j) + 1):
            if a * b > 4 or (a > 2 and b > 1) or (b > 2 and a > 1):
                continue
            w = _value(i - a, j - b, band, best) * unit
            if w > 0.0:
                w *= few(a, b, i, j, s, band, t, ev, f)
            if w > top:
                top, step, a_best, b_best = w, 10 * a + b, a, b
                if w >= value:  # no other can be heavier
                    return step, a, b
        unit /= norm[i - a]
    unit = 1.0
    for a in range(1, min(LONGEST_CUT, i) + 1 if top < value else 0):
        for b in range(1, min(s.slack.size - a, j + 1)):
            r = s.y[j] - s.y[j - b] - s.x[i] + s.x[i - a]
            w = _value(i - a, j - b, band, best) * unit
            if abs(r) <= FIT_M and w > 0.0:
                w *= move_cut(r, a, b, s.fresh[j] - s.fresh[j - b], s.closing[j] - s.closing[j - b], table)
            else:
                w = 0.0
            if w > top:
                top, step, a_best, b_best = w, CUT, a, b
        unit /= norm[i - a]
    return _reroute_into(i, j, value, band, t, best, log_scale) if top < value else (step, a_best, b_best)


@njit(cache=True, error_model="numpy")
def _reroute_into(i, j, value, band, t, best, log_scale):
    """The cell from which a re-route leads to this one: rows are looked through backwards until one explains the weight."""
    top, at_i, at_j = 0.0, -1, -1
    for i0 in range(i - 1, -1, -1):
        low, high, o = span(band, i0)
        unit = t.reroute * np.exp(min(log_scale[i0] - log_scale[i - 1], 600.0)) * t.reroute_more ** (i - i0)
        for j0 in range(low, min(high, j - 1) + 1):
            w = best[o + j0] * unit * t.reroute_more ** (j - j0)
            if w > top:
                top, at_i, at_j = w, i0, j0
        if top > value * (1.0 - _ROUNDING):
            break
    return (REROUTE, i - at_i, j - at_j) if at_i >= 0 else (BEGIN, 0, 0)
