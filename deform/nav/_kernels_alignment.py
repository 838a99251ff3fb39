"""Numba kernels of the alignment in motion over epochs (SI, radian)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.geometry._kernels import EARTH_RATE, gravity, radii, rotate, turn_right
from deform.nav._kernels import DURATION, TURN, VELOCITY


@njit(cache=True, error_model="numpy")
def inertial_vectors(table, speeds, mounting, first_attitude, latitude, height, alpha, beta, span):
    """Fill alpha (epoch, 3), body at the start frozen in inertial space, and beta (epoch, 3), local level at the start frozen.

    alpha(t) = B v(t) - v(0) - ∫ B f dt + ∫ earth rate × v dt,  beta(t) = ∫ N g dt, attitude alpha = beta. The earth-rate term and
    the transport rate take the attitude known so far; ``span`` (epoch,) is the time since the start.
    """
    B, N = np.eye(3), np.eye(3)
    s0, s1, s2 = 0.0, 0.0, 0.0
    c0, c1, c2 = 0.0, 0.0, 0.0
    b0 = b1 = b2 = 0.0
    passed = 0.0
    m0, m1, m2 = mounting
    north, up = EARTH_RATE * math.cos(latitude), EARTH_RATE * math.sin(latitude)
    g = gravity(latitude, height)
    meridian, normal = radii(latitude)
    for k in range(table.shape[0]):
        row = table[k]
        T = row[DURATION]
        # forward velocity in the frozen body frame, then in the local level one
        u = 0.5 * (speeds[k] + speeds[k + 1])
        w0, w1, w2 = rotate(B, u * m0, u * m1, u * m2)
        e, n, _ = rotate(first_attitude, w0, w1, w2)
        o0, o1, o2 = rotate(N, 0.0, north, up)
        # earth rate in the frozen body frame
        r0 = first_attitude[0, 0] * o0 + first_attitude[1, 0] * o1 + first_attitude[2, 0] * o2
        r1 = first_attitude[0, 1] * o0 + first_attitude[1, 1] * o1 + first_attitude[2, 1] * o2
        r2 = first_attitude[0, 2] * o0 + first_attitude[1, 2] * o1 + first_attitude[2, 2] * o2
        c0, c1, c2 = c0 + T * (r1 * w2 - r2 * w1), c1 + T * (r2 * w0 - r0 * w2), c2 + T * (r0 * w1 - r1 * w0)
        f0, f1, f2 = rotate(B, row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2])
        s0, s1, s2 = s0 + f0, s1 + f1, s2 + f2
        # gravity at the middle of the epoch
        z0, z1, z2 = -n / meridian, north + e / normal, up + e / normal * math.tan(latitude)
        turn_right(N, 0.5 * T * z0, 0.5 * T * z1, 0.5 * T * z2)
        b0, b1, b2 = b0 - g * T * N[0, 2], b1 - g * T * N[1, 2], b2 - g * T * N[2, 2]
        turn_right(N, 0.5 * T * z0, 0.5 * T * z1, 0.5 * T * z2)
        for i in range(3):
            x, y, z = B[i, 0], B[i, 1], B[i, 2]
            for j in range(3):
                B[i, j] = x * row[TURN + j] + y * row[TURN + 3 + j] + z * row[TURN + 6 + j]
        passed += T
        span[k] = passed
        v0, v1, v2 = rotate(B, speeds[k + 1] * m0, speeds[k + 1] * m1, speeds[k + 1] * m2)
        alpha[k, 0] = v0 - speeds[0] * m0 - s0 + c0
        alpha[k, 1] = v1 - speeds[0] * m1 - s1 + c1
        alpha[k, 2] = v2 - speeds[0] * m2 - s2 + c2
        beta[k, 0], beta[k, 1], beta[k, 2] = b0, b1, b2
