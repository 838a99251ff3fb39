"""Scalars and small arrays in radians and SI in, the same out: the jitted floor of `earth`, `rotation` and `resample`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# WGS84 (NIMA TR8350.2, 2000, tables 3.1 and 3.4)
SEMI_MAJOR = 6378137.0
FLATTENING = 1.0 / 298.257223563
EARTH_RATE = 7.292115e-5
GRAVITATION = 3.986004418e14
GRAVITY_EQUATOR = 9.7803253359
GRAVITY_POLE = 9.8321849379

SEMI_MINOR = SEMI_MAJOR * (1.0 - FLATTENING)
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
SECOND_ECCENTRICITY2 = ECCENTRICITY2 / (1.0 - ECCENTRICITY2)
SOMIGLIANA = SEMI_MINOR * GRAVITY_POLE / (SEMI_MAJOR * GRAVITY_EQUATOR) - 1.0
CENTRIFUGAL_RATIO = EARTH_RATE**2 * SEMI_MAJOR**2 * SEMI_MINOR / GRAVITATION

_SMALL2 = 1e-4  # rad², below it the series carry s and c to the last digit


# ---- earth -----------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def radii(latitude):
    """Meridian and prime-vertical radius of curvature (metre)."""
    s = math.sin(latitude)
    w2 = 1.0 - ECCENTRICITY2 * s * s
    normal = SEMI_MAJOR / math.sqrt(w2)
    return normal * (1.0 - ECCENTRICITY2) / w2, normal


@njit(cache=True, error_model="numpy")
def gravity(latitude, height):
    """Normal gravity along the ellipsoid's normal (m/s², positive down)."""
    s2 = math.sin(latitude) ** 2
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / math.sqrt(1.0 - ECCENTRICITY2 * s2)
    h = height / SEMI_MAJOR
    return surface * (1.0 - 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2) * h + 3.0 * h * h)


@njit(cache=True, error_model="numpy")
def earth_rate(latitude):
    """Rate of the earth in east, north, up (rad/s)."""
    return 0.0, EARTH_RATE * math.cos(latitude), EARTH_RATE * math.sin(latitude)


@njit(cache=True, error_model="numpy")
def transport_rate(latitude, height, east_velocity, north_velocity):
    """Rate of the local level frame over the earth in east, north, up (rad/s)."""
    meridian, normal = radii(latitude)
    around = east_velocity / (normal + height)
    return -north_velocity / (meridian + height), around, around * math.tan(latitude)


@njit(cache=True, error_model="numpy")
def geodetic_to_ecef(latitude, longitude, height):
    """Earth-centred coordinates (metre)."""
    normal = radii(latitude)[1]
    across = (normal + height) * math.cos(latitude)
    up = (normal * (1.0 - ECCENTRICITY2) + height) * math.sin(latitude)
    return across * math.cos(longitude), across * math.sin(longitude), up


@njit(cache=True, error_model="numpy")
def ecef_to_geodetic(x, y, z):
    """Latitude, longitude, height; Bowring's start, iterated until it stands still."""
    p = math.hypot(x, y)
    longitude = math.atan2(y, x)
    tangent = math.atan2(z * SEMI_MAJOR, p * SEMI_MINOR)
    latitude = 0.0
    for _ in range(6):
        s, c = math.sin(tangent), math.cos(tangent)
        latitude = math.atan2(z + SECOND_ECCENTRICITY2 * SEMI_MINOR * s**3, p - ECCENTRICITY2 * SEMI_MAJOR * c**3)
        following = math.atan2((1.0 - FLATTENING) * math.sin(latitude), math.cos(latitude))
        if abs(following - tangent) < 1e-16:
            break
        tangent = following
    s, c = math.sin(latitude), math.cos(latitude)
    height = p * c + z * s - SEMI_MAJOR * math.sqrt(1.0 - ECCENTRICITY2 * s * s)
    return latitude, longitude, height


