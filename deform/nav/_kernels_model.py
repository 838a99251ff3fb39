"""Numba kernels of the error model: an epoch and a state in, transition, process noise and the odometer's displacement out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.geometry._kernels_earth import EARTH_RATE, gravity, radii
from deform.geometry._kernels_rotation import rotate
from deform.nav._kernels import (
    ATTITUDE_TIME,
    ATTITUDE_TRAVEL,
    BRIDGED_PUSH,
    BRIDGED_TURN,
    COLUMNS,
    DURATION,
    FORCE_BY_AXIS,
    FORCE_BY_SHEAR,
    GAP,
    GAP_BOW,
    GAP_EXPECTED,
    GAP_TRAVEL,
    GAP_TURN,
    POSITION,
    SENSE,
    TRAVEL,
    TURN_BY_AXIS,
    TURN_BY_SHEAR,
    VELOCITY,
)
from deform.nav._kernels_state import (
    B_ACCEL_BIAS,
    B_ACCEL_SCALE,
    B_ACCEL_SHEAR,
    B_DELAY,
    B_DISTANCE,
    B_GYRO_BIAS,
    B_GYRO_SCALE,
    B_GYRO_SHEAR,
    B_LEAN,
    B_LEVER,
    B_MEAN,
    B_MOUNTING,
    B_SAG,
    B_SCALE,
    B_TILT,
    B_WOBBLE,
    BANDS,
    DELAY,
    LEAN,
    LEVER,
    MATRIX,
    MEAN,
    MOUNTING,
    SAG,
    SCALE,
    TILT,
    WAVES,
    WOBBLE,
)

GAP_REACH = 0.01  # share of the travel in a gap by which the wheels, or the tool's own wobble, may mislead there
SUMS = {"reassoc", "contract", "nsz"}  # sums may be taken in another order, nothing else: NaN and infinity keep their rules


# Slots of the errors of the sensors: how many states, and where the row of an epoch holds their Jacobian
GYRO_BLOCKS = ((B_GYRO_BIAS, 3, ATTITUDE_TIME), (B_GYRO_SCALE, 3, TURN_BY_AXIS), (B_GYRO_SHEAR, 3, TURN_BY_SHEAR))
ACCEL_BLOCKS = ((B_ACCEL_BIAS, 3, ATTITUDE_TIME), (B_ACCEL_SCALE, 3, FORCE_BY_AXIS), (B_ACCEL_SHEAR, 5, FORCE_BY_SHEAR))


@njit(cache=True, error_model="numpy")
def block(F, r, c, size, C, row, start, factor):
    """F[r:r+3, c:c+size] = factor * C @ (3 x size block of the row)."""
    for i in range(3):
        for j in range(size):
            b0, b1, b2 = row[start + j], row[start + size + j], row[start + 2 * size + j]
            F[r + i, c + j] = factor * (C[i, 0] * b0 + C[i, 1] * b1 + C[i, 2] * b2)


@njit(cache=True, error_model="numpy")
def block_cross(F, r, c, size, f0, f1, f2, factor):
    """F[r:r+3, c:c+size] = factor * [f ×] @ F[6:9, c:c+size]."""
    for j in range(c, c + size):
        b0, b1, b2 = F[6, j], F[7, j], F[8, j]
        F[r, j] = factor * (f1 * b2 - f2 * b1)
        F[r + 1, j] = factor * (f2 * b0 - f0 * b2)
        F[r + 2, j] = factor * (f0 * b1 - f1 * b0)


@njit(cache=True, error_model="numpy")
def transition(row, x, at, F):
    """Fill F (9 or more, n): rows of the transition of the navigated states. ``row`` is corrected for the state's biases."""
    F[:, :] = 0.0
    T = row[DURATION]
    C = x[MATRIX : MATRIX + 9].reshape((3, 3))
    v0, v1, v2 = rotate(C, row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2])
    p0, p1, p2 = rotate(C, row[POSITION], row[POSITION + 1], row[POSITION + 2])
    if row[TRAVEL] == 0.0:  # at rest nothing pushes aside: the sensors' noise would pass for a force seen from another azimuth
        v0 = v1 = p0 = p1 = 0.0
    latitude, height = x[0], x[2]
    meridian, normal = radii(latitude)
    meridian += height
    normal += height
    north = row[SENSE] * EARTH_RATE * math.cos(latitude)
    up = row[SENSE] * EARTH_RATE * math.sin(latitude)
    around = x[3] / normal
    t0, t1, t2 = -x[4] / meridian, around, around * math.tan(latitude)
    for i in range(9):
        F[i, i] = 1.0
    # position
    F[0, 3] = F[1, 4] = F[2, 5] = T
    F[0, 7], F[0, 8], F[1, 6], F[1, 8], F[2, 6], F[2, 7] = p2, -p1, -p2, p0, p1, -p0
    # velocity
    c0, c1, c2 = t0, t1 + 2.0 * north, t2 + 2.0 * up
    F[3, 4], F[3, 5], F[4, 3], F[4, 5], F[5, 3], F[5, 4] = c2 * T, -c1 * T, -c2 * T, c0 * T, c1 * T, -c0 * T
    F[3, 7], F[3, 8], F[4, 6], F[4, 8], F[5, 6], F[5, 7] = v2, -v1, -v2, v0, v1, -v0
    F[5, 2] = 2.0 * gravity(latitude, height) / 6.371e6 * T
    # attitude
    z0, z1, z2 = t0 * T, (t1 + north) * T, (t2 + up) * T
    F[6, 7], F[6, 8], F[7, 6], F[7, 8], F[8, 6], F[8, 7] = z2, -z1, -z2, z0, z1, -z0
    F[6, 4], F[7, 3], F[8, 3] = T / meridian, -T / normal, -T * math.tan(latitude) / normal
    F[7, 1], F[8, 1] = T * up / meridian, -T * north / meridian
    for slot, size, start in GYRO_BLOCKS:
        c = at[slot]
        if c >= 0:
            block(F, 6, c, size, C, row, start, -1.0)
            block_cross(F, 3, c, size, v0, v1, v2, -0.5)
            block_cross(F, 0, c, size, v0, v1, v2, -T / 6.0)
    for slot, size, start in ACCEL_BLOCKS:
        c = at[slot]
        if c >= 0:
            block(F, 3, c, size, C, row, start, -1.0)
            block(F, 0, c, size, C, row, start, -0.5 * T)


