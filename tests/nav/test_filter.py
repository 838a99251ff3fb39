"""Filter and smoother against the plain Rauch-Tung-Striebel twin, against truth, and forwards against backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.geometry import earth
from deform.geometry.rotation import rotation_vector_to_matrix
from deform.nav import _kernels, _kernels_model
from deform.nav import _kernels_state as kernels
from deform.nav.aiding import mark_aid, travel_aid
from deform.nav.error_model import compose
from deform.nav.filter import Buffers, Innovations, Problem, Start, run_block, run_forward
from deform.nav.reverse import run_backward
from deform.nav.smoother import smooth
from deform.nav.solution import misclosures
from deform.nav.strapdown import epoch_bounds, preintegrate
from tests.naive import navigation as naive
from tests.nav.ideal import ideal_run
from tests.nav.test_strapdown import header

BIAS, DRIFT = 2e-4, np.radians(0.005) / 3600.0


def problem_of(model="full", duration=700.0, seed=0, marks_every=200.0, mark_sigma=0.3, gap=None, aids=False, **path):
    run = ideal_run(duration, rate=50.0, rest=200.0, gyro_bias=DRIFT, accel_bias=BIAS, seed=seed,
                    gyro_walk=np.radians(0.002) / 60.0, accel_walk=1e-4, **path)  # fmt: skip
    if gap is not None:
        run = without(run, *gap)
    speed = np.gradient(run.distance, run.counts.time)
    times = np.arange(210.0, duration, marks_every)
    noise = np.random.default_rng(seed + 100)
    bounds = epoch_bounds(run.counts.time, 1.0, times)
    epochs = preintegrate(run.counts, run.distance, bounds)
    travel = travel_aid(epochs, speed, np.full(speed.size, 2e-3), speed < 1e-6, 2e-7)
    error_model = compose(model, header(), joints=aids, straight=aids)
    places = run.places[np.searchsorted(run.counts.time, times)]
    shift = mark_sigma * noise.standard_normal((len(times), 3))
    moved = earth.enu_shift(np.degrees(places[:, 0]), np.degrees(places[:, 1]), places[:, 2], *shift.T)
    places = np.column_stack([np.radians(moved[0]), np.radians(moved[1]), moved[2]])
    marks = mark_aid(epochs, times, places, np.full((len(times), 2), mark_sigma), 0.0)
    variance = error_model.variance.copy()
    variance[0:3], variance[3:6], variance[6:9] = 1.0, 1e-4, np.radians([0.02, 0.02, 0.5]) ** 2
    state = np.zeros(kernels.STATE_COLUMNS)
    turn = noise.standard_normal(3) * np.sqrt(variance[6:9])
    state[:3], state[6:15] = run.places[0], (rotation_vector_to_matrix(turn) @ run.attitudes[0]).ravel()
    covariance = error_model.first_covariance()
    covariance[:9, :9] = np.diag(variance[:9])
    return run, Problem(epochs, travel, marks, error_model, Start(state, covariance))


def without(run, begin, end):
    """The run without the samples between two times."""
    keep = (run.counts.time < begin) | (run.counts.time > end)
    counts = replace(run.counts, time=run.counts.time[keep], gyro=run.counts.gyro[keep], accel=run.counts.accel[keep])
    rest = (getattr(run, name)[keep] for name in ("distance", "places", "velocities", "attitudes"))
    return type(run)(counts, *rest)


def errors(run, problem, states):
    truth = run.places[problem.epochs.bounds]
    return np.column_stack(earth.enu_difference(np.degrees(states[:, 0]), np.degrees(states[:, 1]), states[:, 2],
                                                np.degrees(truth[:, 0]), np.degrees(truth[:, 1]), truth[:, 2]))  # fmt: skip


@pytest.mark.parametrize("model", ["full", "odometer", "inertial"])
def test_smoothed_path_lies_within_its_sigma_in_every_configuration(model):
    squares = []
    for seed in range(3):
        run, problem = problem_of(model, seed=seed)
        smoothed = smooth(problem, run_forward(problem))
        squares.append((errors(run, problem, smoothed.states) / smoothed.sigma[:, :3]) ** 2)
    assert 0.05 < np.mean(squares) < 2.5
    assert np.abs(errors(run, problem, smoothed.states)).max() < 1.5


def test_smoother_equals_the_plain_twin():
    _, problem = problem_of(duration=260.0, marks_every=20.0)
    n_bounds, n = problem.epochs.bounds.size, problem.model.size
    buffers = Buffers.of(n, n_bounds)
    x, P = problem.start.state.copy(), problem.start.covariance.copy()
    run_block(problem, 0, n_bounds - 1, x, P, buffers, Innovations.of(problem))
    smoothed = smooth(problem, run_forward(problem))
    transitions, predicted = [], [buffers.covariances[0]]
    model, travel, table = problem.model, problem.travel, problem.epochs.table
    F, J, D, axes = np.empty((9, n)), np.empty((3, n)), np.empty(3), np.empty((3, 3))
    row, decay, Q = np.empty(table.shape[1]), np.ones(n), np.zeros(n)
    w, u = (np.arange(n)[model.index(name)] for name in ("wobble", "sway"))
    m = np.arange(n)[model.index("mean")]
    follows, shared, recalls = np.zeros(w.size), np.zeros(w.size), np.zeros(2)
    at, reckoned, *noise = model.arguments
    for k in range(n_bounds - 1):
        s, change = buffers.states[k], travel.speeds[k + 1] - travel.speeds[k]
        _kernels.correct_row(table[k], s[15:35], row)
        _kernels_model.track_axes(row, s[6:15].reshape(3, 3), axes)
        _kernels_model.odometer_step(row, s, axes, change, travel.tilt[k], D)
        _kernels_model.odometer_rows(row, s, at, axes, change, travel.tilt[k], D, J)
        _kernels_model.lead(row, s, at, False, axes, J, F)
        _kernels_model.process(row, at, *noise, reckoned, travel.variance[k], axes, decay, follows, recalls, Q, shared)
        full, drive = np.diag(decay), np.diag(Q)
        full[:9] = F
        full[w, u] = decay[w] * follows
        full[np.tile(m, w.size // 2), w] = np.tile(decay[m] * recalls, w.size // 2)
        drive[w, u] = drive[u, w] = shared
        transitions.append(full)
        predicted.append(full @ buffers.covariances[k] @ full.T + drive)
    # errors against the filtered states: the filter's own error estimate is zero behind each feedback, the next state is known
    jumps = np.zeros((n_bounds, n))
    _, covariances = naive.rauch_tung_striebel(jumps, buffers.covariances[:n_bounds], predicted, transitions)
    sigma = np.sqrt(np.array([np.diag(P) for P in covariances]))
    np.testing.assert_allclose(smoothed.sigma[:, :9], sigma[:, :9], rtol=1e-4, atol=1e-12)


def test_more_markers_than_a_bound_takes_are_named_and_left_out_whole(caplog):
    _, problem = problem_of(duration=260.0)
    time, place = np.array([230.0, 230.1, 230.2, 230.3, 240.0]), np.tile(problem.start.state[:3], (5, 1))
    marks = mark_aid(problem.epochs, time, place, np.ones((5, 2)), 0.0)
    assert marks.index.tolist() == [0, 1, 2, 4]
    assert "t=230.3 s" in caplog.text


def test_blocks_do_not_show():
    _, problem = problem_of(duration=800.0)
    filtered = run_forward(problem)
    assert len(filtered.checkpoints) > 1
    smoothed = smooth(problem, filtered)
    steps = np.diff(smoothed.states[:, 2])
    assert np.abs(np.diff(steps)).max() < 0.05
    assert np.abs(np.diff(smoothed.sigma[:, 2])).max() < 0.02


def test_sigma_grows_away_from_the_marks_and_only_the_end_is_open():
    _, problem = problem_of(duration=900.0, marks_every=300.0, mark_sigma=0.01)
    sigma = smooth(problem, run_forward(problem)).sigma[:, 0]
    at = problem.marks.epoch
    between = (at[1] + at[0]) // 2
    assert sigma[between] > 1.2 * max(sigma[at[0]], sigma[at[1]])


def test_a_mark_that_lies_off_shows_in_its_misclosure_without_it():
    _, problem = problem_of(duration=900.0, marks_every=150.0)
    place = problem.marks.place.copy()
    place[2, 0] += 20.0 / 6.37e6
    problem = replace(problem, marks=replace(problem.marks, place=place))
    left_out, sigma, _ = misclosures(problem.marks, smooth(problem, run_forward(problem)))
    size = np.abs(left_out / sigma).max(axis=1)
    assert int(np.argmax(size)) == 2
    assert abs(left_out[2, 1] + 20.0) < 3.0


def test_reverse_processing_agrees_within_its_sigma():
    run, problem = problem_of(duration=700.0)
    smoothed = smooth(problem, run_forward(problem))
    variance = np.concatenate([np.full(3, 1.0), np.full(3, 1e-2), np.radians([0.1, 0.1, 1.0]) ** 2])
    end = np.zeros(kernels.STATE_COLUMNS)
    end[:3], end[3:6], end[6:15] = run.places[-1], run.velocities[-1], run.attitudes[-1].ravel()
    back = run_backward(problem, end, variance)
    truth = Start(smoothed.states[0], np.diag(smoothed.sigma[0] ** 2))
    again = run_backward(replace(problem, start=truth), end, variance)
    assert np.abs(again.difference[:3] / again.sigma[:3]).max() < 4.0
    assert np.abs(again.difference[6:9] / again.sigma[6:9]).max() < 4.0
    assert back.filtered.news.shape == again.filtered.news.shape
