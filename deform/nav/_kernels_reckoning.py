"""Numba kernels of dead reckoning over epochs (SI, radian)."""

from __future__ import annotations

import math

from numba import njit

from deform.geometry._kernels_rotation import rotate, rotate_back, turn_left
from deform.nav._kernels import ATTITUDE_TRAVEL, DURATION, SENSE, TURN, navigation_rates, shift_place


@njit(cache=True, error_model="numpy")
def led_vertical(table, up, earth, out):
    """Fill out (epoch, 3) with the vertical in body axes at the begin of each epoch: turned by the gyros, and with the earth."""
    v0, v1, v2 = up[0], up[1], up[2]
    e0, e1, e2 = earth[0], earth[1], earth[2]
    for k in range(table.shape[0]):
        out[k, 0], out[k, 1], out[k, 2] = v0, v1, v2
        turn, T = table[k, TURN : TURN + 9].reshape((3, 3)), table[k, DURATION]
        moved = v0 + T * (e1 * v2 - e2 * v1), v1 + T * (e2 * v0 - e0 * v2), v2 + T * (e0 * v1 - e1 * v0)
        v0, v1, v2 = rotate_back(turn, moved[0], moved[1], moved[2])
        e0, e1, e2 = rotate_back(turn, e0, e1, e2)


@njit(cache=True, error_model="numpy")
def reckon(table, place, C, mounting, scale, places, attitudes, steps):
    """Fill places (epoch + 1, 3), attitudes (epoch + 1, 3, 3) and steps (epoch, 3) east, north, up.

    ``mounting`` is the direction of travel in body axes.
    """
    places[0] = place
    attitudes[0] = C
    for k in range(table.shape[0]):
        row, C0, C1 = table[k], attitudes[k], attitudes[k + 1]
        b0, b1, b2 = 0.0, 0.0, 0.0
        for j in range(3):
            b0 += row[ATTITUDE_TRAVEL + j] * mounting[j]
            b1 += row[ATTITUDE_TRAVEL + 3 + j] * mounting[j]
            b2 += row[ATTITUDE_TRAVEL + 6 + j] * mounting[j]
        s0, s1, s2 = rotate(C0, scale * b0, scale * b1, scale * b2)
        T = row[DURATION]
        north, up, t0, t1, t2, _, _ = navigation_rates(places[k, 0], places[k, 2], s0 / T, s1 / T, row[SENSE])
        z0, z1, z2 = 0.5 * T * t0, 0.5 * T * (t1 + north), 0.5 * T * (t2 + up)  # the level frame turns under the frozen one
        s0, s1, s2 = s0 - (z1 * s2 - z2 * s1), s1 - (z2 * s0 - z0 * s2), s2 - (z0 * s1 - z1 * s0)
        steps[k, 0], steps[k, 1], steps[k, 2] = s0, s1, s2
        for j in range(3):
            places[k + 1, j] = places[k, j]
        shift_place(places[k + 1], s0, s1, s2)
        north, up, t0, t1, t2, _, _ = navigation_rates(
            0.5 * (places[k, 0] + places[k + 1, 0]), places[k, 2], s0 / T, s1 / T, row[SENSE]
        )
        for i in range(3):
            for j in range(3):
                C1[i, j] = C0[i, 0] * row[j] + C0[i, 1] * row[3 + j] + C0[i, 2] * row[6 + j]
        turn_left(C1, -t0 * T, -(t1 + north) * T, -(t2 + up) * T)


@njit(cache=True, error_model="numpy")
def turned(steps, azimuth, pitch, scale, out):
    """Steps (n, 3) with azimuth and pitch of each turned by small angles (radian) and its length scaled."""
    for k in range(steps.shape[0]):
        e, n, u = steps[k, 0], steps[k, 1], steps[k, 2]
        level = math.hypot(e, n)
        length = math.hypot(level, u) * (1.0 + scale)
        if length == 0.0:
            out[k, :] = 0.0
            continue
        a, p = math.atan2(e, n) + azimuth, math.atan2(u, level) + pitch
        out[k, 0], out[k, 1], out[k, 2] = (
            length * math.sin(a) * math.cos(p),
            length * math.cos(a) * math.cos(p),
            length * math.sin(p),
        )
