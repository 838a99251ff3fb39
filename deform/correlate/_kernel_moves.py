"""Two lists, a place in both and the rates in, the weight of the move that ends there out.

A weight is the probability of what the two lists show over that of two strangers, whose joints are drawn one by one from the
density of listed lengths.
"""

from __future__ import annotations

from math import gamma, pi, sqrt

import numpy as np
from numba import njit

from deform.correlate._kernel_types import BIN, MOST_LOOSE

PEAK = np.array([0.0, *(gamma(1 << k) / gamma((1 << k) - 0.5) / sqrt(pi * ((2 << k) - 1)) for k in (1, 2, 3))])  # Student's t
_REACH = 15.0  # sigma; a sum of joints that differs more is not the same pipe with a weld missed
FIT_M = 6.0  # metre, a replaced stretch that differs more in length is a re-route
_LOOSE = 0.1  # share of the replaced stretches whose length was not kept, within about a metre


@njit(cache=True, error_model="numpy")
def student(r, sigma, shape):
    """Density of Student's t with 3, 7 or 15 degrees of freedom and this scale."""
    z = 1.0 + r * r / (((2 << shape) - 1) * sigma * sigma)
    z *= z
    if shape > 1:
        z *= z
    if shape > 2:
        z *= z
    return PEAK[shape] / (sigma * z)


@njit(cache=True, error_model="numpy")
def noise(t):
    """Student's t of the rates made ready: factor of the square, peak, shape, and how far a sum of joints may differ, metre."""
    return 1.0 / (((2 << t.shape) - 1) * t.sigma * t.sigma), PEAK[t.shape] / t.sigma, t.shape, _REACH * t.sigma


@njit(cache=True, error_model="numpy")
def fit(r, f):
    """Density of a length difference."""
    z = 1.0 + f[0] * r * r
    z *= z
    if f[2] > 1:
        z *= z
    if f[2] > 2:
        z *= z
    return f[1] / z


# The next three take numbers alone, for the innermost loops call them: `whole` and `one`, `two`, `three` are one over the
# densities of the listed joints that end in a cell, the pieces in the order of the list.


@njit(cache=True, error_model="numpy")
def against_two(r, whole, one, two, missed, false, f):
    """One joint against two: the one run missed the weld between them, or the other made it up."""
    return fit(r, f) * (missed * whole + false * one * two)


@njit(cache=True, error_model="numpy")
def against_three(r, whole, one, two, three, missed, again, false, f):
    """One joint against three: two welds missed (what hides a weld may hide the next), one missed and one false, or two false."""
    mixed = missed * false * whole * (one + three)
    return fit(r, f) * (missed * again * whole + mixed + 2.0 * false * false * one * two * three)


@njit(cache=True, error_model="numpy")
def two_against_two(r, shift, length, a1, a2, b1, b2, density, t, f):
    """Two joints against two: weight with the weld between them one displaced weld, and with two welds that are strangers.

    Strangers are: each run missed the other's weld, each weld is false, or one is false and the other was missed.
    """
    z = shift / t.shift_m
    pair_a, pair_b = a1 * a2, b1 * b2
    near = fit(r, f)
    same = near * t.shifted * np.sqrt(pair_a * pair_b) / (np.pi * t.shift_m * (1.0 + z * z))
    ends = a2 * b1 if shift > 0 else a1 * b2
    strangers = t.missed_a * t.missed_b * at_length(density, abs(shift)) * ends
    strangers += t.missed_a * t.false_a * pair_a + t.missed_b * t.false_b * pair_b
    strangers += t.false_a * t.false_b * pair_a * pair_b * at_length(density, length)
    return same, near * strangers


@njit(cache=True, error_model="numpy")
def at_length(table, length):
    """Density at a length."""
    return table[min(int(max(length, 0.0) / BIN), table.size - 1)]


