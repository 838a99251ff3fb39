"""Angles, vectors, matrices and quaternions in, the same out: the jitted floor of `rotation`."""

from __future__ import annotations

import math

from numba import njit

_SMALL2 = 1e-4  # rad², below it the series carry s and c to the last digit


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
