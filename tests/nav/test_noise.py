"""The noise that makes the data most likely: exact slopes, what is found of a wobble that is known, and gaps."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from deform.nav import filter as filter_
from deform.nav import noise
from deform.nav.filter import Buffers, run_forward
from tests.nav.ideal import WOBBLE_WAVES_M
from tests.nav.test_filter import problem_of

WOBBLE_DEG = 0.08


@cache
def learned(gap=None):
    _, problem = problem_of(duration=850.0, wobble_deg=WOBBLE_DEG, turn_deg=10.0, gap=gap)
    return noise.learn(problem, run_forward(problem))


def rms_deg(problem):
    """Root mean square (degree) right and up of the wobble learned, over waves of 10 to 250 m."""
    here = problem.model.index("wobble")
    waves = np.geomspace(10.0, 250.0, 400)
    density = noise.wobble_spectrum(
        problem.model.steady[here].reshape(-1, 2), problem.model.reach[problem.model.index("mean")], waves
    )
    return np.degrees(np.sqrt(-2.0 * np.trapezoid(density, 1.0 / waves, axis=0)))


def test_slopes_of_the_likelihood_are_its_finite_differences(monkeypatch):
    monkeypatch.setattr(filter_, "GATE", 0.0)
    _, problem = problem_of(duration=430.0, wobble_deg=WOBBLE_DEG)
    rng = np.random.default_rng(1)
    parts = noise.stretches(problem, run_forward(problem))
    parts = [noise._only(p, rng.random(p.travel.variance.shape) < 0.9) for p in parts]  # each component by itself may be left out
    buffers = [Buffers.of(problem.model.size, p.epochs.bounds.size) for p in parts]
    usual = noise.Noise.usual().logs
    x = usual + rng.uniform(-1.0, 1.0, usual.size)
    slope, step = noise._misfit(x, parts, usual, buffers)[1], 1e-2
    for i in range(x.size):
        ends = []
        for sign in (-1.0, 1.0):
            y = x.copy()
            y[i] += sign * step
            ends.append(noise._misfit(y, parts, usual, buffers)[0])
        assert slope[i] == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=0.02, abs=0.05)


def test_a_component_that_is_left_out_stays_out_whatever_noise_is_tried():
    _, problem = problem_of(duration=430.0)
    part = noise.stretches(problem, run_forward(problem))[0]
    use = np.ones(part.travel.variance.shape, bool)
    use[::3, 1] = use[1::3, 2] = use[::5, 0] = False
    tried = noise.apply(noise._only(part, use), noise.Noise.usual())
    np.testing.assert_array_equal(tried.travel.variance > 0, use & (part.travel.variance > 0))


def test_the_wobble_of_the_tool_is_found():
    np.testing.assert_allclose(rms_deg(learned()), WOBBLE_DEG, rtol=0.35)
    assert min(WOBBLE_WAVES_M) > 10.0
    assert max(WOBBLE_WAVES_M) < 250.0


def test_a_gap_does_not_collapse_the_noise():
    whole, broken = learned(), learned((550.0, 555.0))
    assert broken.epochs.gap.max() > 4.0
    np.testing.assert_allclose(rms_deg(broken), rms_deg(whole), rtol=0.25)


def test_stretches_are_few_free_of_gaps_and_spread_over_the_run(monkeypatch):
    monkeypatch.setattr(noise, "STRETCH_EPOCHS", 100)
    monkeypatch.setattr(noise, "LEAST_EPOCHS", 50)
    monkeypatch.setattr(noise, "BLOCK_EPOCHS", 100)
    _, problem = problem_of(duration=1200.0, gap=(500.0, 505.0))
    checkpoints = tuple((problem.start.state, problem.start.covariance) for _ in range(20))
    filtered = filter_.Filtered(checkpoints, *[np.empty(0)] * 5)
    parts = noise.stretches(problem, filtered)
    assert len(parts) == noise.MOST_STRETCHES
    assert all(p.epochs.gap.max() == 0 and not p.marks.epoch.size for p in parts)
    assert parts[-1].epochs.time[0] - parts[0].epochs.time[-1] > 500.0
