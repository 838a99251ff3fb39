"""How far the mean of the wheels may wander is told by how far they wander from each other."""

from __future__ import annotations

import numpy as np
import pytest

from deform.nav.error_model import SCALE_WALK, compose
from deform.nav.wheel_scale import BLOCK_M, COMMON_WANDER, wander
from tests.nav.test_filter import header


def ratios(walk: float, wheels: int, blocks: int = 300, noise: float = 5e-5, seed: int = 0):
    """Scales of wheels that walk by themselves (per root metre), seen block by block with noise, against their mean."""
    rng = np.random.default_rng(seed)
    scale = np.cumsum(walk * np.sqrt(BLOCK_M) * rng.standard_normal((blocks, wheels)), axis=0)
    seen = scale + noise * rng.standard_normal(scale.shape)
    return seen - seen.mean(axis=1, keepdims=True)


@pytest.mark.parametrize("wheels", [2, 3, 5])
def test_wander_of_the_mean_is_that_of_a_wheel_over_the_root_of_their_number(wheels):
    found = np.mean([wander(ratios(1e-5, wheels, blocks=3000, seed=seed)) ** 2 for seed in range(20)])
    assert np.sqrt(found) == pytest.approx(1e-5 / np.sqrt(wheels), rel=0.1)


def test_steady_wheels_are_believed_no_further_than_what_turns_them_alike_allows():
    found = [wander(ratios(0.0, 3, seed=seed)) for seed in range(20)]
    assert min(found) == pytest.approx(COMMON_WANDER)
    assert np.mean(found) < 2.0 * COMMON_WANDER


def test_a_slip_in_a_few_blocks_is_no_wander():
    steady = ratios(0.0, 3)
    slipped = steady.copy()
    slipped[[40, 130, 220], 1] -= 0.01
    assert wander(slipped) < wander(steady) + COMMON_WANDER


def test_too_short_a_way_tells_nothing():
    assert wander(ratios(0.0, 3, blocks=6)) == SCALE_WALK


def test_the_filter_takes_the_wander_for_its_scale():
    model = compose("full", header()).with_wander(2e-6)
    assert model.travel_walk[model.index("scale")] == pytest.approx([4e-12])
    assert np.count_nonzero(model.travel_walk) == 1
