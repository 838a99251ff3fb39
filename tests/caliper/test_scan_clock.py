"""The error of the scan clock from welds that arms and other channels share, on channels made by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from deform.caliper.scan_clock import clock_error
from deform.caliper.weld_channels import HEARD, Channel
from deform.caliper.weld_hits import hit_score

WELDS = np.arange(10.0, 2400.0, 12.0)
NOISE = np.random.default_rng(1).normal(0, 0.004, (2, WELDS.size))


def trajectory():
    time = np.arange(0.0, 2000.0, 0.05)
    speed = 1.2 + 0.3 * np.sin(time / 150.0)
    chainage = 1.2 * time - 45.0 * (np.cos(time / 150.0) - 1.0)
    return xr.Dataset({n: ("time", v) for n, v in (("chainage", chainage), ("speed", speed))}, {"time": time})


def channel(name, place):
    score = np.full(place.size, HEARD)
    return Channel(name, place, score, 0 * score, place, score, np.array([[0.0, 2500.0]]))


def heard_late(name, late, noise):
    t = trajectory()
    when = np.interp(WELDS, t.chainage, t.time) + late
    return channel(name, np.interp(when, t.time, t.chainage) + noise)


def test_accelerometers_that_ring_after_a_weld_do_not_move_the_scan_clock():
    arms, detector = channel("arms", WELDS + NOISE[0]), heard_late("detector", 0.0, NOISE[1])
    ringing = heard_late("accelerometer", 0.045, NOISE[1])
    assert clock_error(arms, [ringing], trajectory(), 1) is None
    assert clock_error(arms, [ringing, detector], trajectory(), 1) is None


@pytest.mark.parametrize("name", ["detector", "accelerometer"])
def test_a_scan_clock_that_is_late_is_found_by_either(name):
    error = clock_error(channel("arms", WELDS + NOISE[0]), [heard_late(name, -0.3, NOISE[1])], trajectory(), 1)
    assert error is not None
    assert error.late == pytest.approx(0.3, abs=0.01)
    assert error.ahead == pytest.approx(0.0, abs=0.02)


def test_the_beginning_of_a_record_in_motion_is_no_hit():
    counts = np.random.default_rng(2).normal(0, 20, (4000, 3)).round() + np.array([3000, -500, 4900])
    counts += np.linspace(400.0, -400.0, len(counts))[:, None]  # the pipe's slope changes along the way
    score, _ = hit_score(counts, 0.01, np.ones(len(counts), bool))
    assert score[:50].max() < 5.0
    assert score[-50:].max() < 5.0