@njit(cache=True, error_model="numpy")
def lead(row, x, at, dead, axes, J, F):
    """Rows F of the transition; of the position by the odometer's derivative J when it is ``dead`` reckoned.

    With a state of the distance since the last weld, its row follows the displacement along the tool.
    """
    transition(row, x, at, F)
    if dead:
        for i in range(3):
            for j in range(J.shape[1]):
                F[i, j] = J[i, j]
            F[i, i] += 1.0
    c = at[B_DISTANCE]
    if c >= 0:
        for j in range(J.shape[1]):
            F[c, j] = axes[0, 0] * F[0, j] + axes[0, 1] * F[1, j] + axes[0, 2] * F[2, j]
        for j in range(3):
            F[c, j] -= axes[0, j]
        F[c, c] = 1.0


@njit(cache=True, error_model="numpy")
def track_axes(row, C, axes):
    """Fill axes (3, 3) with unit vectors along the tool, to its right and level, and up across (east, north, up)."""
    t0, t1, t2 = rotate(C, row[ATTITUDE_TIME + 1], row[ATTITUDE_TIME + 4], row[ATTITUDE_TIME + 7])
    size = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
    t0, t1, t2 = t0 / size, t1 / size, t2 / size
    level = math.hypot(t0, t1)
    if level > 0.02:
        r0, r1, r2 = t1 / level, -t0 / level, 0.0
    else:  # a riser: the body's right serves
        r0, r1, r2 = C[0, 0], C[1, 0], C[2, 0]
    axes[0, 0], axes[0, 1], axes[0, 2] = t0, t1, t2
    axes[1, 0], axes[1, 1], axes[1, 2] = r0, r1, r2
    axes[2, 0], axes[2, 1], axes[2, 2] = r1 * t2 - r2 * t1, r2 * t0 - r0 * t2, r0 * t1 - r1 * t0


@njit(cache=True, error_model="numpy")
def pipe_in_tool(x, tilt):
    """Direction of the pipe against the tool's axis, to the right and up in the level frame (radian), by the state."""
    aside, rise = -x[MEAN], x[SAG] - x[MEAN + 1]
    for i in range(WAVES):
        aside += x[WOBBLE + 2 * i]
        rise += x[WOBBLE + 2 * i + 1]
    for i in range(BANDS):
        aside += x[TILT + 2 * i] * tilt[2 * i]
        rise += x[TILT + 2 * i + 1] * tilt[2 * i + 1]
    return aside, rise


