"""Tables of a line and of a motion in, the tool's state at any time and what its sensors integrate out; radians and SI."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deform.geometry import _kernels_earth as earth
from deform.geometry import _kernels_rotation as rotation
from deform.geometry._kernels_resample import find_interval

# table of a line: one row per knot of chainage in the direction of travel, then pairs of a value and its derivative,
# of the pipe and of the tool in it
S, COLUMNS = 0, 21
AZIMUTH, PITCH, LATITUDE, LONGITUDE, HEIGHT, ROLL, YAW, TILT, RIGHT, ABOVE = range(1, COLUMNS, 2)
TURN, RISE, D_LATITUDE, D_LONGITUDE, D_HEIGHT = range(2, 12, 2)

HIT_FREQUENCY = 2.0 * math.pi * 22.0  # rad/s, ringing of the tool after a girth weld
HIT_DECAY = 0.05  # s
HIT_LENGTH = 0.8  # s


@njit(cache=True, error_model="numpy")
def integrate_line(table, latitude, longitude, height):
    """Fill position and its slopes of a table from its headings, by three Gauss points per interval."""
    table[0, LATITUDE], table[0, LONGITUDE], table[0, HEIGHT] = latitude, longitude, height
    node, weight = 0.5 * math.sqrt(0.6), 5.0 / 18.0
    for i in range(table.shape[0]):
        if i > 0:
            h = table[i, S] - table[i - 1, S]
            east = north = up = 0.0
            for k in range(3):
                u = 0.5 + (k - 1) * node
                w = weight if k != 1 else 8.0 / 18.0
                a = hermite(table, i - 1, AZIMUTH, u, h)
                p = hermite(table, i - 1, PITCH, u, h)
                east += w * h * math.sin(a) * math.cos(p)
                north += w * h * math.cos(a) * math.cos(p)
                up += w * h * math.sin(p)
            height = table[i - 1, HEIGHT] + 0.5 * up
            latitude = table[i - 1, LATITUDE]
            meridian, normal = earth.radii(latitude)
            meridian, normal = earth.radii(latitude + 0.5 * north / (meridian + height))
            middle = latitude + 0.5 * north / (meridian + height)
            table[i, LATITUDE] = latitude + north / (meridian + height)
            table[i, LONGITUDE] = table[i - 1, LONGITUDE] + east / ((normal + height) * math.cos(middle))
            table[i, HEIGHT] = table[i - 1, HEIGHT] + up
        a, p = table[i, AZIMUTH], table[i, PITCH]
        meridian, normal = earth.radii(table[i, LATITUDE])
        table[i, D_LATITUDE] = math.cos(a) * math.cos(p) / (meridian + table[i, HEIGHT])
        table[i, D_LONGITUDE] = math.sin(a) * math.cos(p) / ((normal + table[i, HEIGHT]) * math.cos(table[i, LATITUDE]))
        table[i, D_HEIGHT] = math.sin(p)


@njit(cache=True, error_model="numpy")
def hermite(table, i, column, u, h):
    """Cubic through values and slopes of two neighbouring rows, at the fraction u of their interval h."""
    v = 1.0 - u
    value = v * v * (1.0 + 2.0 * u) * table[i, column] + u * u * (1.0 + 2.0 * v) * table[i + 1, column]
    return value + h * u * v * (v * table[i, column + 1] - u * table[i + 1, column + 1])


@njit(cache=True, error_model="numpy")
def hermite_row(table, i, u, h, row):
    """Fill row with all values and their derivatives between two neighbouring rows of the table."""
    v = 1.0 - u
    for c in range(1, COLUMNS, 2):
        rise = (table[i + 1, c] - table[i, c]) / h
        first, last = table[i, c + 1], table[i + 1, c + 1]
        row[c] = table[i, c] + h * u * (v * v * first - u * v * last + u * (3.0 - 2.0 * u) * rise)
        row[c + 1] = 6.0 * u * v * rise + v * (v - 2.0 * u) * first + u * (u - 2.0 * v) * last


@njit(cache=True, error_model="numpy")
def fill_columns(table, where, column, out):
    """Fill out (n, 2) with a column and its derivative at chainages."""
    row = np.empty(COLUMNS)
    i = 0
    for n in range(where.size):
        i = find_interval(where[n], table[:, S], i)
        h = table[i + 1, S] - table[i, S]
        hermite_row(table, i, (where[n] - table[i, S]) / h, h, row)
        out[n, 0], out[n, 1] = row[column], row[column + 1]


@njit(cache=True, error_model="numpy")
def travel(motion, step, t):
    """Distance and speed at a time: a cubic of the speed per interval of constant length."""
    k = min(max(int(t / step), 0), motion.shape[0] - 1)
    x = t - k * step
    c = motion[k]
    speed = ((c[1] * x + c[2]) * x + c[3]) * x + c[4]
    return c[0] + x * (c[4] + x * (0.5 * c[3] + x * (c[2] / 3.0 + x * 0.25 * c[1]))), speed


@njit(cache=True, error_model="numpy")
def fill_travel(motion, step, times, out):
    """Fill out (n, 2) with distance and speed."""
    for n in range(times.size):
        out[n, 0], out[n, 1] = travel(motion, step, times[n])


@njit(cache=True, error_model="numpy")
def shake(t, speed, vibration, hit_times, hit_signs, hit, out):
    """Fill out (5,) with velocity right, along, up (m/s) and angles yaw, tilt (rad) of the ride; return the latest weld hit."""
    for k in range(5):
        out[k] = 0.0
    gate = min(speed / 0.3, 1.0)
    gate = gate * gate * (3.0 - 2.0 * gate)
    if gate > 0.0:
        for k in range(vibration.shape[0]):
            out[int(vibration[k, 0])] += gate * vibration[k, 1] * math.sin(vibration[k, 2] * t + vibration[k, 3])
    while hit + 1 < hit_times.size and hit_times[hit + 1] <= t:
        hit += 1
    while hit >= 0 and hit_times[hit] > t:
        hit -= 1
    if hit >= 0 and t - hit_times[hit] < HIT_LENGTH:
        x = (t - hit_times[hit]) / HIT_DECAY
        pulse = x * x * math.exp(2.0 - x) * 0.25
        for k in range(3):
            out[k] += hit_signs[hit, k] * pulse * math.sin(HIT_FREQUENCY * (t - hit_times[hit]))
    return hit


@njit(cache=True, error_model="numpy")
def state(t, table, motion, step, mounting, vibration, hit_times, hit_signs, i, hit, work, T, C, x):
    """Fill C (3, 3), attitude of the IMU, T (3, 3), of the tool, and x with the state of the IMU; return hints.

    x: latitude, longitude, height, velocity east, north, up, distance, speed, azimuth and pitch of the pipe.
    work: (COLUMNS + 5,) room for the row of the table and the shaking.
    """
    row, ride = work[:COLUMNS], work[COLUMNS:]
    s, speed = travel(motion, step, t)
    i = find_interval(s, table[:, S], i)
    h = table[i + 1, S] - table[i, S]
    hermite_row(table, i, (s - table[i, S]) / h, h, row)
    hit = shake(t, speed, vibration, hit_times, hit_signs, hit, ride)
    rotation.attitude_matrix(T, row[AZIMUTH] + row[YAW] + ride[3], row[PITCH] + row[TILT] + ride[4], row[ROLL])
    for r in range(3):
        for c in range(3):
            C[r, c] = T[r, 0] * mounting[0, c] + T[r, 1] * mounting[1, c] + T[r, 2] * mounting[2, c]
    sa, ca, sp, cp = math.sin(row[AZIMUTH]), math.cos(row[AZIMUTH]), math.sin(row[PITCH]), math.cos(row[PITCH])
    right, above, turn, rise = row[RIGHT], row[ABOVE], row[TURN], row[RISE]
    # pipe frame: right (ca, -sa, 0), forward (sa cp, ca cp, sp), above (-sa sp, -ca sp, cp); its turning moves the offset
    forward = speed * (1.0 - right * turn * cp - above * rise) + ride[1]
    across = speed * (row[RIGHT + 1] - above * turn * sp) + ride[0]
    upward = speed * (row[ABOVE + 1] + right * turn * sp) + ride[2]
    x[3] = across * ca + forward * sa * cp - upward * sa * sp
    x[4] = -across * sa + forward * ca * cp - upward * ca * sp
    x[5] = forward * sp + upward * cp
    meridian, normal = earth.radii(row[LATITUDE])
    x[0] = row[LATITUDE] + (-right * sa - above * ca * sp) / (meridian + row[HEIGHT])
    x[1] = row[LONGITUDE] + (right * ca - above * sa * sp) / ((normal + row[HEIGHT]) * math.cos(row[LATITUDE]))
    x[2] = row[HEIGHT] + above * cp
    x[6], x[7], x[8], x[9] = s, speed, row[AZIMUTH], row[PITCH]
    return i, hit


@njit(cache=True, error_model="numpy")
def fill_states(times, table, motion, step, mounting, vibration, hit_times, hit_signs, out):
    """Fill out (n, 16) with x of `state`, then azimuth, pitch, roll of the IMU and of the tool."""
    C, T, work = np.empty((3, 3)), np.empty((3, 3)), np.empty(COLUMNS + 5)
    i, hit = 0, -1
    for n in range(times.size):
        i, hit = state(times[n], table, motion, step, mounting, vibration, hit_times, hit_signs, i, hit, work, T, C, out[n])
        out[n, 10], out[n, 11], out[n, 12] = rotation.matrix_attitude(C)
        out[n, 13], out[n, 14], out[n, 15] = rotation.matrix_attitude(T)


@njit(cache=True, error_model="numpy")
def turned(C, D):
    """Rotation vector of Cᵀ D for a turn well below a right angle."""
    x = y = z = 0.0
    for k in range(3):
        x += C[k, 2] * D[k, 1] - C[k, 1] * D[k, 2]
        y += C[k, 0] * D[k, 2] - C[k, 2] * D[k, 0]
        z += C[k, 1] * D[k, 0] - C[k, 0] * D[k, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    f = 0.5 * (math.asin(sine) / sine if sine > 1e-4 else 1.0 + sine * sine / 6.0)
    return f * x, f * y, f * z


@njit(cache=True, error_model="numpy")
def inertial(C, x, dv, out):
    """Fill out (6,) with the inertial rate of the level frame and the specific force, both in the axes of the IMU."""
    _, earth_north, earth_up = earth.earth_rate(x[0])
    over_east, over_north, over_up = earth.transport_rate(x[0], x[2], x[3], x[4])
    out[0], out[1], out[2] = rotation.rotate_back(C, over_east, earth_north + over_north, earth_up + over_up)
    we, wn, wu = over_east, 2.0 * earth_north + over_north, 2.0 * earth_up + over_up
    ce, cn, cu = rotation.cross(we, wn, wu, x[3], x[4], x[5])
    fu = dv[2] + cu + earth.gravity(x[0], x[2])
    out[3], out[4], out[5] = rotation.rotate_back(C, dv[0] + ce, dv[1] + cn, fu)


@njit(cache=True, error_model="numpy")
def fill_increments(begin, dt, panels, table, motion, step, mounting, vibration, hit_times, hit_signs, out):
    """Fill out (n, 6) with the integrals of inertial angular rate and of specific force over n intervals from a time on.

    Each interval is cut into panels; in a panel the rotation vector and the velocity are parabolas through begin, middle and
    end, so that both telescope exactly: what is lost or gained does not grow with time.
    """
    Cs, T, xs, work = np.empty((3, 3, 3)), np.empty((3, 3)), np.empty((3, 10)), np.empty(COLUMNS + 5)
    f, dv = np.empty((3, 6)), np.empty((3, 3))
    h = dt / panels
    i, hit = state(begin, table, motion, step, mounting, vibration, hit_times, hit_signs, 0, -1, work, T, Cs[2], xs[2])
    for n in range(out.shape[0]):
        for c in range(6):
            out[n, c] = 0.0
        for k in range(panels):
            t = begin + n * dt + k * h
            for c in range(10):  # element by element: a whole row drags numba's texts of errors in, 8 s to compile
                xs[0, c] = xs[2, c]
                if c < 9:
                    Cs[0, c // 3, c % 3] = Cs[2, c // 3, c % 3]
            for j in range(1, 3):
                at = t + 0.5 * j * h
                i, hit = state(at, table, motion, step, mounting, vibration, hit_times, hit_signs, i, hit, work, T, Cs[j], xs[j])
            for c in range(3):
                v0, vm, ve = xs[0, 3 + c], xs[1, 3 + c], xs[2, 3 + c]
                dv[0, c] = (4.0 * vm - 3.0 * v0 - ve) / h
                dv[1, c] = (ve - v0) / h
                dv[2, c] = (v0 - 4.0 * vm + 3.0 * ve) / h
            for j in range(3):
                inertial(Cs[j], xs[j], dv[j], f[j])
            for c in range(6):
                out[n, c] += h / 6.0 * (f[0, c] + 4.0 * f[1, c] + f[2, c])
            add_turn(Cs, h, out[n])


@njit(cache=True, error_model="numpy")
def add_turn(Cs, h, out):
    """Add the integral of the body's rate in the level frame, of the parabola a t + b t² through the rotation vectors."""
    mx, my, mz = turned(Cs[0], Cs[1])
    ex, ey, ez = turned(Cs[0], Cs[2])
    ax, ay, az = (4.0 * mx - ex) / h, (4.0 * my - ey) / h, (4.0 * mz - ez) / h
    k = 2.0 / (h * h)
    bx, by, bz = k * (ex - 2.0 * mx), k * (ey - 2.0 * my), k * (ez - 2.0 * mz)
    cx, cy, cz = rotation.cross(ax, ay, az, bx, by, bz)
    dx, dy, dz = rotation.cross(ax, ay, az, cx, cy, cz)
    p, q = h * h * h / 6.0, h**4 / 24.0
    out[0] += ex - p * cx + q * dx
    out[1] += ey - p * cy + q * dy
    out[2] += ez - p * cz + q * dz