@njit(cache=True, error_model="numpy")
def fill_local(latitude, longitude, height, latitude_0, longitude_0, height_0, out):
    """East, north, up (n, 3) of points in the tangent frame at a place."""
    x0, y0, z0 = geodetic_to_ecef(latitude_0, longitude_0, height_0)
    sp, cp = math.sin(latitude_0), math.cos(latitude_0)
    sl, cl = math.sin(longitude_0), math.cos(longitude_0)
    for i in range(latitude.size):
        x, y, z = geodetic_to_ecef(latitude[i], longitude[i], height[i])
        x, y, z = x - x0, y - y0, z - z0
        outward = cl * x + sl * y
        out[i, 0] = -sl * x + cl * y
        out[i, 1] = -sp * outward + cp * z
        out[i, 2] = cp * outward + sp * z


@njit(cache=True, error_model="numpy")
def fill_geodetic(east, north, up, latitude_0, longitude_0, height_0, out):
    """Latitude, longitude, height (n, 3) of points given in the tangent frame at a place."""
    x0, y0, z0 = geodetic_to_ecef(latitude_0, longitude_0, height_0)
    sp, cp = math.sin(latitude_0), math.cos(latitude_0)
    sl, cl = math.sin(longitude_0), math.cos(longitude_0)
    for i in range(east.size):
        outward = cp * up[i] - sp * north[i]
        x = x0 + cl * outward - sl * east[i]
        y = y0 + sl * outward + cl * east[i]
        z = z0 + sp * up[i] + cp * north[i]
        out[i, 0], out[i, 1], out[i, 2] = ecef_to_geodetic(x, y, z)


# ---- rotation --------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def attitude_matrix(C, azimuth, pitch, roll):
    """Fill C (3, 3), body to east, north, up: Rz(-azimuth) Rx(pitch) Ry(roll)."""
    sa, ca = math.sin(azimuth), math.cos(azimuth)
    sp, cp = math.sin(pitch), math.cos(pitch)
    sr, cr = math.sin(roll), math.cos(roll)
    C[0, 0], C[0, 1], C[0, 2] = ca * cr + sa * sp * sr, sa * cp, ca * sr - sa * sp * cr
    C[1, 0], C[1, 1], C[1, 2] = -sa * cr + ca * sp * sr, ca * cp, -sa * sr - ca * sp * cr
    C[2, 0], C[2, 1], C[2, 2] = -cp * sr, sp, cp * cr


@njit(cache=True, error_model="numpy")
def matrix_attitude(C):
    """Azimuth, pitch, roll of a matrix, body to east, north, up."""
    azimuth = math.atan2(C[0, 1], C[1, 1])
    pitch = math.atan2(C[2, 1], math.hypot(C[0, 1], C[1, 1]))
    return azimuth, pitch, math.atan2(-C[2, 0], C[2, 2])


@njit(cache=True, error_model="numpy")
def savage(angle2):
    """Coefficients s = sin(a)/a and c = (1 - cos a)/a² of the squared angle."""
    if angle2 < _SMALL2:
        s = 1.0 - angle2 / 6.0 * (1.0 - angle2 / 20.0 * (1.0 - angle2 / 42.0))
        return s, 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0 * (1.0 - angle2 / 56.0))
    angle = math.sqrt(angle2)
    half = math.sin(0.5 * angle)
    return math.sin(angle) / angle, 2.0 * half * half / angle2


@njit(cache=True, error_model="numpy")
def vector_matrix(C, x, y, z):
    """Fill C with I + s Ω + c Ω² of the rotation vector."""
    s, c = savage(x * x + y * y + z * z)
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    C[1, 0], C[1, 1], C[1, 2] = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    C[2, 0], C[2, 1], C[2, 2] = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)


