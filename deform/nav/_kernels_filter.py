"""Numba kernels of filter and smoother over epochs: table, aids and first state in, states with covariance out (SI, radian)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.geometry._kernels import EARTH_RATE, gravity, radii, rotate, turn_left
from deform.nav._kernels import (
    ATTITUDE_TIME,
    ATTITUDE_TRAVEL,
    COLUMNS,
    DURATION,
    FORCE_BY_AXIS,
    GAP,
    POSITION,
    SENSE,
    TRAVEL,
    TURN_BY_AXIS,
    VELOCITY,
    advance,
    correct_row,
    place_difference,
    shift_place,
)

# Columns of a state: place, velocity, matrix, then the instrument's parameters.
PLACE, VELOCITY_AT, MATRIX, GYRO_BIAS, ACCEL_BIAS, GYRO_SCALE, ACCEL_SCALE = 0, 3, 6, 15, 18, 21, 24
MOUNTING, SCALE, DELAY, SAG, WOBBLE, TILT, STATE_COLUMNS = 27, 29, 30, 31, 32, 36, 38
NAVIGATED = 9  # error states with full rows in the transition: position, velocity, attitude

# Blocks of the error state behind the navigated nine: place of the first in the vector, or -1.
BLOCKS = 10
B_GYRO_BIAS, B_ACCEL_BIAS, B_GYRO_SCALE, B_ACCEL_SCALE, B_MOUNTING, B_SCALE, B_DELAY, B_SAG, B_WOBBLE, B_TILT = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    8,
    9,
)

SUMS = {"reassoc", "contract", "nsz"}  # sums may be taken in another order, nothing else: NaN and infinity keep their rules
PARAMETERS_EVERY = 10  # bounds between two sigmas of the instruments' parameters; in between the last one holds
MOST_SCALARS = 12  # scalar measurements at one epoch: 3 of travel, 3 of each of up to three marks


@njit(cache=True, error_model="numpy")
def block3(F, r, c, C, row, start, factor):
    """F[r:r+3, c:c+3] = factor * C @ (3 x 3 block of the row)."""
    for i in range(3):
        for j in range(3):
            F[r + i, c + j] = factor * (C[i, 0] * row[start + j] + C[i, 1] * row[start + 3 + j] + C[i, 2] * row[start + 6 + j])


@njit(cache=True, error_model="numpy")
def block3_cross(F, r, c, f0, f1, f2, base, factor):
    """F[r:r+3, c:c+3] = factor * [f ×] @ base."""
    for j in range(3):
        b0, b1, b2 = base[0, j], base[1, j], base[2, j]
        F[r, c + j] = factor * (f1 * b2 - f2 * b1)
        F[r + 1, c + j] = factor * (f2 * b0 - f0 * b2)
        F[r + 2, c + j] = factor * (f0 * b1 - f1 * b0)


@njit(cache=True, error_model="numpy")
def transition(row, x, at, F, J, D):
    """Fill F (9, n), rows of the transition of the navigated states, and J (3, n), derivative of the odometer's displacement.

    ``row`` is corrected for the state's biases, ``D`` is the odometer's displacement; `travel_parameters` adds to J.
    """
    F[:, :] = 0.0
    J[:, :] = 0.0
    T = row[DURATION]
    C = x[MATRIX : MATRIX + 9].reshape((3, 3))
    v0, v1, v2 = rotate(C, row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2])
    p0, p1, p2 = rotate(C, row[POSITION], row[POSITION + 1], row[POSITION + 2])
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
    base = np.empty((3, 3))
    for b in range(2):  # gyro bias, gyro scale
        c = at[B_GYRO_BIAS] if b == 0 else at[B_GYRO_SCALE]
        if c >= 0:
            block3(F, 6, c, C, row, ATTITUDE_TIME if b == 0 else TURN_BY_AXIS, -1.0)
            for i in range(3):
                for j in range(3):
                    base[i, j] = F[6 + i, c + j]
            block3_cross(F, 3, c, v0, v1, v2, base, -0.5)
            block3_cross(F, 0, c, v0, v1, v2, base, -T / 6.0)
    for b in range(2):  # accelerometer bias, accelerometer scale
        c = at[B_ACCEL_BIAS] if b == 0 else at[B_ACCEL_SCALE]
        if c >= 0:
            block3(F, 3, c, C, row, ATTITUDE_TIME if b == 0 else FORCE_BY_AXIS, -1.0)
            block3(F, 0, c, C, row, ATTITUDE_TIME if b == 0 else FORCE_BY_AXIS, -0.5 * T)
    # the odometer's displacement
    J[0, 7], J[0, 8], J[1, 6], J[1, 8], J[2, 6], J[2, 7] = D[2], -D[1], -D[2], D[0], D[1], -D[0]
    k = 1.0 + x[SCALE]
    for i in range(3):
        g0 = C[i, 0] * row[ATTITUDE_TRAVEL] + C[i, 1] * row[ATTITUDE_TRAVEL + 3] + C[i, 2] * row[ATTITUDE_TRAVEL + 6]
        g1 = C[i, 0] * row[ATTITUDE_TRAVEL + 1] + C[i, 1] * row[ATTITUDE_TRAVEL + 4] + C[i, 2] * row[ATTITUDE_TRAVEL + 7]
        g2 = C[i, 0] * row[ATTITUDE_TRAVEL + 2] + C[i, 1] * row[ATTITUDE_TRAVEL + 5] + C[i, 2] * row[ATTITUDE_TRAVEL + 8]
        if at[B_MOUNTING] >= 0:
            J[i, at[B_MOUNTING]] = k * g0
            J[i, at[B_MOUNTING] + 1] = k * g2
        if at[B_SCALE] >= 0:
            J[i, at[B_SCALE]] = x[MOUNTING] * g0 + g1 + x[MOUNTING + 1] * g2


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
    aside = (x[WOBBLE] + x[TILT] * tilt[0]) * row[TRAVEL]
    rise = (x[SAG] + x[WOBBLE + 1] + x[TILT + 1] * tilt[1]) * row[TRAVEL]
    D[0] = d0 + late * axes[0, 0] + aside * axes[1, 0] + rise * axes[2, 0]
    D[1] = d1 + late * axes[0, 1] + aside * axes[1, 1] + rise * axes[2, 1]
    D[2] = d2 + late * axes[0, 2] + aside * axes[1, 2] + rise * axes[2, 2]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def scalar_update(P, dx, H, z, R, gate, K):
    """One scalar measurement z = H dx + noise, in Joseph's form; beyond ``gate`` sigma its variance grows with the innovation.

    Returns the innovation, its variance as used, its variance before any growth. K is filled with the gain.

    Joseph's (I - K H) P (I - K H)' + K R K' is, with h = P H' and s = H h + R, the same as P - K h' - h K' + s K K', which
    stays symmetric and, whatever K is, positive.
    """
    n = dx.size
    s, innovation = R, z
    for i in range(n):
        h = 0.0
        for j in range(n):
            h += P[i, j] * H[j]
        K[i] = h
    for j in range(n):
        s += H[j] * K[j]
        innovation -= H[j] * dx[j]
    expected = s
    if gate > 0.0 and innovation * innovation > gate * gate * s:
        s = abs(innovation) * math.sqrt(s) / gate if abs(innovation) < 3.0 * gate * math.sqrt(s) else innovation * innovation
        s = max(s, expected)
    for i in range(n):
        k = K[i] / s
        dx[i] += k * innovation
    for i in range(n):
        ki = K[i] / s
        for j in range(i, n):
            P[i, j] -= ki * K[j]
            P[j, i] = P[i, j]
    for i in range(n):
        K[i] /= s
    return innovation, s, expected


@njit(cache=True, error_model="numpy")
def feed_back(x, dx, at):
    """Take the errors dx into the state x."""
    shift_place(x[0:3], dx[0], dx[1], dx[2])
    x[3] += dx[3]
    x[4] += dx[4]
    x[5] += dx[5]
    turn_left(x[MATRIX : MATRIX + 9].reshape((3, 3)), dx[6], dx[7], dx[8])
    for j in range(3):
        if at[B_GYRO_BIAS] >= 0:
            x[GYRO_BIAS + j] += dx[at[B_GYRO_BIAS] + j]
        if at[B_ACCEL_BIAS] >= 0:
            x[ACCEL_BIAS + j] += dx[at[B_ACCEL_BIAS] + j]
        if at[B_GYRO_SCALE] >= 0:
            x[GYRO_SCALE + j] += dx[at[B_GYRO_SCALE] + j]
        if at[B_ACCEL_SCALE] >= 0:
            x[ACCEL_SCALE + j] += dx[at[B_ACCEL_SCALE] + j]
    if at[B_MOUNTING] >= 0:
        x[MOUNTING] += dx[at[B_MOUNTING]]
        x[MOUNTING + 1] += dx[at[B_MOUNTING] + 1]
    if at[B_SCALE] >= 0:
        x[SCALE] += dx[at[B_SCALE]]
    if at[B_DELAY] >= 0:
        x[DELAY] += dx[at[B_DELAY]]
    if at[B_SAG] >= 0:
        x[SAG] += dx[at[B_SAG]]
    if at[B_WOBBLE] >= 0:
        for j in range(4):
            x[WOBBLE + j] += dx[at[B_WOBBLE] + j]
    if at[B_TILT] >= 0:
        x[TILT] += dx[at[B_TILT]]
        x[TILT + 1] += dx[at[B_TILT] + 1]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def predict(P, F, decay, Q, W):
    """P becomes Φ P Φ' + diag(Q), Φ with rows F for the navigated states and the diagonal ``decay`` for the others."""
    n = P.shape[0]
    for i in range(NAVIGATED):
        for j in range(n):
            W[i, j] = 0.0
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                for j in range(n):
                    W[i, j] += f * P[k, j]
    for i in range(NAVIGATED):
        for j in range(i, NAVIGATED):
            total = 0.0
            for k in range(n):
                total += W[i, k] * F[j, k]
            P[i, j] = P[j, i] = total
        for j in range(NAVIGATED, n):
            P[i, j] = P[j, i] = W[i, j] * decay[j]
    for i in range(NAVIGATED, n):
        for j in range(i, n):
            P[i, j] = P[j, i] = P[i, j] * decay[i] * decay[j]
    for i in range(n):
        P[i, i] += Q[i]


