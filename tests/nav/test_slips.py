"""Slips that no other wheel shows: seen by the inertial unit, told, and without harm to the path."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deform.nav import _kernels as k
from deform.nav.filter import run_forward
from deform.nav.slips import SlipsSeen
from deform.nav.smoother import smooth
from tests.nav.test_filter import errors, problem_of


def slipped(problem, begin, seconds, share, lone=True):
    """The problem with a share of the travel lost for some seconds, and the way lost (m)."""
    here = (problem.epochs.time[:-1] >= begin) & (problem.epochs.time[:-1] < begin + seconds)
    table = problem.epochs.table.copy()
    lost = share * table[here, k.TRAVEL].sum()
    table[here, k.TRAVEL] *= 1.0 - share
    table[here, k.ATTITUDE_TRAVEL : k.ATTITUDE_TRAVEL + 9] *= 1.0 - share
    travel = replace(problem.travel, lone=lone)
    return replace(problem, epochs=replace(problem.epochs, table=table), travel=travel), lost


def solved(problem):
    filtered = run_forward(problem)
    return SimpleNamespace(problem=problem, filtered=filtered, smoothed=smooth(problem, filtered))


@pytest.mark.parametrize(("seconds", "share"), [(4.0, 1.0), (6.0, 0.5), (25.0, 0.04)])
def test_slip_of_a_lone_wheel_is_told_and_the_path_stays_within_its_sigma(seconds, share):
    run, whole = problem_of(duration=500.0, marks_every=280.0)
    problem, lost = slipped(whole, 350.0, seconds, share)
    found = solved(problem)
    seen = SlipsSeen.of(found)
    assert seen.lost.sum() == pytest.approx(lost, abs=0.05)
    assert abs(seen.begin[0] - 350.0) < 1.5
    assert ("lost" in seen.remark()) == (lost > 0.5)
    error = errors(run, problem, found.smoothed.states)
    assert np.mean(np.abs(error) < 1.96 * found.smoothed.sigma[:, :3]) > 0.9
    usual = solved(whole)
    assert np.abs(error - errors(run, whole, usual.smoothed.states)).max() < 0.1
    np.testing.assert_allclose(seen.epochs.travel.sum(), whole.epochs.travel.sum(), atol=0.05)


def test_a_slip_that_lasts_drags_the_velocity_of_a_filter_that_pulls_in_full():
    run, whole = problem_of(duration=500.0, marks_every=280.0)
    off, usual = [], errors(run, whole, solved(whole).smoothed.states)
    for lone in (True, False):
        problem, _ = slipped(whole, 350.0, 25.0, 0.015, lone)
        moved = errors(run, problem, solved(problem).smoothed.states) - usual
        off.append(np.abs(moved).max())
    assert off[0] < 0.5 * off[1]


def test_no_slip_is_told_of_wheels_that_do_not_slip():
    _, whole = problem_of(duration=400.0)
    seen = SlipsSeen.of(solved(whole))
    assert seen.begin.size == 0
    assert seen.remark() == ""
    np.testing.assert_array_equal(seen.epochs.table, whole.epochs.table)
