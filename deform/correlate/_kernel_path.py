"""Weights of the best alignments up to every cell in, the best path out: partner and move of each weld."""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.correlate._kernel_moves import (
    begin,
    displaced,
    joint_at,
    move_11,
    move_12,
    move_13,
    move_21,
    move_22,
    move_31,
    move_cut,
    noise,
    span,
)
from deform.correlate._kernel_types import LONGEST_CUT

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
    slack : least way of the path to the edge of the band.
    """
    n, m = s.x.size, s.y.size
    f = noise(t)
    partner, move = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    i, j = _last(best, log_scale, band, m, t)
    slack = m
    while i >= 0:
        if band.low[i] > 0:
            slack = min(slack, j - band.low[i])
        if band.high[i] < m - 1:
            slack = min(slack, band.high[i] - j)
        partner[i] = j
        step, a, b = _move_into(i, j, s, band, t, ev, best, norm, log_scale, f)
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
        for j in range(low if n - 1 - i < 400 else max(m - 1, low), high + 1):
            w = best[o + j] * begin(n - 1 - i, m - 1 - j, t)
            if w > 0.0 and np.log(w) + log_scale[i] > top:
                top, at_i, at_j = np.log(w) + log_scale[i], i, j
    return at_i, at_j


@njit(cache=True, error_model="numpy")
def _value(i, j, band, best):
    low, high, o = span(band, i)
    return best[o + j] if low <= j <= high else 0.0


@njit(cache=True, error_model="numpy")
def _move_into(i, j, s, band, t, ev, best, norm, log_scale, f):
    """The heaviest move into a cell: its kind, and the joints of A and of B that it consumes."""
    low, _, o = span(band, i)
    step, a_best, b_best = BEGIN, 0, 0
    top = begin(i, j, t) * (np.exp(-max(log_scale[i - 1], -600.0)) if i > 0 else 1.0)
    unit = 1.0
    for a in range(1, min(LONGEST_CUT, i) + 1):
        for b in range(1, 4):
            if a > 3 or a * b > 4 or (a == 1 and b > 3) or j - b < 0:
                continue
            v = _value(i - a, j - b, band, best) * unit
            if v <= 0.0:
                continue
            w = v * _few(a, b, i, j, s, band, t, ev, f)
            if w > top:
                top, step, a_best, b_best = w, 10 * a + b, a, b
        for b in range(1, min(s.slack.size - a, j + 1)):
            v = _value(i - a, j - b, band, best) * unit
            if v > 0.0:
                w = v * move_cut(i - a, j - b, i, j, s, t)
                if w > top:
                    top, step, a_best, b_best = w, CUT, a, b
        unit /= norm[i - a]
    value = best[o + j] * norm[i]
    if ev.weld.size:
        value /= ev.weld[o + j]
    if top < value * (1.0 - 1e-9):
        return _reroute_into(i, j, value, band, t, best, log_scale)
    return step, a_best, b_best


@njit(cache=True, error_model="numpy")
def _few(a, b, i, j, s, band, t, ev, f):
    """Weight of a move of a few welds."""
    if a == 2 and b == 2:
        same, strangers = move_22(i, j, s, t, f)
        return same * displaced(i, j, band, ev) + strangers
    if a == 1:
        w = move_11(i, j, s, t, f) if b == 1 else move_12(i, j, s, t, f) if b == 2 else move_13(i, j, s, t, f)
    else:
        w = move_21(i, j, s, t, f) if a == 2 else move_31(i, j, s, t, f)
    if ev.joint.size:
        w *= joint_at(ev.joint, band, i - a + 1, j - b + 1)
    return w


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
        if top > value * (1.0 - 1e-6):
            break
    return (REROUTE, i - at_i, j - at_j) if at_i >= 0 else (BEGIN, 0, 0)
