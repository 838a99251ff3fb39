"""Lengths of joints and straight stretches as aids: what they hold, and that the sigma of what they find tells the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deform.nav._kernels import ATTITUDE_TRAVEL, TRAVEL
from deform.nav._kernels_filter import direction_rows
from deform.nav._kernels_model import unit_row
from deform.nav._kernels_state import BANDS, COURSE, SCALE
from deform.nav.aiding import KnownPipe, span_aid
from deform.nav.filter import run_forward
from deform.nav.smoother import smooth
from tests.nav.test_filter import errors, problem_of

JOINT_M, JOINT_SIGMA_M = 12.0, 0.003


def joints_of(run):
    """Times at both welds, length and sigma of joints one behind the other, measured with their noise."""
    moving = np.concatenate([[True], np.diff(run.distance) > 0])
    welds = np.arange(JOINT_M, run.distance[-1], JOINT_M)
    times = np.interp(welds, run.distance[moving], run.counts.time[moving])
    length = JOINT_M + JOINT_SIGMA_M * np.random.default_rng(3).standard_normal(welds.size - 1)
    return np.column_stack([times[:-1], times[1:], length, np.full(welds.size - 1, JOINT_SIGMA_M)])


def azimuth_of_pipe(state, at):
    """Azimuth (degree) of the pipe's direction by a state."""
    axes, D, J = np.empty((3, 3)), np.empty(3), np.empty((3, int(at.max()) + 20))
    direction_rows(state, at, axes, np.zeros(2 * BANDS), unit_row(), D, J)
    return np.degrees(np.arctan2(D[0], D[1]))


def test_lengths_of_joints_find_the_scale_of_the_odometer():
    run, problem = problem_of(duration=600.0, marks_every=1e4, aids=True)
    stretched = replace(problem.epochs, table=problem.epochs.table.copy())
    stretched.table[:, TRAVEL] *= 1.004
    stretched.table[:, ATTITUDE_TRAVEL : ATTITUDE_TRAVEL + 9] *= 1.004
    problem = replace(problem, epochs=stretched)
    joints = replace(problem, spans=span_aid(problem.epochs, problem.travel, KnownPipe(joints=joints_of(run))))
    scale = problem.model.index("scale")
    found, blind = (smooth(p, run_forward(p)) for p in (joints, problem))
    assert abs(found.states[-1, SCALE] + 0.004 / 1.004) < 3.0 * found.sigma[-1, scale][0]
    assert found.sigma[-1, scale][0] < 0.5 * blind.sigma[-1, scale][0]
    way = run.velocities[problem.epochs.bounds]
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-9)[:, None]
    off = [abs(np.sum(np.diff(errors(run, problem, s.states), axis=0) * way[1:])) for s in (found, blind)]
    assert off[0] < 0.5 * off[1]


def test_a_straight_stretch_holds_the_azimuth_of_the_pipe():
    spread = []
    for straight in (False, True):
        _, problem = problem_of(duration=800.0, marks_every=1e4, aids=True, turn_deg=0.0, wobble_deg=0.08)
        if straight:
            spans = span_aid(problem.epochs, problem.travel, KnownPipe(straights=np.array([[240.0, 790.0, np.radians(0.005)]])))
            problem = replace(problem, spans=spans)
        found = smooth(problem, run_forward(problem))
        here = slice(260, 780)
        spread.append(np.std([azimuth_of_pipe(x, problem.model.at) for x in found.states[here]]))
    assert spread[1] < 0.5 * spread[0]


def test_the_azimuth_of_a_straight_stretch_lies_within_its_sigma():
    normal = []
    for seed in range(6):
        _, problem = problem_of(duration=500.0, seed=seed, marks_every=60.0, aids=True, turn_deg=0.0, wobble_deg=0.08)
        spans = span_aid(problem.epochs, problem.travel, KnownPipe(straights=np.array([[240.0, 490.0, np.radians(0.005)]])))
        problem = replace(problem, spans=spans)
        found = smooth(problem, run_forward(problem))
        error = found.states[350, COURSE] - np.radians(100.0)
        normal.append(error / found.sigma[350, problem.model.index("course")][0])
        assert found.sigma[350, problem.model.index("course")][0] < found.sigma[350, 8]  # surer than the tool's own azimuth
    assert 0.2 < np.mean(np.square(normal)) < 2.4  # 95 % of six independent honest ones