@njit(cache=True, error_model="numpy")
def few(a, b, i, j, s, band, t, ev, f):
    """Weight of the move of a joints of A and b of B, three at most, that ends at (i, j)."""
    x, y, inv_a, inv_b = s.x, s.y, s.inv_a, s.inv_b
    r = y[j] - y[j - b] - x[i] + x[i - a]
    if a == 1 and b == 1:
        w = t.same * fit(r, f) * at_length(s.shared, x[i] - x[i - 1] + 0.5 * r) * inv_a[i] * inv_b[j]
    elif abs(r) >= f[3]:
        return 0.0
    elif a == 2 and b == 2:
        shift, length = y[j - 1] - y[j - 2] - x[i - 1] + x[i - 2], x[i] - x[i - 2]
        same, strangers = two_against_two(r, shift, length, inv_a[i - 1], inv_a[i], inv_b[j - 1], inv_b[j], s.density, t, f)
        return same * displaced(i, j, band, ev) + strangers
    elif a == 1 and b == 2:
        w = against_two(r, inv_a[i], inv_b[j - 1], inv_b[j], t.missed_a, t.false_b, f)
    elif a == 1:
        w = against_three(r, inv_a[i], inv_b[j - 2], inv_b[j - 1], inv_b[j], t.missed_a, t.again, t.false_b, f)
    elif a == 2:
        w = against_two(r, inv_b[j], inv_a[i - 1], inv_a[i], t.missed_b, t.false_a, f)
    else:
        w = against_three(r, inv_b[j], inv_a[i - 2], inv_a[i - 1], inv_a[i], t.missed_b, t.again, t.false_a, f)
    if ev.joint.size:
        w *= joint_at(ev.joint, band, i - a + 1, j - b + 1)
    return w


@njit(cache=True, error_model="numpy")
def cut_table(s, t):
    """Factor of the square, peak (by joints in both runs) and weight (by joints of A) of stretches replaced in place."""
    table = np.zeros((s.slack.size, 3))
    for k in range(1, s.slack.size):
        table[k, 0], table[k, 1] = 1.0 / (7.0 * s.slack[k] ** 2), (1.0 - _LOOSE) * PEAK[2] / s.slack[k]
        table[k, 2] = t.cut * (1.0 - t.cut_more) * t.cut_more ** (k - 1)
    return table


@njit(cache=True, error_model="numpy")
def move_cut(r, a, b, fresh, closing, table):
    """Stretch of a joints replaced in place by b: its length is kept, and one of the new joints was cut to fit.

    ``r`` is the difference of its length, ``fresh`` and ``closing`` what `Lists` holds of the new joints together.
    """
    if a + b < 4 or a + b >= table.shape[0]:
        return 0.0
    z = 1.0 + table[a + b, 0] * r * r
    z *= z
    kept = table[a + b, 1] / (z * z) + _LOOSE / (np.pi * (1.0 + r * r))
    return table[a, 2] * kept * np.exp(fresh) * closing / b


@njit(cache=True, error_model="numpy")
def begin(i, j, t):
    """Weight of an alignment that begins at (i, j), counted from the first welds; of one that ends, counted from the last."""
    if i == 0 or j == 0:
        return 1.0
    if i + j > MOST_LOOSE:
        return 0.0
    return t.ends * t.reroute_more ** (i + j)


@njit(cache=True, error_model="numpy")
def span(band, i):
    """First and last column of row i, and the flat place of its column 0; an empty row outside."""
    if i < 0 or i >= band.low.size:
        return 1, 0, 0
    return band.low[i], band.high[i], band.offset[i] - band.low[i]


@njit(cache=True, error_model="numpy")
def joint_at(weight, band, i, j):
    """What the traits say of the joints that end at (i, j) being one; nothing outside the band.

    In a move of one joint against several, the first of the several begins at the same weld as the one.
    """
    low, high, o = span(band, i)
    return weight[o + j] if low <= j <= high else 1.0


@njit(cache=True, error_model="numpy")
def displaced(i, j, band, ev):
    """What the hints say of two joints against two that end at (i, j), with the weld between them one displaced weld."""
    w = 1.0
    if ev.joint.size:
        w *= joint_at(ev.joint, band, i - 1, j - 1) * joint_at(ev.joint, band, i, j)
    if ev.weld.size:
        w *= joint_at(ev.weld, band, i - 1, j - 1)
    return w
