"""A tool whose gyros give no azimuth: nothing is learned from them that they cannot tell, and rests tell their drift."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np
import pytest

from deform.geometry.earth import EARTH_RATE, enu_difference
from deform.nav import _kernels_state as kernels
from deform.nav.aiding import SETTLING_RAD, SpanAid, mark_aid, rest_aid, travel_aid
from deform.nav.error_model import compose
from deform.nav.filter import NO_STATES, Buffers, Innovations, Problem, Start, run_block, run_forward
from deform.nav.navigate import navigate
from deform.nav.smoother import smooth
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.synthetic.in_memory import passages_of, raw_run
from deform.synthetic.simulate import built_line, passage_of
from tests.nav.ideal import GYRO_PULSE, ideal_run
from tests.nav.test_filter import problem_of
from tests.nav.test_strapdown import header

REST_S, LATITUDE = 150, np.radians(61.0)
BIAS, WALK = np.radians(10.0) / 3600.0, np.radians(0.1) / 60.0  # Porter's gyros: rad/s, rad per root second


def at_rest(azimuth_off_deg: float = 3.0, rests: bool = False) -> Problem:
    """A coarse unit at rest, its azimuth known to 10 degree and off by some; linear about the truth."""
    run = ideal_run(
        float(REST_S), rate=50.0, rest=float(REST_S), gyro_bias=0.5 * BIAS, gyro_walk=WALK, accel_walk=1e-3, substeps=1
    )
    epochs = preintegrate(run.counts, run.distance, epoch_bounds(run.counts.time, 1.0))
    n = run.counts.time.size
    travel = travel_aid(epochs, np.zeros(n), np.full(n, 2e-3), np.ones(n, bool))
    model = compose("inertial", header())
    variance, walk = model.variance.copy(), model.walk.copy()
    variance[:9] = np.concatenate([np.full(3, 1.0), np.full(3, 1e-4), np.radians([0.6, 0.6, 10.0]) ** 2])
    variance[model.index("gyro_bias")], walk[6:9], walk[3:6] = BIAS**2, WALK**2, 1e-6
    state = np.zeros(kernels.STATE_COLUMNS)
    state[:3], state[6:15] = run.places[0], run.attitudes[0].ravel()
    truth = np.tile(state, (epochs.bounds.size, 1))
    turn = np.zeros(variance.size)
    turn[8] = np.radians(azimuth_off_deg)
    kernels.feed_back(state, turn, model.at)
    model = replace(model, walk=walk, tau=np.zeros_like(model.tau), steady=np.zeros_like(model.steady))
    none = mark_aid(epochs, np.empty(0), np.empty((0, 3)), np.empty((0, 2)), 0.0)
    problem = Problem(epochs, travel, none, model, Start(state, np.diag(variance)), about=truth)
    return replace(problem, spans=SpanAid(resting=rest_aid(epochs, travel, WALK**2, GYRO_PULSE))) if rests else problem


def behind(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    x, P = problem.start.state.copy(), problem.start.covariance.copy()
    last = problem.epochs.bounds.size - 1
    run_block(problem, 0, last, x, P, Buffers.of(problem.model.size, 0), Innovations.of(problem))
    return x, P


def test_errors_against_a_state_are_those_that_lead_to_the_other():
    model = compose("full", header(), joints=True, straight=True, corners=True)
    base = np.zeros(kernels.STATE_COLUMNS)
    base[:3], base[6:15] = [0.9, -1.2, 300.0], np.eye(3).ravel()
    wanted = np.random.default_rng(1).normal(0.0, 0.1, model.size)
    x, found = base.copy(), np.empty(model.size)
    kernels.feed_back(x, wanted, model.at)
    kernels.errors_from(x, base, model.at, found)
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)


def test_about_its_smoothed_path_a_linear_problem_has_the_same_solution():
    _, problem = problem_of(duration=260.0, marks_every=20.0)
    once = smooth(problem, run_forward(problem))
    problem = replace(problem, about=once.states)
    again = smooth(problem, run_forward(problem))
    apart = (again.states[:, :3] - once.states[:, :3]) * [6.37e6, 3.1e6, 1.0]
    assert np.abs(apart / once.sigma[:, [1, 0, 2]]).max() < 0.05
    np.testing.assert_allclose(again.sigma[:, :9], once.sigma[:, :9], rtol=0.03)


@pytest.mark.parametrize("about_truth", [True, False])
def test_coarse_gyros_at_rest_tell_no_more_of_the_azimuth_than_their_bias_allows(about_truth):
    """Azimuth and level bias show in one sum only: 1 / σ² = 1 / σ₀² + (Ω cos φ / b)².

    With the noise of the level accelerometers in the derivatives it was 4 degree instead of 10.
    """
    problem = at_rest()
    _, P = behind(problem if about_truth else replace(problem, about=NO_STATES))
    least = 1.0 / np.sqrt(np.radians(10.0) ** -2 + (EARTH_RATE * np.cos(LATITUDE) / BIAS) ** 2)
    assert np.sqrt(P[8, 8]) == pytest.approx(least, rel=0.01)


def test_rest_tells_the_drift_about_the_vertical():
    problem = at_rest(rests=True)
    x, P = behind(problem)
    up = problem.start.state[6:15].reshape(3, 3)[2]
    b = problem.model.index("gyro_bias")
    seen = (WALK**2 + GYRO_PULSE**2 / 6.0 + SETTLING_RAD**2) / REST_S
    sigma = np.sqrt(up @ P[b, b] @ up)
    assert sigma == pytest.approx(1.0 / np.sqrt(BIAS**-2 + 1.0 / seen), rel=0.02)
    assert abs(up @ (x[15:18] - 0.5 * BIAS)) < 3.0 * sigma


@pytest.mark.parametrize("kinds", [("launcher", "agm", "receiver"), ("launcher", "receiver")])
def test_line_of_a_coarse_unit_lies_within_its_sigma_and_no_good_point_is_dropped(kinds):
    """Porter's unit over 4 km: with points every 500 m, and with both ends alone, where the azimuth drifts by degrees unseen."""
    tool = ToolOptions(imu="porter-1990", caliper=False, unheard=0.0, stops=1)
    route = RouteOptions(length_m=4000.0, marker_spacing_m=500.0, valve_spacing_m=1e9, latitude_deg=65.3, longitude_deg=-126.9)
    date = datetime.date(1990, 1, 1)
    options = SimulateOptions(line="coarse", seed=11, route=route, tool=tool, runs=(RunOptions(id="coarse", date=date),))
    passage = passage_of(options, built_line(options), 0)
    raw = raw_run(passage, options)
    heard = passages_of(passage, options)
    found = navigate(replace(raw, passages=heard.isel(marker=np.isin(heard["kind"].values.astype(str), kinds))))
    assert found.markers["used"].values.all()
    path, places = found.trajectory, np.arange(50.0, 3950.0, 10.0)
    at = passage.motion.passage(places)
    here = (np.interp(at, path["time"].values, path[name].values) for name in ("latitude", "longitude", "height"))
    off = np.column_stack(enu_difference(*here, *passage.line.position(places)))
    sigma = np.column_stack(
        [np.interp(at, path["time"].values, path[f"{axis}_sigma"].values) for axis in ("east", "north", "up")]
    )
    assert np.mean((off / sigma) ** 2) < 2.5
    assert np.hypot(off[:, 0], off[:, 1]).max() < (2.0 if "agm" in kinds else 15.0)
