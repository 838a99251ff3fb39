"""The odometer against travels it cannot know: scale, slip, bend, wear, dead wheels, stalls and stops."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.nav.odometer import combine
from tests.nav.wheels import PULSE, run


def departure(solution, travel):
    return solution.on_samples()[0] - travel


def test_wheels_without_fault_give_the_travel_within_two_pulses():
    raw, travel = run(scales=(0.0, 0.0, 0.0))
    solution = combine(raw)
    assert solution.on_samples()[0].shape == solution.on_samples()[1].shape == (raw.imu.sizes["sample"] + 1,)
    assert np.abs(departure(solution, travel)).max() < 2 * PULSE
    assert (np.diff(solution.on_samples()[0]) >= 0).all()
    assert solution.slips == ()
    assert solution.stalls == ()


def test_relative_scales_are_found_within_their_sigma_and_their_mean_is_the_scale_of_the_distance():
    scales = np.array([0.004, 0.001, -0.002])
    raw, travel = run(scales=tuple(scales))
    solution = combine(raw)
    assert np.abs((solution.wheel_scale - (scales - scales.mean())) / solution.wheel_scale_sigma).max() < 4.0
    assert np.abs(departure(solution, travel * (1 + scales.mean()))).max() < 3 * PULSE


@pytest.mark.parametrize("lost", [0.1, 0.3, 1.0])
def test_slip_of_one_wheel_is_found_with_its_times_and_repaired(lost):
    raw, travel = run(slips=[(1, 200.0, 205.0, lost)])
    solution = combine(raw)
    (slip,) = solution.slips
    assert slip.wheel == 1
    assert abs(slip.start - 200.0) < 0.5
    assert abs(slip.end - 205.0) < 0.5
    true = lost * np.diff(np.interp([200.0, 205.0], raw.imu.time, travel[1:]))[0]
    assert slip.lost_distance == pytest.approx(true, abs=0.02)
    assert np.abs(departure(solution, travel)).max() < 0.02


def test_two_wheels_that_slip_at_once_are_both_left_out():
    raw, travel = run(slips=[(0, 200.0, 206.0, 0.8), (2, 202.0, 209.0, 0.5)])
    solution = combine(raw)
    assert {s.wheel for s in solution.slips} == {0, 2}
    assert np.abs(departure(solution, travel)).max() < 0.04


def test_sharp_bend_is_no_slip_and_gives_the_arms_of_the_wheels():
    raw, travel = run(bends=[(100.0, 2.5, 90.0), (200.0, 2.5, -60.0), (300.0, 2.5, 90.0)])
    solution = combine(raw)
    assert solution.slips == ()
    assert np.abs(departure(solution, travel)).max() < 0.02
    right = 0.5 * 0.3239 * np.sin(np.radians([0.0, 120.0, 240.0]))
    assert np.abs(solution.wheel_arm[:, 0] - right).max() < 0.02


def test_slip_inside_a_bend_is_repaired_with_the_arms_of_the_wheels():
    raw, travel = run(bends=[(100.0, 2.5, 90.0), (200.0, 2.5, -60.0), (300.0, 2.5, 90.0)], slips=[(1, 358.0, 368.0, 1.0)])
    solution = combine(raw)
    assert {s.wheel for s in solution.slips} == {1}
    assert np.abs(departure(solution, travel)).max() < 0.05


def test_dead_wheel_is_left_out_and_named():
    raw, travel = run(dead=(2,), scales=(0.001, -0.001, 0.0))
    solution = combine(raw)
    assert np.isnan(solution.wheel_scale[2])
    assert any("wheel 2 is dead" in r for r in solution.remarks)
    assert np.abs(departure(solution, travel)).max() < 3 * PULSE


def test_wheel_that_dies_on_the_way_does_not_take_distance_along():
    raw, travel = run(slips=[(0, 300.0, 700.0, 1.0)])
    solution = combine(raw)
    assert np.abs(departure(solution, travel)).max() < 0.05


def test_worn_wheel_does_not_bend_the_scale_when_it_drops_out():
    raw, travel = run(duration=1500.0, wear=-0.006, scales=(0.0, 0.0, 0.0), slips=[(0, 1200.0, 1300.0, 1.0)])
    solution = combine(raw)
    assert any("wear" in r for r in solution.remarks)
    inside = np.interp([1190.0, 1310.0], raw.imu.time, departure(solution, travel)[1:])
    ramp = -0.002 * 120.0 * 1250.0 / 1500.0  # a third of the wear is in the mean of three wheels
    assert np.diff(inside)[0] == pytest.approx(ramp, abs=0.03)


def test_single_wheel_is_taken_as_it_is_with_a_wide_sigma():
    raw, travel = run(scales=(0.0,), clocks=(0.0,))
    solution = combine(raw)
    assert np.abs(departure(solution, travel)).max() < 2 * PULSE
    assert any("only the inertial unit sees its slips" in r for r in solution.remarks)
    assert np.median(solution.on_samples()[2][20000:]) > 0.015


def test_stop_is_recognised_and_only_there():
    raw, _ = run(stops=[(0.0, 60.0), (300.0, 330.0)])
    solution = combine(raw)
    time = np.concatenate([[0.0], raw.imu.time])
    inside = (time < 59.0) | ((time > 301.0) & (time < 329.0))
    outside = ((time > 60.2) & (time < 299.8)) | (time > 330.2)
    assert solution.on_samples()[3][inside].mean() > 0.98
    assert not solution.on_samples()[3][outside].any()


def test_stall_of_all_wheels_is_flagged_bridged_and_uncertain():
    raw, travel = run(stalls=[(250.0, 262.0)])
    solution = combine(raw)
    ((start, end),) = solution.stalls
    assert abs(start - 250.0) < 1.0
    assert abs(end - 262.0) < 1.0
    assert not solution.on_samples()[3][25000:26200].any()
    assert solution.on_samples()[2][25600] > 0.5
    assert np.abs(departure(solution, travel)).max() < 2.0


def test_speed_errors_are_as_large_as_their_sigma_says():
    raw, travel = run(scales=(0.0, 0.0, 0.0), speed=0.8)
    solution = combine(raw)
    true = np.gradient(travel, 0.01)
    moving = slice(8000, -500)
    error = (solution.on_samples()[1] - true)[moving] / solution.on_samples()[2][moving]
    assert 0.4 < np.sqrt(np.mean(error**2)) < 1.3


def test_odometer_that_never_counts_is_refused():
    raw, _ = run(duration=100.0, stops=[(0.0, 100.0)])
    with pytest.raises(InputError, match="no wheel turned"):
        combine(raw)
