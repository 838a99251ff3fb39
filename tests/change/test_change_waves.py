"""Amplitudes of waves, noise by speeds and the look for tails hold against twins that go by the definitions place by place."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from deform.change import noise_floor, wavelength
from deform.change.datum import DriftModel
from deform.change.signals import Nodes, Signals
from deform.change.significance import caution_factor
from tests.naive import change as naive

MODEL = DriftModel(walk=np.array([1e-9, 4e-10, 1e-9]), noise=np.array([1e-5, 4e-5, 1e-5]), step=10.0)


@pytest.fixture(scope="module")
def signals():
    rng = np.random.default_rng(3)
    n = 900
    place = np.arange(n) + 0.5
    azimuth, pitch = np.cumsum(rng.normal(0, 0.02, n)), 0.1 * np.sin(place / 70.0)
    right = np.stack([np.cos(azimuth), -np.sin(azimuth), 0.0 * place], -1) * np.cos(pitch)[:, None]
    lift = np.stack([-np.sin(azimuth) * np.sin(pitch), -np.cos(azimuth) * np.sin(pitch), np.cos(pitch)], -1)
    difference = np.cumsum(rng.normal(0, 1e-3, (n, 3)), axis=0) + rng.normal(0, 2e-3, (n, 3))
    difference[400:405] = np.nan
    change, sigma = rng.normal(0, 1e-4, (n, 2)), rng.uniform(0.5e-4, 2e-4, (n, 2))
    change[100:120, 0] = np.nan
    return Signals(place, difference, right, lift, change, sigma, 2.0)


@pytest.mark.parametrize("length", [14.0, 160.0])
def test_amplitudes_from_positions_equal_their_definition_and_are_absent_near_unknown_pipe(signals, length):
    size = max(int(length / 32), 1)
    node = Nodes.of(signals, np.ones(signals.place.size, bool), size)
    got, shifted = wavelength._from_position(node, MODEL, length)
    means = signals.difference[: size * node.place.size].reshape(-1, size, 3).mean(axis=1)
    sideways = np.cross(node.lift, node.right)
    gap, half = np.isnan(means).any(axis=1), 0
    for m, axis in enumerate((node.right, node.lift)):
        weights = wavelength.position_weights(length, float(size), MODEL.walk[m], MODEL.noise[m] * 10.0 / size)
        half = weights.size // 2
        for i in np.flatnonzero(np.isfinite(got[:, m]))[::17]:
            assert got[i, m] == pytest.approx(naive.amplitude_from_positions(means, axis, weights, i), rel=1e-9, abs=1e-12)
            assert shifted[i, m] == pytest.approx(naive.amplitude_from_positions(sideways, axis, weights, i), rel=1e-9, abs=1e-12)
    near = np.array([gap[max(i - half, 0) : i + half + 1].any() for i in range(gap.size)])
    near[: half + 1] = near[gap.size - half - 1 :] = True
    np.testing.assert_array_equal(np.isnan(got).any(axis=1), near)


@pytest.mark.parametrize("length", [10.0, 226.0])
def test_amplitudes_from_curvature_equal_least_squares_of_the_shape(signals, length):
    size = max(int(length / 32), 1)
    count = signals.place.size // size
    got, weight = wavelength._from_curvature(signals, length, size, count)
    shape = wavelength.curvature_shape(length, 1.0, 2.0)
    for m in range(2):
        for i in range(0, count, 23):
            columns = signals.curvature[:, m], signals.curvature_sigma[:, m]
            value, worth = naive.amplitude_from_curvature(*columns, shape, i * size + size // 2)
            if np.isfinite(weight[i, m]):
                assert (got[i, m], weight[i, m]) == pytest.approx((value, worth), rel=1e-9, abs=1e-12)
            else:
                assert worth < 0.02 * np.sum(shape**2) * signals.usual_weight[m]
    assert np.isnan(weight[100:120, 0]).any() == (length == 10.0)


def test_tails_raise_the_threshold_of_amplitudes_that_are_known_already_and_change_nothing_else(signals):
    quiet = np.ones(signals.place.size, bool)
    waves = wavelength.scan(signals, MODEL, np.array([10.0, 40.0]), quiet, reach=5.7)
    for wave, raised in zip(waves, wavelength.with_tails(waves, 5.7), strict=True):
        z = (wave.amplitude / wave.sigma)[wave.free]
        assert list(raised.caution) == [caution_factor(z[:, m], wave.looks, 5.7) for m in range(2)]
        assert (raised.caution >= wave.caution).all()
        for field in dataclasses.fields(wave):
            assert field.name == "caution" or getattr(raised, field.name) is getattr(wave, field.name)


@pytest.mark.parametrize("unknown", [(0.0, 0.0), (0.1, 0.0), (0.0, 1.0)])
def test_noise_by_speeds_from_counts_equals_the_noise_place_by_place(unknown):
    rng = np.random.default_rng(8)
    n = 20_000
    speed = 1.3 * np.exp(rng.normal(0, 0.4, (2, n)))
    v = rng.standard_normal(n) * np.hypot(*(speed**-1.2))
    known = [noise_floor.speed_step(s, n) for s in speed]
    steps = [np.where(rng.random(n) < part, noise_floor.SPEEDS, s) for s, part in zip(known, unknown, strict=True)]
    a, b = (part.astype(np.uint8) for part in steps)
    noise = noise_floor.speed_noise(v, a, b, np.ones(n, bool))
    whole = noise_floor.spread(v)
    for got, part in zip((noise.reference, noise.other), naive.speed_tables(a, b, v / whole), strict=True):
        np.testing.assert_allclose(got, whole**2 * part, rtol=1e-7)
    for number, value in noise.floors.items():
        if number >= 0:
            own = [part[noise_floor._CLASS_OF[part] == number] for part in (a, b)]
            assert value == pytest.approx(np.sqrt(noise.reference[own[0]].mean() + noise.other[own[1]].mean()), rel=1e-9)
