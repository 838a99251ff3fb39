"""Noise floors by the speeds of both runs, and thresholds that hold where the noise has heavy tails."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from deform.change.noise_floor import SPEEDS, class_name, speed_noise, speed_step, spread
from deform.change.significance import confidence_of, few_looks_factor, limit_of, tail_factor


def test_speeds_go_to_logarithmic_steps_and_unknown_ones_to_their_own():
    step = speed_step(np.array([0.25, 0.5, 1.0, np.nan, 0.0, 1e6]), 6)
    assert list(step) == [0, 10, 20, SPEEDS, 0, SPEEDS - 1]
    assert (speed_step(None, 4) == SPEEDS).all()


def test_floor_is_the_sum_of_what_each_run_adds_at_its_own_speed_whatever_moved():
    rng = np.random.default_rng(1)
    n = 80000
    speed = rng.choice([0.8, 2.5], (2, n))
    true = np.hypot(*np.where(speed > 1, [[3.0], [2.0]], [[1.0], [0.5]]))
    values = rng.standard_normal(n) * true
    values[:800] += 50.0
    stable = np.arange(n) >= 800
    steps = speed_step(speed[0], n), speed_step(speed[1], n)
    noise = speed_noise(values, *steps, stable)
    for first in (0.8, 2.5):
        for second in (0.8, 2.5):
            cell = (speed[0] == first) & (speed[1] == second)
            assert np.median(noise.at(*steps)[cell]) == pytest.approx(true[cell][0], rel=0.05)
    assert {class_name(k) for k in noise.floors} == {"all speeds", "0.75 to 1 m/s", "2 to 3 m/s"}
    assert noise.floors[5] > 3 * noise.floors[2] > 2.0


def test_floor_between_two_speeds_lies_between_their_floors():
    rng = np.random.default_rng(5)
    n = 60000
    speed = np.exp(rng.uniform(np.log(0.5), np.log(4.0), n))
    values = rng.standard_normal(n) * speed
    steps = speed_step(speed, n), np.full(n, SPEEDS, np.uint8)
    got = speed_noise(values, *steps, np.ones(n, bool)).at(*steps)
    middle = (speed > 0.8) & (speed < 3.0)
    assert np.median(np.abs(got / speed - 1.0)[middle]) < 0.06


@pytest.mark.parametrize("power", [-2.0, -1.5, -1.0])
def test_noise_that_grows_as_the_tool_slows_is_known_on_the_slowest_hundredth_of_the_pipe(power):
    rng = np.random.default_rng(11)
    n = 50000
    speed = 1.3 * np.exp(np.clip(rng.normal(0.0, 0.22, (2, n)), -0.35, 0.35))
    slow = np.arange(n) < n // 100
    speed[0, slow] = rng.uniform(0.65, 0.75, slow.sum())
    true = np.hypot(*(speed**power))
    values = rng.standard_normal(n) * true
    steps = speed_step(speed[0], n), speed_step(speed[1], n)
    got = speed_noise(values, *steps, np.ones(n, bool)).at(*steps)
    assert np.median((got / true)[slow]) == pytest.approx(1.0, abs=0.15)
    assert np.median((got / true)[~slow]) == pytest.approx(1.0, abs=0.03)


def test_no_pair_of_speeds_is_taken_for_free_of_noise():
    rng = np.random.default_rng(10)
    n = 20000
    speed = np.exp(rng.normal(0.0, 0.3, (2, n)))
    values = rng.standard_normal(n) * np.where(speed[0] * speed[1] > 1.3, 6.0, 1.0)
    steps = speed_step(speed[0], n), speed_step(speed[1], n)
    noise = speed_noise(values, *steps, np.ones(n, bool))
    every = np.add.outer(noise.reference, noise.other)
    assert every.min() > 0.3


def test_unknown_speeds_share_one_floor():
    values = 2.0 * np.random.default_rng(6).standard_normal(20000)
    unknown = np.full(values.size, SPEEDS, np.uint8)
    noise = speed_noise(values, unknown, unknown, np.ones(values.size, bool))
    assert noise.at(unknown, unknown)[0] == pytest.approx(2.0, rel=0.03)


def test_too_little_pipe_gives_no_floor_rather_than_a_wrong_one():
    unknown = np.full(5, SPEEDS, np.uint8)
    assert np.isnan(speed_noise(np.ones(5), unknown, unknown, np.ones(5, bool)).at(unknown, unknown)).all()


def test_pipe_that_is_too_short_for_cells_of_speed_has_one_floor_at_all_speeds():
    rng = np.random.default_rng(12)
    steps = speed_step(np.linspace(0.5, 2.0, 40), 40), speed_step(rng.permutation(np.linspace(0.5, 2.0, 40)), 40)
    values = rng.standard_normal(40)
    got = speed_noise(values, *steps, np.ones(40, bool)).at(*steps)
    assert np.median(got) == pytest.approx(spread(values), rel=0.3)


def test_heavy_tails_widen_the_floor_and_a_normal_noise_does_not():
    rng = np.random.default_rng(2)
    assert spread(rng.standard_normal(100000)) == pytest.approx(1.0, abs=0.02)
    assert spread(rng.standard_t(2, 100000)) > 1.3


def test_normal_noise_has_no_tail_factor_to_speak_of():
    z = np.random.default_rng(7).standard_normal(60000)
    assert 1.0 <= tail_factor(z, z.size, 5.5) < 1.06


def test_tail_factor_leads_to_the_quantile_that_a_heavy_tailed_noise_reaches():
    draws = student.rvs(8, size=60000, random_state=8)
    z = draws / (student.ppf(0.75, 8) / norm.ppf(0.75))
    true = student.isf(norm.sf(4.0), 8) / (student.ppf(0.75, 8) / norm.ppf(0.75)) / 4.0
    seen = np.quantile(np.abs(z), 0.999) / norm.ppf(0.9995)
    assert seen < tail_factor(z, z.size, 4.0) < 1.05 * true
    assert tail_factor(z, z.size, 4.0) > 0.87 * true  # a straight line through the ratios falls short of a power law


def test_few_values_say_nothing_of_tails_and_are_trusted_less():
    z = np.random.default_rng(9).standard_normal(30)
    assert tail_factor(z, 30.0, 5.5) == 1.0
    assert few_looks_factor(30.0, 5.5) > 1.5
    assert few_looks_factor(1e5, 5.5) == pytest.approx(1.0, abs=1e-2)


def test_threshold_and_confidence_are_two_sides_of_one_chance():
    assert confidence_of(limit_of(0.1, 1000.0, 1), 1000.0, 1) == pytest.approx(0.9)
    assert confidence_of(limit_of(0.1, 1000.0, 2), 1000.0, 2) == pytest.approx(0.9)
    assert confidence_of(1.0, 1000.0, 1) == 0.0
