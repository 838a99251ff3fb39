"""Mean counts of a unit at rest in k orientations in; biases, drifts and attitudes with their full covariance out."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry import earth
from deform.geometry.rotation import (
    attitude_to_matrix,
    matrix_to_attitude,
    matrix_to_rotation_vector,
    rotation_vector_to_matrix,
    skew,
)
from deform.nav.alignment import Alignment, level_and_gyrocompass
from deform.nav.compensation import STANDARD_GRAVITY
from deform.nav.rest_sets import RestSets
from deform.run.raw import Compensation, ImuHeader

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

AXES = ("right", "forward", "up")
LIKELY, APART_RAD = 0.01, math.radians(1.0)  # of a second solution worth telling of
WEAK = 10.0  # times the sigma of the best axis
MOST_STEPS, STANDS = 60, 1e-6  # in sigmas of the observations


@dataclass(frozen=True)
class Calibration:
    """Result of the adjustment.

    Parameters
    ----------
    accel_bias : (3,) m/s², added to the true force by the sensors.
    gyro_bias : (3,) rad/s.
    matrices : (k, 3, 3) attitude of each orientation, body to east, north, up.
    covariance : of accel_bias, gyro_bias, then per orientation the turning error about east, north, up (radian).
    residuals : (k, 6) force (m/s²) and rate (rad/s).
    variance_factor : of the adjustment; 1 when the sigmas of the observations are honest, NaN without redundancy.
    other_azimuth : azimuth of the last orientation (degree) in a second solution that fits about as well, NaN without one.
    """

    accel_bias: Floats
    gyro_bias: Floats
    matrices: Floats
    covariance: Floats
    residuals: Floats
    variance_factor: float
    other_azimuth: float = math.nan

    @property
    def attitudes(self) -> Floats:
        """Azimuth, pitch, roll of each orientation (k, 3), degree."""
        return np.column_stack(matrix_to_attitude(self.matrices))

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

    def alignment(self, orientation: int = -1) -> Alignment:
        """Return the attitude of one orientation, the mission's being the last, as an alignment."""
        return Alignment(self.matrices[orientation], 0.0, np.radians(self.attitude_sigma[orientation]), "calibrated", (0.0, 0.0))

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return gyro drifts, accelerometer biases and orientations with their standard deviations.

        References
        ----------
        Porter (1990), tables 4-1, 4-2 and 4-3.
        """
        per_hour = np.degrees(1.0) * 3600.0
        drifts = {"axis": AXES, "drift_deg_per_h": self.gyro_bias * per_hour, "sigma_deg_per_h": self.gyro_bias_sigma * per_hour}
        biases = {"axis": AXES, "bias_m_per_s2": self.accel_bias, "sigma_m_per_s2": self.accel_bias_sigma}
        angles = {f"{name}_deg": self.attitudes[:, i] for i, name in enumerate(("azimuth", "pitch", "roll"))}
        sigmas = np.array([self.alignment(i).angle_sigma for i in range(len(self.matrices))])
        angles |= {f"{name}_sigma_deg": sigmas[:, i] for i, name in enumerate(("azimuth", "pitch", "roll"))}
        return {"gyro_drift": pd.DataFrame(drifts), "accel_bias": pd.DataFrame(biases), "orientation": pd.DataFrame(angles)}

    def compensation(self, imu: ImuHeader) -> Compensation:
        """Return what the header of a run under the same power-up should say: drifts and biases in sensor axes, added to its own.

        What a header holds besides (scale, asymmetry, mass unbalance) stays.
        """
        known = imu.compensation or Compensation()
        drift = imu.mounting.T @ np.degrees(self.gyro_bias) * 3600.0 + known.gyro_drift_deg_per_h
        bias = imu.mounting.T @ self.accel_bias / (STANDARD_GRAVITY * 1e-6) + known.accel_bias_ug
        return replace(known, gyro_drift_deg_per_h=tuple(drift.tolist()), accel_bias_ug=tuple(bias.tolist()))


def calibrate_sets(sets: RestSets, latitude_deg: float, height: float = 0.0, *, bias_known: bool = True) -> Calibration:
    """Return the calibration of a unit from its recordings at rest, with the maker's figures for sigmas.

    Parameters
    ----------
    sets : means and sigmas from `rest_sets.rest_sets`.
    latitude_deg, height : of the place.
    bias_known : the maker's one-sigma figures of bias and drift hold the unknowns; False leaves them to the sets alone, which
        one set cannot carry.

    Examples
    --------
    >>> sets = rest_sets(raw, [(0.0, 600.0), (900.0, 1500.0)])  # doctest: +SKIP
    >>> found = calibrate_sets(sets, 61.0, 200.0)  # doctest: +SKIP
    >>> found.tables()["gyro_drift"]  # doctest: +SKIP
    """
    prior = sets.bias_sigma if bias_known else None
    sigma = {"force_sigma": sets.force_sigma, "rate_sigma": sets.rate_sigma}
    return calibrate(sets.force, sets.rate, latitude_deg, height, bias_sigma=prior, **sigma)


def calibrate(
    force: Sequence | Floats,
    rate: Sequence | Floats,
    latitude_deg: float,
    height: float = 0.0,
    *,
    force_sigma: float | Floats,
    rate_sigma: float | Floats,
    bias_sigma: tuple[float, float] | None = None,
) -> Calibration:
    """Adjust biases, drifts and attitudes to k sets of mean force and mean angular rate at rest.

    Parameters
    ----------
    force, rate : (k, 3) means in body axes (m/s², rad/s).
    latitude_deg, height : of the place.
    force_sigma, rate_sigma : standard deviation of a mean, one for all or one per set.
    bias_sigma : what is known beforehand of accelerometer biases and gyro drifts (m/s², rad/s); (0, 0) holds them at zero
        (alignment only: three unknowns from six observations); without it they are free, which one set cannot carry.

    Notes
    -----
    Observation equations Rᵀ g - f + b = 0 and Rᵀ ω - w + d = 0 per orientation, linearised in a turn of R about east, north, up,
    which has no singular pitch; normal equations N = AᵀC⁻¹A, solution -N⁻¹AᵀC⁻¹w (Porter's 3-13 lacks the inverse on C),
    damped after Levenberg where a full step would go wrong, covariance N⁻¹. Directions that the orientations do not determine
    get an infinite variance; weakly determined ones, such as the forward bias of sets that never pitch, a large one, and are
    named in the log. Sets that all lie on one heading fit the heading mirrored about east as well, with another forward drift:
    both solutions are sought, the better one is given, and the covariance holds the way to the other as far as it is likely.

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
    pairs = np.column_stack([np.broadcast_to(force_sigma, k), np.broadcast_to(rate_sigma, k)])
    seen, sigma = np.column_stack([force, rate]).ravel(), np.repeat(pairs, 3, axis=1).ravel()
    if bias_sigma is not None:  # what is known beforehand is observed as zero
        held = (1e-3 * pairs[:, 0].min(), 1e-3 * pairs[:, 1].min())
        seen, sigma = np.append(seen, np.zeros(6)), np.append(sigma, np.repeat(np.maximum(bias_sigma, held), 3))
    model = _Model(np.array([0.0, 0.0, float(earth.gravity(latitude_deg, height))]), earth.earth_rate(latitude_deg), sigma)
    first = np.stack([level_and_gyrocompass(w, f) for f, w in zip(force, rate, strict=True)])
    bias, matrices, w, A = model.adjust(seen, np.zeros(6), first)
    other = model.adjust(seen, bias, _mirrored(matrices))
    if other[2] @ other[2] < w @ w:
        other, (bias, matrices, w, A) = (bias, matrices, w, A), other
    covariance, free = _covariance(A.T @ A)
    share = math.exp(-0.5 * float(other[2] @ other[2] - w @ w))  # how likely the other one is beside this one
    apart = np.concatenate([other[0] - bias, matrix_to_rotation_vector(other[1] @ matrices.transpose(0, 2, 1)).ravel()])
    covariance += share / (1.0 + share) * np.outer(apart, apart)
    azimuth = float(matrix_to_attitude(other[1][-1])[0]) if share > LIKELY and np.abs(apart[6:]).max() > APART_RAD else math.nan
    freedom = seen.size - A.shape[1] + free
    factor = float(w @ w) / freedom if freedom > 0 else math.nan
    residuals = (w * sigma)[: 6 * k].reshape(k, 6)
    found = Calibration(bias[:3], bias[3:], matrices, covariance, residuals, factor, azimuth)
    _tell_weak(found)
    return found


@dataclass(frozen=True)
class _Model:
    """Gravity and earth rate in east, north, up, and the standard deviations of the observations."""

    gravity: Floats
    earth: Floats
    sigma: Floats

    def adjust(self, seen: Floats, bias: Floats, matrices: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Bias, attitudes, normalised misclosures and design where the squares of the misclosures are least."""
        damping = 0.0
        A, w = self.design(seen, bias, matrices)
        for _ in range(MOST_STEPS):
            N = A.T @ A
            step = -_pseudo_inverse(N + damping * np.diag(np.diag(N)))[0] @ (A.T @ w)
            ahead = bias + step[:6], rotation_vector_to_matrix(step[6:].reshape(-1, 3)) @ matrices
            A_ahead, w_ahead = self.design(seen, *ahead)
            if w_ahead @ w_ahead > w @ w * (1.0 + 1e-9) + 1e-12 and damping < 1e6:
                damping = max(10.0 * damping, 1e-4)
                continue
            (bias, matrices), A, w = ahead, A_ahead, w_ahead
            damping = damping / 10.0 if damping > 1e-6 else 0.0
            if damping == 0.0 and np.abs(A @ step).max() < STANDS:
                break
        return bias, matrices, w, A

    def design(self, seen: Floats, bias: Floats, matrices: Floats) -> tuple[Floats, Floats]:
        """Design (observation, 6 + 3 k) and misclosures, model minus observation, both in sigmas of the observations."""
        k = len(matrices)
        A, w = np.zeros((seen.size, 6 + 3 * k)), -seen
        vectors = np.stack([self.gravity, self.earth])
        w[: 6 * k] += (vectors @ matrices).ravel() + np.tile(bias, k)
        turns = (matrices.transpose(0, 2, 1)[:, None] @ skew(vectors)).reshape(k, 6, 3)
        A[:, :6] = np.tile(np.eye(6), (seen.size // 6, 1))
        for i, turn in enumerate(turns):
            A[6 * i : 6 * i + 6, 6 + 3 * i : 9 + 3 * i] = turn
        w[6 * k :] += bias[: seen.size - 6 * k]
        return A / self.sigma[:, None], w / self.sigma


def _mirrored(matrices: Floats) -> Floats:
    """Attitudes with the azimuth mirrored about the line east to west: their level axes meet the same earth rate across."""
    azimuth, pitch, roll = matrix_to_attitude(matrices)
    return attitude_to_matrix(180.0 - azimuth, pitch, roll)


def _pseudo_inverse(N: Floats) -> tuple[Floats, Floats]:
    """Pseudo-inverse in scaled unknowns, and the directions (n, m) that the data say nothing of."""
    scale = 1.0 / np.sqrt(np.diag(N))
    values, vectors = np.linalg.eigh(N * scale * scale[:, None])
    good = values > 1e-12 * values[-1]
    return (vectors[:, good] / values[good]) @ vectors[:, good].T * scale * scale[:, None], vectors[:, ~good]


def _covariance(N: Floats) -> tuple[Floats, int]:
    """Covariance with infinite variance where the data say nothing, and the number of such directions."""
    covariance, lost = _pseudo_inverse(N)
    rows = np.flatnonzero(np.abs(lost).max(axis=1, initial=0.0) > 1e-6)
    covariance[rows, rows] = np.inf
    return covariance, lost.shape[1]


def _tell_weak(found: Calibration) -> None:
    for what, sigma in (("accelerometer bias", found.accel_bias_sigma), ("gyro drift", found.gyro_bias_sigma)):
        best = float(sigma.min()) if np.isfinite(sigma.min()) else 1.0
        for axis, size in zip(AXES, sigma / best, strict=True):
            if size > WEAK:
                told = "not determined" if np.isinf(size) else f"weakly determined, {size:.0f} times the sigma of the best axis"
                log.warning(
                    "calibration: the %s %s is %s: lay the unit so that this axis meets other directions", axis, what, told
                )
    if not math.isnan(found.other_azimuth):
        log.warning("calibration: an azimuth of %.1f degree fits about as well as %.1f: lay the unit on another heading as well",
                    found.other_azimuth, found.attitudes[-1, 0])  # fmt: skip


def orientation(azimuth: float, pitch: float, roll: float, latitude_deg: float, height: float = 0.0) -> tuple[Floats, Floats]:
    """Return force (m/s²) and rate (rad/s) in body axes of a perfect unit at rest with an attitude in degree."""
    C = attitude_to_matrix(azimuth, pitch, roll)
    return C.T @ np.array([0.0, 0.0, float(earth.gravity(latitude_deg, height))]), C.T @ earth.earth_rate(latitude_deg)
