"""Calibration over static orientations: known biases come back, weak geometry shows in the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.nav.calibration import calibrate, orientation

SETS = [
    (10.0, 0.0, 0.0),
    (100.0, 5.0, 90.0),
    (190.0, -8.0, 180.0),
    (280.0, 40.0, 270.0),
    (45.0, 80.0, 30.0),
    (300.0, -60.0, 120.0),
]
ACCEL, GYRO = np.array([5e-4, -3e-4, 8e-4]), np.radians([0.02, -0.01, 0.03]) / 3600.0
FORCE_SIGMA, RATE_SIGMA = 1e-5, np.radians(0.002) / 3600.0


def observed(sets, seed=None):
    pairs = [orientation(*s, 61.0, 200.0) for s in sets]
    force, rate = np.array([p[0] for p in pairs]) + ACCEL, np.array([p[1] for p in pairs]) + GYRO
    if seed is None:
        return force, rate
    noise = np.random.default_rng(seed)
    return force + FORCE_SIGMA * noise.standard_normal(force.shape), rate + RATE_SIGMA * noise.standard_normal(rate.shape)


def test_biases_drifts_and_attitudes_come_back_from_six_orientations():
    found = calibrate(*observed(SETS), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    np.testing.assert_allclose(found.accel_bias, ACCEL, atol=1e-9)
    np.testing.assert_allclose(found.gyro_bias, GYRO, atol=1e-13)
    wrapped = (found.attitudes - np.array(SETS) + 180.0) % 360.0 - 180.0
    assert np.abs(wrapped).max() < 1e-6


def test_the_covariance_is_honest():
    errors = []
    for seed in range(60):
        found = calibrate(*observed(SETS, seed), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
        errors.append(
            np.concatenate(
                [(found.accel_bias - ACCEL) / found.accel_bias_sigma, (found.gyro_bias - GYRO) / found.gyro_bias_sigma]
            )
        )
    assert 0.7 < np.mean(np.square(errors)) < 1.35


def test_level_sets_leave_the_vertical_bias_to_gravity_and_the_forward_one_weak():
    level = [(a, 0.01, r) for a, r in ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0))]
    rolled = [*level[:2], (180.0, 0.01, 90.0), (270.0, 0.01, 180.0)]
    weak = calibrate(*observed(rolled, 1), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    full = calibrate(*observed(SETS, 1), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    assert (
        weak.accel_bias_sigma[1] > 3.0 * full.accel_bias_sigma[1]
    )  # forward never meets gravity: told through the earth's rate only


def test_one_set_aligns_when_the_biases_are_known_to_be_small():
    force, rate = observed(SETS[1:2])
    found = calibrate(
        force, rate, 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA, bias_sigma=(5e-4, np.radians(0.02) / 3600.0)
    )
    assert np.abs((found.attitudes[0] - SETS[1] + 180.0) % 360.0 - 180.0).max() < 3.0 * found.attitude_sigma.max()
    assert np.isfinite(found.covariance).all()


def test_shapes_that_differ_are_refused():
    with pytest.raises(InputError, match="shapes"):
        calibrate(np.zeros((2, 3)), np.zeros((3, 3)), 61.0, force_sigma=1.0, rate_sigma=1.0)
