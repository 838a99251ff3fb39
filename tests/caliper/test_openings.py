"""Openings of a simulated line: as many as there are, each at its place and clock, whatever else stands out far away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks._caliper_line import caliper_line
from deform.caliper.measure import measure
from deform.options import FittingOptions

NOISE_M = 3e-4
TEES = (  # the last two face each other
    FittingOptions(id="A", chainage_m=40.3, kind="tee", clock_deg=75.0, height_m=0.02, length_m=0.1),
    FittingOptions(id="B", chainage_m=90.0, kind="tee", clock_deg=200.0, height_m=0.012, length_m=0.16),
    FittingOptions(id="C", chainage_m=130.0, kind="tee", clock_deg=30.0, height_m=0.015, length_m=0.1),
    FittingOptions(id="D", chainage_m=130.0, kind="tee", clock_deg=210.0, height_m=0.015, length_m=0.1),
)


@pytest.fixture(scope="module")
def found():
    tool = {"arms": 48, "caliper_rate_hz": 200.0, "arm_noise_m": NOISE_M}
    made = caliper_line(5, 160.0, {"induction_bends_deg": ()}, tool, fittings=TEES)
    counts, scale = made.raw.arms["radius"].values.copy(), made.raw.arms["radius"].attrs["scale_factor"]
    stray = int(np.searchsorted(np.interp(made.raw.arms["time"].values, made.trajectory.time, made.trajectory.chainage), 110.0))
    counts[stray, ..., 5] += round(0.02 / scale)  # one arm of one scan
    arms = made.raw.arms.assign(radius=made.raw.arms["radius"].copy(data=counts))
    features = measure(replace(made.raw, arms=arms), made.trajectory).features
    return features.isel(feature=np.flatnonzero(features.kind.values == "tee"))


def test_every_opening_of_the_line_is_there_and_a_stray_scan_is_none(found):
    middle = 0.5 * (found.chainage.values + found.chainage_end.values)
    assert sorted(middle) == pytest.approx([t.chainage_m for t in TEES], abs=0.03)


def test_two_openings_that_face_each_other_keep_their_own_clocks(found):
    facing = found.clock.values[np.abs(found.chainage.values - 130.0) < 0.5]
    assert sorted(facing) == pytest.approx([30.0, 210.0], abs=6.0)


def test_how_far_an_opening_reaches_is_as_sure_as_it_says(found):
    place, clock = found.chainage.values, np.radians(found.clock.values)
    order = [int(np.argmin(np.hypot(place - t.chainage_m, np.sin((clock - np.radians(t.clock_deg)) / 2)))) for t in TEES]
    error = found.value.values[order] - np.array([t.height_m for t in TEES])
    assert np.abs(error / found.value_sigma.values[order]).max() < 3.0
    assert found.value_sigma.values.min() > NOISE_M / 3.0  # noise of a mean over five scans, at least
    assert found.value_sigma.values.max() < 2e-3
