"""The trajectory and the centreline: chainage, zero, standstill, direction of travel, offset of the tool."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from deform.errors import InputError
from deform.geometry.earth import enu_difference, enu_shift
from deform.nav.trajectory import centreline, decimation, trajectory
from deform.options import NavigationOptions
from deform.run import schema
from tests.nav.wheels import header

RATE, SPEED, AZIMUTH, CLIMB = 20.0, 1.0, 60.0, 2.0


def straight(duration=200.0, stop=(0.0, 30.0), again=(100.0, 120.0), backwards=0.0):
    """Values of a tool that runs up a straight slope with two stops; at the second it may be pushed back a little."""
    time = np.arange(0.0, duration, 1.0 / RATE)
    speed = np.where((time < stop[1]) | ((time >= again[0]) & (time < again[1])), 0.0, SPEED)
    if backwards:
        speed = np.where((time >= again[0]) & (time < again[0] + 5.0), -backwards, speed)
    ahead = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / RATE])
    east, north = np.sin(np.radians(AZIMUTH)) * np.cos(np.radians(CLIMB)), np.cos(np.radians(AZIMUTH)) * np.cos(np.radians(CLIMB))
    up = np.sin(np.radians(CLIMB))
    place = enu_shift(61.0, -121.0, 200.0, ahead * east, ahead * north, ahead * up)
    full = np.ones(time.size)
    values = {
        "time": time,
        "log_distance": np.maximum.accumulate(ahead),
        "latitude": place[0],
        "longitude": place[1],
        "height": place[2],
        "east_sigma": 0.1 * full,
        "north_sigma": 0.2 * full,
        "up_sigma": 0.3 * full,
        "azimuth": AZIMUTH * full,
        "pitch": CLIMB * full,
        "roll": 170.0 + 0.2 * time,
        "velocity_east": speed * east,
        "velocity_north": speed * north,
        "velocity_up": speed * up,
        "speed": speed,
        "stationary": speed == 0.0,
    }
    return values, ahead


def passages(kind, time):
    return xr.Dataset({"kind": ("marker", [kind, "agm"]), "time": ("marker", [time, np.nan])})


def of(values, direction="downstream", **keywords):
    return SimpleNamespace(trajectory=trajectory(values, header(direction), **keywords))


def test_chainage_is_the_travel_of_the_tool_and_zero_at_the_launcher():
    values, ahead = straight()
    made = trajectory(values, header(), passages("launcher", 35.0))
    np.testing.assert_allclose(made.chainage, ahead - 5.0, atol=0.06)
    assert schema.dataset_faults("trajectory", made) == []


def test_first_weld_is_zero_where_no_trap_was_heard():
    values, _ = straight()
    welds = xr.Dataset({"time": ("event", [50.0, 60.0])})
    made = trajectory(values, header(), passages("launcher", np.nan), welds)
    assert np.interp(50.0, made.time, made.chainage) == pytest.approx(0.0, abs=1e-9)


def test_standstill_does_not_drift_along_the_pipe():
    values, _ = straight()
    values["velocity_east"] = values["velocity_east"] + 0.002
    values["speed"] = values["speed"] + 0.002
    made = trajectory(values, header())
    still = (made.time > 1.0) & (made.time < 29.0)
    assert np.ptp(made.chainage.values[still]) == 0.0


def test_centreline_is_regular_and_its_time_rises_through_the_stops():
    values, _ = straight(backwards=0.02)
    line = centreline(of(values), header())
    np.testing.assert_allclose(np.diff(line.chainage), 0.1, atol=1e-9)
    assert (np.diff(line.time) > 0).all()
    assert np.isfinite(line.time).all()
    assert line.time[0] == pytest.approx(30.0, abs=0.2)
    assert schema.dataset_faults("centreline", line) == []


def test_centreline_stays_on_the_line_of_the_truth():
    values, ahead = straight()
    made = of(values)
    line = centreline(made, header())
    place = np.interp(line.time, values["time"], ahead)
    east, _, up = enu_difference(line.latitude, line.longitude, line.height, 61.0, -121.0, 200.0)
    np.testing.assert_allclose(east, place * np.sin(np.radians(AZIMUTH)) * np.cos(np.radians(CLIMB)), atol=1e-3)
    np.testing.assert_allclose(up, place * np.sin(np.radians(CLIMB)), atol=1e-3)
    np.testing.assert_allclose(line.azimuth, AZIMUTH, atol=1e-6)
    np.testing.assert_allclose(line.pitch, CLIMB, atol=1e-6)
    assert float(line.east_sigma.mean()) == pytest.approx(0.1)


def test_upstream_run_has_falling_chainage_in_time_and_looks_downstream():
    values, ahead = straight()
    made = of(values, "upstream", passages=passages("receiver", values["time"][-1]))
    assert made.trajectory.chainage[-1] == pytest.approx(0.0, abs=0.1)
    assert made.trajectory.chainage[0] == pytest.approx(ahead[-1], abs=0.1)
    line = centreline(made, header("upstream"))
    assert (np.diff(line.time) < 0).all()
    np.testing.assert_allclose(line.azimuth, AZIMUTH + 180.0, atol=1e-6)
    np.testing.assert_allclose(line.pitch, -CLIMB, atol=1e-6)


def test_tool_roll_takes_the_short_way_through_the_turn():
    line = centreline(of(straight()[0]), header())
    turn = np.abs((np.diff(line.tool_roll) + 180.0) % 360.0 - 180.0)
    assert turn.max() < 5.0
    assert line.tool_roll.min() >= -180.0


def test_offset_of_the_tool_in_the_pipe_is_taken_off():
    values, _ = straight()
    made = of(values)
    time = made.trajectory.time.values[[0, -1]]
    pose = xr.Dataset({"time": time, "offset_right": ("time", [0.02, 0.02]), "offset_up": ("time", [-0.03, -0.03])})
    plain, moved = centreline(made, header()), centreline(made, header(), pose=pose)
    east, north, up = enu_difference(moved.latitude, moved.longitude, moved.height, plain.latitude, plain.longitude, plain.height)
    right = east * np.cos(np.radians(AZIMUTH)) - north * np.sin(np.radians(AZIMUTH))
    np.testing.assert_allclose(right, -0.02, atol=1e-4)
    np.testing.assert_allclose(up, 0.03 * np.cos(np.radians(CLIMB)), atol=1e-4)


def test_tool_that_never_moved_is_refused():
    values, _ = straight(stop=(0.0, 1000.0))
    with pytest.raises(InputError, match="advanced by"):
        centreline(of(values), header())


@pytest.mark.parametrize(("rate", "wanted", "every"), [(100.0, 20.0, 5), (16.0, 20.0, 1), (200.0, 20.0, 10), (50.0, 20.0, 2)])
def test_output_rate_is_at_least_the_one_wanted(rate, wanted, every):
    assert decimation(rate, NavigationOptions(output_rate_hz=wanted)) == every
