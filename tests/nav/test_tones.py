"""Tones of the tool: their closed forms, how they are found, whose they are, and what the smoother makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from deform.nav import _kernels_path, pipe_direction, tones
from deform.nav.pipe_direction import TURN_LAGS_M, direction_along
from deform.nav.tones import Tone, find_tone, with_share
from deform.nav.wobble import WobbleModel
from deform.nav.wobble_fit import fit_departure
from tests.nav.test_pipe_direction import GRID, S, made, turns
from tests.nav.wheels import header

NODE = 0.5
TONE = Tone(1.0 / 12.0, 1.0 / 80.0, 1e-6)
CALM = WobbleModel(1e-13, 0.1, 1, 1e-10, 4e-8, 1e-12, 1e-16, 1e-13)


def sine(length_m, wavelength, amplitude, drift=0.0):
    """Sinusoid at places a node apart, its wavelength drifting by a part over the length."""
    place = NODE * (np.arange(round(length_m / NODE)) + 0.5)
    return amplitude * np.sin(2.0 * np.pi * np.cumsum(NODE / (wavelength * (1.0 + drift * (place / length_m - 0.5)))) + 0.4)


def white(frequency):
    """Spectrum of independent values of 4e-4 rad at the nodes."""
    return np.full(np.shape(frequency), 2.0 * NODE * 4e-4**2)


def test_spectrum_covariance_and_states_are_those_of_one_oscillator():
    frequency, lag = np.linspace(0.0, 40.0, 2_000_001), np.array([0.0, 3.0, 17.0, 100.0])
    spectrum = TONE.spectrum(frequency)
    summed = [np.trapezoid(spectrum * np.cos(2.0 * np.pi * frequency * d), frequency) for d in lag]
    np.testing.assert_allclose(TONE.covariance(lag), summed, atol=1e-5 * TONE.variance)
    held = solve_continuous_lyapunov(TONE.turning, -TONE.drive)
    np.testing.assert_allclose(held, TONE.variance * np.eye(2), atol=1e-12 * TONE.variance)
    led = [(expm(TONE.turning * d) @ held)[0, 0] for d in lag]
    np.testing.assert_allclose(TONE.covariance(lag), led, atol=1e-12 * TONE.variance)


def test_periodogram_of_a_tone_is_what_pieces_of_it_show():
    rng, F = np.random.default_rng(4), expm(TONE.turning * NODE)
    push = np.linalg.cholesky(TONE.variance * (np.eye(2) - F @ F.T) + 1e-18 * np.eye(2))
    state, values = np.sqrt(TONE.variance) * rng.normal(size=2), np.empty(60_000)
    for k, noise in enumerate(rng.normal(size=(values.size, 2)) @ push.T):
        state = F @ state + noise
        values[k] = state[0]
    seen = (np.abs(tones.pieces(values, 256)) ** 2).mean(axis=0) * 2.0 * NODE
    near = slice(5, 20)  # about the tone
    np.testing.assert_allclose(seen[near], TONE.periodogram(256, NODE)[near], rtol=0.25)


def test_smooth_noise_holds_a_line_as_seldom_as_stated(monkeypatch):
    rng = np.random.default_rng(1)
    runs = [4e-4 * rng.normal(size=2000) for _ in range(150)]
    assert not any(find_tone(run, NODE, white) for run in runs)
    monkeypatch.setattr(tones, "FALSE_ALARM", 0.3)
    monkeypatch.setattr(tones, "_LEAST_RATIO", 1.0)
    rate = np.mean([find_tone(run, NODE, white) is not None for run in runs])
    assert 0.05 < rate < 0.3 + 3.0 * np.sqrt(0.3 * 0.7 / len(runs))


@pytest.mark.parametrize(
    ("wavelength", "amplitude", "drift"), [(12.0, 3e-4, 0.0), (12.0, 2e-3, 0.04), (3.0, 1e-3, 0.01), (40.0, 2e-3, 0.0)]
)
def test_tone_is_found_with_its_length_and_size(wavelength, amplitude, drift):
    rng = np.random.default_rng(2)
    slope = 4e-4 * rng.normal(size=4000) + sine(2000.0, wavelength, amplitude, drift)
    tone = find_tone(slope, NODE, white)
    assert 1.0 / tone.frequency == pytest.approx(wavelength, rel=0.01)
    assert np.sqrt(2.0 * tone.variance) == pytest.approx(amplitude, rel=0.35)
    assert find_tone(slope, NODE, white, [tone]) is None or drift > 0.0


@pytest.mark.parametrize("share", [1.0, 0.0, 0.6 + 0.3j])
@pytest.mark.parametrize("lever", [None, -1.3])
def test_attitude_and_ring_tell_whether_a_tone_is_wobble_or_shift(share, lever):
    rng, omega = np.random.default_rng(3), 2.0 * np.pi / 12.0
    place = NODE * np.arange(6001)
    wave = 1e-3 * np.exp(1j * omega * place)  # of the departure
    wobble, shift = share * wave, (share - 1.0) / (1j * omega) * wave
    total = (wave / (1j * omega)).real + 1e-5 * rng.normal(size=place.size)
    between = (wobble * np.exp(0.5j * omega * NODE)).real[:-1] + 1e-5 * np.cumsum(rng.normal(size=6000))
    ring = None if lever is None else (lever, (shift + lever * wobble).real + 2e-4 * rng.normal(size=place.size))
    found = with_share(Tone(1.0 / 12.0, 1e-3, 5e-7), np.diff(total) / NODE, NODE, between, ring, 1.0)
    assert abs(found.share - share) < 4.0 * found.share_sigma + 0.02
    assert found.share_sigma < 0.1


def test_pipe_that_bends_with_the_wave_of_a_tone_is_not_taken_for_wobble():
    rng = np.random.default_rng(3)
    departure, pipe = sine(3000.0, 12.0, 5e-4), sine(3000.0, 12.0, 2e-2)
    slope = departure + 4e-4 * rng.normal(size=6000)
    found = with_share(Tone(1.0 / 12.0, 1e-3, 1.25e-7), slope, NODE, departure + pipe, None, 0.5)
    assert abs(found.share) < 1.0
    assert found.share_sigma > 0.1  # and this is not known


def smoothed(model, total, offset=None, lever=0.0, shift=1e-6):
    """Wobble and its sigma at the nodes by the smoother of a model."""
    F, Q, Q_push, P0 = model.discrete(NODE, shift, 1 if lever else model.order)
    rows, wanted = pipe_direction._rows(model, F.shape[0], lever)
    seen = total[:, None] if offset is None else np.stack([total, offset], axis=1)
    variance = np.array([model.shift_variance, 4e-4**2])[: seen.shape[1]]
    value, sigma, odd = np.empty((total.size, 2)), np.empty(total.size), np.zeros(1, np.int64)
    _kernels_path.smooth_chain(seen, variance, rows, np.ones(total.size), F, Q, Q_push, P0, wanted, value, sigma, odd)
    return value[:, 0], sigma


def test_smoother_leaves_of_a_tone_what_its_spectrum_and_that_of_the_noise_leave():
    model = replace(CALM, tones=(TONE,))
    place = NODE * np.arange(4000)
    for frequency in TONE.frequency * np.array([0.8, 0.97, 1.0, 1.02, 1.3]):
        omega = 2.0 * np.pi * frequency
        value, sigma = smoothed(model, np.sin(omega * place) / omega * 1e-3)
        wave, middle = 1e-3 * np.cos(omega * place), slice(1000, 3000)
        tone = TONE.spectrum(np.array([frequency]))[0]
        noise = model.noise_spectrum(np.array([frequency]), NODE)[0]
        passed = np.sum(value[middle] * wave[middle]) / np.sum(wave[middle] ** 2)
        assert passed == pytest.approx(tone / (tone + noise), abs=0.02)
    frequency = np.geomspace(1e-3, 1.0, 20_000)
    left = np.trapezoid(model.left_spectrum(frequency, NODE, 1e-9, 0.0), frequency)
    assert sigma[2000] == pytest.approx(np.sqrt(left), rel=0.05)


@pytest.mark.parametrize("lever", [0.0, -0.6])
@pytest.mark.parametrize("share", [1.0, 0.0])
def test_what_smooth_spectra_take_of_a_tone_is_what_their_smoother_takes(lever, share):
    model = WobbleModel(1.0e-6, 0.1, 2, 1e-9, 3e-9, 1e-9, 1e-13, 1e-13)
    place, omega = NODE * np.arange(4000), 2.0 * np.pi / 13.0
    wave = 1e-3 * np.exp(1j * omega * place)
    offset = ((share - 1.0) / (1j * omega) + lever * share) * wave
    value, _ = smoothed(model, (wave / (1j * omega)).real, offset.real if lever else None, lever, 1.5e-3)
    middle = slice(1000, 3000)
    passed = np.sum(value[middle] * wave.real[middle]) / np.sum(wave.real[middle] ** 2)
    tone = Tone(1.0 / 13.0, 1e-3, 5e-7, share)
    taken = model.taken(tone, NODE, 1.5e-3, 4e-4 if lever else 0.0, lever)
    assert passed == pytest.approx(taken.real, abs=0.02)


def test_model_of_a_smooth_run_has_no_tones_and_that_of_a_tool_with_one_has_it():
    rng = np.random.default_rng(6)
    smooth = np.convolve(rng.normal(size=4100), np.exp(-np.arange(100) / 10.0), "valid")[:4000]
    smooth *= np.radians(0.05) / smooth.std()
    for amplitude in (0.0, 2e-3):
        wobble = smooth + sine(2000.0, 5.0, amplitude)
        total = np.concatenate([[0.0], np.cumsum(wobble) * NODE]) + 1e-3 * rng.normal(size=4001)
        model = fit_departure(total, NODE, 1.0, header().imu, wobble, None, lambda model: (0.5 * model.sigma, 0.0))
        assert [round(1.0 / tone.frequency, 1) for tone in model.tones] == ([5.0] if amplitude else [])


def turns_of(tone_deg=0.0, pipe_deg=0.0, wobble_deg=0.05):
    """Errors (degree) of the turn over 2 m and its sigma, of a tool with a tone of 6 m in a pipe with bends every 6.2 m."""
    tone, periodic = (a * np.sin(2.0 * np.pi * S / length) for a, length in ((tone_deg, 6.0), (pipe_deg, 6.2)))
    given = {"length": 8.0, "mounting": (0.0, 0.0), "roll_rate": 0.0}
    trajectory, azimuth, _, away = made(wobble_deg=wobble_deg, tone=(tone, 0.0), periodic=periodic, **given)
    result = direction_along(trajectory, S, GRID, header())
    error = (result.azimuth - np.interp(GRID, S, azimuth) + 180.0) % 360.0 - 180.0
    inside = np.interp(GRID, S, away) > 0.99
    return turns(error)[inside[20:] & inside[:-20]], result.turn_sigma[0, list(TURN_LAGS_M).index(2.0)]


def test_tone_of_the_tool_is_taken_off_and_the_sigma_says_so():
    error, sigma = turns_of(tone_deg=0.1)
    assert np.std(error) < 0.1 * 0.1 / np.sqrt(2.0) * 2.0 * np.sin(np.pi * 2.0 / 6.0)
    assert 0.2 < np.mean(error**2) / sigma**2 < 1.5


@pytest.mark.parametrize("wobble_deg", [0.003, 0.05])
def test_pipe_with_bends_at_every_joint_keeps_them(wobble_deg):
    still, _ = turns_of(wobble_deg=wobble_deg)
    error, _ = turns_of(pipe_deg=0.5, wobble_deg=wobble_deg)
    assert np.std(error) < 1.1 * np.std(still) + 0.001