@njit(cache=True, error_model="numpy")
def sway_matrix(d, reach):
    """Transition of wobble and slope over a distance d: covariance s² (1 + d / l) exp(-d / l), smooth as a tool is long."""
    b = 1.0 / reach
    e = math.exp(-b * d)
    return e * (1.0 + b * d), e * d, -e * b * b * d, e * (1.0 - b * d)


@njit(cache=True, error_model="numpy")
def sway(x, P, w, d, reach, steady):
    """Lead the wobble (right, up at index w, their slopes at w + 2) on over a distance d, in state and covariance."""
    n = P.shape[0]
    for c in range(2):
        i, j = w + c, w + 2 + c
        a00, a01, a10, a11 = sway_matrix(d, reach[i])
        value, slope = x[WOBBLE + c], x[WOBBLE + 2 + c]
        x[WOBBLE + c], x[WOBBLE + 2 + c] = a00 * value + a01 * slope, a10 * value + a11 * slope
        for m in range(n):
            p, q = P[i, m], P[j, m]
            P[i, m], P[j, m] = a00 * p + a01 * q, a10 * p + a11 * q
        for m in range(n):
            p, q = P[m, i], P[m, j]
            P[m, i], P[m, j] = a00 * p + a01 * q, a10 * p + a11 * q
        v, u = steady[i], steady[j]
        P[i, i] += v - (a00 * a00 * v + a01 * a01 * u)
        P[j, j] += u - (a10 * a10 * v + a11 * a11 * u)
        cross = a00 * a10 * v + a01 * a11 * u
        P[i, j] -= cross
        P[j, i] -= cross


