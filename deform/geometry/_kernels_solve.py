"""Small normal equations in, their solution out; and the biweights by which points that stand off lose their say.

Whole rows are written element by element: a slice drags numba's texts of errors in, seconds of compiling.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TUKEY = 4.685  # width of the biweight in sigma: 95 % efficient on clean data (Holland and Welsch 1977)
TINY = 1e-14  # a pivot that is no greater belongs to a singular matrix


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def cholesky(normal, inverse, size):
    """Factor the lower triangle in place, 1 / diagonal into ``inverse``; False when it is not positive definite."""
    for i in range(size):
        for j in range(i + 1):
            value = normal[i, j]
            for k in range(j):
                value -= normal[i, k] * normal[j, k]
            if i == j:
                if not value > TINY:
                    return False
                normal[i, i] = np.sqrt(value)
                inverse[i] = 1.0 / normal[i, i]
            else:
                normal[i, j] = value * inverse[j]
    return True


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def forward(factor, inverse, right, size):
    """Solve with the lower factor, in place."""
    for i in range(size):
        value = right[i]
        for k in range(i):
            value -= factor[i, k] * right[k]
        right[i] = value * inverse[i]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def backward(factor, inverse, right, size):
    """Solve with the transposed lower factor, in place."""
    for i in range(size - 1, -1, -1):
        value = right[i]
        for k in range(i + 1, size):
            value -= factor[k, i] * right[k]
        right[i] = value * inverse[i]


@njit(cache=True, error_model="numpy")
def _partition(values, count, k):
    """Order the first ``count`` values so that the k-th stands in its place and none before it is greater."""
    low, high = 0, count - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break


@njit(cache=True, error_model="numpy")
def median_of_roots(squares, count, work):
    """Median of the square roots of the first ``count`` values; ``work`` is overwritten."""
    for i in range(count):
        work[i] = squares[i]
    k = count // 2
    _partition(work, count, k)
    upper = np.sqrt(work[k])
    if count % 2:
        return upper
    lower = work[0]
    for i in range(1, k):
        lower = max(lower, work[i])
    return 0.5 * (np.sqrt(lower) + upper)


@njit(cache=True, error_model="numpy")
def biweights(squares, count, least, weight, work):
    """Tukey's biweights of squared misclosures, their scale no smaller than ``least`` squared; return the sum of the weights."""
    width = (TUKEY * max(least, 1.4826 * median_of_roots(squares, count, work))) ** 2
    total = 0.0
    for i in range(count):
        part = squares[i] / width
        weight[i] = (1.0 - part) ** 2 if part < 1.0 else 0.0
        total += weight[i]
    return total