@njit(cache=True, error_model="numpy")
def swing(row, C, axes):
    """Turn of the epoch to the left and upwards (radian), then its mean specific force to the right and along (m/s²)."""
    w0, w1, w2 = rotate(C, 0.5 * (row[7] - row[5]), 0.5 * (row[2] - row[6]), 0.5 * (row[3] - row[1]))
    f0, f1, f2 = rotate(C, row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2])
    per_second = 1.0 / row[DURATION] if row[DURATION] > 0.0 else 0.0
    return (
        w0 * axes[2, 0] + w1 * axes[2, 1] + w2 * axes[2, 2],
        w0 * axes[1, 0] + w1 * axes[1, 1] + w2 * axes[1, 2],
        per_second * (f0 * axes[1, 0] + f1 * axes[1, 1] + f2 * axes[1, 2]),
        per_second * (f0 * axes[0, 0] + f1 * axes[0, 1] + f2 * axes[0, 2]),
    )


@njit(cache=True, error_model="numpy")
def odometer_step(row, x, axes, speed_change, tilt, D):
    """Displacement by the odometer (east, north, up), with all that the state says of its direction and length."""
    C = x[MATRIX : MATRIX + 9].reshape((3, 3))
    k = 1.0 + x[SCALE]
    b0 = k * (row[ATTITUDE_TRAVEL] * x[MOUNTING] + row[ATTITUDE_TRAVEL + 1] + row[ATTITUDE_TRAVEL + 2] * x[MOUNTING + 1])
    b1 = k * (row[ATTITUDE_TRAVEL + 3] * x[MOUNTING] + row[ATTITUDE_TRAVEL + 4] + row[ATTITUDE_TRAVEL + 5] * x[MOUNTING + 1])
    b2 = k * (row[ATTITUDE_TRAVEL + 6] * x[MOUNTING] + row[ATTITUDE_TRAVEL + 7] + row[ATTITUDE_TRAVEL + 8] * x[MOUNTING + 1])
    d0, d1, d2 = rotate(C, b0, b1, b2)
    y = 0.5 * row[SENSE] * EARTH_RATE * row[DURATION]  # the level frame turns with the earth under the frozen one
    y1, y2 = y * math.cos(x[0]), y * math.sin(x[0])
    d0, d1, d2 = d0 - (y1 * d2 - y2 * d1), d1 - y2 * d0, d2 + y1 * d0
    late = x[DELAY] * speed_change
    aside, rise = pipe_in_tool(x, tilt)
    aside *= row[TRAVEL]
    rise *= row[TRAVEL]
    if x[LEVER] != 0.0 or x[LEAN] != 0.0 or x[LEAN + 1] != 0.0:
        left, climb, push, pull = swing(row, C, axes)
        aside += x[LEAN] * push * row[TRAVEL] - x[LEVER] * left
        rise += x[LEAN + 1] * pull * row[TRAVEL] + x[LEVER] * climb
    D[0] = d0 + late * axes[0, 0] + aside * axes[1, 0] + rise * axes[2, 0]
    D[1] = d1 + late * axes[0, 1] + aside * axes[1, 1] + rise * axes[2, 1]
    D[2] = d2 + late * axes[0, 2] + aside * axes[1, 2] + rise * axes[2, 2]


