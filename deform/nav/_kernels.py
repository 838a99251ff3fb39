"""Numba kernels at the navigation rate: counts in, increments per epoch and trajectories at output times out (SI, radian)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from deform.geometry._kernels_earth import EARTH_RATE, gravity, radii
from deform.geometry._kernels_rotation import rotate, turn_left, turn_right
from deform.nav._kernels_arc import arc_stretch, tilted
from deform.run.stamps import MOST_BRIDGED, lost_before

# One row of the table of epochs: integrals over the epoch in the body axes of its beginning, frozen in inertial space.
TURN = 0  # 9: matrix, body at the end to body at the beginning
VELOCITY = 9  # 3: integral of specific force (m/s)
POSITION = 12  # 3: its second integral (m)
ATTITUDE_TIME = 15  # 9: integral of the matrix over time (s), Jacobian of turn and velocity to the biases
ATTITUDE_TRAVEL = 24  # 9: integral of the matrix over the odometer's distance (m); column 1 is the dead-reckoned displacement
TURN_BY_AXIS = 33  # 9: integral of the matrix times diag(angular increments), Jacobian to the gyro scale factors
FORCE_BY_AXIS = 42  # 9: the same with velocity increments, Jacobian to the accelerometer scale factors
DURATION = 51  # s
TRAVEL = 52  # m, by the odometer
GAP = 53  # s without samples inside the epoch
SENSE = 54  # +1, or -1 for an epoch that is run through backwards in time
TURN_BY_SHEAR = 55  # 9: the same of turns that other gyros see, Jacobian to the skew of the gyros (see `correct_row`)
FORCE_BY_SHEAR = 64  # 15: the same of forces that other accelerometers see, Jacobian to the skew of the accelerometers
STEADY_S = 1.0  # s before and behind a gap, whose mean force levels it; that before it goes on over it
BRIDGED_TURN, BRIDGED_PUSH = 79, 80  # variance of what bridged samples may have turned (rad²) and pushed ((m/s)²) otherwise
GAP_TRAVEL = 81  # m of the travel that lie in gaps
# variance of the turn over the gaps about each axis, and of that by which the path bows (rad²)
GAP_TURN, GAP_BOW = 82, 83
GAP_EXPECTED = 84  # 3: turn that was expected over the gaps against the one in the row, rotation vector (see `gaps`)
COLUMNS = 87
# What a gap may hide: a pipe turns in bends of any angle, a tool rolls by turns per kilometre; at rest it settles.
LOST_TURN, MOST_TURN = math.radians(20.0) ** 2, 1.0  # rad² per m of travel, rad² at most: any direction is as likely
RESTING_TURN = math.radians(0.1) ** 2  # rad² per s
PARAMETERS = 20  # biases of gyros and accelerometers, scales of both, skews of both, as `correct_row` takes them

# Rows of the table of compensation K, one sensor axis per column: drift, scale, asymmetry of scale, unbalance about spin and
# input axis, index of the spin axis of a gyro; bias, scale, asymmetry of an accelerometer; then the matrices of the mounting.
GYRO_MOUNTING, ACCEL_MOUNTING = 9, 12


@njit(cache=True, error_model="numpy")
def compensate(K, g0, g1, g2, a0, a1, a2, dt):
    """Angular and velocity increments in body axes from those of the sensor axes, Porter's section 3.4.1."""
    a0 -= K[6, 0] * dt + K[7, 0] * a0 + K[8, 0] * abs(a0)
    a1 -= K[6, 1] * dt + K[7, 1] * a1 + K[8, 1] * abs(a1)
    a2 -= K[6, 2] * dt + K[7, 2] * a2 + K[8, 2] * abs(a2)
    spins = (a0, a1, a2)
    s0, s1, s2 = spins[int(K[5, 0])], spins[int(K[5, 1])], spins[int(K[5, 2])]
    g0 -= K[0, 0] * dt + K[1, 0] * g0 + K[2, 0] * abs(g0) + K[3, 0] * a0 + K[4, 0] * s0
    g1 -= K[0, 1] * dt + K[1, 1] * g1 + K[2, 1] * abs(g1) + K[3, 1] * a1 + K[4, 1] * s1
    g2 -= K[0, 2] * dt + K[1, 2] * g2 + K[2, 2] * abs(g2) + K[3, 2] * a2 + K[4, 2] * s2
    return (
        K[9, 0] * g0 + K[9, 1] * g1 + K[9, 2] * g2,
        K[10, 0] * g0 + K[10, 1] * g1 + K[10, 2] * g2,
        K[11, 0] * g0 + K[11, 1] * g1 + K[11, 2] * g2,
        K[12, 0] * a0 + K[12, 1] * a1 + K[12, 2] * a2,
        K[13, 0] * a0 + K[13, 1] * a1 + K[13, 2] * a2,
        K[14, 0] * a0 + K[14, 1] * a1 + K[14, 2] * a2,
    )


