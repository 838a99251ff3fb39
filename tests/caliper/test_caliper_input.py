"""What a caliper file can have wrong: each fault is named, or borne."""

from __future__ import annotations

import logging
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from pydantic import TypeAdapter

from deform.caliper import dent_fit
from deform.caliper.measure import measure, on_chainage
from deform.caliper.scans import SEGMENT
from deform.errors import InputError
from deform.run import build
from deform.run.raw import RawRun, RunHeader

HEADER = {
    "run": {"id": "r", "line": "l", "date": "2020-01-01"},
    "pipe": {"outside_diameter_m": 0.3239, "nominal_wall_m": 0.00635},
    "launch": {"latitude_deg": 60.0, "longitude_deg": 10.0, "height_m": 0.0},
    "imu": {"rate_hz": 100.0},
    "odometer": {"wheels": 1},
    "caliper": {"arms": 24, "ring_offset_m": [-0.6], "noise_m": 3e-4},
}
LENGTH, SPEED, RATE = 60.0, 1.0, 60.0


def trajectory(length=LENGTH):
    time = np.arange(0.0, length / SPEED, 0.05)
    zero = np.zeros_like(time)
    names = ("latitude", "longitude", "height", "east_sigma", "north_sigma", "up_sigma", "azimuth", "pitch")
    values = {"time": time, "chainage": SPEED * time, "log_distance": SPEED * time, "roll": 3.0 * time, "speed": zero + SPEED}
    return build.dataset("trajectory", {**dict.fromkeys(names, zero), **values})


def readings(seed=1, arms=24):
    """Radius (scan, arm) in metre of a round pipe with a tool 2 mm off its centre."""
    angle = np.arange(arms) * 2 * np.pi / arms
    time = np.arange(0.0, LENGTH / SPEED, 1 / RATE)
    radius = 0.1556 + 0.002 * np.cos(angle + 0.05 * time[:, None])
    return time, angle, radius + np.random.default_rng(seed).normal(0, 3e-4, radius.shape)


def raw_run(time=None, angle=None, radius=None, scale=1e-4, samples=6000, **header):
    defaults = readings()
    time, angle, radius = (d if v is None else v for v, d in zip((time, angle, radius), defaults, strict=True))
    counts = np.where(np.isfinite(radius), np.round(radius / scale), 65535).astype(np.uint16)
    attrs = {"scale_factor": scale, "add_offset": 0.0, "_FillValue": np.uint16(65535)}
    arms = xr.Dataset({"time": ("scan", time), "radius": (("scan", "arm"), counts, attrs), "arm_angle": ("arm", angle)})
    count = np.random.default_rng(2).integers(-9, 9, (samples, 3)).astype(np.int32)
    imu = xr.Dataset({"time": ("sample", np.arange(samples) * 0.01), "accel_count": (("sample", "axis"), count)})
    content = {**HEADER, **header}
    return RawRun(TypeAdapter(RunHeader).validate_python(content), imu, xr.Dataset(), arms)


def test_a_round_pipe_has_no_dent_no_ovality_and_its_diameter():
    m = measure(raw_run(), trajectory())
    assert m.dents.sizes["dent"] == 0
    assert float(m.sections.diameter_mean.median()) == pytest.approx(2 * 0.1556, abs=3e-5)
    assert float(m.sections.ovality.median()) < 4e-4
    offset = np.hypot(m.pose.offset_right, m.pose.offset_up)
    assert float(offset.median()) == pytest.approx(0.002, abs=1e-4)


def test_arms_out_of_order_change_nothing():
    time, angle, radius = readings()
    order = np.random.default_rng(0).permutation(24)
    straight, mixed = (measure(raw_run(time, a, r), trajectory()) for a, r in ((angle, radius), (angle[order], radius[:, order])))
    assert mixed.sections.ovality.values == pytest.approx(straight.sections.ovality.values, abs=1e-9)
    assert mixed.wall.radius.values == pytest.approx(straight.wall.radius.values, abs=2e-5, nan_ok=True)


