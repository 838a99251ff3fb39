"""Loops of the caliper room against plain twins, and simple shapes with known answers."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from deform.caliper._kernels import bead_and_step, departures, fill_bins, unrest
from deform.caliper.cross_section import to_pipe_clock, to_tool_angle
from deform.caliper.weld_chain import _length_score, with_joint_lengths
from deform.caliper.weld_hits import hit_centre, hit_score
from deform.geometry.harmonics import HarmonicFitter, harmonic_basis

_SPEC = importlib.util.spec_from_file_location("naive_caliper", Path(__file__).parents[1] / "naive" / "caliper.py")
naive = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(naive)

ARMS = 24
ANGLE = np.arange(ARMS) * 2 * np.pi / ARMS


def scans(n=60, seed=1):
    rng = np.random.default_rng(seed)
    radius = 0.15 + harmonic_basis(ANGLE)[:, 1:] @ rng.normal(0, 1e-3, (4, n))
    radius = radius.T + rng.normal(0, 3e-4, (n, ARMS))
    radius[rng.random((n, ARMS)) < 0.03] = np.nan
    radius[: n // 2, 4:8] -= 5e-3
    return radius


def test_the_robust_section_equals_its_plain_twin():
    radius = scans()
    harmonics, *_ = HarmonicFitter(ANGLE, 3e-4).fit(radius)
    twin = np.array([naive.robust_section(r, harmonic_basis(ANGLE), 3e-4) for r in radius])
    assert harmonics == pytest.approx(twin, abs=1e-8)


def test_departures_equal_their_plain_twin():
    residual = scans() - 0.15
    dip, bulge = np.empty(60), np.empty(60)
    dip_arm, bulge_arm = np.empty(60, np.int64), np.empty(60, np.int64)
    departures(residual, 2, dip, dip_arm, bulge, bulge_arm)
    for size, arm, side in ((dip, dip_arm, residual), (bulge, bulge_arm, -residual)):
        twin = naive.inward_running(side, 2)
        assert size == pytest.approx(twin[0], abs=1e-12)
        assert (arm == twin[1]).all()


def test_unrest_is_the_mean_step_of_each_arm_between_scans_in_use():
    radius, use = scans(), np.random.default_rng(2).random(60) > 0.2
    step, count = np.empty(ARMS), np.empty(ARMS)
    unrest(radius, use, step, count)
    pairs = np.flatnonzero(use[1:] & use[:-1])
    change = np.abs(radius[pairs + 1] - radius[pairs])
    assert step == pytest.approx(np.nanmean(change, axis=0), abs=1e-12)
    assert (count == np.isfinite(change).sum(axis=0)).all()


def test_bead_and_step_equal_their_plain_twin():
    rng = np.random.default_rng(3)
    place = np.sort(rng.uniform(0, 10, 600))
    radius = 0.15 - 1e-3 * (place > 5) + rng.normal(0, 1e-4, 600)
    bead, step = np.empty(600), np.empty(600)
    bead_and_step(place, radius, 1e-4, 0.03, 0.25, bead, step)
    twin = naive.bead_and_step(place, radius, 1e-4, 0.03, 0.25)
    assert bead == pytest.approx(twin[0], abs=1e-9)
    assert step == pytest.approx(twin[1], abs=1e-9)
    assert abs(place[np.argmax(step)] - 5.0) < 0.06


@pytest.mark.parametrize("sign", [1, -1])
def test_an_oval_pipe_stays_where_it_is_while_the_tool_rolls(sign):
    roll = np.linspace(0, 9, 50)
    clock = sign * (ANGLE + roll[:, None])
    right, up, oval_cos, oval_sin = 2e-3, -1e-3, 4e-4, 7e-4
    x = 0.15 + oval_cos * np.cos(2 * clock) + oval_sin * np.sin(2 * clock)
    along = right * np.sin(clock) + up * np.cos(clock)
    radius = along + np.sqrt(x**2 - (right * np.cos(clock) - up * np.sin(clock)) ** 2)
    harmonics, *_ = HarmonicFitter(ANGLE, 3e-4).fit(radius)
    found = to_pipe_clock(harmonics, roll, sign)
    for value, true in zip(found, (0.15, right, up, oval_cos, oval_sin), strict=True):
        assert value == pytest.approx(np.full(50, true), abs=8e-6)
    assert to_tool_angle(*found, roll, sign) == pytest.approx(harmonics, abs=1e-9)  # third order in offset over radius


@pytest.mark.parametrize("sign", [1, -1])
def test_the_wall_map_shows_a_mark_at_its_clock_whatever_the_roll(sign):
    roll = np.linspace(0, 7, 40)
    clock = (sign * (ANGLE + roll[:, None])) % (2 * np.pi)
    off = (clock - np.radians(100) + np.pi) % (2 * np.pi) - np.pi
    radius = 0.15 - 5e-3 * np.exp(-((off / 0.5) ** 2))
    total, count = np.zeros((1, 72), np.float32), np.zeros((1, 72), np.uint16)
    fill_bins(np.zeros(40, np.int64), ANGLE, sign, roll, radius, np.zeros(40), np.zeros(40), 72, total, count)
    wall = total[0] / count[0]
    assert (count >= 39).all()
    assert int(np.argmin(wall)) * 5 == pytest.approx(100, abs=5)
    assert wall.min() == pytest.approx(0.145, abs=3e-4)


def test_the_joint_chain_equals_the_sum_over_all_subsets():
    lengths = np.array([12.0, 12.1, 12.2, 11.9, 12.0, 12.1, 6.0, 12.0, 12.1])
    place = np.concatenate([np.cumsum(lengths)[:6], [40.0], np.cumsum(lengths)[6:] + 0.0])
    place = np.sort(place)
    probability = np.full(place.size, 0.97)
    probability[np.searchsorted(place, 40.0)] = 0.6
    score = _length_score(lengths[lengths > 0.3], 12.2)
    probability = np.clip(probability, 0, 1)
    found = with_joint_lengths(place, probability, 12.2)
    sure = np.diff(place[probability > 0.95])
    score = _length_score(sure[(sure > 0.3) & (sure < 1.6 * 12.2)], max(float(sure.max()), 12.2))
    twin = naive.chain(place, np.log(probability / (1 - probability)), score)
    assert found == pytest.approx(twin, abs=1e-9)
    assert found[np.searchsorted(place, 40.0)] < 0.2


def test_hits_are_found_in_vibration_and_placed_at_their_centre():
    rng = np.random.default_rng(4)
    n = 30_000
    time = np.arange(n) * 0.01
    counts = 30 * np.sin(2 * np.pi * 11 * time)[:, None] + rng.normal(0, 3, (n, 3))
    at = np.arange(500, n - 500, 700)
    for lag in range(-2, 3):
        counts[at + lag] += rng.normal(0, 18, (at.size, 3)) * np.exp(-0.2 * lag**2)
    score, energy = hit_score(np.round(counts).astype(np.int32), 0.01, np.ones(n, bool))
    hits = np.array([score[a - 5 : a + 6].max() for a in at])
    away = np.delete(np.arange(n), (at[:, None] + np.arange(-12, 13)).ravel())
    assert np.median(hits) > 8
    assert (score[away] > 7).sum() <= 3
    centre = np.array([hit_centre(energy, int(a), 0.01, time) for a in at])
    assert np.abs(np.median(centre - time[at])) < 0.002
