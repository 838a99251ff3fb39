"""The whole navigation on the demonstration runs against their truth, and on runs that are broken on purpose."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from deform.errors import InputError
from deform.geometry import earth
from deform.nav.navigate import navigate
from deform.readers.reader import read_source
from deform.run import build

RUNS = ("demo-2019", "demo-2021", "demo-2023")


@cache
def raw_run(folder: Path):
    return read_source(folder)


@cache
def navigated(folder: Path):
    return navigate(raw_run(folder))


def misplaced(line, truth, run="demo-2019"):
    """Errors east, north, up and their sigma on a regular grid of true chainage, the centreline being the truth."""
    with xr.open_dataset(truth / run / "truth.nc") as true:
        chainage = np.interp(line.time, true.time, true.chainage)
        rising = np.concatenate([[True], np.diff(chainage) > 1e-6])
        grid = np.arange(chainage.min() + 0.5, chainage.max() - 0.5, 1.0)
        when = np.interp(grid, chainage[rising], line.time.values[rising])
        place = [np.interp(when, line.time, line[v]) for v in ("latitude", "longitude", "height")]
        wanted = [np.interp(grid, true.grid_chainage, true[f"grid_{v}"]) for v in ("latitude", "longitude", "height")]
        error = np.column_stack(earth.enu_difference(*place, *wanted))
        sigma = np.column_stack([np.interp(when, line.time, line[f"{c}_sigma"]) for c in ("east", "north", "up")])
        return error, sigma


@pytest.mark.demo
@pytest.mark.parametrize("run", RUNS)
def test_demo_runs_lie_within_three_decimetres(demo, run):
    error, _ = misplaced(navigated(demo / run).trajectory, demo / "truth", run)
    assert np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)) < 0.30
    assert np.sqrt(np.mean(error[:, 2] ** 2)) < 0.30
    assert np.abs(error).max() < 1.0


@pytest.mark.demo
def test_sigmas_of_the_demo_runs_are_honest(demo):
    pairs = [misplaced(navigated(demo / run).trajectory, demo / "truth", run) for run in RUNS]
    ratio = np.concatenate([(e / s).ravel() for e, s in pairs])
    inside = np.mean(np.abs(ratio) < 1.96)
    assert inside > 0.85
    assert 0.4 < np.mean(ratio**2) < 1.8


@pytest.mark.demo
def test_diagnostics_and_markers_follow_the_vocabulary(demo):
    from deform.run.schema import dataset_faults

    found = navigated(demo / RUNS[0])
    for group, dataset in (("trajectory", found.trajectory), ("markers", found.markers), ("navigation", found.diagnostics)):
        assert not dataset_faults(group, dataset)
    assert found.markers["used"].values.all()
    square = found.diagnostics["innovation_square"]
    assert all(0.3 < square.sel(kind=f"travel {axis}").item() < 2.0 for axis in ("along", "right", "up"))


@pytest.mark.demo
def test_a_marker_twenty_metres_off_is_found_named_and_does_no_harm(demo, caplog):
    raw = raw_run(demo / RUNS[0])
    passages = raw.passages.copy(deep=True)
    passages["longitude"].values[3] += 20.0 / 54e3
    found = navigate(replace(raw, passages=passages))
    assert "contradicted" in found.markers["remark"].values[3]
    assert found.markers["used"].values.sum() == 5
    assert "AGM02" in caplog.text
    error, _ = misplaced(found.trajectory, demo / "truth")
    assert np.abs(error).max() < 1.0


@pytest.mark.demo
def test_launch_wrong_by_kilometres_is_not_believed(demo, caplog):
    raw = raw_run(demo / RUNS[0])
    launch = replace(raw.header.launch, latitude_deg=raw.header.launch.latitude_deg + 0.05)
    found = navigate(replace(raw, header=replace(raw.header, launch=launch)))
    assert "launch" in caplog.text
    error, _ = misplaced(found.trajectory, demo / "truth")
    assert np.abs(error).max() < 1.0


@pytest.mark.demo
def test_without_markers_the_sigma_stays_open_and_honest(demo):
    found = navigate(replace(raw_run(demo / RUNS[0]), passages=None))
    error, sigma = misplaced(found.trajectory, demo / "truth")
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.85
    drift, opened = (error - error[0])[1:], np.sqrt(sigma[1:] ** 2 - sigma[0] ** 2)  # beyond the launch's own
    assert np.hypot(*opened[-1, :2]) > 1.0
    assert np.mean(np.abs(drift) < 1.96 * opened) > 0.85


@pytest.mark.demo
def test_a_gap_of_five_seconds_is_bridged(demo):
    raw = raw_run(demo / RUNS[0])
    time = raw.imu["time"].values
    found = navigate(replace(raw, imu=raw.imu.isel(sample=(time < 2000.0) | (time > 2005.0))))
    error, sigma = misplaced(found.trajectory, demo / "truth")
    assert np.abs(error).max() < 1.0
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.85


@pytest.mark.demo
@pytest.mark.parametrize(("counts", "axis", "name"), [("gyro_count", 1, "y"), ("accel_count", 1, "y"), ("gyro_count", 0, "x")])
def test_a_reversed_axis_is_refused_by_name(demo, counts, axis, name):
    raw = raw_run(demo / RUNS[0])
    imu = raw.imu.copy(deep=True)
    imu[counts].values[:, axis] *= -1
    with pytest.raises(InputError, match=f"axis {name}"):
        navigate(replace(raw, imu=imu))


def test_control_points_replace_the_coordinates_of_markers_of_their_name():
    from deform.nav.navigate import with_control

    values = {
        "latitude": [1.0, 2.0],
        "longitude": [3.0, 4.0],
        "height": [5.0, 6.0],
        "sigma_horizontal": [0.3, 0.3],
        "sigma_vertical": [0.3, 0.3],
    }
    passages = build.dataset("passages", {"name": ["A", "B"], "kind": ["agm", "agm"], "time": [1.0, 2.0], **values})
    control = build.dataset("control", {"name": ["B"], **{k: [9.0] for k in values}})
    found = with_control(passages, control)
    assert found["latitude"].values.tolist() == [1.0, 9.0]
    assert passages["latitude"].values.tolist() == [1.0, 2.0]