def test_stuck_silent_and_noisy_arms_are_named_and_dropped(caplog):
    time, angle, radius = readings()
    radius[:, 3], radius[:, 9] = 0.150, np.nan
    radius[:, 15] += np.random.default_rng(5).normal(0, 4e-3, time.size)
    with caplog.at_level(logging.WARNING):
        m = measure(raw_run(time, angle, radius), trajectory())
    assert all(word in caplog.text for word in ("45 degree: stuck", "135 degree: silent", "225 degree: noisy"))
    assert m.dents.sizes["dent"] == 0
    assert float(m.sections.diameter_mean.median()) == pytest.approx(2 * 0.1556, abs=5e-5)


def test_constant_arm_offsets_are_found_and_taken_off(caplog):
    time, angle, radius = readings()
    radius[:, 7] += 2e-3
    with caplog.at_level(logging.WARNING):
        m = measure(raw_run(time, angle, radius), trajectory())
    assert "offsets" in caplog.text
    assert m.dents.sizes["dent"] == 0
    assert float(m.sections.ovality.median()) < 6e-4


def test_more_than_a_third_of_the_arms_lost_is_refused_with_the_arms():
    time, angle, radius = readings()
    radius[:, :9] = np.nan
    with pytest.raises(InputError, match="9 of 24 arms out of use"):
        measure(raw_run(time, angle, radius), trajectory())


def test_a_stretch_that_lost_its_arms_has_no_section_and_is_named(caplog):
    time, angle, radius = readings()
    lost = (time > 20) & (time < 30)
    radius[np.ix_(lost, np.arange(10))] = np.nan
    with caplog.at_level(logging.WARNING):
        m = measure(raw_run(time, angle, radius), trajectory())
    inside = on_chainage(m, np.array([10.0, 24.0, 40.0]))
    assert np.isfinite(inside.ovality.values).tolist() == [True, False, True]
    assert "19.4" in caplog.text
    assert "arms" in caplog.text


def test_millimetres_taken_for_metres_are_named_with_the_unit():
    time, angle, radius = readings()
    with pytest.raises(InputError, match="looks like mm"):
        measure(raw_run(time, angle, radius * 1000, scale=0.1), trajectory())


def test_a_scan_clock_that_falls_back_is_named_with_its_place():
    time, angle, radius = readings()
    time = time.copy()
    time[1000] = time[998]
    with pytest.raises(InputError, match="not rising at scan 1000"):
        measure(raw_run(time, angle, radius), trajectory())


def test_a_file_of_another_clock_is_named():
    time, angle, radius = readings()
    with pytest.raises(InputError, match="scan clock and IMU clock differ"):
        measure(raw_run(time + 1e5, angle, radius), trajectory())


def drifting(rate, stuck=()):
    """A run over 38 welds with a dent near its end, its scan clock fast by ``rate``; arm 12 stands still over some scans."""
    time, ends = np.arange(0.0, 240.0, 1 / RATE), np.cumsum(np.random.default_rng(7).uniform(5.0, 7.0, 38))
    angle = np.arange(24) * 2 * np.pi / 24
    place = SPEED * time - 0.6
    radius = 0.1556 + np.random.default_rng(1).normal(0, 3e-4, (time.size, 24))
    radius -= 1.5e-3 * (np.abs(place[:, None] - ends).min(axis=1) < 0.012)[:, None]
    radius[np.abs(place - 233.0) < 0.1, 5:8] -= 0.01
    radius[stuck, 12] = 0.150
    heard = build.dataset("weld_events", {"time": ends / SPEED, "amplitude": np.ones(ends.size)})
    return replace(raw_run(time + rate * (time - 120.0), angle, radius, samples=24_000), weld_events=heard)


