"""Loops of the caliper room: running means over scans, unrest of arms, filling of clock bins, scores of beads and steps."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def departures(residual, half, dip, dip_arm, bulge, bulge_arm):
    """Greatest inward and outward departure of each scan after a running mean over 2 half + 1 scans of each arm.

    residual (n, arms) m, positive outward, NaN where missing; dip and bulge (n) m, both positive, and their arms are written.
    """
    n, arms = residual.shape
    sums, counts = np.zeros(arms), np.zeros(arms)
    for i in range(-half, n):
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
        if i < 0:
            continue
        dip[i], dip_arm[i], bulge[i], bulge_arm[i] = -np.inf, -1, -np.inf, -1
        for a in range(arms):
            if counts[a] > 0.5:
                mean = sums[a] / counts[a]
                if -mean > dip[i]:
                    dip[i], dip_arm[i] = -mean, a
                if mean > bulge[i]:
                    bulge[i], bulge_arm[i] = mean, a


@njit(cache=True, error_model="numpy")
def unrest(radius, use, step, count):
    """Mean size of the step from scan to scan of each arm, over scans in use; step and count (arms) are written."""
    n, arms = radius.shape
    for a in range(arms):
        step[a] = count[a] = 0.0
    for i in range(1, n):
        if use[i] and use[i - 1]:
            for a in range(arms):
                change = abs(radius[i, a] - radius[i - 1, a])
                if not np.isnan(change):
                    step[a] += change
                    count[a] += 1.0
    for a in range(arms):
        step[a] /= max(count[a], 1.0)


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
