"""Two lists, a place in both and the rates in, the weight of the move that ends there out.

A weight is the probability of what the two lists show over that of two strangers, whose joints are drawn one by one from the
density of listed lengths.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from deform.correlate._kernel_types import BIN

_PEAK = np.array([0.0, 2.0 / (np.pi * np.sqrt(3.0)), 0.3849914508322673, 0.39235316414483514])  # Student's t, 3, 7 and 15 degrees, at zero
_REACH = 15.0  # sigma; a sum of joints that differs more is not the same pipe with a weld missed
_FIT_M = 6.0  # metre, a replaced stretch that differs more in length is a re-route
_LOOSE = 0.1  # share of the replaced stretches whose length was not kept, within about a metre


@njit(cache=True, error_model="numpy")
def student(r, sigma, shape):
    """Density of Student's t with 3, 7 or 15 degrees of freedom and this scale."""
    z = 1.0 + r * r / ((2.0 ** (shape + 1) - 1.0) * sigma * sigma)
    z *= z
    if shape > 1:
        z *= z
    if shape > 2:
        z *= z
    return _PEAK[shape] / (sigma * z)


@njit(cache=True, error_model="numpy")
def noise(t):
    """Student's t of the rates made ready: factor of the square, peak, shape."""
    return 1.0 / ((2.0 ** (t.shape + 1) - 1.0) * t.sigma * t.sigma), _PEAK[t.shape] / t.sigma, t.shape


@njit(cache=True, error_model="numpy")
def _density(r, f):
    z = 1.0 + f[0] * r * r
    z *= z
    if f[2] > 1:
        z *= z
    if f[2] > 2:
        z *= z
    return f[1] / z


@njit(cache=True, error_model="numpy")
def _at(table, length):
    return table[min(int(max(length, 0.0) / BIN), table.size - 1)]


@njit(cache=True, error_model="numpy")
def move_11(i, j, s, t, f):
    """One joint against one, both ending at (i, j): their joint density over the product of the single ones."""
    u, v = s.x[i] - s.x[i - 1], s.y[j] - s.y[j - 1]
    return t.same * _density(v - u, f) * _at(s.shared, 0.5 * (u + v)) * s.inv_a[i] * s.inv_b[j]


@njit(cache=True, error_model="numpy")
def move_12(i, j, s, t, f):
    """One joint of A against two of B: a weld missed in A, or a false one in B anywhere in the joint."""
    r = s.y[j] - s.y[j - 2] - s.x[i] + s.x[i - 1]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    return _density(r, f) * (t.missed_a * s.inv_a[i] + t.false_b * s.inv_b[j] * s.inv_b[j - 1])


@njit(cache=True, error_model="numpy")
def move_21(i, j, s, t, f):
    """Two joints of A against one of B."""
    r = s.y[j] - s.y[j - 1] - s.x[i] + s.x[i - 2]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    return _density(r, f) * (t.missed_b * s.inv_b[j] + t.false_a * s.inv_a[i] * s.inv_a[i - 1])


@njit(cache=True, error_model="numpy")
def move_13(i, j, s, t, f):
    """One joint of A against three of B: two welds missed, one missed and one false, or two false."""
    r = s.y[j] - s.y[j - 3] - s.x[i] + s.x[i - 1]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    mixed = t.missed_a * t.false_b * s.inv_a[i] * (s.inv_b[j] + s.inv_b[j - 2])
    false = 2.0 * t.false_b**2 * s.inv_b[j] * s.inv_b[j - 1] * s.inv_b[j - 2]
    return _density(r, f) * (t.missed_a**2 * s.inv_a[i] + mixed + false)


@njit(cache=True, error_model="numpy")
def move_31(i, j, s, t, f):
    """Three joints of A against one of B."""
    r = s.y[j] - s.y[j - 1] - s.x[i] + s.x[i - 3]
    if abs(r) > _REACH * t.sigma:
        return 0.0
    mixed = t.missed_b * t.false_a * s.inv_b[j] * (s.inv_a[i] + s.inv_a[i - 2])
    false = 2.0 * t.false_a**2 * s.inv_a[i] * s.inv_a[i - 1] * s.inv_a[i - 2]
    return _density(r, f) * (t.missed_b**2 * s.inv_b[j] + mixed + false)


@njit(cache=True, error_model="numpy")
def move_22(i, j, s, t, f):
    """Two joints against two: weight with the weld between them one displaced weld, and with two welds that are strangers.

    Strangers are: each run missed the other's weld, each weld is false, or one is false and the other was missed.
    """
    x, y, inv_a, inv_b = s.x, s.y, s.inv_a, s.inv_b
    whole = x[i] - x[i - 2]
    r = y[j] - y[j - 2] - whole
    if abs(r) > _REACH * t.sigma:
        return 0.0, 0.0
    fit = _density(r, f)
    shift = y[j - 1] - y[j - 2] - x[i - 1] + x[i - 2]
    z = shift / t.shift_m
    pair_a, pair_b = inv_a[i] * inv_a[i - 1], inv_b[j] * inv_b[j - 1]
    same = fit * t.shifted * np.sqrt(pair_a * pair_b) / (np.pi * t.shift_m * (1.0 + z * z))
    ends = inv_a[i] * inv_b[j - 1] if shift > 0 else inv_a[i - 1] * inv_b[j]
    strangers = t.missed_a * t.missed_b * _at(s.density, abs(shift)) * ends
    strangers += t.missed_a * t.false_a * pair_a + t.missed_b * t.false_b * pair_b
    strangers += t.false_a * t.false_b * pair_a * pair_b * _at(s.density, whole)
    return same, fit * strangers


@njit(cache=True, error_model="numpy")
def move_cut(i0, j0, i, j, s, t):
    """Stretch between (i0, j0) and (i, j) replaced in place: its length is kept, and one of the new joints was cut to fit."""
    a, b = i - i0, j - j0
    r = (s.y[j] - s.y[j0]) - (s.x[i] - s.x[i0])
    if abs(r) > _FIT_M or a + b < 4 or a + b >= s.slack.size:
        return 0.0
    fit = (1.0 - _LOOSE) * student(r, s.slack[a + b], 2) + _LOOSE / (np.pi * (1.0 + r * r))
    new = np.exp(s.fresh[j] - s.fresh[j0]) * (s.closing[j] - s.closing[j0]) / b
    return t.cut * (1.0 - t.cut_more) * t.cut_more ** (a - 1) * new * fit


@njit(cache=True, error_model="numpy")
def begin(i, j, t):
    """Weight of an alignment that begins at (i, j), counted from the first welds; of one that ends, counted from the last."""
    if i == 0 or j == 0:
        return 1.0
    if i + j > 400:
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