@njit(cache=True, error_model="numpy")
def quantize(values, pulse, remainder, out):
    """Fill out (n, k) with pulses; what a pulse does not hold is carried into the next sample through remainder (k,)."""
    for n in range(values.shape[0]):
        for k in range(values.shape[1]):
            total = values[n, k] / pulse[k] + remainder[k]
            whole = math.floor(total + 0.5)
            out[n, k] = int(whole)
            remainder[k] = total - whole


@njit(cache=True, error_model="numpy")
def wander(noise, decay, start, out):
    """Fill out (n, k) with first-order Gauss-Markov sequences driven by noise; start (k,) is carried on."""
    for n in range(noise.shape[0]):
        for k in range(noise.shape[1]):
            start[k] = decay * start[k] + noise[n, k]
            out[n, k] = start[k]


@njit(cache=True, error_model="numpy")
def arm_ranges(places, poses, angles, offset, joints, dents, noise, out):
    """Fill out (n, arm) with the distance from the tool's axis to the wall along each arm (metre), noise (n, arm) added.

    places (n,): chainage of the ring; poses (n, 5): roll, yaw, tilt, right, above at the IMU; joints (m, 6): start, radius,
    amplitude and clock of its ovality (blended in over 0.5 m), bead height at its start, recess;
    dents (d, 7): chainage, clock, depth, half length, half width (angle), sharpness, kind (0 dent, 1 tee, 2 wrinkle), sorted.
    """
    starts = joints[:, 0]
    j = first = 0
    for n in range(places.size):
        s = places[n]
        roll, yaw, tilt = poses[n, 0], poses[n, 1], poses[n, 2]
        ox, oz = poses[n, 3] + offset * yaw, poses[n, 4] + offset * tilt
        j = find_interval(s, starts, j)
        while first < dents.shape[0] and dents[first, 0] < s - 2.0:
            first += 1
        while first > 0 and dents[first - 1, 0] >= s - 2.0:
            first -= 1
        for a in range(angles.size):
            direction = angles[a] + roll
            dx, dz = math.sin(direction), math.cos(direction)
            along = ox * dx + oz * dz
            squared = ox * ox + oz * oz - along * along
            radius = joints[j, 1]
            reach = radius - along
            for _ in range(2):
                clock = math.atan2(ox + reach * dx, oz + reach * dz)
                place = s - reach * (dx * yaw + dz * tilt)
                radius = wall_radius(place, clock, j, joints)
                for d in range(first, dents.shape[0]):
                    if dents[d, 0] > s + 2.0:
                        break
                    radius -= intrusion(dents, d, place, clock)
                reach = math.sqrt(radius * radius - squared) - along
            out[n, a] = reach + noise[n, a]