@njit(cache=True, error_model="numpy")
def adjoint_sway(adjoint, information, w, d, reach):
    """Take `sway` back: the transposed transition on adjoint and information."""
    n = adjoint.size
    for c in range(2):
        i, j = w + c, w + 2 + c
        a00, a01, a10, a11 = sway_matrix(d, reach[i])
        p, q = adjoint[i], adjoint[j]
        adjoint[i], adjoint[j] = a00 * p + a10 * q, a01 * p + a11 * q
        for m in range(n):
            p, q = information[i, m], information[j, m]
            information[i, m], information[j, m] = a00 * p + a10 * q, a01 * p + a11 * q
        for m in range(n):
            p, q = information[m, i], information[m, j]
            information[m, i], information[m, j] = a00 * p + a10 * q, a01 * p + a11 * q


@njit(cache=True, error_model="numpy")
def process(row, at, walk, travel_walk, tau, steady, unknown, reckoned, R, axes, decay, Q):
    """Fill decay and Q of an epoch.

    ``walk`` variance per second, ``travel_walk`` per metre, ``tau`` correlation time of a Gauss-Markov state (0 = none) of
    variance ``steady``; the wobble is led on by `sway`. ``unknown``: variance per second of gap of attitude and velocity,
    and per radian of turn of the attitude.
    """
    n = decay.size
    T, s = row[DURATION], abs(row[TRAVEL])
    for i in range(n):
        decay[i] = math.exp(-T / tau[i]) if tau[i] > 0.0 else 1.0
        Q[i] = walk[i] * T + travel_walk[i] * s + steady[i] * (1.0 - decay[i] * decay[i])
    turn = 0.0
    for j in range(9):
        turn += abs(row[TURN_BY_AXIS + j])
    for i in range(3):
        Q[6 + i] += unknown[2] * turn + unknown[0] * row[GAP]
        Q[3 + i] += unknown[1] * row[GAP]
        Q[i] += (0.03 * s) ** 2 if row[GAP] > 0.0 else 0.0
        if reckoned:
            Q[i] += R[0] * axes[0, i] ** 2 + R[1] * axes[1, i] ** 2 + R[2] * axes[2, i] ** 2


