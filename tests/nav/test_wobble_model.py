"""The wobble of the tool as the filter models it, against its closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from deform.nav import _kernels, _kernels_model
from deform.nav.error_model import WOBBLE_LENGTHS_M
from deform.nav.noise import wobble_spectrum
from deform.nav.second_path import swung
from deform.nav.wobble import WobbleModel, _wobble_told
from tests.nav.test_filter import problem_of


def covariance(length, distance):
    """Matérn's of order 3/2, of variance one."""
    far = np.abs(distance) / length
    return (1.0 + far) * np.exp(-far)


@pytest.fixture(scope="module")
def model():
    return problem_of()[1].model


def step(model, travel):
    """Transition and noise covariance (n, n) of the states behind the nine over an epoch of this travel."""
    n, w, u, m = (*(model.size,), *(model.index(name) for name in ("wobble", "sway", "mean")))
    row = np.zeros(_kernels.COLUMNS)
    row[_kernels.TRAVEL], row[_kernels.SENSE] = travel, 1.0
    at, reckoned, *noise = model.arguments
    decay, Q, (follows, shared), recalls = np.ones(n), np.zeros(n), np.zeros((2, w.stop - w.start)), np.zeros(2)
    _kernels_model.process(row, at, *noise, reckoned, np.zeros(3), np.eye(3), decay, follows, recalls, Q, shared)
    F, drive = np.diag(decay), np.diag(Q)
    F[w, u] = np.diag(decay[w] * follows)
    F[m, w] = np.tile(np.diag(decay[m] * recalls), 3)
    drive[w, u] = drive[u, w] = np.diag(shared)
    return F, drive


@pytest.mark.parametrize("travel", [0.3, 4.0, -4.0, 40.0])
def test_an_epoch_keeps_the_variance_and_leaves_the_covariance_of_its_length(model, travel):
    w, here = model.index("wobble"), np.r_[model.index("wobble"), model.index("sway")]
    first, (F, drive) = model.first_covariance(), step(model, travel)
    after = (F @ first @ F.T + drive)[np.ix_(here, here)]
    np.testing.assert_allclose(after, first[np.ix_(here, here)], rtol=1e-9, atol=1e-18)
    lengths = np.repeat(WOBBLE_LENGTHS_M, 2)
    np.testing.assert_allclose(np.diag((F @ first)[w, w]), model.variance[w] * covariance(lengths, travel), rtol=1e-9)


@pytest.mark.parametrize("travel", [0.2, 1.5])
def test_the_mean_of_the_wobble_settles_where_its_long_run_lies(model, travel):
    model = model.with_mean([60.0, 400.0])
    here = np.concatenate([model.ride_states(axis) for axis in (0, 1)])
    F, drive = (matrix[np.ix_(here, here)] for matrix in step(model, travel))
    settled = solve_discrete_lyapunov(F, drive)
    first = model.first_covariance()[np.ix_(here, here)]
    scale = np.sqrt(np.diag(first))
    np.testing.assert_allclose(settled / np.outer(scale, scale), first / np.outer(scale, scale), atol=0.05 * travel)


def density(model, frequency):
    """Spectrum (frequency, 2), two-sided, of the wobble of the model."""
    variance = model.variance[model.index("wobble")].reshape(-1, 2)
    return wobble_spectrum(variance, model.reach[model.index("mean")], 1.0 / frequency)


def test_spectrum_holds_the_variance_of_wobble_without_its_mean(model):
    frequency = np.geomspace(1e-7, 1e2, 40001)
    total = []
    for axis in (0, 1):
        take = np.array([1.0] * len(WOBBLE_LENGTHS_M) + [0.0] * len(WOBBLE_LENGTHS_M) + [-1.0])
        total.append(take @ model.ride_covariance(axis) @ take)
    np.testing.assert_allclose(2.0 * np.trapezoid(density(model, frequency), frequency, axis=0), total, rtol=1e-3)


@pytest.mark.parametrize("way", [5.0, 70.0, 2000.0])
def test_the_path_swings_by_what_its_spectrum_sums_up_to(model, way):
    model = model.with_mean([100.0, 300.0])
    frequency = np.geomspace(1e-7, 1e1, 200001)
    passed = (np.sin(np.pi * frequency * way) / (np.pi * frequency)) ** 2
    summed = 2.0 * np.trapezoid(density(model, frequency) * passed[:, None], frequency, axis=0)
    assert swung(model, np.array([way]))[0] == pytest.approx(summed.max(), rel=2e-3)


@pytest.mark.parametrize(("path", "tilt"), [(5e-9, 1.2e-11), (3e-8, 1e-17), (1e-6, 1e-8), (1e-10, 1e-12)])
def test_error_of_the_path_is_that_of_wobble_against_drift_in_all_waves(path, tilt):
    """One pole alone is ten times too strong in waves of tens of metres where the tilt rules: a ring was believed there."""
    model = WobbleModel(3.4e-6, 0.058, 2, 1e-9, 3e-9, path, tilt, 1e-13)
    chains = model.path_error()
    for wave in (5.0, 15.0, 45.0, 100.0, 400.0, 2000.0):
        k = 2.0 * np.pi / wave
        drift = 2.0 * path / k**2 + 2.0 * tilt / k**4
        wobble = float(model.wobble_spectrum(np.array([1.0 / wave]))[0])
        shown = sum(float(chain.spectrum(np.array([k]))[0]) for chain in chains)
        assert 0.5 < shown / (wobble * drift / (wobble + drift)) < 2.0


def test_error_of_the_path_is_led_on_as_its_chains_say():
    model = WobbleModel(3.4e-6, 0.058, 2, 1e-9, 3e-9, 5e-9, 1.2e-11, 1e-13)
    F, _, push, P0 = model.discrete(0.5, 1e-3, 1)
    at, own = model.order + 1, model.shift_state
    omega = np.geomspace(1e-6, 50.0, 100_000)
    for first, chain in zip((at, at + 1), model.path_error(), strict=True):
        variance = np.trapezoid(chain.spectrum(omega), omega) / (2.0 * np.pi)
        assert P0[first, first] == pytest.approx(variance, rel=1e-3)
        x = 10.0 * chain.rate
        led = (np.linalg.matrix_power(F, 20) @ P0)[first, first] / P0[first, first]
        assert led == pytest.approx(np.exp(-x) * (1.0 + x * (chain.poles - 1)), rel=1e-6)
    here = slice(at, own)
    assert F[here, here] @ P0[here, here] @ F[here, here].T + push[here, here] == pytest.approx(P0[here, here], rel=1e-6)


def test_wobble_is_told_from_ride_by_what_attitude_and_departure_have_in_common():
    """Pipe, wobble and ride of 2.5 to 5 m: of the departure only the wobble goes with the attitude."""
    rng, n, node = np.random.default_rng(5), 40_000, 0.5
    frequency = np.fft.rfftfreq(n, node)
    band = (frequency > 0.2) & (frequency < 0.4)

    def in_band(sigma):
        made = np.fft.irfft(np.fft.rfft(rng.normal(size=n)) * band, n)
        return sigma * made / made.std()

    pipe, wobble, ride = in_band(3e-4), in_band(1e-4), in_band(2e-4)
    at, told = _wobble_told(wobble - ride, pipe + wobble, node)
    inside = (at > 0.22) & (at < 0.38)
    assert told[inside].mean() == pytest.approx(1e-8 / 0.2, rel=0.1)
    _, none = _wobble_told(-ride, pipe, node)
    assert none[inside].mean() < 0.1 * 1e-8 / 0.2
