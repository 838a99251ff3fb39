"""Calibration over static orientations: known biases come back, weak geometry shows in the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.geometry.rotation import matrix_to_rotation_vector
from deform.nav.alignment import level_and_gyrocompass
from deform.nav.calibration import calibrate, calibrate_sets, orientation
from deform.nav.compensation import compensation_table
from deform.nav.rest_sets import find_rests, rest_sets
from deform.nav.strapdown import Counts
from deform.run.raw import ImuHeader

SETS = [
    (10.0, 0.0, 0.0),
    (100.0, 5.0, 90.0),
    (190.0, -8.0, 180.0),
    (280.0, 40.0, 270.0),
    (45.0, 80.0, 30.0),
    (300.0, -60.0, 120.0),
]
ACCEL, GYRO = np.array([5e-4, -3e-4, 8e-4]), np.radians([0.02, -0.01, 0.03]) / 3600.0
FORCE_SIGMA, RATE_SIGMA = 1e-5, np.radians(0.002) / 3600.0


def observed(sets, seed=None):
    pairs = [orientation(*s, 61.0, 200.0) for s in sets]
    force, rate = np.array([p[0] for p in pairs]) + ACCEL, np.array([p[1] for p in pairs]) + GYRO
    if seed is None:
        return force, rate
    noise = np.random.default_rng(seed)
    return force + FORCE_SIGMA * noise.standard_normal(force.shape), rate + RATE_SIGMA * noise.standard_normal(rate.shape)


def test_biases_drifts_and_attitudes_come_back_from_six_orientations():
    found = calibrate(*observed(SETS), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    np.testing.assert_allclose(found.accel_bias, ACCEL, atol=1e-9)
    np.testing.assert_allclose(found.gyro_bias, GYRO, atol=1e-13)
    wrapped = (found.attitudes - np.array(SETS) + 180.0) % 360.0 - 180.0
    assert np.abs(wrapped).max() < 1e-6


def test_the_covariance_is_honest():
    errors = []
    for seed in range(60):
        found = calibrate(*observed(SETS, seed), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
        errors.append(
            np.concatenate(
                [(found.accel_bias - ACCEL) / found.accel_bias_sigma, (found.gyro_bias - GYRO) / found.gyro_bias_sigma]
            )
        )
    assert 0.7 < np.mean(np.square(errors)) < 1.35


def test_level_sets_leave_the_vertical_bias_to_gravity_and_the_forward_one_weak():
    level = [(a, 0.01, r) for a, r in ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0))]
    rolled = [*level[:2], (180.0, 0.01, 90.0), (270.0, 0.01, 180.0)]
    weak = calibrate(*observed(rolled, 1), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    full = calibrate(*observed(SETS, 1), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    assert (
        weak.accel_bias_sigma[1] > 3.0 * full.accel_bias_sigma[1]
    )  # forward never meets gravity: told through the earth's rate only


def test_one_set_aligns_when_the_biases_are_known_to_be_small():
    force, rate = observed(SETS[1:2])
    found = calibrate(
        force, rate, 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA, bias_sigma=(5e-4, np.radians(0.02) / 3600.0)
    )
    assert np.abs((found.attitudes[0] - SETS[1] + 180.0) % 360.0 - 180.0).max() < 3.0 * found.attitude_sigma.max()
    assert np.isfinite(found.covariance).all()


def test_one_set_with_biases_held_at_zero_is_levelling_and_gyrocompassing():
    force, rate = observed(SETS[1:2])
    found = calibrate(force, rate, 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA, bias_sigma=(0.0, 0.0))
    assert np.abs(np.concatenate([found.accel_bias / 5e-4, found.gyro_bias / np.radians(0.02) * 3600.0])).max() < 1e-4
    turned = matrix_to_rotation_vector(found.matrices[0] @ level_and_gyrocompass(rate[0], force[0]).T)
    assert (
        np.degrees(np.abs(turned)).max() < 3e-3
    )  # the gyros level a little too, by their drift over Ω against the biases' over g


def test_one_set_alone_cannot_carry_biases_and_says_so(caplog):
    force, rate = observed(SETS[1:2])
    found = calibrate(force, rate, 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    assert np.isinf(found.covariance).any()
    assert np.isnan(found.variance_factor)


COARSE = {"force_sigma": 5e-4, "rate_sigma": np.radians(0.5) / 3600.0}
DRIFT, BIAS = np.radians([4.4, 3.1, 1.8]) / 3600.0, np.array([9e-4, -3.2e-2, 4e-4])
ROLLED = [(100.0, 0.3, 0.0), (100.0, 0.2, 90.0), (100.0, -0.1, 180.0), (100.0, 0.1, 270.0), (100.0, 0.2, 0.0)]


def porters_unit(sets, seed):
    """A unit as in tables 4-1 and 4-2, first run: drifts of degrees per hour, sets rolled by quarters."""
    pairs = [orientation(*s, 61.0, 200.0) for s in sets]
    draw = np.random.default_rng(seed)
    force = np.array([p[0] for p in pairs]) + BIAS + COARSE["force_sigma"] * draw.standard_normal((len(sets), 3))
    rate = np.array([p[1] for p in pairs]) + DRIFT + COARSE["rate_sigma"] * draw.standard_normal((len(sets), 3))
    return calibrate(force, rate, 61.0, 200.0, **COARSE)


def test_sets_on_one_heading_leave_the_forward_bias_weak_until_one_is_pitched(caplog):
    """Tables 4-1 to 4-3: sigma of the forward bias 0.048 m/s² level, 0.0068 with an inclined set; of pitch 17′ and 2′."""
    level, pitched = porters_unit([*ROLLED, (100.0, 0.0, 90.0)], 1), porters_unit([*ROLLED, (100.0, 25.0, 90.0)], 1)
    assert "forward accelerometer bias is weakly determined" in caplog.text
    assert level.accel_bias_sigma[1] > 10.0 * pitched.accel_bias_sigma[1]
    sigma = [c.tables()["orientation"].pitch_sigma_deg.mean() for c in (level, pitched)]
    assert sigma[0] > 10.0 * sigma[1]


def test_second_heading_that_fits_is_told_and_held_in_the_covariance(caplog):
    """On one heading the azimuth mirrored about east fits as well, with a forward drift that is degrees per hour off."""
    found = [porters_unit([*ROLLED, (100.0, 0.0, 90.0)], seed) for seed in range(20)]
    assert "fits about as well" in caplog.text
    forward = np.array([(c.gyro_bias[1] - DRIFT[1]) / c.gyro_bias_sigma[1] for c in found])
    assert 0.85 < np.mean(np.abs(forward) < 1.96) <= 1.0
    two = [(100.0, 0.3, 0.0), (190.0, 0.2, 90.0), (280.0, 0.1, 180.0), (10.0, 0.1, 270.0)]
    assert np.isnan(porters_unit(two, 1).other_azimuth)


def test_tables_and_compensation_say_what_was_found():
    found = calibrate(*observed(SETS), 61.0, 200.0, force_sigma=FORCE_SIGMA, rate_sigma=RATE_SIGMA)
    tables = found.tables()
    assert tables["gyro_drift"].drift_deg_per_h.to_numpy() == pytest.approx([0.02, -0.01, 0.03], abs=1e-7)
    assert list(tables["accel_bias"].axis) == ["right", "forward", "up"]
    assert len(tables["orientation"]) == len(SETS)
    imu = ImuHeader(rate_hz=100.0, sensor_to_body=((0, -1, 0), (1, 0, 0), (0, 0, 1)))
    known = found.compensation(imu)
    assert known.gyro_drift_deg_per_h == pytest.approx((-0.01, -0.02, 0.03), abs=1e-7)  # sensor axes: x is body forward


def recorded(seconds=80.0, rate=20.0):
    """A unit laid on six sides for a while each, and turned quickly in between: counts, and where the rests are."""
    dt, gyro, accel, spans, now = 1.0 / rate, [], [], [], 0.0
    for angles in SETS:
        force, turn = orientation(*angles, 61.0, 200.0)
        n = int(seconds * rate)
        gyro += [np.tile((turn + GYRO) * dt, (n, 1)), np.tile([0.3 * dt, 0.0, 0.1 * dt], (int(4 * rate), 1))]
        accel += [np.tile((force + ACCEL) * dt, (n, 1)), np.tile([0.0, 2.0 * dt, 9.0 * dt], (int(4 * rate), 1))]
        spans.append((now, now + seconds))
        now += seconds + 4.0
    pulses = 1e-9, 1e-8
    counts = [
        np.diff(np.rint(np.cumsum(np.concatenate(v), axis=0) / p), axis=0, prepend=0.0)
        for v, p in zip((gyro, accel), pulses, strict=True)
    ]
    time = dt * np.arange(1, len(counts[0]) + 1)
    table = compensation_table(ImuHeader(rate_hz=rate))
    return Counts(time, *(np.asarray(c, np.int64) for c in counts), *pulses, table, dt), spans


def test_rests_of_a_recording_are_found_and_calibrate_the_unit():
    counts, spans = recorded()
    imu = ImuHeader(rate_hz=20.0, gyro_bias_deg_per_h=0.05, accel_bias_ug=200.0, accel_scale_ppm=1.0)
    assert np.array(find_rests(counts)) == pytest.approx(np.array(spans) + np.array([5.0, -5.0]), abs=2.0)
    sets = rest_sets(counts, imu)
    found = calibrate_sets(sets, 61.0, 200.0)
    assert np.all(np.abs(found.accel_bias - ACCEL) < 3.0 * found.accel_bias_sigma)
    assert np.all(np.abs(found.gyro_bias - GYRO) < 3.0 * found.gyro_bias_sigma)
    halves = rest_sets(counts, imu, spans[:3]) + rest_sets(counts, imu, spans[3:])
    assert np.degrees(np.abs(calibrate_sets(halves, 61.0, 200.0).gyro_bias - found.gyro_bias)).max() * 3600.0 < 1e-3


def test_recording_without_a_rest_is_refused():
    counts, _ = recorded(seconds=20.0)
    with pytest.raises(InputError, match="no rest"):
        rest_sets(counts, ImuHeader(rate_hz=20.0))
    with pytest.raises(InputError, match="no data for the rest from 9000"):
        rest_sets(counts, ImuHeader(rate_hz=20.0), [(9000.0, 9600.0)])


def test_shapes_that_differ_are_refused():
    with pytest.raises(InputError, match="shapes"):
        calibrate(np.zeros((2, 3)), np.zeros((3, 3)), 61.0, force_sigma=1.0, rate_sigma=1.0)
