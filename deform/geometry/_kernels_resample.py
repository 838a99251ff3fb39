"""Values on one axis in, values on another out: the jitted floor of `resample`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def find_interval(x, axis, i):
    """Interval i with axis[i] <= x < axis[i + 1], by walking from a guess, by bisection when it lies far."""
    last = axis.size - 2
    i = min(max(i, 0), last)
    for _ in range(8):
        if x < axis[i]:
            if i == 0:
                return 0
            i -= 1
        elif x >= axis[i + 1]:
            if i == last:
                return last
            i += 1
        else:
            return i
    low, high = 0, last
    while low < high:
        middle = (low + high + 1) // 2
        if axis[middle] <= x:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, error_model="numpy")
def interpolate(x, axis, values, period, out):
    """Fill out (n, k) with values (m, k) between the points of a rising axis, NaN outside; period 0 = no angle."""
    i = 0
    for n in range(x.size):
        if not (axis[0] <= x[n] <= axis[-1]):
            for k in range(values.shape[1]):
                out[n, k] = np.nan
            continue
        i = find_interval(x[n], axis, i)
        part = (x[n] - axis[i]) / (axis[i + 1] - axis[i])
        for k in range(values.shape[1]):
            if part == 0.0 or part == 1.0:  # a gap beside a good point does not reach over it
                out[n, k] = values[i, k] if part == 0.0 else values[i + 1, k]
                continue
            step = values[i + 1, k] - values[i, k]
            if period > 0.0:
                step -= period * math.floor(step / period + 0.5)
            out[n, k] = values[i, k] + part * step


@njit(cache=True, error_model="numpy")
def cumulative(axis, values, out):
    """Fill out (m, k) with the integral of the broken line from the first point on; NaN stretches add nothing."""
    for k in range(values.shape[1]):
        out[0, k] = 0.0
    for i in range(1, axis.size):
        half = 0.5 * (axis[i] - axis[i - 1])
        for k in range(values.shape[1]):
            area = half * (values[i, k] + values[i - 1, k])
            out[i, k] = out[i - 1, k] + (area if area == area else 0.0)


@njit(cache=True, error_model="numpy")
def integral_at(x, i, axis, values, integral, k):
    """Integral of the broken line from its first point to x, which lies in interval i."""
    d = x - axis[i]
    slope = (values[i + 1, k] - values[i, k]) / (axis[i + 1] - axis[i])
    return integral[i, k] + d * (values[i, k] + 0.5 * d * slope)


@njit(cache=True, error_model="numpy")
def box_average(centre, length, axis, values, integral, gaps, out):
    """Fill out (n, k) with the mean over the box about each centre; NaN where it leaves the axis or meets a gap."""
    low = high = 0
    slack = 1e-9 * (axis[-1] - axis[0])
    for n in range(centre.size):
        begin, end = centre[n] - 0.5 * length, centre[n] + 0.5 * length
        if not (begin >= axis[0] - slack and end <= axis[-1] + slack):
            for k in range(values.shape[1]):
                out[n, k] = np.nan
            continue
        begin, end = max(begin, axis[0]), min(end, axis[-1])
        low, high = find_interval(begin, axis, low), find_interval(end, axis, high)
        last = high + 1 if end > axis[high] else high
        for k in range(values.shape[1]):
            if gaps[last, k] - (gaps[low - 1, k] if low > 0 else 0) > 0:
                out[n, k] = np.nan
                continue
            area = integral_at(end, high, axis, values, integral, k) if last > high else integral[high, k]
            out[n, k] = (area - integral_at(begin, low, axis, values, integral, k)) / length