@njit(cache=True, error_model="numpy")
def intrusion(dents, d, place, clock):
    """How far a dent, or the crests of a wrinkle, stand inward (metre); the opening of a tee is negative."""
    off = (clock - dents[d, 1] + math.pi) % (2.0 * math.pi) - math.pi
    x, y = (place - dents[d, 0]) / dents[d, 3], off / dents[d, 4]
    x2, y2 = x * x, y * y
    if dents[d, 6] == 1.0:
        return -dents[d, 2] if x2 + y2 < 1.0 else 0.0
    if x2 > 9.0 or y2 > 9.0:
        return 0.0
    if dents[d, 6] == 2.0:
        return dents[d, 2] * math.cos(math.pi * x) * math.exp(-0.5 * (x2 + y2))
    power = 0.5 * dents[d, 5]
    return dents[d, 2] * math.exp(-math.log(10.0) * (x2**power + y2**power))


@njit(cache=True, error_model="numpy")
def wall_radius(place, clock, j, joints):
    """Inner radius of the undented wall: the joint's bore, its oval, the beads at both ends, the recess of a valve."""
    while j + 1 < joints.shape[0] and place >= joints[j + 1, 0]:
        j += 1
    while j > 0 and place < joints[j, 0]:
        j -= 1
    end = joints[j + 1, 0] if j + 1 < joints.shape[0] else joints[j, 0] + 100.0
    near = min(place - joints[j, 0], end - place)
    blend = min(max(near / 0.5, 0.0), 1.0)
    blend = blend * blend * (3.0 - 2.0 * blend)
    radius = joints[j, 1] + blend * joints[j, 2] * math.cos(2.0 * (clock - joints[j, 3]))
    before, after = (place - joints[j, 0]) / 0.006, (end - place) / 0.006
    if before < 5.0:
        radius -= joints[j, 4] * math.exp(-0.5 * before * before)
    if after < 5.0 and j + 1 < joints.shape[0]:
        radius -= joints[j + 1, 4] * math.exp(-0.5 * after * after)
    if joints[j, 5] > 0.0 and abs(place - 0.5 * (joints[j, 0] + end)) < 0.15:
        radius += joints[j, 5]
    return radius


@njit(cache=True, error_model="numpy")
def follow(increments, method, out):
    """Fill out (n, 3, 3) with the attitude after each increment (n, 3), from the identity on.

    method 0: rotation vector; 1: rotation vector with the coning term of two neighbouring increments; 2, 3, 4: product of
    elementary turns in the orders x y z, y z x, z x y.
    """
    C = np.eye(3)
    bx = by = bz = 0.0
    for n in range(increments.shape[0]):
        x, y, z = increments[n, 0], increments[n, 1], increments[n, 2]
        if method == 0:
            rotation.turn_right(C, x, y, z)
        elif method == 1:
            cx, cy, cz = rotation.cross(bx, by, bz, x, y, z)
            rotation.turn_right(C, x + cx / 12.0, y + cy / 12.0, z + cz / 12.0)
            bx, by, bz = x, y, z
        else:
            for k in range(3):
                axis = (method - 2 + k) % 3
                rotation.turn_right(C, x if axis == 0 else 0.0, y if axis == 1 else 0.0, z if axis == 2 else 0.0)
        for r in range(3):
            for c in range(3):
                out[n, r, c] = C[r, c]
