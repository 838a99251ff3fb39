"""Plain twins of the loops of the caliper room."""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def robust_section(radius, basis, sigma, rounds=12, tukey=4.685):
    """Harmonics of one scan by iterated weighted least squares."""
    there = np.isfinite(radius)
    basis, radius = basis[there], radius[there]
    solution = np.linalg.lstsq(basis, radius, rcond=None)[0]
    for _ in range(rounds):
        residual = radius - basis @ solution
        if np.abs(residual).max() < 4 * sigma:
            break
        width = tukey * max(sigma, 1.4826 * np.median(np.abs(residual)))
        root = np.clip(1 - (residual / width) ** 2, 0, None)
        before, solution = solution, np.linalg.lstsq(basis * root[:, None], radius * root, rcond=None)[0]
        if np.abs(solution - before).max() < 0.01 * sigma:
            break
    return solution


def inward_running(residual, half):
    """Greatest inward mean over 2 half + 1 scans, and its arm."""
    n = len(residual)
    depth, arm = np.empty(n), np.empty(n, int)
    for i in range(n):
        mean = -np.nanmean(residual[max(0, i - half) : i + half + 1], axis=0)
        arm[i] = np.nanargmax(mean)
        depth[i] = mean[arm[i]]
    return depth, arm


def bead_and_step(place, radius, noise, bead_half, flank):
    """Scores of a bead and of a step at each scan."""
    bead, step = np.zeros(len(place)), np.zeros(len(place))
    for i, at in enumerate(place):
        left = radius[(place >= at - flank) & (place < at - bead_half)]
        right = radius[(place > at + bead_half) & (place <= at + flank)]
        if len(left) < 2 or len(right) < 2:
            continue
        bead[i] = (min(left.mean(), right.mean()) - radius[i]) / (noise * np.sqrt(1 + 1 / min(len(left), len(right))))
        step[i] = abs(right.mean() - left.mean()) / (noise * np.sqrt(1 / len(left) + 1 / len(right)))
    return bead, step


def chain(place, odds, score):
    """Posterior of each candidate by summing over all subsets; ``score`` is the log of a joint of that length."""
    n = len(place)
    total, share = 0.0, np.zeros(n)
    for subset in range(1, 2**n):
        chosen = [k for k in range(n) if subset >> k & 1]
        value = sum(odds[k] for k in chosen) + sum(float(score(np.array([place[b] - place[a]]))[0]) for a, b in pairwise(chosen))
        weight = np.exp(value)
        total += weight
        share[chosen] += weight
    return share / total
