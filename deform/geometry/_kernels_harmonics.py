"""Rings of ranges in, their robust harmonics out: offset, mean radius and oval of millions of scans."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from deform.geometry._kernels_solve import backward, biweights, cholesky, forward

BLOCK = 256  # scans that share scratch
_ROUNDS = 12
_OFF = 4.0  # sigma: a scan whose readings all lie nearer is clean and needs no weights


@njit(cache=True, error_model="numpy", parallel=True)
def fit_harmonics(radius, basis, inverse, sigma, least_arms, harmonics, residual, spread, used):
    """Fit radius = basis @ harmonics scan by scan; readings that stand off lose their weight by Tukey's biweight.

    radius (n, arms) m, NaN where an arm gave nothing; basis (arms, k); inverse (k, arms) its pseudo-inverse; results are
    written into harmonics (n, k), residual (n, arms), spread (n) and used (n, the sum of the weights).
    """
    n, arms = radius.shape
    size = basis.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        normal = np.empty((size, size))
        vectors = np.empty((4, size))
        work = np.empty((3, arms))
        index = np.empty(arms, np.int64)
        for i in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            there = 0
            for a in range(arms):
                if not np.isnan(radius[i, a]):
                    index[there] = a
                    there += 1
            if there < least_arms:
                for k in range(size):
                    harmonics[i, k] = np.nan
                for a in range(arms):
                    residual[i, a] = np.nan
                spread[i], used[i] = np.nan, 0.0
                continue
            good, used[i] = _fit_one(radius[i], basis, inverse, sigma, index, there, normal, vectors, work)
            squares, freedom = 0.0, -float(size)
            for a in range(arms):
                value = radius[i, a]
                for k in range(size):
                    value -= basis[a, k] * vectors[0, k]
                residual[i, a] = value
                if abs(value) < _OFF * sigma:
                    squares += value * value
                    freedom += 1.0
            for k in range(size):
                harmonics[i, k] = vectors[0, k] if good else np.nan
            spread[i] = np.sqrt(squares / max(freedom, 1.0))


@njit(cache=True, error_model="numpy")
def _fit_one(radius, basis, inverse, sigma, index, there, normal, vectors, work):
    """Solve one scan into vectors[0]; return whether it could be solved, and the sum of the weights."""
    arms, size = basis.shape
    solution, before, right, scale = vectors[0], vectors[1], vectors[2], vectors[3]
    squares, weight = work[0], work[1]
    for j in range(there):
        weight[j] = 1.0
    good = True
    if there == arms:
        for k in range(size):
            solution[k] = 0.0
            for a in range(arms):
                solution[k] += inverse[k, a] * radius[a]
    else:
        good = _weighted(radius, basis, weight, index, there, normal, right, scale, solution)
    total = float(there)
    for _ in range(_ROUNDS):
        largest = 0.0
        for j in range(there):
            value = radius[index[j]]
            for k in range(size):
                value -= basis[index[j], k] * solution[k]
            squares[j] = value * value
            largest = max(largest, squares[j])
        if largest < (_OFF * sigma) ** 2 or not good:
            break
        total = biweights(squares, there, sigma, weight, work[2])
        for k in range(size):
            before[k] = solution[k]
        good = _weighted(radius, basis, weight, index, there, normal, right, scale, solution)
        change = 0.0
        for k in range(size):
            change = max(change, abs(solution[k] - before[k]))
        if change < 0.01 * sigma:
            break
    return good, total


@njit(cache=True, error_model="numpy")
def _weighted(radius, basis, weight, index, there, normal, right, scale, solution):
    """Weighted least squares of one scan; False when the arms with weight cannot tell the harmonics."""
    size = basis.shape[1]
    for k in range(size):
        right[k] = 0.0
        for m in range(k + 1):
            normal[k, m] = 0.0
    for j in range(there):
        a = index[j]
        for k in range(size):
            part = weight[j] * basis[a, k]
            right[k] += part * radius[a]
            for m in range(k + 1):
                normal[k, m] += part * basis[a, m]
    if not normal[0, 0] > 0.0:
        return False
    for k in range(size):  # to a unit weight in total, so that the test for singularity means the same for all
        for m in range(k + 1):
            normal[k, m] /= there
        right[k] /= there
    if not cholesky(normal, scale, size):
        return False
    forward(normal, scale, right, size)
    backward(normal, scale, right, size)
    for k in range(size):
        solution[k] = right[k]
    return True
