"""Extent of a movement from curvature alone: ends against known bumps, and the honesty of their sigma."""

from __future__ import annotations

import numpy as np
import pytest

from deform.change.support import find_support
from deform.synthetic.epochs import bump

PLACE = np.arange(0.0, 1500.0, 1.0)


def bent(start, length, plateau, size, rng, component=0):
    """Curvature of a movement whose largest curvature is ``size`` sigma, in one component, with unit noise in both."""
    shape = bump((PLACE - start) / length, plateau)[2]
    shape = np.where((start < PLACE) & (start + length > PLACE), shape / np.abs(shape).max(), 0.0)
    change = rng.standard_normal((PLACE.size, 2))
    change[:, component] += size * shape
    return change, np.ones_like(change)


@pytest.mark.parametrize(("length", "plateau"), [(30.0, 0.0), (60.0, 0.2), (160.0, 0.4), (240.0, 0.2)])
def test_extent_of_a_movement_is_that_of_its_bump(length, plateau):
    rng = np.random.default_rng(int(length))
    shares = []
    for k in range(4):
        start = 600.0 + rng.uniform()
        change, sigma = bent(start, length, plateau, 12.0, rng, k % 2)
        found = find_support(PLACE, change, sigma, start + 0.35 * length, start + 0.65 * length)
        assert found.closed
        shares.append(
            (min(found.end, start + length) - max(found.start, start))
            / (max(found.end, start + length) - min(found.start, start))
        )
    assert min(shares) > 0.75
    assert np.mean(shares) > 0.85


def test_seed_at_one_end_of_a_movement_finds_both_ends():
    change, sigma = bent(600.0, 160.0, 0.2, 10.0, np.random.default_rng(2))
    found = find_support(PLACE, change, sigma, 610.0, 640.0)
    assert found.start == pytest.approx(600.0, abs=16.0)
    assert found.end == pytest.approx(760.0, abs=16.0)


def test_sigma_of_the_ends_is_honest():
    rng = np.random.default_rng(3)
    z = []
    for _ in range(24):
        start, length = 600.0 + rng.uniform(), float(rng.uniform(50.0, 120.0))
        change, sigma = bent(start, length, rng.choice([0.0, 0.2, 0.4]), 5.0, rng)
        found = find_support(PLACE, change, sigma, start + 0.3 * length, start + 0.7 * length)
        z += [(found.start - start) / found.start_sigma, (found.end - start - length) / found.end_sigma]
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_step_is_told_from_a_movement_that_comes_back():
    x = np.clip((PLACE - 700.0) / 50.0, 0.0, 1.0)
    bend = np.gradient(np.gradient(x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)))
    change = np.random.default_rng(4).standard_normal((PLACE.size, 2))
    change[:, 1] += 20.0 * bend / np.abs(bend).max()
    found = find_support(PLACE, change, np.ones_like(change), 715.0, 735.0)
    assert not found.closed
    assert found.start == pytest.approx(700.0, abs=8.0)
    assert found.end == pytest.approx(750.0, abs=8.0)


def test_places_without_curvature_have_no_part_and_noise_alone_is_worth_nothing():
    change, sigma = bent(600.0, 100.0, 0.2, 12.0, np.random.default_rng(5))
    change[630:640] = np.nan
    found = find_support(PLACE, change, sigma, 630.0, 670.0)
    assert found.start == pytest.approx(600.0, abs=12.0)
    assert find_support(PLACE, np.full_like(change, np.nan), sigma, 630.0, 670.0) is None
    noise = np.random.default_rng(6).standard_normal(change.shape)
    assert find_support(PLACE, noise, sigma, 630.0, 670.0).worth < 0
