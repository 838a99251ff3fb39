"""The drift between two runs against a dense twin, and what it leaves of movement and of markers."""

from __future__ import annotations

import change_lines as lines
import numpy as np
import pytest

from deform.change import _kernels
from deform.change.datum import DriftModel, drift_model, fit_drift, second_difference
from tests.naive import drift as naive_drift


def axes_of(azimuth, pitch):
    a, p = np.radians(azimuth), np.radians(pitch)
    zero = np.zeros_like(a)
    tangent = np.stack([np.sin(a) * np.cos(p), np.cos(a) * np.cos(p), np.sin(p)], -1)
    right = np.stack([np.cos(a) * np.cos(p), -np.sin(a) * np.cos(p), zero], -1)
    return tangent, right, np.stack([-np.sin(a) * np.sin(p), -np.cos(a) * np.sin(p), np.cos(p)], -1)


def test_drift_smoother_equals_the_dense_adjustment():
    rng = np.random.default_rng(1)
    n = 40
    place = np.cumsum(rng.uniform(8, 12, n))
    tangent, right, lift = axes_of(rng.uniform(0, 360) + np.cumsum(rng.normal(0, 8, n)), rng.normal(0, 5, n))
    value, noise, used = rng.normal(0, 0.3, (n, 3)), np.full((n, 3), 4e-4), rng.random(n) > 0.3
    walk = np.array([1e-7, 2e-7, 3e-8])
    state, cover = np.zeros((n, 6)), np.zeros((n, 6, 6))
    ahead, ahead_cover = np.zeros((n, 6)), np.zeros((n, 6, 6))
    _kernels.drift_filter(place, tangent, right, lift, value, noise, used, walk, state, cover, ahead, ahead_cover)
    _kernels.drift_smooth(place, tangent, right, lift, state, cover, ahead, ahead_cover)
    drift, variance = naive_drift.smooth(place, tangent, right, lift, value, noise, used, walk)
    np.testing.assert_allclose(state[:, :3], drift, atol=2e-6)
    np.testing.assert_allclose([np.diag(c)[:3] for c in cover], variance, rtol=2e-4)


def test_bridge_over_a_gap_has_the_variance_of_an_integrated_walk():
    place = np.arange(0.0, 4000.0, 1.0)
    axes = axes_of(np.full(place.size, 30.0), np.zeros(place.size))
    q = 1e-9
    stable = np.abs(place - 2000.0) > 60.0
    model = DriftModel(np.array([q, q, q]), np.full(3, 1e-10), 10.0)
    datum = fit_drift(place, np.zeros((place.size, 3)), axes, stable, model)
    middle = datum.variance[2000].max()
    assert middle == pytest.approx(q * 130.0**3 / 192.0, rel=0.2)


def test_constant_turn_and_scale_between_runs_are_drift_even_through_a_bend():
    place = np.arange(0.0, 1000.0, 1.0)
    azimuth = np.where(place < 500, 20.0, 110.0)
    axes = axes_of(azimuth, np.zeros(place.size))
    line = np.cumsum(axes[0], axis=0)
    turn, scale = 2e-3, 5e-4
    difference = turn * np.column_stack([line[:, 1], -line[:, 0], 0 * place]) + scale * line + [0.3, -0.2, 0.5]
    stable = np.abs(place - 500.0) > 100.0
    model = DriftModel(np.full(3, 1e-14), np.full(3, 1e-6), 10.0)
    datum = fit_drift(place, difference, axes, stable, model)
    assert np.abs(datum.drift - difference).max() < 0.02


def test_moved_pipe_has_no_part_in_the_datum():
    rng = np.random.default_rng(2)
    place = np.arange(0.0, 3000.0, 1.0)
    axes = axes_of(np.full(place.size, 45.0), np.zeros(place.size))
    smooth = np.column_stack([0.3 * np.sin(place / 600 + k) for k in range(3)])
    movement = lines.bump(place, 1500.0, 120.0, 0.8)
    difference = smooth + 0.003 * rng.standard_normal((place.size, 3))
    difference[:, 2] += movement
    stable = np.abs(place - 1500.0) > 75.0
    datum = fit_drift(place, difference, axes, stable, drift_model(difference, *axes, 1.0, stable))
    np.testing.assert_allclose((difference - datum.drift)[:, 2], movement, atol=0.03)
    far = np.abs(place - 1500.0) > 1000
    assert np.sqrt(np.mean((difference - datum.drift)[far] ** 2)) < 0.006


def test_statistics_of_a_drift_are_found_though_pipe_moved():
    rng = np.random.default_rng(3)
    place = np.arange(0.0, 40000.0, 1.0)
    q, r = 4e-10, 1e-4
    axes = axes_of(np.full(place.size, 0.0), np.zeros(place.size))
    heading = np.cumsum(rng.normal(0, np.sqrt(q), place.size))
    difference = np.column_stack([np.cumsum(heading), 0 * place, 0 * place]) + np.sqrt(r) * rng.standard_normal((place.size, 3))
    for at in range(2000, 40000, 6000):
        difference[:, 0] += lines.bump(place, at, 150.0, 1.0)
    model = drift_model(difference, *axes, 1.0, np.ones(place.size, bool))
    assert 0.3 < model.walk[0] / q < 3.0
    assert model.noise[1] == pytest.approx(r, rel=0.2)


def test_second_difference_of_a_straight_line_is_zero():
    line = np.column_stack([np.arange(50.0), 3.0 - 0.2 * np.arange(50.0)])
    assert np.abs(second_difference(line, 7)).max() < 1e-12