def test_a_scan_clock_that_drifts_is_put_right_by_the_welds(caplog):
    """400 ppm over 240 s: what the arms saw stands 48 mm off at both ends, until the detector's welds put it right."""
    with caplog.at_level(logging.WARNING):
        m = measure(drifting(400e-6), trajectory(240.0))
    told = re.search(r"by (\d+) welds the scan clock runs ([\d.]+) ppm fast", caplog.text)
    assert told is not None
    assert float(told[2]) == pytest.approx(400.0, abs=20.0)
    assert int(told[1]) > 30
    assert m.dents.chainage.values == pytest.approx([233.0], abs=0.015)


@pytest.mark.parametrize("rate", [0.0, 400e-6])
def test_an_arm_that_stands_still_for_a_while_is_dropped_there_and_stays_so_after_the_clock_is_put_right(rate, caplog):
    stuck = slice(2 * SEGMENT, 3 * SEGMENT)
    with caplog.at_level(logging.WARNING):
        m = measure(drifting(rate, stuck), trajectory(240.0))
    assert ("the scan clock runs" in caplog.text) == (rate > 0)
    assert re.search(r"arm at 180 degree stood still between 67\.\d and 10[12]\.\d m", caplog.text)
    assert m.dents.chainage.values == pytest.approx([233.0], abs=0.015)
    rows = (m.wall.chainage.values > 2 * SEGMENT / RATE + 1.0) & (m.wall.chainage.values < 3 * SEGMENT / RATE - 2.0)
    assert float(np.nanmin(m.wall.radius.values[rows])) > 0.153  # welds stand in by 1.5 mm, the arm by 5.6 mm


def test_a_dent_whose_fit_has_not_settled_is_named(monkeypatch, caplog):
    time, angle, radius = readings()
    radius[np.abs(time - 30.6) < 0.1, 5:8] -= 0.01
    monkeypatch.setattr(dent_fit, "_ROUNDS", 3)
    with caplog.at_level(logging.WARNING):
        m = measure(raw_run(time, angle, radius), trajectory())
    assert m.dents.sizes["dent"] == 1
    assert re.search(r"r: the fit of the dent at (29.9|30.0)\d m", caplog.text)


def test_half_a_file_gives_half_a_wall(caplog):
    time, angle, radius = readings()
    long = trajectory()
    long = long.assign_coords(time=long.time * 3.0)
    long["chainage"] = long["chainage"] * 3.0
    with caplog.at_level(logging.WARNING):
        m = measure(raw_run(time, angle, radius), long)
    assert "ends at 60 s" in caplog.text
    assert float(m.sections.chainage.max()) < 60.0


def test_a_run_without_caliper_still_has_a_weld_log():
    raw = replace(raw_run(), arms=None)
    m = measure(raw, trajectory())
    assert m.sections is None
    assert on_chainage(m, np.arange(3.0)) is None
    assert m.welds.sizes["weld"] == 0


def test_rings_and_their_places_must_agree():
    header = {**HEADER["caliper"], "ring_offset_m": [-0.6, 0.6]}
    with pytest.raises(InputError, match="1 rings in the file, 2 values"):
        measure(raw_run(caliper=header), trajectory())


def test_a_sharp_dent_that_one_arm_crosses_in_five_scans_is_measured():
    time, angle, radius = readings()
    place, clock = SPEED * time[:, None] - 0.6, angle + np.radians(3.0 * time[:, None])
    around = (clock - np.radians(135.0) + np.pi) % (2 * np.pi) - np.pi
    depth = 0.006 * np.exp(-np.log(10) * (np.abs((place - 29.4) / 0.035) ** 1.5 + np.abs(around / 0.13) ** 1.5))
    assert (depth > 0.1 * depth.max()).sum() == 5  # so many readings stand in by more than a tenth
    dents = measure(raw_run(radius=radius - depth), trajectory()).dents
    assert dents.sizes["dent"] == 1
    assert float(dents.chainage[0]) == pytest.approx(29.4, abs=0.01)
    assert abs(float(dents.depth[0]) - 0.006) < 1.96 * float(dents.depth_sigma[0])
    assert float(dents.depth_sigma[0]) < 0.006