@njit(cache=True, error_model="numpy")
def turn_right(C, x, y, z):
    """C becomes C (I + s Ω + c Ω²): a rotation vector in body axes."""
    s, c = savage(x * x + y * y + z * z)
    m00, m01, m02 = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    m10, m11, m12 = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    m20, m21, m22 = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
    for i in range(3):
        a, b, d = C[i, 0], C[i, 1], C[i, 2]
        C[i, 0] = a * m00 + b * m10 + d * m20
        C[i, 1] = a * m01 + b * m11 + d * m21
        C[i, 2] = a * m02 + b * m12 + d * m22


@njit(cache=True, error_model="numpy")
def turn_left(C, x, y, z):
    """C becomes (I + s Ω + c Ω²) C: a rotation vector in the axes that C leads to."""
    s, c = savage(x * x + y * y + z * z)
    m00, m01, m02 = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    m10, m11, m12 = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    m20, m21, m22 = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
    for j in range(3):
        a, b, d = C[0, j], C[1, j], C[2, j]
        C[0, j] = m00 * a + m01 * b + m02 * d
        C[1, j] = m10 * a + m11 * b + m12 * d
        C[2, j] = m20 * a + m21 * b + m22 * d


@njit(cache=True, error_model="numpy")
def rotate(C, x, y, z):
    """C times a vector."""
    return (
        C[0, 0] * x + C[0, 1] * y + C[0, 2] * z,
        C[1, 0] * x + C[1, 1] * y + C[1, 2] * z,
        C[2, 0] * x + C[2, 1] * y + C[2, 2] * z,
    )


@njit(cache=True, error_model="numpy")
def rotate_back(C, x, y, z):
    """Transpose of C times a vector."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


@njit(cache=True, error_model="numpy")
def cross(ax, ay, az, bx, by, bz):
    """Vector product a × b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, error_model="numpy")
def vector_quaternion(x, y, z):
    """Quaternion (scalar first) of a rotation vector."""
    quarter2 = 0.25 * (x * x + y * y + z * z)
    s, c = savage(quarter2)
    return 1.0 - c * quarter2, 0.5 * s * x, 0.5 * s * y, 0.5 * s * z


@njit(cache=True, error_model="numpy")
def quaternion_product(a0, a1, a2, a3, b0, b1, b2, b3):
    """Hamilton product: the rotation b, then a, as with matrices A B."""
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@njit(cache=True, error_model="numpy")
def quaternion_matrix(C, q0, q1, q2, q3):
    """Fill C with the matrix of a quaternion; its length does not matter."""
    w = 2.0 / (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - w * (q2 * q2 + q3 * q3), w * (q1 * q2 - q0 * q3), w * (q1 * q3 + q0 * q2)
    C[1, 0], C[1, 1], C[1, 2] = w * (q1 * q2 + q0 * q3), 1.0 - w * (q1 * q1 + q3 * q3), w * (q2 * q3 - q0 * q1)
    C[2, 0], C[2, 1], C[2, 2] = w * (q1 * q3 - q0 * q2), w * (q2 * q3 + q0 * q1), 1.0 - w * (q1 * q1 + q2 * q2)


@njit(cache=True, error_model="numpy")
def matrix_quaternion(C):
    """Quaternion (scalar first, not negative) of a matrix, through its greatest component (Shepperd 1978)."""
    trace = C[0, 0] + C[1, 1] + C[2, 2]
    largest = max(trace, C[0, 0], C[1, 1], C[2, 2])
    if largest == trace:
        q0, q1, q2, q3 = 1.0 + trace, C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]
    elif largest == C[0, 0]:
        q0, q1, q2, q3 = C[2, 1] - C[1, 2], 1.0 + 2.0 * C[0, 0] - trace, C[0, 1] + C[1, 0], C[0, 2] + C[2, 0]
    elif largest == C[1, 1]:
        q0, q1, q2, q3 = C[0, 2] - C[2, 0], C[0, 1] + C[1, 0], 1.0 + 2.0 * C[1, 1] - trace, C[1, 2] + C[2, 1]
    else:
        q0, q1, q2, q3 = C[1, 0] - C[0, 1], C[0, 2] + C[2, 0], C[1, 2] + C[2, 1], 1.0 + 2.0 * C[2, 2] - trace
    length = math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    if q0 < 0.0:
        length = -length
    return q0 / length, q1 / length, q2 / length, q3 / length


