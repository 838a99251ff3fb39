"""Curvature from raw rates: a bend of known angle, and the simulated demonstration line against its truth."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from deform.errors import InputError
from deform.nav.quick_look import quick_look
from deform.readers.reader import read_source
from tests.nav.wheels import run


def test_bend_shows_its_angle_over_its_length_to_the_right():
    raw, _ = run(bends=[(100.0, 10.0, 30.0)], stops=[(0.0, 60.0), (300.0, 330.0)])
    look = quick_look(raw)
    at = look.sel(log_distance=slice(101.0 - 1.1 + 1.0, 109.0 - 1.1 - 1.0))
    np.testing.assert_allclose(at.curvature_horizontal, np.radians(30.0) / 10.0, rtol=0.03)
    assert float(np.abs(look.curvature_vertical).max()) < 0.02 * np.radians(30.0) / 10.0
    away = look.sel(log_distance=slice(150.0, 400.0))
    assert float(np.abs(away.curvature_horizontal).max()) < 2e-3


def test_turn_of_the_earth_while_the_tool_stands_is_no_bend():
    raw, _ = run(stops=[(0.0, 60.0), (300.0, 400.0)])
    raw.imu["gyro_count"] = raw.imu["gyro_count"] + (np.arange(3) == 2).astype(np.int32) * 7
    look = quick_look(raw)
    assert float(np.abs(look.curvature_horizontal).max()) < 1e-4


def test_run_shorter_than_its_gauge_is_refused():
    raw, _ = run(duration=61.5)
    with pytest.raises(InputError, match="gauge length"):
        quick_look(raw)


@pytest.mark.demo
def test_quick_look_finds_the_bends_of_the_demonstration_line(demo):
    look = quick_look(read_source(demo / "demo-2019"))
    with xr.open_dataset(demo / "truth" / "demo-2019" / "truth.nc") as truth:
        grid = truth.grid_chainage.values
        for name in ("horizontal", "vertical"):
            turned = np.concatenate([[0.0], np.cumsum(0.05 * (k := truth[f"curvature_{name}"].values)[1:] + 0.05 * k[:-1])])
            scale = float(truth.travel[-1] - truth.travel[0]) / look.log_distance.values[-1]  # of the odometer, not of the look
            place = look.log_distance.values * scale + float(truth.chainage[0])
            true = (np.interp(place + 1.0, grid, turned) - np.interp(place - 1.0, grid, turned)) / 2.0
            ours = look[f"curvature_{name}"].values
            good = np.isfinite(ours)
            straight = good & (np.abs(true) < 1e-3)
            # wobble 3e-4, earth's rate up to 7e-5, and the vertical bends of a tool that rolls by a degree more than it knows
            assert 1.4826 * np.median(np.abs(ours - true)[straight]) < 6e-4
            assert np.corrcoef(ours[good], true[good])[0, 1] > 0.95
