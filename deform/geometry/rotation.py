"""Attitude angles (degree), matrices, rotation vectors (radian) and quaternions in, the same rotation in another form out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deform.errors import OptionError
from deform.geometry import _kernels_rotation as kernels

Floats = NDArray[Any]


def attitude_to_matrix(azimuth: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Floats:
    """Return the matrices (..., 3, 3) that turn body axes (right, forward, up) into east, north, up.

    Parameters
    ----------
    azimuth : clockwise from north (degree).
    pitch : positive nose up (degree).
    roll : positive right side down (degree).

    Notes
    -----
    C = Rz(-azimuth) Rx(pitch) Ry(roll): roll first, then pitch, then heading.

    References
    ----------
    Porter (1990), eq. 3-38, transposed (he leads from the local level frame to the body).

    Examples
    --------
    >>> attitude_to_matrix(90.0, 0.0, 0.0)[:, 1].round(12)
    array([1., 0., 0.])
    """
    angles = np.broadcast_arrays(*(np.asarray(a, float) for a in (azimuth, pitch, roll)))
    out = np.empty((angles[0].size, 3, 3))
    a, p, r = (np.radians(angle).ravel() for angle in angles)
    kernels.fill_attitude_matrix(a, p, r, out)
    return out.reshape(*angles[0].shape, 3, 3)


def matrix_to_attitude(matrix: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return azimuth in [0, 360), pitch and roll (degree) of matrices (..., 3, 3), body to east, north, up.

    References
    ----------
    Porter (1990), eq. 3-39 to 3-41, the arcsine replaced by a two-sided arctangent, which stays exact near the vertical.
    """
    flat, shape = _flat(matrix, (3, 3))
    out = np.empty((len(flat), 3))
    kernels.fill_matrix_attitude(flat, out)
    azimuth, pitch, roll = (np.degrees(out[:, i]).reshape(shape) for i in range(3))
    return azimuth % 360.0, pitch, roll


def savage_coefficients(angle: ArrayLike) -> tuple[Floats, Floats]:
    """Return s = sin(a) / a and c = (1 - cos a) / a² of angles in radian, by their series near zero.

    References
    ----------
    Porter (1990), eq. 3-37; Savage (1984).
    """
    angle2 = np.asarray(angle, float) ** 2
    pairs = np.array([kernels.savage(a) for a in angle2.ravel()]).reshape(*angle2.shape, 2)
    return pairs[..., 0], pairs[..., 1]


def rotation_vector_to_matrix(vector: ArrayLike) -> Floats:
    """Return the matrices (..., 3, 3) I + s Ω + c Ω² of rotation vectors (..., 3) in radian.

    References
    ----------
    Porter (1990), eq. 3-37.
    """
    flat, shape = _flat(vector, (3,))
    out = np.empty((len(flat), 3, 3))
    kernels.fill_vector_matrix(flat, out)
    return out.reshape(*shape, 3, 3)


def matrix_to_rotation_vector(matrix: ArrayLike) -> Floats:
    """Return the rotation vectors (..., 3) in radian, at most half a turn, of matrices (..., 3, 3)."""
    return quaternion_to_rotation_vector(matrix_to_quaternion(matrix))


def rotation_vector_to_quaternion(vector: ArrayLike) -> Floats:
    """Return unit quaternions (..., 4), scalar first, of rotation vectors (..., 3) in radian."""
    flat, shape = _flat(vector, (3,))
    out = np.empty((len(flat), 4))
    kernels.fill_vector_quaternion(flat, out)
    return out.reshape(*shape, 4)


def quaternion_to_rotation_vector(quaternion: ArrayLike) -> Floats:
    """Return rotation vectors (..., 3) in radian, at most half a turn, of quaternions (..., 4)."""
    flat, shape = _flat(quaternion_normalise(quaternion), (4,))
    out = np.empty((len(flat), 3))
    kernels.fill_quaternion_vector(flat, out)
    return out.reshape(*shape, 3)


def quaternion_to_matrix(quaternion: ArrayLike) -> Floats:
    """Return the matrices (..., 3, 3) of quaternions (..., 4), scalar first; their length does not matter."""
    flat, shape = _flat(quaternion, (4,))
    out = np.empty((len(flat), 3, 3))
    kernels.fill_quaternion_matrix(flat, out)
    return out.reshape(*shape, 3, 3)


def matrix_to_quaternion(matrix: ArrayLike) -> Floats:
    """Return unit quaternions (..., 4), scalar first and not negative, of matrices (..., 3, 3)."""
    flat, shape = _flat(matrix, (3, 3))
    out = np.empty((len(flat), 4))
    kernels.fill_matrix_quaternion(flat, out)
    return out.reshape(*shape, 4)