@njit(cache=True, error_model="numpy")
def quaternion_vector(q0, q1, q2, q3):
    """Rotation vector (at most half a turn) of a unit quaternion."""
    if q0 < 0.0:
        q0, q1, q2, q3 = -q0, -q1, -q2, -q3
    sine2 = q1 * q1 + q2 * q2 + q3 * q3
    if sine2 < 1e-10:
        k = 2.0 / q0 * (1.0 - sine2 / (3.0 * q0 * q0))
    else:
        sine = math.sqrt(sine2)
        k = 2.0 * math.atan2(sine, q0) / sine
    return k * q1, k * q2, k * q3


@njit(cache=True, error_model="numpy")
def orthonormalise(C):
    """One step C (I - E / 2) with E = CᵀC - I: the condition adjustment of a matrix that is nearly a rotation."""
    e00 = C[0, 0] * C[0, 0] + C[1, 0] * C[1, 0] + C[2, 0] * C[2, 0] - 1.0
    e11 = C[0, 1] * C[0, 1] + C[1, 1] * C[1, 1] + C[2, 1] * C[2, 1] - 1.0
    e22 = C[0, 2] * C[0, 2] + C[1, 2] * C[1, 2] + C[2, 2] * C[2, 2] - 1.0
    e01 = C[0, 0] * C[0, 1] + C[1, 0] * C[1, 1] + C[2, 0] * C[2, 1]
    e02 = C[0, 0] * C[0, 2] + C[1, 0] * C[1, 2] + C[2, 0] * C[2, 2]
    e12 = C[0, 1] * C[0, 2] + C[1, 1] * C[1, 2] + C[2, 1] * C[2, 2]
    for i in range(3):
        a, b, d = C[i, 0], C[i, 1], C[i, 2]
        C[i, 0] = a - 0.5 * (a * e00 + b * e01 + d * e02)
        C[i, 1] = b - 0.5 * (a * e01 + b * e11 + d * e12)
        C[i, 2] = d - 0.5 * (a * e02 + b * e12 + d * e22)


@njit(cache=True, error_model="numpy")
def fill_attitude_matrix(azimuth, pitch, roll, out):
    """Fill out (n, 3, 3) with attitude matrices."""
    for i in range(azimuth.size):
        attitude_matrix(out[i], azimuth[i], pitch[i], roll[i])


