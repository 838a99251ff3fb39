"""The tool's way through the pipe: distance, stops, attitude."""

from __future__ import annotations

import numpy as np
import pytest

from deform.geometry.earth import enu_difference
from deform.options import RouteOptions, ToolOptions
from deform.synthetic.motion import TRAP_M, move
from deform.synthetic.route import lay


@pytest.fixture(scope="module")
def line():
    return lay(RouteOptions(length_m=1000.0), seed=2)


@pytest.fixture(scope="module")
def motion(line):
    return move(line, ToolOptions(static_start_s=100.0, static_end_s=50.0, stops=2), 2, "run")


def test_tool_stands_in_the_trap_travels_and_stands_at_the_other_end(line, motion):
    distance, speed = motion.distance([0.0, motion.begin, motion.end, motion.duration - 1])
    assert distance == pytest.approx([TRAP_M, TRAP_M, line.length - TRAP_M, line.length - TRAP_M], abs=1e-6)
    assert speed == pytest.approx([0, 0, 0, 0], abs=1e-12)


def test_speed_is_the_derivative_of_the_distance_and_never_backwards(motion):
    times = np.arange(0.0, motion.duration, 0.05)
    distance, speed = motion.distance(times)
    assert (speed >= 0).all()
    assert np.gradient(distance, times)[2:-2] == pytest.approx(speed[2:-2], abs=5e-4)


def test_stops_are_as_many_as_asked(motion):
    times = np.arange(motion.begin + 20, motion.end - 20, 0.1)
    standing = motion.distance(times)[1] < 1e-9
    assert np.sum(np.diff(standing.astype(int)) == 1) == 2


def test_a_tool_without_standstill_is_moving_when_its_clock_starts(line):
    motion = move(line, ToolOptions(static_start_s=0.0), 2, "run")
    assert motion.distance([0.0])[1][0] > 0.3


def test_passage_is_the_time_at_which_the_distance_is_reached(line, motion):
    where = np.array([3.0, 50.0, 500.0, line.length - 3.0, line.length, -1.0])
    times = motion.passage(where)
    assert np.isnan(times).tolist() == [False] * 4 + [True] * 2
    assert motion.distance(times[:4])[0] == pytest.approx(where[:4], abs=1e-6)


def test_velocity_is_the_derivative_of_the_position_offset_and_wobble_included(line):
    motion = move(line, ToolOptions(static_start_s=10.0, vibration=0.0, offset_m=0.02), 2, "run")
    times = np.arange(20.0, 700.0, 3.3)
    h = 1e-3
    behind, ahead, here = (motion.states(times + k * h) for k in (-1, 1, 0))
    degrees = [np.degrees(x) for x in (ahead[:, 0], ahead[:, 1], behind[:, 0], behind[:, 1])]
    moved = np.stack(enu_difference(degrees[0], degrees[1], ahead[:, 2], degrees[2], degrees[3], behind[:, 2]), axis=1)
    assert moved / (2 * h) == pytest.approx(here[:, 3:6], abs=2e-5)


def test_attitude_is_the_pipes_within_the_wobble_and_the_imu_differs_by_a_constant(line, motion):
    from deform.geometry.rotation import attitude_to_matrix

    x = motion.states(np.arange(150.0, 800.0, 1.7))
    off = np.degrees((x[:, 13] - x[:, 8] + np.pi) % (2 * np.pi) - np.pi), np.degrees(x[:, 14] - x[:, 9])
    assert 0.03 < np.std(off[0]) < 0.4
    assert 0.03 < np.std(off[1]) < 0.4
    body, tool = attitude_to_matrix(*np.degrees(x[:, 10:13]).T), attitude_to_matrix(*np.degrees(x[:, 13:16]).T)
    constant = np.swapaxes(tool, 1, 2) @ body
    assert np.ptp(constant, axis=0).max() < 1e-12
    assert constant[0] == pytest.approx(attitude_to_matrix(*motion.mounting_deg), abs=1e-12)


def test_tool_is_hit_at_each_weld(line):
    motion = move(line, ToolOptions(static_start_s=10.0), 2, "run")
    quiet = move(line, ToolOptions(static_start_s=10.0, vibration=0.0), 2, "run")
    assert quiet.hit_times.size == 0
    assert motion.hit_times.size == np.sum((line.joints.start_m > TRAP_M) & (line.joints.start_m < line.length - TRAP_M))
    k = motion.hit_times.size // 2
    times = motion.hit_times[k] + np.arange(-0.5, 0.5, 0.002)
    shaken = np.abs(motion.states(times)[:, 5] - quiet.states(times)[:, 5])
    assert shaken[times > motion.hit_times[k]].max() > 2 * shaken[times < motion.hit_times[k]].max()
