"""Numba kernel of the trajectory: counts and smoothed states at the epochs in, the samples between them out (SI, radian)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from deform.geometry._kernels_rotation import rotate, turn_left, turn_right
from deform.nav._kernels import (
    COLUMNS,
    DURATION,
    GAP,
    GAP_EXPECTED,
    PARAMETERS,
    POSITION,
    SENSE,
    TURN,
    VELOCITY,
    advance,
    bridged,
    correct_row,
    increments,
    levelled_turn,
    place_difference,
    shift_place,
    steady_push,
    two_sample,
)
from deform.nav._kernels_state import turn_of
from deform.run.stamps import MOST_BRIDGED, lost_before


@njit(cache=True, error_model="numpy", parallel=True)
def expand(time, gyro, accel, gyro_pulse, accel_pulse, K, bounds, usual, table, states, spread, wanted, offsets, out):
    """Fill out (10 + q, output): place, velocity, azimuth, pitch, roll, speed, and the columns of ``spread`` (bound, q), led
    on linearly between the bounds.

    ``states`` (epoch + 1, 35 or more): place, velocity, matrix, parameters of both triads at the bounds.
    ``wanted`` are sample indices, ``offsets[k]`` the first of them at or behind bounds[k]. Inside an epoch the counts are
    integrated from its beginning; what then is missing at its end is laid on linearly.
    """
    for k in prange(bounds.size - 1):
        state, following = states[k], states[k + 1]
        row, end = np.empty(COLUMNS), np.empty(COLUMNS)
        place, v, C = state[0:3], state[3:6], state[6:15].copy().reshape((3, 3))
        place_end, v_end, C_end = np.empty(3), np.empty(3), np.empty((3, 3))
        correct_row(table[k], state[15 : 15 + PARAMETERS], end)
        if table[k, GAP] > 0.0:  # of a gap the turn that was expected; what the states have instead is left over
            turn_left(end[TURN : TURN + 9].reshape((3, 3)), end[GAP_EXPECTED], end[GAP_EXPECTED + 1], end[GAP_EXPECTED + 2])
        advance(end, place, v, C, place_end, v_end, C_end)
        e0, e1, e2 = place_difference(following[0:3], place_end)
        u0, u1, u2 = following[3] - v_end[0], following[4] - v_end[1], following[5] - v_end[2]
        D = np.empty((3, 3))  # left over turn: C_following = D C_end
        for i in range(3):
            for j in range(3):
                D[i, j] = (
                    following[6 + 3 * i] * C_end[j, 0] + following[7 + 3 * i] * C_end[j, 1] + following[8 + 3 * i] * C_end[j, 2]
                )
        r0, r1, r2 = turn_of(D)
        total = table[k, DURATION]
        row[:] = 0.0
        row[SENSE] = 1.0
        R = np.eye(3)
        v0 = v1 = v2 = x0 = x1 = x2 = passed = 0.0
        first = bounds[k]
        dt = max(time[first] - time[first - 1], 1e-9) if first > 0 else 1.0
        p0, p1, p2, b0, b1, b2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, first, dt)
        if first == 0:
            p0 = p1 = p2 = b0 = b1 = b2 = 0.0
        n = offsets[k]
        stop = offsets[k + 1] if k < bounds.size - 2 else wanted.size
        for i in range(first, bounds[k + 1] + 1):
            if n >= stop:
                break
            if i > first:
                dt = time[i] - time[i - 1]
                lost = lost_before(time, i, usual)
                g0, g1, g2, a0, a1, a2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, i, dt if lost == 0 else usual)
                if lost > MOST_BRIDGED:
                    share = dt / usual
                    d0, d1, d2 = steady_push(gyro, accel, gyro_pulse, accel_pulse, K, i, usual)
                    s0, s1, s2 = levelled_turn(time, gyro, accel, gyro_pulse, accel_pulse, K, i, usual, d0, d1, d2)
                    d0, d1, d2 = d0 * share, d1 * share, d2 * share
                    g0 = g1 = g2 = p0 = p1 = p2 = 0.0
                else:
                    n0, n1, n2, c0, c1, c2 = g0, g1, g2, a0, a1, a2
                    g0, g1, g2, a0, a1, a2 = bridged(lost, g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2)
                    s0, s1, s2, d0, d1, d2 = two_sample(g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2)
                    p0, p1, p2, b0, b1, b2 = n0, n1, n2, c0, c1, c2
                    s0 -= state[15] * dt + state[21] * g0 + state[29] * g2
                    s1 -= state[16] * dt + state[22] * g1 + state[27] * g0 + state[28] * g2
                    s2 -= state[17] * dt + state[23] * g2
                    d0 -= state[18] * dt + state[24] * a0 + state[30] * a2 + state[33] * a1
                    d1 -= state[19] * dt + state[25] * a1 + state[31] * a0 + state[32] * a2
                    d2 -= state[20] * dt + state[26] * a2 + state[30] * a0 + state[34] * a1
                w0, w1, w2 = rotate(R, d0, d1, d2)
                x0 += dt * (v0 + 0.5 * w0)
                x1 += dt * (v1 + 0.5 * w1)
                x2 += dt * (v2 + 0.5 * w2)
                v0, v1, v2 = v0 + w0, v1 + w1, v2 + w2
                turn_right(R, s0, s1, s2)
                passed += dt
            if i != wanted[n]:
                continue
            for j in range(9):
                row[TURN + j] = R[j // 3, j % 3]
            row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2] = v0, v1, v2
            row[POSITION], row[POSITION + 1], row[POSITION + 2] = x0, x1, x2
            row[DURATION] = max(passed, 1e-9)
            advance(row, place, v, C, place_end, v_end, C_end)
            w = passed / total if total > 0.0 else 0.0
            shift_place(place_end, w * e0, w * e1, w * e2)
            turn_left(C_end, w * r0, w * r1, w * r2)
            for j in range(3):
                out[j, n] = place_end[j]
            v_end[0], v_end[1], v_end[2] = v_end[0] + w * u0, v_end[1] + w * u1, v_end[2] + w * u2
            out[3, n], out[4, n], out[5, n] = v_end[0], v_end[1], v_end[2]
            out[6, n] = math.atan2(C_end[0, 1], C_end[1, 1])
            out[7, n] = math.atan2(C_end[2, 1], math.hypot(C_end[0, 1], C_end[1, 1]))
            out[8, n] = math.atan2(-C_end[2, 0], C_end[2, 2])
            out[9, n] = math.sqrt(v_end[0] * v_end[0] + v_end[1] * v_end[1] + v_end[2] * v_end[2])
            for j in range(spread.shape[1]):
                out[10 + j, n] = spread[k, j] + w * (spread[k + 1, j] - spread[k, j])
            n += 1