@njit(cache=True, error_model="numpy")
def increments(gyro, accel, gyro_pulse, accel_pulse, K, i, dt):
    """Compensated increments of sample i in body axes."""
    return compensate(
        K,
        gyro_pulse * gyro[i, 0],
        gyro_pulse * gyro[i, 1],
        gyro_pulse * gyro[i, 2],
        accel_pulse * accel[i, 0],
        accel_pulse * accel[i, 1],
        accel_pulse * accel[i, 2],
        dt,
    )


@njit(cache=True, error_model="numpy")
def two_sample(g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2):
    """Rotation vector and velocity increment (axes of the sample's beginning) from this sample and the one before it.

    Coning: g + (1/12) p × g. Rotation and sculling: a + (1/2) g × a + (1/6) g × (g × a) + (1/12)(p × a + b × g).
    """
    r0 = g0 + (p1 * g2 - p2 * g1) / 12.0
    r1 = g1 + (p2 * g0 - p0 * g2) / 12.0
    r2 = g2 + (p0 * g1 - p1 * g0) / 12.0
    h0, h1, h2 = 0.5 * g0 + p0 / 12.0, 0.5 * g1 + p1 / 12.0, 0.5 * g2 + p2 / 12.0
    d0 = a0 + h1 * a2 - h2 * a1 + (b1 * g2 - b2 * g1) / 12.0
    d1 = a1 + h2 * a0 - h0 * a2 + (b2 * g0 - b0 * g2) / 12.0
    d2 = a2 + h0 * a1 - h1 * a0 + (b0 * g1 - b1 * g0) / 12.0
    ga, gg = (g0 * a0 + g1 * a1 + g2 * a2) / 6.0, (g0 * g0 + g1 * g1 + g2 * g2) / 6.0
    return r0, r1, r2, d0 + g0 * ga - a0 * gg, d1 + g1 * ga - a1 * gg, d2 + g2 * ga - a2 * gg


@njit(cache=True, error_model="numpy")
def bridged(lost, g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2):
    """Increments g, a with those of the samples lost before them, for each of which the mean with the last ones p, b stands."""
    h = 0.5 * lost
    return g0 + h * (g0 + p0), g1 + h * (g1 + p1), g2 + h * (g2 + p2), a0 + h * (a0 + b0), a1 + h * (a1 + b1), a2 + h * (a2 + b2)


@njit(cache=True, error_model="numpy")
def bridge_variance(count, pulse, i, lost):
    """Variance of what the lost samples before sample i may have held beside the mean of their neighbours, of the worst axis.

    As much as the neighbours differ, and as they rose or fell: a sensor that saturates was on its way to a peak.
    """
    worst = 0.0
    for j in range(3):
        apart, slope = abs(count[i, j] - count[i - 1, j]), 0.0
        if i > 1:
            slope = abs(count[i - 1, j] - count[i - 2, j])
        if i + 1 < count.shape[0]:
            slope = max(slope, abs(count[i + 1, j] - count[i, j]))
        worst = max(worst, pulse * lost * (apart + 0.5 * lost * slope))
    return worst * worst


@njit(cache=True, error_model="numpy")
def steady_push(gyro, accel, gyro_pulse, accel_pulse, K, i, usual):
    """Velocity increment of a usual sample before sample i, the mean over `STEADY_S`.

    A single sample is shaken by the ride and by welds: 0.5 m/s², held over a gap of five seconds, would be 2.5 m/s.
    """
    first = max(i - max(round(STEADY_S / usual), 1), 0)
    return mean_push(gyro, accel, gyro_pulse, accel_pulse, K, first, i, usual)