@njit(cache=True, error_model="numpy")
def fill_matrix_attitude(matrices, out):
    """Fill out (n, 3) with azimuth, pitch, roll."""
    for i in range(matrices.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = matrix_attitude(matrices[i])


@njit(cache=True, error_model="numpy")
def fill_vector_matrix(vectors, out):
    """Fill out (n, 3, 3) with the matrices of rotation vectors."""
    for i in range(vectors.shape[0]):
        vector_matrix(out[i], vectors[i, 0], vectors[i, 1], vectors[i, 2])


@njit(cache=True, error_model="numpy")
def fill_vector_quaternion(vectors, out):
    """Fill out (n, 4) with the quaternions of rotation vectors."""
    for i in range(vectors.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = vector_quaternion(vectors[i, 0], vectors[i, 1], vectors[i, 2])


@njit(cache=True, error_model="numpy")
def fill_quaternion_vector(quaternions, out):
    """Fill out (n, 3) with the rotation vectors of unit quaternions."""
    for i in range(quaternions.shape[0]):
        q = quaternions[i]
        out[i, 0], out[i, 1], out[i, 2] = quaternion_vector(q[0], q[1], q[2], q[3])


@njit(cache=True, error_model="numpy")
def fill_quaternion_matrix(quaternions, out):
    """Fill out (n, 3, 3) with the matrices of quaternions."""
    for i in range(quaternions.shape[0]):
        q = quaternions[i]
        quaternion_matrix(out[i], q[0], q[1], q[2], q[3])


@njit(cache=True, error_model="numpy")
def fill_matrix_quaternion(matrices, out):
    """Fill out (n, 4) with the quaternions of matrices."""
    for i in range(matrices.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = matrix_quaternion(matrices[i])


# ---- resample --------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def find_interval(x, axis, i):
    """Interval i with axis[i] <= x < axis[i + 1], by walking from a guess, by bisection when it lies far."""
    last = axis.size - 2
    i = min(max(i, 0), last)
    for _ in range(8):
        if x < axis[i]:
            if i == 0:
                return 0
            i -= 1
        elif x >= axis[i + 1]:
            if i == last:
                return last
            i += 1
        else:
            return i
    low, high = 0, last
    while low < high:
        middle = (low + high + 1) // 2
        if axis[middle] <= x:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, error_model="numpy")
def interpolate(x, axis, values, period, out):
    """Fill out (n, k) with values (m, k) between the points of a rising axis, NaN outside; period 0 = no angle."""
    i = 0
    for n in range(x.size):
        if not (axis[0] <= x[n] <= axis[-1]):
            for k in range(values.shape[1]):
                out[n, k] = np.nan
            continue
        i = find_interval(x[n], axis, i)
        part = (x[n] - axis[i]) / (axis[i + 1] - axis[i])
        for k in range(values.shape[1]):
            if part == 0.0 or part == 1.0:  # a gap beside a good point does not reach over it
                out[n, k] = values[i, k] if part == 0.0 else values[i + 1, k]
                continue
            step = values[i + 1, k] - values[i, k]
            if period > 0.0:
                step -= period * math.floor(step / period + 0.5)
            out[n, k] = values[i, k] + part * step


@njit(cache=True, error_model="numpy")
def cumulative(axis, values, out):
    """Fill out (m, k) with the integral of the broken line from the first point on; NaN stretches add nothing."""
    for k in range(values.shape[1]):
        out[0, k] = 0.0
    for i in range(1, axis.size):
        half = 0.5 * (axis[i] - axis[i - 1])
        for k in range(values.shape[1]):
            area = half * (values[i, k] + values[i - 1, k])
            out[i, k] = out[i - 1, k] + (area if area == area else 0.0)


@njit(cache=True, error_model="numpy")
def integral_at(x, i, axis, values, integral, k):
    """Integral of the broken line from its first point to x, which lies in interval i."""
    d = x - axis[i]
    slope = (values[i + 1, k] - values[i, k]) / (axis[i + 1] - axis[i])
    return integral[i, k] + d * (values[i, k] + 0.5 * d * slope)


@njit(cache=True, error_model="numpy")
def box_average(centre, length, axis, values, integral, gaps, out):
    """Fill out (n, k) with the mean over the box about each centre; NaN where it leaves the axis or meets a gap."""
    low = high = 0
    slack = 1e-9 * (axis[-1] - axis[0])
    for n in range(centre.size):
        begin, end = centre[n] - 0.5 * length, centre[n] + 0.5 * length
        if not (begin >= axis[0] - slack and end <= axis[-1] + slack):
            for k in range(values.shape[1]):
                out[n, k] = np.nan
            continue
        begin, end = max(begin, axis[0]), min(end, axis[-1])
        low, high = find_interval(begin, axis, low), find_interval(end, axis, high)
        last = high + 1 if end > axis[high] else high
        for k in range(values.shape[1]):
            if gaps[last, k] - (gaps[low - 1, k] if low > 0 else 0) > 0:
                out[n, k] = np.nan
                continue
            area = integral_at(end, high, axis, values, integral, k) if last > high else integral[high, k]
            out[n, k] = (area - integral_at(begin, low, axis, values, integral, k)) / length