@njit(cache=True, error_model="numpy", nogil=True)
def forward(first, last, table, speeds, tilts, R, mark_epoch, mark_place, mark_R, mark_late, x, P, at, reckoned, gate,
            walk, travel_walk, tau, reach, steady, unknown, keep, xs, Ps, counts, Hs, Ks, news, residuals, mark_news, score,
            turned):  # fmt: skip
    """Filter the bounds ``first`` ... ``last``; x and P, the state before the first's measurements, are led on behind the last.

    With ``keep`` the state and covariance behind the measurements of each bound, and the measurements, are kept in the buffers
    (index from ``first`` on). ``residuals`` (epoch, 3) takes the innovations of the travel along, right, up and ``news``
    (.., 0) innovation (.., 1) variance used (.., 2) variance expected. ``score`` (3,) gathers the log-likelihood of the travel's
    innovations along, right, up, those beyond the gate counted at it; ``turned`` (bound, 9), when it has rows, the attitudes.
    """
    n = P.shape[0]
    F, J, W, D = np.empty((NAVIGATED, n)), np.empty((3, n)), np.empty((NAVIGATED, n)), np.empty(3)
    axes, row, H, K = np.empty((3, 3)), np.empty(COLUMNS), np.empty(n), np.empty(n)
    dx, decay, Q = np.zeros(n), np.ones(n), np.zeros(n)
    place, v, C = np.empty(3), np.empty(3), np.empty((3, 3))
    m = 0
    while m < mark_epoch.size and mark_epoch[m] < first:
        m += 1
    for k in range(first, last + 1):
        b = k - first
        used = 0
        dx[:] = 0.0
        while m < mark_epoch.size and mark_epoch[m] == k:
            e, no, u = place_difference(mark_place[m], x[0:3])
            miss = (e - x[3] * mark_late[m], no - x[4] * mark_late[m], u - x[5] * mark_late[m])
            speed = math.hypot(x[3], x[4])
            a0, a1 = (x[3] / speed, x[4] / speed) if speed > 0.05 else (x[MATRIX + 1], x[MATRIX + 4])
            size = math.hypot(a0, a1)
            a0, a1 = (a0 / size, a1 / size) if size > 1e-6 else (0.0, 1.0)
            for c in range(3):
                H[:] = 0.0
                if c == 0:
                    H[0], H[1], z = a0, a1, a0 * miss[0] + a1 * miss[1]
                elif c == 1:
                    H[0], H[1], z = a1, -a0, a1 * miss[0] - a0 * miss[1]
                else:
                    H[2], z = 1.0, miss[2]
                if used < MOST_SCALARS - 3:
                    innovation, s, expected = scalar_update(P, dx, H, z, mark_R[m, c], 0.0, K)
                    mark_news[m, c], mark_news[m, 3 + c] = innovation, expected
                    if keep:
                        Hs[b, used], Ks[b, used] = H, K
                        news[b, used, 0], news[b, used, 1], news[b, used, 2] = innovation, s, expected
                    used += 1
            m += 1
        if k < table.shape[0]:
            correct_row(table[k], x[15:18], x[18:21], x[21:24], x[24:27], row)
            C_now = x[MATRIX : MATRIX + 9].reshape((3, 3))
            track_axes(row, C_now, axes)
            odometer_step(row, x, axes, speeds[k + 1] - speeds[k], tilts[k], D)
            s0, s1, s2 = advance(row, x[0:3], x[3:6], C_now, place, v, C)
            transition(row, x, at, F, J, D)
            travel_parameters(row, at, axes, speeds[k + 1] - speeds[k], tilts[k], J)
            r0, r1, r2 = D[0] - s0, D[1] - s1, D[2] - s2
            for c in range(3):
                z = axes[c, 0] * r0 + axes[c, 1] * r1 + axes[c, 2] * r2
                for j in range(n):
                    H[j] = axes[c, 0] * (F[0, j] - J[0, j]) + axes[c, 1] * (F[1, j] - J[1, j]) + axes[c, 2] * (F[2, j] - J[2, j])
                for j in range(3):
                    H[j] = 0.0
                if R[k, c] <= 0.0:
                    residuals[k, c] = np.nan
                    continue
                innovation, s, expected = scalar_update(P, dx, H, z, R[k, c], gate, K)
                residuals[k, c] = innovation / math.sqrt(expected)
                score[c] -= 0.5 * (math.log(expected) + min(residuals[k, c] ** 2, gate * gate if gate > 0.0 else 1e300))
                if keep:
                    Hs[b, used], Ks[b, used] = H, K
                    news[b, used, 0], news[b, used, 1], news[b, used, 2] = innovation, s, expected
                used += 1
        feed_back(x, dx, at)
        if turned.shape[0] > 0:
            turned[k] = x[MATRIX : MATRIX + 9]
        if keep:
            xs[b] = x
            Ps[b] = P
            counts[b] = used
        if k >= table.shape[0]:
            break
        correct_row(table[k], x[15:18], x[18:21], x[21:24], x[24:27], row)
        C_now = x[MATRIX : MATRIX + 9].reshape((3, 3))
        track_axes(row, C_now, axes)
        odometer_step(row, x, axes, speeds[k + 1] - speeds[k], tilts[k], D)
        advance(row, x[0:3], x[3:6], C_now, place, v, C)
        dead = reckoned or row[GAP] > 0.0  # no force is known in a gap: the odometer leads the position over it
        lead(row, x, at, dead, F, J, D, axes, speeds[k + 1] - speeds[k], tilts[k])
        process(row, at, walk, travel_walk, tau, steady, unknown, reckoned, R[k], axes, decay, Q)
        predict(P, F, decay, Q, W)
        follow(x, place, v, C, D, decay, at, dead)
        if at[B_WOBBLE] >= 0:
            sway(x, P, at[B_WOBBLE], abs(row[TRAVEL]), reach, steady)


