"""Numba kernels of the smoother: what the filter kept in, states from all data, sigmas and slopes of the likelihood out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.nav._kernels import COLUMNS, GAP, PARAMETERS, TRAVEL, correct_row
from deform.nav._kernels_filter import OTHER
from deform.nav._kernels_model import (
    SUMS,
    adjoint_drive_wobble,
    adjoint_lead,
    follow_rows,
    lead,
    odometer_rows,
    odometer_step,
    process,
    track_axes,
)
from deform.nav._kernels_state import (
    B_DISTANCE,
    B_MEAN,
    B_SWAY,
    B_WOBBLE,
    MATRIX,
    MEAN,
    NAVIGATED,
    WAVES,
    WOBBLE,
    adjoint_begin_anew,
    feed_back,
)

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
    for i in range(n):
        ahead, across = H[i] * weight - g[i], -H[i]
        for j in range(n):
            information[i, j] += ahead * H[j] + across * g[j]
    return 0.5 * (push * push - weight)


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def smoothed_sigma(P, information, wanted, g, sigma):
    """Fill sigma of the first ``wanted`` states: root of the diagonal of P - P information P."""
    n = P.shape[0]
    for i in range(wanted):
        for j in range(n):
            g[j] = 0.0
        for m in range(n):
            for j in range(n):
                g[j] += P[i, m] * information[m, j]
        taken = 0.0
        for j in range(n):
            taken += g[j] * P[i, j]
        sigma[i] = math.sqrt(max(P[i, i] - taken, 0.0))


@njit(cache=True, error_model="numpy")
def slope_of_mean(x, P, adjoint, information, at, row, F, decay, reach, follows, recalls, v, q, recalled):
    """Add to ``recalled`` (2,) the slope of the log-likelihood to the logarithm of the length of the wobble's mean, right and up.

    The mean m goes to d m + (1 - d) w, d = exp(-s / length): its slope to d is that of the state along m - w.
    """
    n, full, m, first = adjoint.size, F.shape[0], at[B_MEAN], at[B_WOBBLE]
    for c in range(2):
        known = x[MEAN + c]
        for j in range(n):
            v[j] = P[m + c, j]
        for i in range(c, follows.size, 2):
            known -= x[WOBBLE + i]
            for j in range(n):
                v[j] -= P[first + i, j]
        for i in range(follows.size):
            v[m + i % 2] += recalls[i % 2] * v[first + i]
            v[first + i] += follows[i] * v[at[B_SWAY] + i]
        for i in range(n):
            q[i] = decay[i] * v[i]
        for i in range(full):
            q[i] = 0.0
            for j in range(n):
                q[i] += F[i, j] * v[j]
        total = -adjoint[m + c] * known
        for j in range(n):
            total += (adjoint[m + c] * adjoint[j] - information[m + c, j]) * q[j]
        recalled[c] += total * decay[m + c] * abs(row[TRAVEL]) / reach[m + c]


@njit(cache=True, error_model="numpy", nogil=True)
def backward(first, last, travel, span, noise, buffers, adjoint, information, smooth, sigma, pull, drive, recalled):
    """Smooth the bounds ``first`` ... ``last`` from the buffers of `forward`; adjoint and information come from behind ``last``.

    Modified Bryson-Frazier: x_s = x - P adjoint, P_s = P - P information P, with both behind the measurements of the bound.
    Fills smooth (bound, STATE_COLUMNS) and sigma (bound, n); neither when smooth has no rows.

    Slopes of the log-likelihood: ``pull`` (epoch, 3) to the variances of the displacement, ``drive`` (n,) to the logarithm of
    each state's process noise (Koopman 1993; Koopman and Shephard 1992), ``recalled`` (2,) to those of the lengths of the mean of
    the wobble, right and up; none when pull has no rows.
    """
    table, speeds, tilts, R = travel
    _, _, begins = span
    at, reckoned, walk, travel_walk, tau, reach, steady, unknown = noise
    xs, Ps, counts, Hs, Ks, news = buffers
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
                total = 0.0
                for j in range(n):
                    total -= P[i, j] * adjoint[j]
                dx[i] = total
            due = k % PARAMETERS_EVERY == 0 or k >= table.shape[0]
            smoothed_sigma(P, information, n if due else NAVIGATED, g, sigma[k])
            if not due:
                sigma[k, NAVIGATED:] = sigma[k + 1, NAVIGATED:]
            smooth[k] = x
            feed_back(smooth[k], dx, at)
        for j in range(counts[b] - 1, -1, -1):
            slope = adjoint_measure(adjoint, information, Hs[b, j], Ks[b, j], news[b, j, 0], news[b, j, 1], g)
            if learns and news[b, j, 2] != OTHER:
                pull[k, int(news[b, j, 2])] = slope
