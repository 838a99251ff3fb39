"""Loops of the caliper room: robust harmonics of millions of scans, running means over scans, filling of clock bins."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

TUKEY = 4.685  # width of the biweight in sigma: 95 % efficient on clean data (Holland and Welsch 1977)
_UNKNOWNS = 5
_ROUNDS = 12


@njit(cache=True, error_model="numpy")
def _solve(normal, right, solution):
    """Cholesky solution of the 5 x 5 normal equations in place; False when they are singular."""
    n = _UNKNOWNS
    for i in range(n):
        for j in range(i + 1):
            value = normal[i, j]
            for k in range(j):
                value -= normal[i, k] * normal[j, k]
            if i == j:
                if value <= 1e-9:
                    return False
                normal[i, i] = np.sqrt(value)
            else:
                normal[i, j] = value / normal[j, j]
    for i in range(n):
        value = right[i]
        for k in range(i):
            value -= normal[i, k] * solution[k]
        solution[i] = value / normal[i, i]
    for i in range(n - 1, -1, -1):
        value = solution[i]
        for k in range(i + 1, n):
            value -= normal[k, i] * solution[k]
        solution[i] = value / normal[i, i]
    return True


@njit(cache=True, error_model="numpy")
def _median_size(values, count, work):
    """Median of the absolute values of the first ``count`` entries."""
    for i in range(count):
        work[i] = abs(values[i])
    part = np.sort(work[:count])
    middle = count // 2
    return part[middle] if count % 2 else 0.5 * (part[middle - 1] + part[middle])


@njit(cache=True, error_model="numpy", parallel=True)
def fit_scans(radius, basis, inverse, sigma, least_arms, harmonics, residual, spread, used):
    """Fit radius = basis @ harmonics scan by scan; dents lose their weight by Tukey's biweight.

    radius (n, arms) m, NaN where an arm gave nothing; basis (arms, 5); inverse (5, arms) its pseudo-inverse; results are
    written into harmonics (n, 5), residual (n, arms), spread (n) and used (n, the sum of the weights).
    """
    n, arms = radius.shape
    for i in prange(n):
        normal = np.empty((_UNKNOWNS, _UNKNOWNS))
        right = np.empty(_UNKNOWNS)
        solution = np.empty(_UNKNOWNS)
        work, sizes = np.empty(arms), np.empty(arms)
        there = 0
        for a in range(arms):
            if not np.isnan(radius[i, a]):
                there += 1
        if there < least_arms:
            for k in range(_UNKNOWNS):
                harmonics[i, k] = np.nan
            for a in range(arms):
                residual[i, a] = np.nan
            spread[i], used[i] = np.nan, 0.0
            continue
        good = True
        if there == arms:
            for k in range(_UNKNOWNS):
                value = 0.0
                for a in range(arms):
                    value += inverse[k, a] * radius[i, a]
                solution[k] = value
        else:
            for k in range(_UNKNOWNS):
                right[k] = 0.0
                for m in range(_UNKNOWNS):
                    normal[k, m] = 0.0
            for a in range(arms):
                if np.isnan(radius[i, a]):
                    continue
                for k in range(_UNKNOWNS):
                    right[k] += basis[a, k] * radius[i, a]
                    for m in range(k + 1):
                        normal[k, m] += basis[a, k] * basis[a, m]
            good = _solve(normal, right, solution)
        total = float(there)
        for _ in range(_ROUNDS):
            largest, count = 0.0, 0
            for a in range(arms):
                value = radius[i, a]
                for k in range(_UNKNOWNS):
                    value -= basis[a, k] * solution[k]
                residual[i, a] = value
                if not np.isnan(value):
                    sizes[count] = value
                    count += 1
                    largest = max(largest, abs(value))
            if largest < 4.0 * sigma or not good:
                break
            width = TUKEY * max(sigma, 1.4826 * _median_size(sizes, count, work))
            total = 0.0
            for k in range(_UNKNOWNS):
                right[k] = 0.0
                for m in range(_UNKNOWNS):
                    normal[k, m] = 0.0
            for a in range(arms):
                value = residual[i, a] / width
                if np.isnan(value) or abs(value) >= 1.0:
                    continue
                weight = (1.0 - value * value) ** 2
                total += weight
                for k in range(_UNKNOWNS):
                    part = weight * basis[a, k]
                    right[k] += part * radius[i, a]
                    for m in range(k + 1):
                        normal[k, m] += part * basis[a, m]
            before = solution.copy()
            good = _solve(normal, right, solution)
            change = 0.0
            for k in range(_UNKNOWNS):
                change = max(change, abs(solution[k] - before[k]))
            if change < 0.01 * sigma:
                break
        squares, freedom = 0.0, -5.0
        for a in range(arms):
            value = radius[i, a]
            for k in range(_UNKNOWNS):
                value -= basis[a, k] * solution[k]
            residual[i, a] = value
            if not np.isnan(value) and abs(value) < 4.0 * sigma:
                squares += value * value
                freedom += 1.0
        for k in range(_UNKNOWNS):
            harmonics[i, k] = solution[k] if good else np.nan
        spread[i] = np.sqrt(squares / max(freedom, 1.0))
        used[i] = total


@njit(cache=True, error_model="numpy")
def inward_running(residual, half, depth, arm):
    """Greatest inward departure of each scan after a running mean over 2 half + 1 scans of each arm.

    residual (n, arms) m, NaN where missing; depth (n) m (positive inward) and arm (n) are written.
    """
    n, arms = residual.shape
    sums, counts = np.zeros(arms), np.zeros(arms)
    for j in range(min(half, n)):
        for a in range(arms):
            if not np.isnan(residual[j, a]):
                sums[a] += residual[j, a]
                counts[a] += 1.0
    for i in range(n):
        if i + half < n:
            for a in range(arms):
                if not np.isnan(residual[i + half, a]):
                    sums[a] += residual[i + half, a]
                    counts[a] += 1.0
        if i - half - 1 >= 0:
            for a in range(arms):
                if not np.isnan(residual[i - half - 1, a]):
                    sums[a] -= residual[i - half - 1, a]
                    counts[a] -= 1.0
        deepest, where = -np.inf, -1
        for a in range(arms):
            if counts[a] > 0.5 and -sums[a] / counts[a] > deepest:
                deepest, where = -sums[a] / counts[a], a
        depth[i], arm[i] = deepest, where


@njit(cache=True, error_model="numpy")
def fill_bins(row, angle, sign, roll, radius, right, up, bins, total, count):
    """Add scans to rows of clock bins: radius from the section's centre, linear between neighbouring arms.

    row (n) index of the row of each scan, -1 to leave it out; angle (arms) rad, rising; sign and roll (n) rad give the
    clock sign * (angle + roll); right, up (n) m centre of the section seen from the tool axis; bins: number of bins;
    total, count (rows, bins) are added to.
    """
    n, arms = radius.shape
    clock, size = np.empty(arms), np.empty(arms)
    step = 2.0 * np.pi / bins
    for i in range(n):
        if row[i] < 0 or np.isnan(right[i]):
            continue
        m = 0
        for a in range(arms):
            value = radius[i, a]
            if np.isnan(value):
                continue
            phi = sign * (angle[a] + roll[i])
            x, z = value * np.sin(phi) - right[i], value * np.cos(phi) - up[i]
            clock[m], size[m] = np.arctan2(x, z), np.sqrt(x * x + z * z)
            m += 1
        for k in range(m):
            first, second = (k, (k + 1) % m) if sign > 0 else ((k + 1) % m, k)
            start, span = clock[first], clock[second] - clock[first]
            span -= 2.0 * np.pi * np.floor(span / (2.0 * np.pi))
            if span <= 0.0 or span > 1.0:
                continue
            b = int(np.ceil(start / step))
            while b * step - start < span:
                part = (b * step - start) / span
                total[row[i], b % bins] += (1.0 - part) * size[first] + part * size[second]
                count[row[i], b % bins] += 1.0
                b += 1


@njit(cache=True, error_model="numpy")
def bead_and_step(place, radius, noise, bead_half, flank, bead, step):
    """Score each scan as weld bead and as wall step, in sigma; place must rise.

    The flanks reach from bead_half to flank (m) on either side. bead: how far the scan stands in over both flanks;
    step: how far the two flanks differ; both are divided by their own standard deviation for independent noise.
    """
    n = place.size
    sums, squares = np.empty(n + 1), np.empty(n + 1)
    sums[0] = squares[0] = 0.0
    middle = radius[n // 2]
    for i in range(n):
        sums[i + 1] = sums[i] + radius[i] - middle
    a = b = c = d = 0
    for i in range(n):
        while place[a] < place[i] - flank:
            a += 1
        while place[b] < place[i] - bead_half:
            b += 1
        while c < n and place[c] <= place[i] + bead_half:
            c += 1
        while d < n and place[d] <= place[i] + flank:
            d += 1
        left, right = b - a, d - c
        bead[i] = step[i] = 0.0
        if left < 2 or right < 2:
            continue
        before = (sums[b] - sums[a]) / left + middle
        behind = (sums[d] - sums[c]) / right + middle
        bead[i] = (min(before, behind) - radius[i]) / (noise * np.sqrt(1.0 + 1.0 / min(left, right)))
        step[i] = abs(behind - before) / (noise * np.sqrt(1.0 / left + 1.0 / right))
