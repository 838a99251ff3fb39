"""Numba kernels of the filter's state: its layout, and errors, resets and the passage of time taken into it (SI, radian)."""

from __future__ import annotations

import math

from numba import njit

from deform.geometry._kernels_rotation import turn_left
from deform.nav._kernels import place_difference, shift_place

WAVES = 3  # components of the wobble, each with a length of its own and a state that drives it
BANDS = 2  # wave bands of the tilt seen by the arms, each believed by its own share

# Columns of a state: place at 0, velocity at 3, matrix, then the parameters in the order of the slots.
MATRIX, GYRO_BIAS, ACCEL_BIAS, GYRO_SCALE, ACCEL_SCALE = 6, 15, 18, 21, 24
GYRO_SHEAR, ACCEL_SHEAR, MOUNTING, SCALE, DELAY, SAG, WOBBLE = 27, 30, 35, 37, 38, 39, 40
SWAY = WOBBLE + 2 * WAVES
MEAN = SWAY + 2 * WAVES
TILT = MEAN + 2
DISTANCE = TILT + 2 * BANDS
COURSE = DISTANCE + 1
LEVER = COURSE + 1
LEAN = LEVER + 1
STATE_COLUMNS = LEAN + 2

NAVIGATED = 9  # error states of position, velocity, attitude

# Slots of the error state behind the navigated nine; `at` holds the index of the first state of each, or -1.
B_GYRO_BIAS, B_ACCEL_BIAS, B_GYRO_SCALE, B_ACCEL_SCALE, B_GYRO_SHEAR, B_ACCEL_SHEAR, B_MOUNTING = 0, 1, 2, 3, 4, 5, 6
B_SCALE, B_DELAY, B_SAG, B_WOBBLE, B_SWAY, B_MEAN, B_TILT, B_DISTANCE, B_COURSE = 7, 8, 9, 10, 11, 12, 13, 14, 15
B_LEVER, B_LEAN, BLOCKS = 16, 17, 18
COLUMN_OF = (
    *(GYRO_BIAS, ACCEL_BIAS, GYRO_SCALE, ACCEL_SCALE, GYRO_SHEAR, ACCEL_SHEAR, MOUNTING),
    *(SCALE, DELAY, SAG, WOBBLE, SWAY, MEAN, TILT, DISTANCE, COURSE, LEVER, LEAN),
)
SIZE_OF = (3, 3, 3, 3, 3, 5, 2, 1, 1, 1, 2 * WAVES, 2 * WAVES, 2, 2 * BANDS, 1, 1, 1, 2)

RESET_DISTANCE, RESET_COURSE = 1, 2  # flags of what begins anew behind a bound's measurements
COURSE_VARIANCE = math.radians(30.0) ** 2  # of the azimuth of a straight stretch before it is seen


@njit(cache=True, error_model="numpy")
def feed_back(x, dx, at):
    """Take the errors dx into the state x."""
    shift_place(x[0:3], dx[0], dx[1], dx[2])
    x[3] += dx[3]
    x[4] += dx[4]
    x[5] += dx[5]
    turn_left(x[MATRIX : MATRIX + 9].reshape((3, 3)), dx[6], dx[7], dx[8])
    for b in range(BLOCKS):
        if at[b] >= 0:
            for j in range(SIZE_OF[b]):
                x[COLUMN_OF[b] + j] += dx[at[b] + j]


@njit(cache=True, error_model="numpy")
def turn_of(D):
    """Rotation vector of a matrix that turns by less than half a turn."""
    s0, s1, s2 = 0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])
    sine = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    angle = math.atan2(sine, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))
    stretch = angle / sine if sine > 1e-12 else 1.0
    return stretch * s0, stretch * s1, stretch * s2


@njit(cache=True, error_model="numpy")
def errors_from(x, base, at, dx):
    """Fill dx with the errors that `feed_back` would take into ``base`` to make it the state x."""
    dx[0], dx[1], dx[2] = place_difference(x[0:3], base[0:3])
    for i in range(3):
        dx[3 + i] = x[3 + i] - base[3 + i]
    C, B = x[MATRIX : MATRIX + 9].reshape((3, 3)), base[MATRIX : MATRIX + 9].reshape((3, 3))
    dx[6], dx[7], dx[8] = turn_of(C @ B.T)
    for b in range(BLOCKS):
        if at[b] >= 0:
            for j in range(SIZE_OF[b]):
                dx[at[b] + j] = x[COLUMN_OF[b] + j] - base[COLUMN_OF[b] + j]


@njit(cache=True, error_model="numpy")
def follow(x, place, v, C, step, axes, decay, follows, recalls, at):
    """State at the end of an epoch from what was mechanized, ``step`` its displacement; Gauss-Markov parameters fade."""
    x[0], x[1], x[2] = place[0], place[1], place[2]
    x[3], x[4], x[5] = v[0], v[1], v[2]
    for i in range(3):
        for j in range(3):
            x[MATRIX + 3 * i + j] = C[i, j]
    for i in range(follows.size):
        x[MEAN + i % 2] += recalls[i % 2] * x[WOBBLE + i]
        x[WOBBLE + i] += follows[i] * x[SWAY + i]
    for b in range(BLOCKS):
        if at[b] >= 0:
            for j in range(SIZE_OF[b]):
                x[COLUMN_OF[b] + j] *= decay[at[b] + j]
    x[DISTANCE] += axes[0, 0] * step[0] + axes[0, 1] * step[1] + axes[0, 2] * step[2]


@njit(cache=True, error_model="numpy")
def begin_anew(x, P, at, flags, course):
    """Distance since the last weld from zero, azimuth of a straight stretch from ``course`` with an open variance."""
    if flags & RESET_DISTANCE and at[B_DISTANCE] >= 0:
        x[DISTANCE] = 0.0
        forget(P, at[B_DISTANCE], 0.0)
    if flags & RESET_COURSE and at[B_COURSE] >= 0:
        x[COURSE] = course
        forget(P, at[B_COURSE], COURSE_VARIANCE)


@njit(cache=True, error_model="numpy")
def begin_errors_anew(dx, at, flags):
    """What begins anew has no error against the state that `begin_anew` gave it."""
    if flags & RESET_DISTANCE and at[B_DISTANCE] >= 0:
        dx[at[B_DISTANCE]] = 0.0
    if flags & RESET_COURSE and at[B_COURSE] >= 0:
        dx[at[B_COURSE]] = 0.0


@njit(cache=True, error_model="numpy")
def forget(P, i, variance):
    """Make state i independent of all others, with a variance."""
    for j in range(P.shape[0]):
        P[i, j] = P[j, i] = 0.0
    P[i, i] = variance


@njit(cache=True, error_model="numpy")
def adjoint_begin_anew(adjoint, information, at, flags):
    """Take `begin_anew` back: what lies behind a reset says nothing about the state before it."""
    if flags & RESET_DISTANCE and at[B_DISTANCE] >= 0:
        adjoint[at[B_DISTANCE]] = 0.0
        forget(information, at[B_DISTANCE], 0.0)
    if flags & RESET_COURSE and at[B_COURSE] >= 0:
        adjoint[at[B_COURSE]] = 0.0
        forget(information, at[B_COURSE], 0.0)
