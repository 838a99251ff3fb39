"""Runs that are broken in ways a tool run is broken, navigated whole: refused by name, or flagged and wider in sigma."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from deform.nav.navigate import navigate
from deform.options import NavigationOptions
from deform.readers.reader import read_source
from tests.nav.test_navigate import misplaced

pytestmark = pytest.mark.demo
QUICK = NavigationOptions(error_model="odometer")  # learns no noise


@cache
def raw_run(folder: Path):
    return read_source(folder)


@cache
def navigated(folder: Path):
    return navigate(raw_run(folder), QUICK)


def honest(found, demo):
    """Share of the line, east, north and up together, on which the error lies within 1.96 sigma; the largest error (m)."""
    error, sigma = misplaced(found.trajectory, demo / "truth")
    return np.mean(np.abs(error) < 1.96 * sigma), np.abs(error).max()


def cut(raw, start, end):
    """The run without what its sensors recorded outside an interval of time."""
    imu, wheel = (ds["time"].values for ds in (raw.imu, raw.odometer))
    return replace(
        raw,
        imu=raw.imu.isel(sample=(imu >= start) & (imu <= end)),
        odometer=raw.odometer.isel(sample=(wheel >= start) & (wheel <= end)),
    )


def sigma_at(found, time, name):
    return np.interp(time, found.trajectory["time"], found.trajectory[name])


def test_recording_that_begins_while_the_tool_moves_is_aligned_in_motion(demo):
    raw = raw_run(demo / "demo-2019")
    found = navigate(cut(raw, raw.header.launch.static_s + 120.0, np.inf), QUICK)
    assert found.diagnostics.attrs["alignment_method"] == "in motion"
    inside, largest = honest(found, demo)
    assert inside > 0.9
    assert largest < 1.5


def test_gap_of_five_seconds_widens_the_sigma_where_it_is(demo):
    raw = raw_run(demo / "demo-2019")
    time = raw.imu["time"].values
    found = navigate(replace(raw, imu=raw.imu.isel(sample=(time < 2000.0) | (time > 2005.0))), QUICK)
    whole = navigated(demo / "demo-2019")
    assert sigma_at(found, 2002.5, "azimuth_sigma") > 1.3 * sigma_at(whole, 2002.5, "azimuth_sigma")
    assert sigma_at(found, 2002.5, "east_sigma") > 1.1 * sigma_at(whole, 2002.5, "east_sigma")
    inside, largest = honest(found, demo)
    assert inside > 0.9
    assert largest < 1.0


def test_forward_and_backward_runs_agree_over_gaps_and_a_bend_in_one_is_told(demo):
    raw = raw_run(demo / "demo-2019")
    time = raw.imu["time"].values
    kept = np.ones(time.size, bool)
    for begin in (836.0, 1600.0, 2000.0, 2330.0, 3300.0):  # the first hides a bend of 47 degree, the fourth a marker's side
        kept &= (time < begin) | (time > begin + 5.0)
    found = navigate(replace(raw, imu=raw.imu.isel(sample=kept)))
    assert "turns there by 47 degree within 6.9 m" in found.diagnostics.attrs["remarks"]
    assert "forward and backward" not in found.diagnostics.attrs["remarks"]
    assert found.markers["used"].values.all()
    inside, largest = honest(found, demo)
    assert inside > 0.9
    assert largest < 1.0


def test_markers_heard_in_the_wrong_order_are_named_and_do_no_harm(demo):
    raw = raw_run(demo / "demo-2019")
    passages = raw.passages.copy(deep=True)
    time = passages["time"].values
    time[2], time[3] = time[3], time[2]
    found = navigate(replace(raw, passages=passages))
    assert ["contradicted" in remark for remark in found.markers["remark"].values] == [False, False, True, True, False, False]
    assert not found.markers["used"].values[2:4].any()
    inside, largest = honest(found, demo)
    assert inside > 0.9
    assert largest < 1.0


def test_stall_of_all_wheels_is_bridged_by_the_inertial_unit(demo):
    raw, start, end = raw_run(demo / "demo-2019"), 3000.0, 3020.0
    wheel = raw.odometer.copy(deep=True)
    count = wheel["count"].values
    first, last = np.searchsorted(wheel["time"].values, (start, end))
    lost = count[last] - count[first]
    count[first:last] = count[first]
    count[last:] -= lost
    found, whole = navigate(replace(raw, odometer=wheel), QUICK), navigated(demo / "demo-2019")
    assert sigma_at(found, 3010.0, "chainage_sigma") > 5.0 * sigma_at(whole, 3010.0, "chainage_sigma")
    travelled = [np.diff(np.interp([2990.0, 3030.0], n.trajectory["time"], n.trajectory["chainage"])) for n in (found, whole)]
    assert abs(travelled[0] - travelled[1]) < 0.5  # of 54 m, 27 m of which no wheel counted
    inside, largest = honest(found, demo)
    assert inside > 0.9
    assert largest < 1.0
