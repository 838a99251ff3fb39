"""Mechanization and its Jacobians against analytic runs, finite differences and the plain twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.geometry import _kernels_rotation as turning
from deform.geometry import earth, rotation
from deform.geometry.rotation import matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav import _kernels
from deform.nav import _kernels_model as moves
from deform.nav import _kernels_state as state
from deform.nav.error_model import compose
from deform.nav.profile import Profile
from deform.nav.strapdown import Counts, epoch_bounds, mechanize, preintegrate
from deform.options import NavigationOptions
from deform.run.raw import RunHeader
from tests.naive import navigation as naive
from tests.nav.ideal import ideal_run


@pytest.fixture(scope="module")
def run():
    return ideal_run(300.0)


@pytest.fixture(scope="module")
def epochs(run):
    return preintegrate(run.counts, run.distance, epoch_bounds(run.counts.time, 1.0))


def header(**imu) -> RunHeader:
    from pydantic import TypeAdapter

    content = {
        "run": {"id": "x", "line": "x", "date": "2020-01-01"},
        "pipe": {"outside_diameter_m": 0.3239, "nominal_wall_m": 0.006},
        "launch": {"latitude_deg": 61.0, "longitude_deg": -121.0, "height_m": 200.0, "static_s": 0.0},
        "imu": {"rate_hz": 100.0, **imu},
        "odometer": {"wheels": 1},
    }
    return TypeAdapter(RunHeader).validate_python(content)


def test_perfect_sensors_drift_less_than_a_decimetre_and_a_millidegree_in_an_hour():
    """At 100 Hz and the filter's own interval; seen are 20 mm up (the truth's own integration) and 2 mm level."""
    run = ideal_run(3600.0)
    bounds = epoch_bounds(run.counts.time, NavigationOptions().filter_interval_s)
    epochs = preintegrate(run.counts, run.distance, bounds)
    places, _, attitudes = mechanize(epochs, run.places[0], run.velocities[0], run.attitudes[0])
    true = run.places[bounds]
    east, north, up = earth.enu_difference(np.degrees(places[:, 0]), np.degrees(places[:, 1]), places[:, 2],
                                           np.degrees(true[:, 0]), np.degrees(true[:, 1]), true[:, 2])  # fmt: skip
    turned = np.degrees(np.linalg.norm(matrix_to_rotation_vector(attitudes @ run.attitudes[bounds].transpose(0, 2, 1)), axis=1))
    assert max(np.abs(east).max(), np.abs(north).max(), np.abs(up).max()) < 0.1
    assert turned.max() < 1e-3


def test_epoch_integrals_equal_the_plain_twin(run, epochs):
    for k in (0, 17, 200):
        twin = naive.preintegrate(run.counts, run.distance, epochs.bounds[k], epochs.bounds[k + 1])
        np.testing.assert_allclose(epochs.table[k], twin, rtol=1e-9, atol=1e-12)


def test_length_of_the_epochs_does_not_matter(run):
    ends = []
    for interval in (0.25, 1.0, 4.0):
        epochs = preintegrate(run.counts, run.distance, epoch_bounds(run.counts.time, interval))
        places, velocities, attitudes = mechanize(epochs, run.places[0], run.velocities[0], run.attitudes[0])
        ends.append((places[-1] * [6.37e6, 3e6, 1.0], velocities[-1], attitudes[-1]))
    for place, velocity, attitude in ends[1:]:
        assert np.abs(place - ends[0][0]).max() < 2e-3  # 1.2 mm of longitude at 4 s
        assert np.abs(velocity - ends[0][1]).max() < 1e-5
        assert np.abs(attitude - ends[0][2]).max() < 1e-7


def test_single_samples_that_are_missing_are_bridged_and_a_late_stamp_loses_nothing(run):
    """Left out without notice, each of them would cost gravity over its interval, a decimetre per second."""
    whole, profile = run.counts, Profile.through(run.counts.time, run.distance)
    keep = np.ones(whole.time.size, bool)
    keep[[3000, 9000, 9001, 9002, 20000]] = False
    late = whole.time.copy()
    late[15000] += 0.008
    short = replace(whole, time=late[keep], gyro=whole.gyro[keep], accel=whole.accel[keep])
    a, b = (preintegrate(one, profile, np.array([0, one.time.size - 1])).table[0] for one in (whole, short))
    assert b[_kernels.GAP] == 0.0
    turned = matrix_to_rotation_vector(a[:9].reshape(3, 3).T @ b[:9].reshape(3, 3))
    assert np.degrees(np.linalg.norm(turned)) < 1e-6
    assert np.abs(b - a)[_kernels.VELOCITY : _kernels.VELOCITY + 3].max() < 1e-6


def test_a_peak_that_is_bridged_widens_the_sigma_by_what_it_may_have_held(run):
    whole, profile = run.counts, Profile.through(run.counts.time, run.distance)
    gyro = whole.gyro.copy()
    gyro[9000:9007, 2] += (np.array([1, 3, 6, 8, 6, 3, 1]) * np.radians(5e-4) / whole.gyro_pulse).astype(np.int32)
    whole = replace(whole, gyro=gyro)
    keep = np.ones(whole.time.size, bool)
    keep[9002:9005] = False  # saturated, left out
    short = replace(whole, time=whole.time[keep], gyro=gyro[keep], accel=whole.accel[keep])
    a, b = (preintegrate(one, profile, np.array([8900, last])).table[0] for one, last in ((whole, 9100), (short, 9097)))
    off = np.linalg.norm(matrix_to_rotation_vector(a[:9].reshape(3, 3).T @ b[:9].reshape(3, 3)))
    sigma = np.sqrt(b[_kernels.BRIDGED_TURN])
    assert a[_kernels.BRIDGED_TURN] == a[_kernels.BRIDGED_PUSH] == 0.0
    assert np.degrees(off) > 0.003
    assert 0.5 < off / sigma < 2.0


def test_lost_samples_have_no_part_in_the_means_of_a_rest():
    counts = ideal_run(30.0, rest=30.0).counts
    keep = (counts.time < 10.0) | (counts.time > 10.5)
    short = replace(counts, time=counts.time[keep], gyro=counts.gyro[keep], accel=counts.accel[keep])
    whole, broken = (_kernels.running_sums(*c.arguments, c.step, 1, c.time.size - 1) for c in (counts, short))
    np.testing.assert_allclose(broken[:6], whole[:6], rtol=1e-6, atol=1e-12)
    assert whole[6] - broken[6] == pytest.approx(0.5, abs=0.03)


def test_dead_reckoned_travel_of_a_perfect_tool_is_its_path(run, epochs):
    from deform.nav.dead_reckoning import dead_reckon

    reckoned = dead_reckon(epochs, run.places[0], run.attitudes[0])
    true = run.places[epochs.bounds]
    assert np.abs((reckoned.places - true) * [6.37e6, 3.1e6, 1.0]).max() < 5e-3


def state_of(run, epochs, k):
    x = np.zeros(state.STATE_COLUMNS)
    i = epochs.bounds[k]
    x[:3], x[3:6], x[6:15] = run.places[i], run.velocities[i], run.attitudes[i].ravel()
    return x


TILT = np.array([0.01, -0.02, 0.015, 0.005])


def test_transition_is_the_derivative_of_the_mechanization(run, epochs):
    model = compose("full", header(), corners=True)
    k, n = 120, model.size
    F, J = np.empty((9, n)), np.empty((3, n))
    x0 = state_of(run, epochs, k)
    axes, D, row = np.empty((3, 3)), np.empty(3), np.empty(_kernels.COLUMNS)
    steps = np.full(n, 1e-4)
    steps[0:3], steps[3:6], steps[6:9] = 10.0, 1e-2, 1e-6
    steps[model.index("gyro_bias")], steps[model.index("accel_bias")] = 1e-7, 1e-4
    for name in ("gyro_scale", "accel_scale", "gyro_shear", "accel_shear"):
        steps[model.index(name)] = 1e-5

    def after(sign, i):
        x, dx = x0.copy(), np.zeros(n)
        dx[i] = sign * steps[i]
        state.feed_back(x, dx, model.at)
        place, v, C = np.empty(3), np.empty(3), np.empty((3, 3))
        _kernels.correct_row(epochs.table[k], x[15:35], row)
        matrix = x[6:15].reshape(3, 3)
        _kernels.advance(row, x[0:3], x[3:6], matrix, place, v, C)
        moves.track_axes(row, matrix, axes)
        moves.odometer_step(row, x, axes, 0.1, TILT, D)
        return place, v, C, D.copy()

    _kernels.correct_row(epochs.table[k], x0[15:35], row)
    moves.track_axes(row, x0[6:15].reshape(3, 3), axes)
    moves.odometer_step(row, x0, axes, 0.1, TILT, D)
    moves.transition(row, x0, model.at, F)
    moves.odometer_rows(row, x0, model.at, axes, 0.1, TILT, D, J)
    for i in range(n):
        (p1, v1, C1, d1), (p0, v0, C0, d0) = after(1, i), after(-1, i)
        numeric = np.concatenate([_kernels.place_difference(p1, p0), v1 - v0, matrix_to_rotation_vector(C1 @ C0.T)]) / (
            2 * steps[i]
        )
        expected = F[:, i].copy()
        assert np.abs(numeric - expected).max() < 5e-4 + 1e-2 * np.abs(expected).max(), (i, numeric, expected)
        # through the track axes the odometer's direction turns with the attitude as well, for delay, tilt and sag alone
        assert np.abs((d1 - d0) / (2 * steps[i]) - J[:, i]).max() < 1e-3 + 2e-2 * np.abs(J[:, i]).max(), i


def test_unit_before_the_rear_axle_swings_out_and_a_lean_gives_way_to_the_force():
    """A turn to the left by 0.1 radian within a second, 10 m travelled, 2 m/s² from the right, 1 m/s² along."""
    model, row = compose("full", header(), corners=True), np.zeros(_kernels.COLUMNS)
    matrix = rotation_vector_to_matrix([0.0, 0.0, 0.1])
    row[:9], row[_kernels.VELOCITY : _kernels.VELOCITY + 3] = matrix.ravel(), [-2.0, 1.0, 9.8]
    row[_kernels.ATTITUDE_TIME : _kernels.ATTITUDE_TIME + 9] = np.eye(3).ravel()
    row[_kernels.ATTITUDE_TRAVEL : _kernels.ATTITUDE_TRAVEL + 9] = 10.0 * np.eye(3).ravel()
    row[_kernels.DURATION], row[_kernels.TRAVEL] = 1.0, 10.0
    axes, steps = np.empty((3, 3)), np.empty((3, 3))
    moves.track_axes(row, np.eye(3), axes)
    for D, (lever, right, up) in zip(steps, ((0.0, 0.0, 0.0), (0.7, 0.0, 0.0), (0.0, -4e-3, -3e-3)), strict=True):
        x = np.zeros(state.STATE_COLUMNS)
        x[6:15] = np.eye(3).ravel()
        x[state.LEVER], x[state.LEAN], x[state.LEAN + 1] = lever, right, up
        moves.odometer_step(row, x, axes, 0.0, 0.0 * TILT, D)
    assert model.index("lean").stop == model.size
    np.testing.assert_allclose(steps[1] - steps[0], [-0.7 * np.sin(0.1), 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(steps[2] - steps[0], [-4e-3 * -2.0 * 10.0, 0.0, -3e-3 * 1.0 * 10.0], atol=1e-12)


def test_time_run_backwards_leads_back_to_the_start(run, epochs):
    from deform.nav.reverse import reversed_epochs

    places, velocities, attitudes = mechanize(epochs, run.places[0], run.velocities[0], run.attitudes[0])
    back = reversed_epochs(epochs)
    p, v, C = mechanize(back, places[-1], -velocities[-1], attitudes[-1])
    assert np.abs((p[-1] - places[0]) * [6.37e6, 3.1e6, 1.0]).max() < 2e-3
    assert np.abs(-v[-1] - velocities[0]).max() < 2e-5
    assert np.abs(C[-1] - attitudes[0]).max() < 1e-8


def test_matrices_led_on_by_the_rotation_vector_stay_rotations_and_equal_the_quaternions():
    """Porter adjusts his matrix every 32 cycles; at double precision a hundred thousand updates leave nothing to adjust."""
    turns = 1e-2 * np.random.default_rng(2).standard_normal((100_000, 3))
    quaternions = rotation.rotation_vector_to_quaternion(turns)
    C, q = np.eye(3), (1.0, 0.0, 0.0, 0.0)
    for turn, step in zip(turns, quaternions, strict=True):
        turning.turn_right(C, *turn)
        q = turning.quaternion_product(*q, *step)
    assert np.abs(C.T @ C - np.eye(3)).max() < 1e-11
    for method in rotation.ORTHONORMALISATIONS:
        assert np.abs(rotation.orthonormalise(C, method) - C).max() < 1e-11
        assert np.abs(rotation.orthonormalise(C, method) - rotation.quaternion_to_matrix(np.array(q))).max() < 1e-11


def test_coning_motion_is_integrated_without_drift():
    rate, cone, frequency = 100.0, 0.01, 5.0
    from deform.nav.strapdown import Counts

    pulse, sub = 1e-10, 200
    t = np.arange(0, 10 * int(rate) * sub + 1) / (rate * sub)
    vector = cone * np.stack([np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t), np.zeros_like(t)], axis=1)
    C = rotation_vector_to_matrix(vector)
    turns = matrix_to_rotation_vector(C[:-1].transpose(0, 2, 1) @ C[1:])
    gyro = np.add.reduceat(turns, np.arange(0, len(turns), sub), axis=0)
    n = len(gyro)
    counts = Counts(np.arange(n + 1) / rate, np.vstack([np.zeros(3), np.rint(gyro / pulse)]).astype(np.int32),
                    np.zeros((n + 1, 3), np.int32), pulse, 1.0,
                    np.vstack([np.zeros((9, 3)), np.eye(3), np.eye(3)]), 1.0)  # fmt: skip
    table = preintegrate(counts, np.zeros(n + 1), np.array([0, n])).table
    error = matrix_to_rotation_vector(C[0].T @ C[-1]) - matrix_to_rotation_vector(table[0, :9].reshape(3, 3))
    plain = cone**2 * np.pi * frequency * 10 * (1 - np.sin(2 * np.pi * frequency / rate) / (2 * np.pi * frequency / rate))
    assert np.abs(error).max() < 0.05 * plain  # one-sample integration would drift by `plain`


@pytest.mark.parametrize("last", [0.5, -0.5])
def test_over_a_gap_the_steady_force_goes_on_not_that_of_the_last_sample(last):
    """A tool that rides is shaken by 0.5 m/s²: held over 5 s it was 2.5 m/s, and threw a run off by 780 m."""
    step, pulse = 0.01, 1e-6
    time = np.concatenate([np.arange(1, 301), np.arange(801, 1101)]) * step
    force = np.tile([0.0, 0.0, 9.81], (600, 1))
    force[:, 1] += 0.5 * np.where(np.arange(600) % 2, 1.0, -1.0)
    force[299, 1:] += last
    accel = np.round(force * step / pulse).astype(np.int32)
    table = np.zeros((15, 3))
    table[9:15] = np.vstack([np.eye(3), np.eye(3)])
    counts = Counts(time, np.zeros((600, 3), np.int32), accel, 1e-9, pulse, table, step)
    gained = preintegrate(counts, np.zeros(600), np.array([0, 299, 300, 599])).table[1]
    assert gained[_kernels.GAP] == pytest.approx(5.01)
    np.testing.assert_allclose(gained[_kernels.VELOCITY : _kernels.VELOCITY + 3], [0.0, 0.0, 9.81 * 5.01], atol=0.04)