@njit(cache=True, error_model="numpy")
def mean_push(gyro, accel, gyro_pulse, accel_pulse, K, first, stop, usual):
    """Mean velocity increment of the samples first ... stop - 1."""
    s0 = s1 = s2 = 0.0
    for j in range(first, stop):
        _, _, _, a0, a1, a2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, j, usual)
        s0, s1, s2 = s0 + a0, s1 + a1, s2 + a2
    n = max(stop - first, 1)
    return s0 / n, s1 / n, s2 / n


@njit(cache=True, error_model="numpy")
def levelled_turn(time, gyro, accel, gyro_pulse, accel_pulse, K, i, usual, b0, b1, b2):
    """Least turn over the gap before sample i (rotation vector) that leaves the steady force where it was before it, at b.

    Gravity is nearly all of the force: pitch and roll follow it. The turn about the vertical stays zero; nothing tells it.
    """
    stop = i + 1
    while stop < time.size and stop - i < max(round(STEADY_S / usual), 1) and lost_before(time, stop, usual) <= MOST_BRIDGED:
        stop += 1
    a0, a1, a2 = mean_push(gyro, accel, gyro_pulse, accel_pulse, K, i, stop, usual)
    r0, r1, r2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    sine = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    stretch = math.atan2(sine, a0 * b0 + a1 * b1 + a2 * b2) / sine
    return stretch * r0, stretch * r1, stretch * r2


@njit(cache=True, error_model="numpy")
def travelled(t, start, step, distance, slope):
    """Distance at a time: a cubic between knots ``step`` apart, steady beyond them."""
    u = (t - start) / step
    k = min(max(math.floor(u), 0), distance.size - 2)
    w = min(max(u - k, 0.0), 1.0)
    rise, a, b = distance[k + 1] - distance[k], slope[k] * step, slope[k + 1] * step
    return distance[k] + w * (a + w * (3.0 * rise - 2.0 * a - b + w * (a + b - 2.0 * rise)))