@njit(cache=True, error_model="numpy")
def travel_parameters(row, at, axes, speed_change, tilt, J):
    """Derivative of the odometer's displacement to delay, sag, wobble and the share of the arms' tilt, into J."""
    for i in range(3):
        if at[B_DELAY] >= 0:
            J[i, at[B_DELAY]] = speed_change * axes[0, i]
        if at[B_SAG] >= 0:
            J[i, at[B_SAG]] = row[TRAVEL] * axes[2, i]
        if at[B_WOBBLE] >= 0:
            J[i, at[B_WOBBLE]] = row[TRAVEL] * axes[1, i]
            J[i, at[B_WOBBLE] + 1] = row[TRAVEL] * axes[2, i]
        if at[B_TILT] >= 0:
            J[i, at[B_TILT]] = row[TRAVEL] * tilt[0] * axes[1, i]
            J[i, at[B_TILT] + 1] = row[TRAVEL] * tilt[1] * axes[2, i]


@njit(cache=True, error_model="numpy")
def lead(row, x, at, reckoned, F, J, D, axes, speed_change, tilt):
    """Rows of the transition; of the position by the odometer when it is dead-reckoned."""
    transition(row, x, at, F, J, D)
    if reckoned:
        travel_parameters(row, at, axes, speed_change, tilt, J)
        for i in range(3):
            for j in range(J.shape[1]):
                F[i, j] = J[i, j]
            F[i, i] += 1.0