def quaternion_multiply(first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the Hamilton product, the quaternion of the matrix product ``first @ second``."""
    a, b = np.moveaxis(np.asarray(first, float), -1, 0), np.moveaxis(np.asarray(second, float), -1, 0)
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ],
        axis=-1,
    )


def quaternion_normalise(quaternion: ArrayLike) -> Floats:
    """Return quaternions (..., 4) of length one."""
    quaternion = np.asarray(quaternion, float)
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)


def skew(vector: ArrayLike) -> Floats:
    """Return the matrices (..., 3, 3) with ``skew(a) @ b == cross(a, b)``."""
    x, y, z = np.moveaxis(np.asarray(vector, float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=-2)


def orthonormalise(matrix: ArrayLike, method: str = "condition") -> Floats:
    """Return the rotations next to matrices (..., 3, 3) that are nearly rotations.

    Parameters
    ----------
    matrix : matrices with small departures from orthonormal rows and columns.
    method : ``condition`` (least-squares condition adjustment), ``polar`` (singular values set to one) or ``quaternion``.

    Notes
    -----
    The condition adjustment asks for the smallest corrections r of the nine elements with RᵀR = I; its limit is the polar
    factor. The quaternion's is another one, equal to first order for the part that is a rotation; they differ at second order.

    References
    ----------
    Porter (1990), eq. 3-42 to 3-45.

    Raises
    ------
    OptionError
        When the method is none of these.
    """
    if method not in ORTHONORMALISATIONS:
        raise OptionError(f"orthonormalisation {method!r} is unknown; known are {', '.join(ORTHONORMALISATIONS)}")
    flat, shape = _flat(matrix, (3, 3))
    return ORTHONORMALISATIONS[method](flat).reshape(*shape, 3, 3)


def _condition(matrices: Floats) -> Floats:
    """Gauss-Newton on w = RᵀR - I = 0 with r = -Bᵀ (B Bᵀ)⁻¹ w, unit weights (3-44)."""
    matrices = matrices.copy()
    upper = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
    i, j = upper.T
    for _ in range(10):
        w = (np.swapaxes(matrices, 1, 2) @ matrices - np.eye(3))[:, i, j]
        if np.abs(w).max(initial=0.0) < 1e-15:
            break
        B = np.zeros((len(matrices), 6, 3, 3))
        for k, (a, b) in enumerate(upper):
            B[:, k, :, a] += matrices[:, :, b]
            B[:, k, :, b] += matrices[:, :, a]
        rows = B.reshape(-1, 6, 9)
        columns = np.swapaxes(rows, 1, 2)
        r = -columns @ np.linalg.solve(rows @ columns, w[..., None])
        matrices += r.reshape(-1, 3, 3)
    return matrices


def _polar(matrices: Floats) -> Floats:
    u, _, v = np.linalg.svd(matrices)
    return u @ v


def _by_quaternion(matrices: Floats) -> Floats:
    """Quaternion nearest to a matrix: the eigenvector of Bar-Itzhack's (2000) symmetric 4 x 4 matrix."""
    m = matrices
    k = np.empty((len(m), 4, 4))
    k[:, 0, 0] = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    k[:, 0, 1] = k[:, 1, 0] = m[:, 2, 1] - m[:, 1, 2]
    k[:, 0, 2] = k[:, 2, 0] = m[:, 0, 2] - m[:, 2, 0]
    k[:, 0, 3] = k[:, 3, 0] = m[:, 1, 0] - m[:, 0, 1]
    k[:, 1:, 1:] = m + np.swapaxes(m, 1, 2) - k[:, :1, :1] * np.eye(3)
    quaternions = np.ascontiguousarray(np.linalg.eigh(k)[1][:, :, -1])
    return quaternion_to_matrix(quaternions)


ORTHONORMALISATIONS: dict[str, Callable[[Floats], Floats]] = {
    "condition": _condition,
    "polar": _polar,
    "quaternion": _by_quaternion,
}


def _flat(values: ArrayLike, tail: tuple[int, ...]) -> tuple[Floats, tuple[int, ...]]:
    array = np.asarray(values, float)
    if array.shape[-len(tail) :] != tail:
        raise ValueError(f"shape {array.shape} does not end in {tail}")
    head = array.shape[: array.ndim - len(tail)]
    return np.ascontiguousarray(array).reshape(-1, *tail), head