@njit(cache=True, error_model="numpy", parallel=True)
def preintegrate(time, gyro, accel, gyro_pulse, accel_pulse, K, start, step, distance, slope, bounds, usual, table):
    """Fill the table (epoch, COLUMNS) with the integrals over the samples bounds[k] + 1 ... bounds[k + 1].

    ``start``, ``step``, ``distance``, ``slope``: the odometer's profile, see `travelled`.
    """
    for k in prange(bounds.size - 1):
        R = np.eye(3)
        row = table[k]
        row[:] = 0.0
        row[SENSE] = 1.0
        v0 = v1 = v2 = x0 = x1 = x2 = 0.0
        first = bounds[k]
        dt = max(time[first] - time[first - 1], 1e-9) if first > 0 else 1.0
        p0, p1, p2, b0, b1, b2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, first, dt)
        if first == 0:
            p0 = p1 = p2 = b0 = b1 = b2 = 0.0
        reached = travelled(time[first], start, step, distance, slope)
        for i in range(first + 1, bounds[k + 1] + 1):
            dt = time[i] - time[i - 1]
            ds, reached = -reached, travelled(time[i], start, step, distance, slope)
            ds += reached
            lost, chord = lost_before(time, i, usual), ds
            g0, g1, g2, a0, a1, a2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, i, dt if lost == 0 else usual)
            if lost > MOST_BRIDGED:  # the counts of the gap are lost: the steady force goes on, and levels the attitude behind it
                share = dt / usual
                a0, a1, a2 = steady_push(gyro, accel, gyro_pulse, accel_pulse, K, i, usual)
                r0, r1, r2 = levelled_turn(time, gyro, accel, gyro_pulse, accel_pulse, K, i, usual, a0, a1, a2)
                a0, a1, a2 = a0 * share, a1 * share, a2 * share
                g0 = g1 = g2 = p0 = p1 = p2 = 0.0
                d0, d1, d2 = a0, a1, a2
                row[GAP] += dt
                row[GAP_TRAVEL] += ds
                chord = ds * arc_stretch(tilted(r0, r1, r2))
                hidden = min(LOST_TURN * abs(ds), MOST_TURN) + RESTING_TURN * dt
                row[GAP_TURN] += hidden
                row[GAP_BOW] += hidden
            else:
                n0, n1, n2, c0, c1, c2 = g0, g1, g2, a0, a1, a2
                g0, g1, g2, a0, a1, a2 = bridged(lost, g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2)
                if lost > 0:
                    row[BRIDGED_TURN] += bridge_variance(gyro, gyro_pulse, i, lost)
                    row[BRIDGED_PUSH] += bridge_variance(accel, accel_pulse, i, lost)
                r0, r1, r2, d0, d1, d2 = two_sample(g0, g1, g2, a0, a1, a2, p0, p1, p2, b0, b1, b2)
                p0, p1, p2, b0, b1, b2 = n0, n1, n2, c0, c1, c2
            w0, w1, w2 = rotate(R, d0, d1, d2)
            x0 += dt * (v0 + 0.5 * w0)
            x1 += dt * (v1 + 0.5 * w1)
            x2 += dt * (v2 + 0.5 * w2)
            v0, v1, v2 = v0 + w0, v1 + w1, v2 + w2
            for j in range(3):
                row[ATTITUDE_TIME + 3 * j] += 0.5 * dt * R[j, 0]
                row[ATTITUDE_TIME + 3 * j + 1] += 0.5 * dt * R[j, 1]
                row[ATTITUDE_TIME + 3 * j + 2] += 0.5 * dt * R[j, 2]
                row[ATTITUDE_TRAVEL + 3 * j] += 0.5 * chord * R[j, 0]
                row[ATTITUDE_TRAVEL + 3 * j + 1] += 0.5 * chord * R[j, 1]
                row[ATTITUDE_TRAVEL + 3 * j + 2] += 0.5 * chord * R[j, 2]
                row[TURN_BY_AXIS + 3 * j] += R[j, 0] * g0
                row[TURN_BY_AXIS + 3 * j + 1] += R[j, 1] * g1
                row[TURN_BY_AXIS + 3 * j + 2] += R[j, 2] * g2
                row[FORCE_BY_AXIS + 3 * j] += R[j, 0] * a0
                row[FORCE_BY_AXIS + 3 * j + 1] += R[j, 1] * a1
                row[FORCE_BY_AXIS + 3 * j + 2] += R[j, 2] * a2
                row[TURN_BY_SHEAR + 3 * j] += R[j, 1] * g0
                row[TURN_BY_SHEAR + 3 * j + 1] += R[j, 1] * g2
                row[TURN_BY_SHEAR + 3 * j + 2] += R[j, 0] * g2
                row[FORCE_BY_SHEAR + 5 * j] += R[j, 0] * a2 + R[j, 2] * a0
                row[FORCE_BY_SHEAR + 5 * j + 1] += R[j, 1] * a0
                row[FORCE_BY_SHEAR + 5 * j + 2] += R[j, 1] * a2
                row[FORCE_BY_SHEAR + 5 * j + 3] += R[j, 0] * a1
                row[FORCE_BY_SHEAR + 5 * j + 4] += R[j, 2] * a1
            turn_right(R, r0, r1, r2)
            for j in range(3):
                row[ATTITUDE_TIME + 3 * j] += 0.5 * dt * R[j, 0]
                row[ATTITUDE_TIME + 3 * j + 1] += 0.5 * dt * R[j, 1]
                row[ATTITUDE_TIME + 3 * j + 2] += 0.5 * dt * R[j, 2]
                row[ATTITUDE_TRAVEL + 3 * j] += 0.5 * chord * R[j, 0]
                row[ATTITUDE_TRAVEL + 3 * j + 1] += 0.5 * chord * R[j, 1]
                row[ATTITUDE_TRAVEL + 3 * j + 2] += 0.5 * chord * R[j, 2]
            row[DURATION] += dt
            row[TRAVEL] += ds
        for j in range(9):
            row[TURN + j] = R[j // 3, j % 3]
        row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2] = v0, v1, v2
        row[POSITION], row[POSITION + 1], row[POSITION + 2] = x0, x1, x2


