"""First attitude at rest and in motion against truth, its stated limit, and axes that are reversed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.errors import InputError
from deform.geometry import earth
from deform.geometry.rotation import attitude_to_matrix, matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav.aiding import travel_aid
from deform.nav.alignment import (
    Alignment,
    align,
    alignment_in_motion,
    check_physics,
    first_epochs,
    level_and_gyrocompass,
    static_alignment,
)
from deform.nav.inertial_alignment import fine, record, wahba
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.run.raw import ImuHeader
from tests.nav.ideal import ACCEL_PULSE, GYRO_PULSE, ideal_run
from tests.nav.wheels import header

IMU = ImuHeader(rate_hz=100.0, gyro_bias_deg_per_h=0.01, gyro_random_walk_deg_per_sqrt_h=0.0005, accel_bias_ug=50.0)
LAUNCH = replace(header().launch, latitude_deg=28.2, height_m=200.0)
HEADER = replace(header(), imu=replace(IMU, gyro_random_walk_deg_per_sqrt_h=0.002), launch=LAUNCH)


def errors_deg(found, true):
    return np.degrees(matrix_to_rotation_vector(found @ true.T))


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (117.0, -3.0, -72.0), (300.0, 60.0, 170.0)])
def test_a_perfect_unit_at_rest_tells_its_attitude(angles):
    C = attitude_to_matrix(*angles)
    found = level_and_gyrocompass(C.T @ earth.earth_rate(61.0), C.T @ np.array([0.0, 0.0, 9.8]))
    np.testing.assert_allclose(found, C, atol=1e-12)


def test_alignment_at_rest_reaches_the_limit_of_bias_and_random_walk():
    """Li (2012): latitude 28.2 degree, 600 s, ten sets; 0.01 °/h gyros, 50 µg: limit = bias / (Ω cos φ), levelling bias / g."""
    azimuth, level, limits, stated = [], [], [], 0.0
    draw = np.random.default_rng(5)
    for seed in range(10):
        drift, bias = draw.standard_normal() * np.radians(0.01) / 3600.0, draw.standard_normal() * 5e-4
        run = ideal_run(600.0, rate=100.0, latitude=28.2, rest=600.0, substeps=1, gyro_bias=drift, accel_bias=bias, seed=seed,
                        gyro_walk=np.radians(0.0005) / 60.0, accel_walk=1e-4)  # fmt: skip
        found = static_alignment(run.counts, 0, run.counts.time.size - 1, 28.2, 200.0, IMU)
        error = errors_deg(found.attitude, run.attitudes[0])
        azimuth.append(error[2])
        east = (run.attitudes[0] @ np.full(3, drift))[0]  # one drift on all axes: its east part is taken for earth rate
        limits.append(np.degrees(east / (earth.EARTH_RATE * np.cos(np.radians(28.2)))))
        level.append(np.hypot(error[0], error[1]))
        stated = np.degrees(found.sigma[2])
    limit = np.degrees(np.radians(0.01) / 3600.0 / (earth.EARTH_RATE * np.cos(np.radians(28.2))))
    assert np.sqrt(np.mean(np.square(azimuth))) < 1.15 * np.sqrt(np.mean(np.square(limits)))
    assert np.sqrt(np.mean(np.square(level))) < 0.007
    assert 0.9 * limit < stated < 1.3 * limit


def moving_epochs(seed=0, first=2000, rate=50.0, **errors):
    """A tool under way on an analytic path: epochs, aid and true first attitude."""
    run = ideal_run(640.0, rate=rate, latitude=28.2, substeps=1, seed=seed, **errors)
    bounds = first + epoch_bounds(run.counts.time[first:], 1.0)
    epochs = preintegrate(run.counts, run.distance, bounds)
    speed = np.linalg.norm(run.velocities, axis=1)
    aid = travel_aid(epochs, speed, np.full(speed.size, 2e-3), np.zeros(speed.size, bool))
    return epochs, aid, run.attitudes[first]


NOISY = {"gyro_bias": 2e-8, "accel_bias": 3e-4, "gyro_walk": np.radians(0.002) / 60.0, "accel_walk": 1e-4}


@pytest.fixture(scope="module")
def moving():
    return moving_epochs(**NOISY)


def test_alignment_in_motion_finds_the_attitude_of_a_moving_tool(moving):
    """Li (2012): 600 s in motion 0.08 degree azimuth and 0.007 degree level; the limit itself is in `benchmarks.alignment`."""
    epochs, aid, true = moving
    found = alignment_in_motion(epochs, aid, HEADER)
    error = errors_deg(found.attitude, true)
    assert found.method == "in motion"
    assert abs(error[2]) < 0.1
    assert np.hypot(error[0], error[1]) < 0.007
    assert np.all(np.abs(error) < 4.0 * np.degrees(found.sigma))


def test_backtracking_forgets_a_coarse_attitude_that_is_far_off(moving):
    epochs, aid, true = moving
    kept = record(epochs, aid)
    near = fine(kept, true, HEADER)
    far = fine(kept, rotation_vector_to_matrix(np.radians([1.0, -1.0, 25.0])) @ true, HEADER)
    assert far.passes > near.passes
    assert np.abs(errors_deg(far.attitude, near.attitude)).max() < 2e-3


def test_perfect_sensors_in_motion_align_to_thousandths_of_a_degree():
    epochs, aid, true = moving_epochs()
    error = errors_deg(alignment_in_motion(epochs, aid, HEADER).attitude, true)
    assert np.abs(error).max() < 3e-3


def test_wander_of_the_taken_together_epochs_does_not_matter(moving):
    """Li records every second; five seconds together hold the same motion."""
    epochs, aid, _ = moving
    one, five = epochs.table[:, 51].sum(), record(epochs, aid)
    assert five.duration.sum() == pytest.approx(one)
    whole = np.eye(3)
    for turn in epochs.table[:, :9].reshape(-1, 3, 3):
        whole = whole @ turn
    np.testing.assert_allclose(five.body[-1], whole, atol=1e-12)


def test_alignment_in_motion_over_seconds_is_refused():
    epochs, aid, _ = moving_epochs()
    with pytest.raises(InputError, match="too little for an azimuth"):
        alignment_in_motion(first_epochs(epochs, 10), aid, HEADER)


def rocked(size_deg, seconds=400.0, rate=50.0):
    """A tool that rests and is rocked about its right axis, ending aslant: counts, epochs, aid, true first attitude."""
    run = ideal_run(seconds, rate=rate, latitude=28.2, rest=seconds, substeps=1, **NOISY)
    t = run.counts.time
    rock = np.radians(size_deg) * (np.sin(t / 7.0) + t / seconds)
    turned = rotation_vector_to_matrix(np.outer(rock, [1.0, 0.0, 0.0]))
    C = run.attitudes @ turned
    gyro, accel = run.counts.gyro * run.counts.gyro_pulse, run.counts.accel * run.counts.accel_pulse
    gyro, accel = (np.einsum("nji,nj->ni", turned, v) for v in (gyro, accel))
    gyro[1:, 0] += np.diff(rock)
    counts = replace(
        run.counts, gyro=np.rint(gyro / GYRO_PULSE).astype(np.int32), accel=np.rint(accel / ACCEL_PULSE).astype(np.int32)
    )
    epochs = preintegrate(counts, run.distance, epoch_bounds(t, 1.0))
    aid = travel_aid(epochs, np.zeros(t.size), np.full(t.size, 2e-3), np.ones(t.size, bool))
    return counts, epochs, aid, C[0]


def test_quiet_rest_is_aligned_by_its_mean_rate():
    found = align(*rocked(0.0)[:3], HEADER)
    assert found.method == "static"


def test_rocked_rest_is_aligned_by_zero_velocity(caplog):
    counts, epochs, aid, true = rocked(0.3)
    with caplog.at_level("INFO"):
        found = align(counts, epochs, aid, HEADER)
    with pytest.raises(InputError, match="vertical rate at rest"):  # its mean rate is not the earth's
        static_alignment(counts, 0, counts.time.size - 1, 28.2, 200.0, IMU)
    assert found.method == "zero velocity"
    assert "rocked" in caplog.text
    error = errors_deg(found.attitude, true)
    assert abs(error[2]) < 4.0 * np.degrees(found.sigma[2]) < 1.0


def test_sigma_of_pitch_and_roll_turns_with_the_heading():
    east = Alignment(attitude_to_matrix(90.0, 0.0, 0.0), 0.0, np.radians([0.1, 0.2, 0.5]), "given", (0.0, 1.0))
    azimuth, pitch, roll = east.angle_sigma
    assert (azimuth, pitch, roll) == pytest.approx((0.5, 0.2, 0.1))  # heading east it pitches about north and rolls about east


def test_wahba_gives_a_rotation_even_for_vectors_in_a_plane():
    C = attitude_to_matrix(40.0, 10.0, -30.0)
    vectors = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(wahba(vectors, vectors @ C.T), C, atol=1e-12)


@pytest.mark.parametrize(("axis", "name"), [(0, "x"), (2, "z")])
def test_a_reversed_gyro_axis_is_named(axis, name):
    C = attitude_to_matrix(100.0, 5.0, 50.0)
    rate, force = C.T @ earth.earth_rate(61.0), C.T @ np.array([0.0, 0.0, float(earth.gravity(61.0, 200.0))])
    check_physics(rate, force, 61.0, 200.0, IMU, 600.0)
    rate[axis] *= -1.0
    with pytest.raises(InputError, match=f"axis {name}"):
        check_physics(rate, force, 61.0, 200.0, IMU, 600.0)


def test_a_wrong_pulse_weight_of_the_accelerometers_is_refused():
    C = attitude_to_matrix(100.0, 5.0, 50.0)
    with pytest.raises(InputError, match="gravity at rest"):
        check_physics(C.T @ earth.earth_rate(61.0), C.T @ np.array([0.0, 0.0, 9.5]), 61.0, 200.0, IMU, 600.0)
