"""Mean counts of a unit at rest in k orientations in; biases, drifts and attitudes with their full covariance out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry import earth
from deform.geometry.rotation import attitude_to_matrix, matrix_to_attitude, rotation_vector_to_matrix, skew
from deform.nav.alignment import level_and_gyrocompass

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """Result of the adjustment.

    Parameters
    ----------
    accel_bias : (3,) m/s², added to the true force by the sensors.
    gyro_bias : (3,) rad/s.
    attitudes : (k, 3) azimuth, pitch, roll of each orientation (degree).
    covariance : of accel_bias, gyro_bias, then per orientation the turning error about east, north, up (radian).
    residuals : (k, 6) force (m/s²) and rate (rad/s).
    variance_factor : of the adjustment; 1 when the sigmas of the observations are honest, NaN without redundancy.
    """

    accel_bias: Floats
    gyro_bias: Floats
    attitudes: Floats
    covariance: Floats
    residuals: Floats
    variance_factor: float

    @property
    def accel_bias_sigma(self) -> Floats:
        """Standard deviations (m/s²)."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def gyro_bias_sigma(self) -> Floats:
        """Standard deviations (rad/s)."""
        return np.sqrt(np.diag(self.covariance)[3:6])

    @property
    def attitude_sigma(self) -> Floats:
        """Standard deviations of the turning errors about east, north, up (k, 3), degree."""
        return np.degrees(np.sqrt(np.diag(self.covariance)[6:])).reshape(-1, 3)


def calibrate(
    force: Sequence | Floats,
    rate: Sequence | Floats,
    latitude_deg: float,
    height: float = 0.0,
    *,
    force_sigma: float,
    rate_sigma: float,
    bias_sigma: tuple[float, float] | None = None,
) -> Calibration:
    """Adjust biases, drifts and attitudes to k sets of mean force and mean angular rate at rest.

    Parameters
    ----------
    force, rate : (k, 3) means in body axes (m/s², rad/s).
    latitude_deg, height : of the place.
    force_sigma, rate_sigma : standard deviation of one mean.
    bias_sigma : what is known beforehand of accelerometer biases and gyro drifts (m/s², rad/s); without it they are free, which
        one orientation alone cannot carry.

    Notes
    -----
    Observation equations Rᵀ g - f + b = 0 and Rᵀ ω - w + d = 0 per orientation, linearised in a turn of R about east, north, up,
    which has no singular pitch; normal equations N = AᵀC⁻¹A, solution -N⁻¹AᵀC⁻¹w (Porter's 3-13 lacks the inverse on C),
    covariance N⁻¹. Directions that the orientations do not determine get the pseudo-inverse's zero in the solution and an
    infinite variance in the covariance; weakly determined ones, such as the forward bias of sets that never pitch, a large one.

    References
    ----------
    Porter (1990), eq. 3-2 to 3-14 and tables 4-1 to 4-3.

    Raises
    ------
    InputError
        When there is no orientation, or shapes differ.
    """
    force, rate = np.atleast_2d(np.asarray(force, float)), np.atleast_2d(np.asarray(rate, float))
    if force.shape != rate.shape or force.shape[1:] != (3,) or not len(force):
        raise InputError(Fault("calibration", "force, rate", f"have shapes {force.shape} and {rate.shape}; wanted (k, 3) both"))
    k = len(force)
    g = np.array([0.0, 0.0, float(earth.gravity(latitude_deg, height))])
    omega = earth.earth_rate(latitude_deg)
    matrices = np.stack([level_and_gyrocompass(w, f) for f, w in zip(force, rate, strict=True)])
    bias = np.zeros(6)
    weight = np.tile(np.repeat([1.0 / force_sigma**2, 1.0 / rate_sigma**2], 3), k)
    for _ in range(20):
        A, w = _design(matrices, bias, g, omega, force, rate)
        N, t = A.T @ (weight[:, None] * A), A.T @ (weight * w)
        if bias_sigma is not None:
            prior = np.repeat([1.0 / bias_sigma[0] ** 2, 1.0 / bias_sigma[1] ** 2], 3)
            N[range(6), range(6)] += prior
            t[:6] += prior * bias
        inverse, unknown = _inverse(N)
        step = -inverse @ t
        bias += step[:6]
        matrices = rotation_vector_to_matrix(step[6:].reshape(-1, 3)) @ matrices
        if np.abs(step[6:]).max() < 1e-12:
            break
    _A, w = _design(matrices, bias, g, omega, force, rate)
    freedom = 6 * k - (6 + 3 * k) + (6 if bias_sigma is not None else int(np.sum(~np.isfinite(np.diag(unknown)))))
    square = float(np.sum(weight * w**2)) + (float(np.sum(prior * bias**2)) if bias_sigma is not None else 0.0)
    angles = np.column_stack(matrix_to_attitude(matrices))
    return Calibration(bias[:3], bias[3:], angles, unknown, w.reshape(k, 6), square / freedom if freedom > 0 else math.nan)


def _design(matrices: Floats, bias: Floats, g: Floats, omega: Floats, force: Floats, rate: Floats) -> tuple[Floats, Floats]:
    """Design matrix (6k, 6 + 3k) and misclosures: model minus observation."""
    k = len(matrices)
    A, w = np.zeros((6 * k, 6 + 3 * k)), np.empty(6 * k)
    for i, C in enumerate(matrices):
        for j, (vector, seen, first) in enumerate(((g, force[i], 0), (omega, rate[i], 3))):
            here = slice(6 * i + 3 * j, 6 * i + 3 * j + 3)
            w[here] = C.T @ vector + bias[first : first + 3] - seen
            A[here, first : first + 3] = np.eye(3)
            A[here, 6 + 3 * i : 9 + 3 * i] = C.T @ skew(vector)
    return A, w


def _inverse(N: Floats) -> tuple[Floats, Floats]:
    """Pseudo-inverse in scaled unknowns, and the covariance with infinite variance where the data say nothing."""
    scale = 1.0 / np.sqrt(np.diag(N))
    values, vectors = np.linalg.eigh(N * scale * scale[:, None])
    good = values > 1e-12 * values[-1]
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T * scale * scale[:, None]
    covariance = inverse.copy()
    if not good.all():
        lost = np.abs(vectors[:, ~good]).max(axis=1) > 1e-6
        covariance[lost, lost] = np.inf
    return inverse, covariance


def orientation(azimuth: float, pitch: float, roll: float, latitude_deg: float, height: float = 0.0) -> tuple[Floats, Floats]:
    """Return force (m/s²) and rate (rad/s) in body axes of a perfect unit at rest with an attitude in degree."""
    C = attitude_to_matrix(azimuth, pitch, roll)
    return C.T @ np.array([0.0, 0.0, float(earth.gravity(latitude_deg, height))]), C.T @ earth.earth_rate(latitude_deg)