@njit(cache=True, error_model="numpy")
def navigation_rates(latitude, height, ve, vn, sense):
    """North and up of the earth's rate (turned when time runs back), transport rate (east, north, up), both radii with height."""
    meridian, normal = radii(latitude)
    meridian += height
    normal += height
    north = sense * EARTH_RATE * math.cos(latitude)
    up = sense * EARTH_RATE * math.sin(latitude)
    around = ve / normal
    return north, up, -vn / meridian, around, around * math.tan(latitude), meridian, normal


@njit(cache=True, error_model="numpy")
def advance(row, place, v, C, place_after, v_after, C_after):
    """State after an epoch: local-level mechanization of the integrals in the table's row.

    ``place`` is latitude, longitude (radian), height (m); v east, north, up; C body to east, north, up. The frame turns with
    z = (earth rate + transport rate) T while the integrals are frozen: velocity takes C V - z × (C V - C P / T), position
    C P - z × C P / 3 (exact for a steady force), attitude exp(-z) C R.
    """
    T = row[DURATION]
    ve, vn, vu = v[0], v[1], v[2]
    f0, f1, f2 = rotate(C, row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2])
    x0, x1, x2 = rotate(C, row[POSITION], row[POSITION + 1], row[POSITION + 2])
    g = gravity(place[0], place[2])
    # middle of the epoch for rates, gravity and Coriolis; the velocity there already in the frame that turned with the earth
    middle_latitude = place[0] + 0.5 * T * vn / 6.37e6
    h0, h1, h2 = f0 - x0 / T, f1 - x1 / T, f2 - x2 / T
    y1, y2 = row[SENSE] * EARTH_RATE * T * math.cos(middle_latitude), row[SENSE] * EARTH_RATE * T * math.sin(middle_latitude)
    # half of force and Coriolis; without the latter the level frame would turn by half an epoch's Coriolis velocity too much
    me = ve + 0.5 * (f0 - (y1 * h2 - y2 * h1)) - (y1 * vu - y2 * vn)
    mn = vn + 0.5 * (f1 - y2 * h0) - y2 * ve
    mu = vu + 0.5 * (f2 + y1 * h0 - g * T) + y1 * ve
    north, up, t0, t1, t2, meridian, normal = navigation_rates(middle_latitude, place[2] + 0.5 * T * vu, me, mn, row[SENSE])
    g = gravity(middle_latitude, place[2] + 0.5 * T * vu)
    z0, z1, z2 = t0 * T, (t1 + north) * T, (t2 + up) * T
    c0, c1, c2 = t0, t1 + 2.0 * north, t2 + 2.0 * up
    k0, k1, k2 = c1 * mu - c2 * mn, c2 * me - c0 * mu, c0 * mn - c1 * me
    # second order of the frame's turn, of a steady force: 1/6 z × (z × f), 1/12 z × (z × x)
    zf, zx, zz = z0 * f0 + z1 * f1 + z2 * f2, z0 * x0 + z1 * x1 + z2 * x2, z0 * z0 + z1 * z1 + z2 * z2
    d0 = f0 - (z1 * h2 - z2 * h1) - k0 * T
    d1 = f1 - (z2 * h0 - z0 * h2) - k1 * T
    d2 = f2 - (z0 * h1 - z1 * h0) - k2 * T - g * T
    s0 = ve * T + x0 - (z1 * x2 - z2 * x1) / 3.0 - 0.5 * k0 * T * T
    s1 = vn * T + x1 - (z2 * x0 - z0 * x2) / 3.0 - 0.5 * k1 * T * T
    s2 = vu * T + x2 - (z0 * x1 - z1 * x0) / 3.0 - 0.5 * k2 * T * T - 0.5 * g * T * T
    d0, d1, d2 = d0 + (z0 * zf - f0 * zz) / 6.0, d1 + (z1 * zf - f1 * zz) / 6.0, d2 + (z2 * zf - f2 * zz) / 6.0
    s0, s1, s2 = s0 + (z0 * zx - x0 * zz) / 12.0, s1 + (z1 * zx - x1 * zz) / 12.0, s2 + (z2 * zx - x2 * zz) / 12.0
    v_after[0], v_after[1], v_after[2] = ve + d0, vn + d1, vu + d2
    place_after[0] = place[0] + s1 / meridian
    place_after[1] = place[1] + s0 / (normal * math.cos(0.5 * (place[0] + place_after[0])))
    place_after[2] = place[2] + s2
    for i in range(3):
        for j in range(3):
            C_after[i, j] = C[i, 0] * row[j] + C[i, 1] * row[3 + j] + C[i, 2] * row[6 + j]
    turn_left(C_after, -z0, -z1, -z2)
    return s0, s1, s2