@njit(cache=True, error_model="numpy")
def odometer_rows(row, x, at, axes, speed_change, tilt, D, J):
    """Fill J (3, n), derivative of the odometer's displacement D to the error state."""
    J[:, :] = 0.0
    C = x[MATRIX : MATRIX + 9].reshape((3, 3))
    J[0, 7], J[0, 8], J[1, 6], J[1, 8], J[2, 6], J[2, 7] = D[2], -D[1], -D[2], D[0], D[1], -D[0]
    k, travel = 1.0 + x[SCALE], row[TRAVEL]
    if at[B_LEVER] >= 0:
        left, climb, push, pull = swing(row, C, axes)
        for i in range(3):
            J[i, at[B_LEVER]] = climb * axes[2, i] - left * axes[1, i]
            J[i, at[B_LEAN]] = push * travel * axes[1, i]
            J[i, at[B_LEAN] + 1] = pull * travel * axes[2, i]
    for i in range(3):
        g0 = C[i, 0] * row[ATTITUDE_TRAVEL] + C[i, 1] * row[ATTITUDE_TRAVEL + 3] + C[i, 2] * row[ATTITUDE_TRAVEL + 6]
        g1 = C[i, 0] * row[ATTITUDE_TRAVEL + 1] + C[i, 1] * row[ATTITUDE_TRAVEL + 4] + C[i, 2] * row[ATTITUDE_TRAVEL + 7]
        g2 = C[i, 0] * row[ATTITUDE_TRAVEL + 2] + C[i, 1] * row[ATTITUDE_TRAVEL + 5] + C[i, 2] * row[ATTITUDE_TRAVEL + 8]
        right, up = travel * axes[1, i], travel * axes[2, i]
        if at[B_MOUNTING] >= 0:
            J[i, at[B_MOUNTING]] = k * g0
            J[i, at[B_MOUNTING] + 1] = k * g2
        if at[B_SCALE] >= 0:
            J[i, at[B_SCALE]] = x[MOUNTING] * g0 + g1 + x[MOUNTING + 1] * g2
        if at[B_DELAY] >= 0:
            J[i, at[B_DELAY]] = speed_change * axes[0, i]
        if at[B_SAG] >= 0:
            J[i, at[B_SAG]] = up
        if at[B_WOBBLE] >= 0:
            for w in range(WAVES):
                J[i, at[B_WOBBLE] + 2 * w] = right
                J[i, at[B_WOBBLE] + 2 * w + 1] = up
        if at[B_MEAN] >= 0:
            J[i, at[B_MEAN]], J[i, at[B_MEAN] + 1] = -right, -up
        if at[B_TILT] >= 0:
            for b in range(BANDS):
                J[i, at[B_TILT] + 2 * b] = right * tilt[2 * b]
                J[i, at[B_TILT] + 2 * b + 1] = up * tilt[2 * b + 1]


@njit(cache=True, error_model="numpy")
def unit_row():
    """Row of an epoch in which the tool goes one metre straight on in no time: its displacement is the pipe's direction."""
    row = np.zeros(COLUMNS)
    for i in range(3):
        row[ATTITUDE_TIME + 4 * i] = row[ATTITUDE_TRAVEL + 4 * i] = 1.0
    row[TRAVEL] = row[SENSE] = 1.0
    return row


@njit(cache=True, error_model="numpy")
def process(row, at, walk, travel_walk, tau, reach, steady, unknown, reckoned, R, axes, decay, follows, recalls, Q, shared):
    """Fill decay and Q of an epoch, by how much each state of the wobble follows the one that drives it and the mean
    the wobble, and shared noise.

    ``walk`` variance per second, ``travel_walk`` per metre; ``tau`` correlation time and ``reach`` correlation length of a
    Gauss-Markov state (0 = none) of variance ``steady``. ``unknown``: variance per second of gap of the velocity, and per radian
    of turn of the attitude. What a gap turns the tool by is in the row; the velocity turns with it, by all that it may, and the
    path bows by what is left of a kink anywhere in it, turn times travel over the root of twelve.

    A component w of the wobble is driven by a Gauss-Markov state u of the same length l: w' = (u - w) / l, u' = -u / l + noise.
    It is smooth: a tool is longer than the short waves that a Gauss-Markov state alone would have. Its covariance is
    sigma² (1 + d / l) exp(-d / l) over a distance d (Matérn's of order 3/2). The mean m of an axis, m' = (sum of w - m) / L, is
    taken off the sum; ``recalls`` is how much of the sum it takes up in an epoch, before it decays.
    """
    n = decay.size
    T, s = row[DURATION], abs(row[TRAVEL])
    for i in range(n):
        fade = (T / tau[i] if tau[i] > 0.0 else 0.0) + (s / reach[i] if reach[i] > 0.0 else 0.0)
        decay[i] = math.exp(-fade) if fade > 0.0 else 1.0
        Q[i] = walk[i] * T + travel_walk[i] * s + steady[i] * (1.0 - decay[i] * decay[i])
    w = at[B_WOBBLE]
    for i in range(follows.size):
        f = s / reach[w + i]
        fade, follows[i] = decay[w + i] * decay[w + i], f
        Q[w + i] = steady[w + i] * (1.0 - fade * (1.0 + 2.0 * f + 2.0 * f * f))
        shared[i] = steady[w + i] * (1.0 - fade * (1.0 + 2.0 * f))
    for i in range(recalls.size):
        recalls[i] = 1.0 / decay[at[B_MEAN] + i] - 1.0
    turn = 0.0
    for j in range(9):
        turn += abs(row[TURN_BY_AXIS + j])
    for i in range(3):
        Q[6 + i] += unknown[1] * turn + row[GAP_TURN] + row[BRIDGED_TURN]
        Q[3 + i] += unknown[0] * row[GAP] + row[GAP_TURN] * (s / T) ** 2 + row[BRIDGED_PUSH]
        Q[i] += row[GAP_TRAVEL] ** 2 * (row[GAP_BOW] / 12.0 + GAP_REACH**2)
        if reckoned:
            Q[i] += R[0] * axes[0, i] ** 2 + R[1] * axes[1, i] ** 2 + R[2] * axes[2, i] ** 2


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def predict(P, F, decay, Q, W):
    """P becomes Φ P Φ' + diag(Q), Φ with the rows F for the first states and the diagonal ``decay`` for the others."""
    n, full = P.shape[0], F.shape[0]
    for i in range(full):
        for j in range(n):
            W[i, j] = 0.0
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                for j in range(n):
                    W[i, j] += f * P[k, j]
    for i in range(full):
        for j in range(i, full):
            total = 0.0
            for k in range(n):
                total += W[i, k] * F[j, k]
            P[i, j] = P[j, i] = total
        for j in range(full, n):
            P[i, j] = P[j, i] = W[i, j] * decay[j]
    for i in range(full, n):
        for j in range(i, n):
            P[i, j] = P[j, i] = P[i, j] * decay[i] * decay[j]
    for i in range(n):
        P[i, i] += Q[i]