@njit(cache=True, error_model="numpy")
def follow(x, place, v, C, D, decay, at, reckoned):
    """State at the end of the epoch; Gauss-Markov parameters fade."""
    if reckoned:
        shift_place(x[0:3], D[0], D[1], D[2])
    else:
        x[0], x[1], x[2] = place[0], place[1], place[2]
    x[3], x[4], x[5] = v[0], v[1], v[2]
    for i in range(3):
        for j in range(3):
            x[MATRIX + 3 * i + j] = C[i, j]
    for j in range(3):
        if at[B_GYRO_BIAS] >= 0:
            x[GYRO_BIAS + j] *= decay[at[B_GYRO_BIAS] + j]
        if at[B_ACCEL_BIAS] >= 0:
            x[ACCEL_BIAS + j] *= decay[at[B_ACCEL_BIAS] + j]
    if at[B_SCALE] >= 0:
        x[SCALE] *= decay[at[B_SCALE]]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def adjoint_measure(adjoint, information, H, K, innovation, s, g):
    """Take one scalar measurement back: adjoint (n) and information (n, n) before it from those behind it."""
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
        for j in range(i, n):
            information[i, j] += -H[i] * g[j] - g[i] * H[j] + H[i] * H[j] * weight
            information[j, i] = information[i, j]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def adjoint_lead(adjoint, information, F, decay, U, a):
    """Take one epoch's transition back: adjoint becomes Φ' adjoint, information Φ' information Φ."""
    n = adjoint.size
    for j in range(n):
        a[j] = decay[j] * adjoint[j] if j >= NAVIGATED else 0.0
    for i in range(NAVIGATED):
        for j in range(n):
            a[j] += F[i, j] * adjoint[i]
    adjoint[:] = a
    for i in range(n):
        for j in range(n):
            U[i, j] = information[i, j] * decay[j] if j >= NAVIGATED else 0.0
        for k in range(NAVIGATED):
            f = information[i, k]
            for j in range(n):
                U[i, j] += f * F[k, j]
    for i in range(n):
        for j in range(i, n):
            information[i, j] = decay[i] * U[i, j] if i >= NAVIGATED else 0.0
    for k in range(NAVIGATED):
        for i in range(n):
            f = F[k, i]
            if f != 0.0:
                for j in range(i, n):
                    information[i, j] += f * U[k, j]
    for i in range(n):
        for j in range(i):
            information[i, j] = information[j, i]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def smoothed_sigma(P, information, wanted, g, sigma):
    """Fill sigma of the first ``wanted`` states: root of the diagonal of P - P information P."""
    n = P.shape[0]
    for i in range(wanted):
        loss = 0.0
        for j in range(n):
            g[j] = 0.0
        for m in range(n):
            p = P[i, m]
            for j in range(n):
                g[j] += p * information[m, j]
        for j in range(n):
            loss += g[j] * P[i, j]
        sigma[i] = math.sqrt(max(P[i, i] - loss, 0.0))


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def backward(first, last, table, speeds, tilts, R, at, reckoned, walk, travel_walk, tau, reach, steady, unknown,
             xs, Ps, counts, Hs, Ks, news, adjoint, information, smooth, sigma):  # fmt: skip
    """Smooth the bounds ``first`` ... ``last`` from the buffers of `forward`; adjoint and information come from behind ``last``.

    Fills smooth (bound, STATE_COLUMNS) and sigma (bound, n).
    Modified Bryson-Frazier: x_s = x - P adjoint, P_s = P - P information P, with both behind the measurements of the bound.
    """
    n = adjoint.size
    F, J, D, axes, row = np.empty((NAVIGATED, n)), np.empty((3, n)), np.empty(3), np.empty((3, 3)), np.empty(COLUMNS)
    decay, Q, dx, a = np.ones(n), np.zeros(n), np.empty(n), np.empty(n)
    U, g = np.empty((n, n)), np.empty(n)
    for k in range(last, first - 1, -1):
        b = k - first
        x, P = xs[b], Ps[b]
        if k < table.shape[0]:
            correct_row(table[k], x[15:18], x[18:21], x[21:24], x[24:27], row)
            track_axes(row, x[MATRIX : MATRIX + 9].reshape((3, 3)), axes)
            odometer_step(row, x, axes, speeds[k + 1] - speeds[k], tilts[k], D)
            lead(row, x, at, reckoned or row[GAP] > 0.0, F, J, D, axes, speeds[k + 1] - speeds[k], tilts[k])
            process(row, at, walk, travel_walk, tau, steady, unknown, reckoned, R[k], axes, decay, Q)
            if at[B_WOBBLE] >= 0:
                adjoint_sway(adjoint, information, at[B_WOBBLE], abs(row[TRAVEL]), reach)
            adjoint_lead(adjoint, information, F, decay, U, a)
        for i in range(n):
            total = 0.0
            for j in range(n):
                total -= P[i, j] * adjoint[j]
            dx[i] = total
        smoothed_sigma(P, information, n if k % PARAMETERS_EVERY == 0 or k >= table.shape[0] else NAVIGATED, g, sigma[k])
        if k < table.shape[0] and k % PARAMETERS_EVERY != 0:
            sigma[k, NAVIGATED:] = sigma[k + 1, NAVIGATED:]
        smooth[k] = x
        feed_back(smooth[k], dx, at)
        for j in range(counts[b] - 1, -1, -1):
            adjoint_measure(adjoint, information, Hs[b, j], Ks[b, j], news[b, j, 0], news[b, j, 1], a)


@njit(cache=True, error_model="numpy")
def travel_residuals(table, speeds, tilts, states, out):
    """Fill out (epoch, 3): odometer's displacement minus that of the states, along, to the right, up (m)."""
    axes, D, row = np.empty((3, 3)), np.empty(3), np.empty(COLUMNS)
    for k in range(table.shape[0]):
        x = states[k]
        correct_row(table[k], x[15:18], x[18:21], x[21:24], x[24:27], row)
        track_axes(row, x[MATRIX : MATRIX + 9].reshape((3, 3)), axes)
        odometer_step(row, x, axes, speeds[k + 1] - speeds[k], tilts[k], D)
        e, n, u = place_difference(states[k + 1, 0:3], x[0:3])
        r0, r1, r2 = D[0] - e, D[1] - n, D[2] - u
        for c in range(3):
            out[k, c] = axes[c, 0] * r0 + axes[c, 1] * r1 + axes[c, 2] * r2


@njit(cache=True, error_model="numpy")
def turn_between(x, y):
    """Angle (radian) between the attitudes of two states."""
    trace = 0.0
    for j in range(9):
        trace += x[MATRIX + j] * y[MATRIX + j]
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
