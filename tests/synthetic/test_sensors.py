"""Inertial noise, wheels and arms against what their figures say."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.errors import OptionError
from deform.options import RouteOptions, ToolOptions
from deform.synthetic import arms, imu, wheels
from deform.synthetic._kernels import quantize
from deform.synthetic.motion import move
from deform.synthetic.route import lay

STILL = {"wobble_deg": 0.0, "offset_m": 0.0, "vibration": 0.0, "mounting_deg": 0.0, "static_start_s": 10.0, "static_end_s": 5.0}
CLEAN = {"arm_noise_m": 0.0, "arm_dropout": 0.0, "wheel_scale": 0.0, "wheel_wear_per_km": 0.0, "slips_per_km": 0.0}


@pytest.fixture(scope="module")
def line():
    return lay(RouteOptions(length_m=500.0, induction_bends_deg=(45.0,), crossings=0), seed=2)


def _motion(line, **tool):
    options = ToolOptions(**(STILL | CLEAN | tool))
    return move(line, options, 2, "run"), options


# ---- inertial unit


def test_quantization_loses_nothing_for_good():
    rng = np.random.default_rng(1)
    values = rng.normal(0.3, 1.0, (5000, 2))
    out, remainder = np.empty((5000, 2), np.int32), np.zeros(2)
    quantize(values, np.array([0.7, 0.01]), remainder, out)
    assert np.abs((out * [0.7, 0.01]).cumsum(axis=0) - values.cumsum(axis=0)).max() < 0.5 * 0.7 + 1e-9


def test_random_walk_has_the_size_of_its_figure():
    grade = imu.Grade(100.0, 0.0, 0.1, 0.0, 0.0, 50.0, 0.0, 1e-9, 1e-9)
    noise = imu.noise(grade, 100.0, 360_000, np.zeros(6), np.random.default_rng(2))
    hours = noise.reshape(60, 6000, 6).sum(axis=1)  # angle and velocity after a minute each
    assert hours[:, :3].std() * np.sqrt(60) == pytest.approx(np.radians(0.1), rel=0.15)
    assert hours[:, 3:].std() / np.sqrt(60) == pytest.approx(50.0 * imu.MICRO_G, rel=0.15)


def test_bias_wanders_with_its_sigma_and_correlation():
    grade = imu.Grade(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-9, 1e-9, wander_part=0.5, wander_s=50.0)
    bias = imu.noise(grade, 1.0, 200_000, np.zeros(6), np.random.default_rng(3))[:, 0]
    assert bias.std() == pytest.approx(0.5 * imu.DEG_PER_H, rel=0.1)
    assert np.corrcoef(bias[:-50], bias[50:])[0, 1] == pytest.approx(np.exp(-1), abs=0.1)


def test_turn_on_errors_scatter_by_the_makers_figures():
    drawn = [imu.draw_errors(imu.GRADES["tactical"], np.random.default_rng(k)) for k in range(300)]
    assert np.std([d.gyro_bias for d in drawn]) / imu.DEG_PER_H == pytest.approx(1.0, rel=0.1)
    assert np.std([np.diag(d.accel_matrix) - 1 for d in drawn]) == pytest.approx(200e-6, rel=0.1)


def test_counts_are_in_sensor_axes(line):
    turned = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))  # body = matrix @ sensor
    motion, plain = _motion(line, imu="perfect")
    _, sensor = _motion(line, imu="perfect", sensor_to_body=turned)
    errors = imu.draw_errors(imu.GRADES["perfect"], np.random.default_rng(1))
    body, own = (next(imu.counts(motion, tool, errors, 1, "run"))[1][2000:2100] for tool in (plain, sensor))
    assert np.abs(own @ np.array(turned).T - body).max() <= 1


def test_unknown_grade_is_refused_with_the_known_ones():
    with pytest.raises(OptionError, match="tactical"):
        imu.grade_of(ToolOptions(imu="toy"))


# ---- wheels


def test_faultless_wheels_measure_the_centreline_on_average(line):
    motion, tool = _motion(line, wheels=4, wheel_pulse_m=1e-4)
    time, count, scale, slips = wheels.roll_wheels(motion, tool, 1, "run")
    way = motion.distance(time)[0]
    mean = count.mean(axis=1) * 1e-4
    assert np.abs(mean - (way - way[0])).max() < 2e-3
    assert (np.diff(count, axis=0) >= 0).all()
    assert len(slips) == 0
    assert (scale == 0).all()


def test_the_wheel_on_the_inside_of_a_bend_travels_less(line):
    motion, tool = _motion(line, wheels=4, wheel_pulse_m=1e-4, roll_turns_per_km=0.0, wheel_lever_m=0.0)
    time, count, _, _ = wheels.roll_wheels(motion, tool, 1, "run")
    bend = line.joints[line.joints.kind == "induction"].iloc[0]
    low, high = np.searchsorted(time, motion.passage([bend.start_m, bend.start_m + bend.length_m]))
    way = (count[high] - count[low]) * 1e-4
    radius = 0.5 * line.outside_diameter - line.joints.wall_m.median()
    assert way[3] - way[1] == pytest.approx(2 * radius * np.radians(45.0), rel=0.02)  # left minus right of a bend to the right


def test_wheels_lose_what_their_slips_say(line):
    motion, tool = _motion(line, slips_per_km=20.0, wheel_pulse_m=1e-4, wheels=2)
    time, count, _, slips = wheels.roll_wheels(motion, tool, 1, "run")
    way = motion.distance(time)[0]
    for wheel in range(2):
        lost = 0.0
        for at, lasts, share in slips[slips.wheel == wheel][["time_s", "duration_s", "fraction_lost"]].to_numpy():
            lost += share * np.subtract(*motion.distance([at + lasts, at])[0])
        overlap = slips[slips.wheel == wheel].time_s.diff().min() < 6.0
        assert way[-1] - way[0] - count[-1, wheel] * 1e-4 == pytest.approx(lost, abs=1.0 if overlap else 0.15)


def test_scale_and_wear_shorten_or_lengthen_the_way(line):
    motion, tool = _motion(line, wheel_scale=0.01, wheel_wear_per_km=0.01, wheel_pulse_m=1e-4)
    time, count, scale, _ = wheels.roll_wheels(motion, tool, 1, "run")
    way = motion.distance(time)[0]
    early = np.searchsorted(way, 60.0)
    ratio = count[early] * 1e-4 / (way[early] - way[0])
    assert ratio - 1 == pytest.approx(scale, abs=2e-3)
    assert (count[-1] * 1e-4 / (way[-1] - way[0]) < ratio + 1e-3).all()


# ---- arms


def _dent(**change):
    dent = {"dent_id": "D", "chainage_m": 250.0, "epoch0_chainage_m": 250.0, "clock_deg": 100.0, "depth_m": 0.01}
    dent |= {"depth_pct_od": 3.0, "length_m": 0.4, "width_m": 0.2, "sharpness": 2.0}
    return pd.DataFrame([dent | change])


NO_DENTS = _dent().iloc[:0]


def _scan(line, dents=NO_DENTS, mirrored=False, **tool):
    motion, options = _motion(line.reversed() if mirrored else line, **tool)
    blocks = list(arms.scans(motion, dents, options, 1, "run", mirrored))
    time, packed = np.concatenate([b[0] for b in blocks]), np.concatenate([b[1] for b in blocks])
    ranges = np.where(packed == arms.FILL, np.nan, packed * arms.PACKING_M)
    return motion, motion.distance(time)[0], ranges


def test_centred_arms_in_round_pipe_read_the_inner_radius(line):
    joints = line.joints.assign(ovality=0.0)
    _, way, ranges = _scan(type(line)(line.table, line.material, line.replaced, joints, line.outside_diameter))
    place = way - 0.6
    k = np.searchsorted(joints.start_m, place, side="right") - 1
    middle = np.abs(place - joints.start_m.to_numpy()[k] - 0.5 * joints.length_m.to_numpy()[k]) < 0.5
    wanted = 0.5 * line.outside_diameter - joints.wall_m.to_numpy()[k]
    pipe = middle & (joints.kind.to_numpy()[k] != "valve")
    assert np.abs(ranges[pipe, 0] - wanted[pipe, None]).max() < 6e-5


def test_a_recessed_valve_opens_in_its_middle(line):
    recessed = lay(RouteOptions(length_m=500.0, valve_spacing_m=400.0, valve_recess_m=0.004, crossings=0), seed=2)
    valve = recessed.joints[recessed.joints.kind == "valve"].iloc[0]
    _, way, ranges = _scan(recessed)
    off = way - 0.6 - valve.start_m
    inner = 0.5 * recessed.outside_diameter - valve.wall_m
    assert np.nanmean(ranges[np.abs(off - 0.75) < 0.1]) == pytest.approx(inner + 0.004, abs=2e-4)
    assert np.nanmean(ranges[np.abs(off - 0.3) < 0.1]) == pytest.approx(inner, abs=2e-4)


def test_weld_bead_stands_inward_at_the_ring(line):
    _, way, ranges = _scan(line, caliper_rate_hz=400.0)
    weld = line.joints.iloc[20]
    near = np.abs(way - 0.6 - weld.start_m) < 0.03
    around = (np.abs(way - 0.6 - weld.start_m) < 0.3) & ~near
    assert np.nanmean(ranges[around]) - np.nanmin(ranges[near].mean(axis=(1, 2))) == pytest.approx(weld.bead_m, abs=4e-4)


def test_offset_tool_sees_a_sinusoid_and_ovality_its_double(line):
    _, way, ranges = _scan(line, offset_m=0.004, wobble_deg=0.2, arms=36)
    k = int(np.argmin(np.abs(way - 123.0)))
    spectrum = np.abs(np.fft.rfft(ranges[k, 0])) / 18
    joint = line.joints.iloc[np.searchsorted(line.joints.start_m, 122.4) - 1]
    assert spectrum[2] == pytest.approx(0.25 * joint.ovality * line.outside_diameter, abs=1e-4)
    assert 1e-4 < spectrum[1] < 0.02
    assert spectrum[3:].max() < 3e-5


@pytest.mark.parametrize("mirrored", [False, True])
def test_dent_is_at_its_clock_and_place_whatever_way_the_tool_runs(line, mirrored):
    dents = _dent()
    settings = {"mirrored": mirrored, "caliper_rate_hz": 200.0, "arms": 72}
    motion, way, dented = _scan(line, dents, **settings)
    plain = _scan(line, **settings)[2]
    depth = (plain - dented)[:, 0]
    row, arm = np.unravel_index(np.nanargmax(depth), depth.shape)
    place = way[row] - 0.6
    assert (line.length - place if mirrored else place) == pytest.approx(250.0, abs=0.02)
    clock = np.degrees(2 * np.pi * arm / 72 + motion.line.at([way[row]], 11)[0, 0])
    assert ((-clock if mirrored else clock) - 100.0 + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=3.0)
    assert depth.max() == pytest.approx(0.01, abs=3e-4)
    tenth = way[depth.max(axis=1) > 0.001]
    assert np.ptp(tenth) == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("kind", ["tee", "wrinkle"])
def test_tee_opens_outward_and_wrinkle_waves_about_the_wall(line, kind):
    fitting = {"fitting_id": "F", "kind": kind, "chainage_m": 250.0, "epoch0_chainage_m": 250.0, "clock_deg": 40.0}
    fittings = pd.DataFrame([fitting | {"height_m": 0.01, "length_m": 0.2}])
    motion, tool = _motion(line, caliper_rate_hz=200.0, arms=72)
    plain, fitted = (
        np.concatenate([b[1][:, 0] for b in arms.scans(motion, NO_DENTS, tool, 1, "run", False, f)]) * arms.PACKING_M
        for f in (None, fittings)
    )
    change = fitted - plain
    way = motion.distance(np.arange(len(change)) / 200.0)[0] - 0.6
    row, arm = np.unravel_index(np.abs(change).argmax(), change.shape)
    assert way[row] == pytest.approx(250.0, abs=0.11)
    assert np.abs(change[np.abs(way - 250.0) > 1.0]).max() < 1e-9
    assert abs((np.degrees(2 * np.pi * arm / 72 + motion.line.at([way[row]], 11)[0, 0]) - 40.0 + 180) % 360 - 180) < 40.0
    if kind == "tee":
        assert change.min() > -1e-9
        assert change.max() == pytest.approx(0.01, abs=2e-4)
    else:
        assert change.min() == pytest.approx(-0.01, abs=4e-4)
        assert change.max() > 0.004


def test_dead_arms_and_drop_outs_give_nothing(line):
    _, _, ranges = _scan(line, dead_arms=(3, 7), arm_dropout=0.01)
    assert np.isnan(ranges[:, 0, [3, 7]]).all()
    rest = np.delete(ranges[:, 0], [3, 7], axis=1)
    assert np.isnan(rest).mean() == pytest.approx(0.01, abs=0.003)


def test_two_rings_see_the_same_wall_one_after_the_other(line):
    _, way, ranges = _scan(line, ring_offset_m=(-0.6, -1.4), speed_variation=0.0, stops=0)
    assert ranges.shape[1] == 2
    mean = ranges.mean(axis=2)
    both = np.interp(way - 0.8, way + np.arange(way.size) * 1e-12, mean[:, 0])
    inside = slice(2000, -2000)
    assert np.median(np.abs(both - mean[:, 1])[inside]) < 5e-5


def test_detector_misses_and_invents_as_often_as_asked(line):
    motion, tool = _motion(line, weld_miss=0.3, weld_false=0.5)
    events, true, seen = arms.detect_welds(motion, tool, 3, "run")
    passed = np.isfinite(true)
    assert 0.1 < 1 - seen[passed].mean() < 0.6
    assert not seen[~passed].any()
    assert len(events) > seen.sum()
    assert (np.diff(events.time_s) >= 0).all()
