"""Numba kernels of the smoother: what the filter kept in, states from all data, sigmas and slopes of the likelihood out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.nav._kernels import COLUMNS, GAP, PARAMETERS, correct_row
from deform.nav._kernels_filter import OTHER
from deform.nav._kernels_model import (
    SUMS,
    adjoint_lead,
    lead,
    odometer_rows,
    odometer_step,
    process,
    track_axes,
)
from deform.nav._kernels_state import (
    B_DISTANCE,
    B_SWAY,
    B_WOBBLE,
    MATRIX,
    NAVIGATED,
    WAVES,
    adjoint_begin_anew,
    feed_back,
)
from deform.nav._kernels_wobble import adjoint_drive_wobble, follow_rows, slope_of_mean

PARAMETERS_EVERY = 10  # bounds between two sigmas of the instruments' parameters; in between the last one holds


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def adjoint_measure(adjoint, information, H, K, innovation, s, g):
    """Take one scalar measurement back: adjoint (n) and information (n, n) before it from those behind it.

    Returns the slope of the log-likelihood to the measurement's variance, ½ (u² - D) of Koopman's smoothing of disturbances.
    """
    n = adjoint.size
    along, square = 0.0, 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += information[i, j] * K[j]
        g[i] = total
    for i in range(n):
        along += K[i] * adjoint[i]
        square += K[i] * g[i]
    push = along + innovation / s
    weight = square + 1.0 / s
    for i in range(n):
        adjoint[i] -= H[i] * push
    for j in range(n):
        g[j] -= 0.5 * weight * H[j]
    for i in range(n):
        h, q = H[i], g[i]
        for j in range(n):
            information[i, j] -= h * g[j] + q * H[j]
    return 0.5 * (push * push - weight)


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def smoothed_sigma(P, information, wanted, sigma):
    """Fill sigma of the first ``wanted`` states: root of the diagonal of P - P information P."""
    n = P.shape[0]
    for i in range(0, wanted, 3):  # three rows at once; the last ones may come twice
        k, m = min(i + 1, wanted - 1), min(i + 2, wanted - 1)
        a, b, c = 0.0, 0.0, 0.0
        for r in range(n):
            p, q, s = 0.0, 0.0, 0.0
            for j in range(n):
                push = information[r, j]
                p += P[i, j] * push
                q += P[k, j] * push
                s += P[m, j] * push
            a += p * P[i, r]
            b += q * P[k, r]
            c += s * P[m, r]
        sigma[i] = math.sqrt(max(P[i, i] - a, 0.0))
        sigma[k] = math.sqrt(max(P[k, k] - b, 0.0))
        sigma[m] = math.sqrt(max(P[m, m] - c, 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def backward(first, last, travel, span, noise, buffers, adjoint, information, smooth, sigma, pull, drive, recalled):
    """Smooth the bounds ``first`` ... ``last`` from the buffers of `forward`; adjoint and information come from behind ``last``.

    Modified Bryson-Frazier: x_s = x - P adjoint, P_s = P - P information P, with both behind the measurements of the bound.
    Fills smooth (bound, STATE_COLUMNS) and sigma (bound, n); neither when smooth has no rows.

    Slopes of the log-likelihood: ``pull`` (epoch, 3) to the variances of the displacement, ``drive`` (n,) to the logarithm of
    each state's process noise (Koopman 1993; Koopman and Shephard 1992), ``recalled`` (2,) to those of the lengths of the mean of
    the wobble, right and up; none when pull has no rows.
    """
    table, speeds, tilts, R, _ = travel
    begins = span[2]
    at, reckoned, walk, travel_walk, tau, reach, steady, unknown = noise
    xs, Ps, counts, Hs, Ks, news, offsets = buffers
    n, full = adjoint.size, NAVIGATED + (1 if at[B_DISTANCE] >= 0 else 0)
    F, J, D, axes, row = np.empty((full, n)), np.empty((3, n)), np.empty(3), np.empty((3, 3)), np.empty(COLUMNS)
    decay, Q, dx, g, a, U = np.ones(n), np.zeros(n), np.zeros(n), np.empty(n), np.empty(n), np.empty((n, n))
    follows, shared = np.zeros((2, 2 * WAVES if at[B_WOBBLE] >= 0 else 0))
    recalls = np.zeros(2 if at[B_WOBBLE] >= 0 else 0)
    wanted, learns = smooth.shape[0] > 0, pull.shape[0] > 0
    for k in range(last, first - 1, -1):
        b = k - first
        x, P = xs[b], Ps[b]
        if k < table.shape[0]:
            change, tilt = speeds[k + 1] - speeds[k], tilts[k]
            correct_row(table[k], x[15 : 15 + PARAMETERS], row)
            track_axes(row, x[MATRIX : MATRIX + 9].reshape((3, 3)), axes)
            odometer_step(row, x, axes, change, tilt, D)
            odometer_rows(row, x, at, axes, change, tilt, D, J)
            lead(row, x, at, reckoned or row[GAP] > 0.0, axes, J, F)
            process(
                row, at, walk, travel_walk, tau, reach, steady, unknown, reckoned, R[k], axes, decay, follows, recalls, Q, shared
            )
            follow_rows(F, at, follows, recalls)
            if learns:
                for i in range(n):
                    drive[i] += 0.5 * (adjoint[i] * adjoint[i] - information[i, i]) * Q[i]
                for i in range(shared.size):
                    w, u = at[B_WOBBLE] + i, at[B_SWAY] + i
                    drive[u] += (adjoint[w] * adjoint[u] - information[w, u]) * shared[i]
                if recalls.size > 0:
                    slope_of_mean(x, P, adjoint, information, at, row, F, decay, reach, follows, recalls, g, a, recalled)
            adjoint_lead(adjoint, information, F, decay, U, a)
            adjoint_drive_wobble(adjoint, information, at, follows, recalls)
        if begins.size > 0 and begins[k] > 0:
            adjoint_begin_anew(adjoint, information, at, begins[k])
        if wanted:
            for i in range(n):
                total = offsets[b, i]
                for j in range(n):
                    total -= P[i, j] * adjoint[j]
                dx[i] = total
            due = k % PARAMETERS_EVERY == 0 or k >= table.shape[0]
            smoothed_sigma(P, information, n if due else NAVIGATED, sigma[k])
            if not due:
                sigma[k, NAVIGATED:] = sigma[k + 1, NAVIGATED:]
            smooth[k] = x
            feed_back(smooth[k], dx, at)
        for j in range(counts[b] - 1, -1, -1):
            slope = adjoint_measure(adjoint, information, Hs[b, j], Ks[b, j], news[b, j, 0], news[b, j, 1], g)
            if learns and news[b, j, 2] != OTHER:
                pull[k, int(news[b, j, 2])] = slope