@njit(cache=True, error_model="numpy")
def shift_place(place, east, north, up):
    """Move a place by small east, north, up (m)."""
    meridian, normal = radii(place[0])
    place[1] += east / ((normal + place[2]) * math.cos(place[0]))
    place[0] += north / (meridian + place[2])
    place[2] += up


@njit(cache=True, error_model="numpy")
def place_difference(a, b):
    """East, north, up (m) from place b to the near place a."""
    meridian, normal = radii(0.5 * (a[0] + b[0]))
    level = 0.5 * (a[2] + b[2])
    return (a[1] - b[1]) * (normal + level) * math.cos(0.5 * (a[0] + b[0])), (a[0] - b[0]) * (meridian + level), a[2] - b[2]


@njit(cache=True, error_model="numpy")
def correct_row(row, p, out):
    """Row of an epoch with small further errors taken off by its Jacobians.

    ``p`` (PARAMETERS,): bias of gyros (rad/s) and accelerometers (m/s²), scale of both, by axis; what the forward gyro sees of
    the turns about right and up, and the right one of that about up; what the accelerometers right and up see of each other's
    force alike, the forward one of the forces right and up, those right and up of the forward force.
    """
    for j in range(row.size):
        out[j] = row[j]
    turn = np.zeros(3)
    push = np.zeros(3)
    for i in range(3):
        for j in range(3):
            turn[i] -= row[ATTITUDE_TIME + 3 * i + j] * p[j] + row[TURN_BY_AXIS + 3 * i + j] * p[6 + j]
            push[i] -= row[ATTITUDE_TIME + 3 * i + j] * p[3 + j] + row[FORCE_BY_AXIS + 3 * i + j] * p[9 + j]
            turn[i] -= row[TURN_BY_SHEAR + 3 * i + j] * p[12 + j]
        for j in range(5):
            push[i] -= row[FORCE_BY_SHEAR + 5 * i + j] * p[15 + j]
    T = row[DURATION]
    v0, v1, v2 = row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2]
    # a steady turning error tilts the force by half of it on the way to the velocity, by a third on the way to the position
    out[VELOCITY] += push[0] + 0.5 * (turn[1] * v2 - turn[2] * v1)
    out[VELOCITY + 1] += push[1] + 0.5 * (turn[2] * v0 - turn[0] * v2)
    out[VELOCITY + 2] += push[2] + 0.5 * (turn[0] * v1 - turn[1] * v0)
    out[POSITION] += 0.5 * T * push[0] + T / 6.0 * (turn[1] * v2 - turn[2] * v1)
    out[POSITION + 1] += 0.5 * T * push[1] + T / 6.0 * (turn[2] * v0 - turn[0] * v2)
    out[POSITION + 2] += 0.5 * T * push[2] + T / 6.0 * (turn[0] * v1 - turn[1] * v0)
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = row[3 * i + j]
    turn_left(R, turn[0], turn[1], turn[2])
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = R[i, j]


@njit(cache=True, error_model="numpy")
def running_sums(time, gyro, accel, gyro_pulse, accel_pulse, K, usual, first, last):
    """Mean angular rate and specific force (body axes) over samples first + 1 ... last, and the time they count.

    A sample behind lost ones counts for its own ``usual`` step: what was lost has no part in the mean.
    """
    sums = np.zeros(7)
    for i in range(first + 1, last + 1):
        dt = usual if lost_before(time, i, usual) > 0 else time[i] - time[i - 1]
        g0, g1, g2, a0, a1, a2 = increments(gyro, accel, gyro_pulse, accel_pulse, K, i, dt)
        sums[0] += g0
        sums[1] += g1
        sums[2] += g2
        sums[3] += a0
        sums[4] += a1
        sums[5] += a2
        sums[6] += dt
    for j in range(6):
        sums[j] /= sums[6]
    return sums
