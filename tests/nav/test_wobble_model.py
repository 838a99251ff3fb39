"""The wobble of the tool as the filter models it, against its closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from deform.nav import _kernels, _kernels_model
from deform.nav.error_model import WOBBLE_LENGTHS_M
from deform.nav.noise import wobble_spectrum
from deform.nav.second_path import swung
from tests.nav.test_filter import problem_of


def covariance(length, distance):
    """Matérn's of order 3/2, of variance one."""
    far = np.abs(distance) / length
    return (1.0 + far) * np.exp(-far)


@pytest.fixture(scope="module")
def model():
    return problem_of()[1].model


@pytest.mark.parametrize("travel", [0.3, 4.0, -4.0, 40.0])
def test_an_epoch_keeps_the_variance_and_leaves_the_covariance_of_its_length(model, travel):
    n, w, u = model.size, model.index("wobble"), model.index("sway")
    row = np.zeros(_kernels.COLUMNS)
    row[_kernels.TRAVEL], row[_kernels.SENSE] = travel, 1.0
    at, reckoned, *noise = model.arguments
    decay, Q, (follows, shared) = np.ones(n), np.zeros(n), np.zeros((2, w.stop - w.start))
    _kernels_model.process(row, at, *noise, reckoned, np.zeros(3), np.eye(3), decay, follows, Q, shared)
    first = model.first_covariance()
    F = np.diag(decay)
    F[w, u] = np.diag(decay[w] * follows)
    drive = np.diag(Q)
    drive[w, u] = drive[u, w] = np.diag(shared)
    here = np.r_[w, u]
    after = (F @ first @ F.T + drive)[np.ix_(here, here)]
    np.testing.assert_allclose(after, first[np.ix_(here, here)], rtol=1e-9, atol=1e-18)
    lengths = np.repeat(WOBBLE_LENGTHS_M, 2)
    np.testing.assert_allclose(np.diag((F @ first)[w, w]), model.variance[w] * covariance(lengths, travel), rtol=1e-9)


def test_spectrum_holds_the_variance(model):
    frequency = np.concatenate([[0.0], np.geomspace(1e-6, 1e2, 20001)])
    density = wobble_spectrum(model.variance[model.index("wobble")].reshape(-1, 2), 1.0 / np.maximum(frequency, 1e-12))
    total = model.variance[model.index("wobble")].reshape(-1, 2).sum(axis=0)
    np.testing.assert_allclose(2.0 * np.trapezoid(density, frequency, axis=0), total, rtol=1e-3)


def test_the_path_swings_by_the_double_integral_of_the_covariance(model):
    way = 70.0
    apart = np.linspace(0.0, way, 20001)
    variance = model.steady[model.index("wobble")].reshape(-1, 2).max(axis=1)
    by_sum = sum(
        2.0 * v * np.trapezoid((way - apart) * covariance(x, apart), apart)
        for v, x in zip(variance, WOBBLE_LENGTHS_M, strict=True)
    )
    assert swung(model, np.array([way]))[0] == pytest.approx(by_sum, rel=1e-6)