@njit(cache=True, error_model="numpy")
def bend_gap(row, before, C, P, dx):
    """Let the path over a gap bend with the turn of the tool in it: covariance of both, and what was expected of them into dx.

    The path keeps to the mean of the directions at both ends. A turn d of the end, with C the attitude there and ``before`` that
    at the begin, moves it by half d × (travel along the end's direction).
    """
    s, q = 0.5 * row[GAP_TRAVEL], row[GAP_TURN]
    t = s * C[0, 1], s * C[1, 1], s * C[2, 1]
    B = np.array([[0.0, t[2], -t[1]], [-t[2], 0.0, t[0]], [t[1], -t[0], 0.0]])
    e = rotate(before, row[GAP_EXPECTED], row[GAP_EXPECTED + 1], row[GAP_EXPECTED + 2])
    for i in range(3):
        dx[6 + i] += e[i]
        for j in range(3):
            dx[i] += B[i, j] * e[j]
            P[i, 6 + j] += q * B[i, j]
            P[6 + j, i] += q * B[i, j]
            for k in range(3):
                P[i, j] += q * B[i, k] * B[j, k]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def adjoint_lead(adjoint, information, F, decay, U, a):
    """Take one epoch's transition back: adjoint becomes Φ' adjoint, information Φ' information Φ."""
    n, full = adjoint.size, F.shape[0]
    thirds = full - full % 3  # three rows at once: what they are added to is read and written once
    for j in range(n):
        a[j] = decay[j] * adjoint[j] if j >= full else 0.0
    for i in range(full):
        for j in range(n):
            a[j] += F[i, j] * adjoint[i]
    adjoint[:] = a
    for i in range(n):
        for j in range(n):
            U[i, j] = information[i, j] * decay[j] if j >= full else 0.0
        for k in range(0, thirds, 3):
            f, g, h = information[i, k], information[i, k + 1], information[i, k + 2]
            for j in range(n):
                U[i, j] += f * F[k, j] + g * F[k + 1, j] + h * F[k + 2, j]
        for k in range(thirds, full):
            f = information[i, k]
            for j in range(n):
                U[i, j] += f * F[k, j]
    for i in range(n):
        for j in range(n):
            information[i, j] = decay[i] * U[i, j] if i >= full else 0.0
        for k in range(0, thirds, 3):
            f, g, h = F[k, i], F[k + 1, i], F[k + 2, i]
            for j in range(n):
                information[i, j] += f * U[k, j] + g * U[k + 1, j] + h * U[k + 2, j]
        for k in range(thirds, full):
            f = F[k, i]
            for j in range(n):
                information[i, j] += f * U[k, j]
    for i in range(n):
        for j in range(i):
            information[i, j] = information[j, i]
