"""Surveys as they come: files out of order, two runs on one day, runs that state different pipes."""

from __future__ import annotations

import change_lines as lines
import numpy as np
import pandas as pd
import pytest

from deform.change.compare import compare
from deform.change.trend import trends


def runs_of(dates, *, shift=0.0, diameters=None):
    """Runs of a short line; a bump of ``shift`` metre grows from run to run in the order given."""
    line = lines.make_line(1200.0, seed=11, bends_per_km=1.0)
    way = lines.bump(line.chainage, 600.0, 80.0, shift)
    od = diameters or [lines.OD] * len(dates)
    return [lines.make_run(lines.moved(line, up=k * way), f"r{k}", date, seed=70 + k, od=od[k]) for k, date in enumerate(dates)]


def test_runs_given_out_of_order_are_compared_in_the_order_of_their_dates():
    runs = runs_of(["2015-05-01", "2019-05-01", "2023-05-01"], shift=0.2)
    forward = compare(runs, lines.identity_matching(runs))
    shuffled = compare([runs[2], runs[0], runs[1]], lines.identity_matching(runs))
    assert list(shuffled.dataset.epoch.values) == ["r0", "r1", "r2"]
    pd.testing.assert_frame_equal(forward.zones, shuffled.zones)
    assert list(forward.zones.first_epoch) == ["r1"]


def test_two_runs_on_one_day_are_noise_and_carry_no_rate():
    runs = runs_of(["2019-05-01", "2019-05-01"])
    comparison = compare(runs, lines.identity_matching(runs))
    assert any("one day" in remark and "no rate" in remark for remark in comparison.remarks)
    assert not len(trends(comparison))


def test_runs_that_state_different_diameters_are_named_and_one_diameter_is_used():
    runs = runs_of(["2019-05-01", "2023-05-01"], diameters=[lines.OD, lines.OD + 0.01])
    comparison = compare(runs, lines.identity_matching(runs))
    (remark,) = [remark for remark in comparison.remarks if "outside diameters" in remark]
    assert f"r1 {lines.OD + 0.01:.4f}" in remark
    assert comparison.dataset.attrs["outside_diameter_m"] == lines.OD
    half = comparison.dataset["curvature_change_vertical"].values[1] * lines.OD / 2.0
    np.testing.assert_allclose(comparison.dataset["bending_strain_change_vertical"].values[1], half)


@pytest.mark.parametrize("date", ["", "not a date"])
def test_run_without_a_date_keeps_its_place_and_gets_no_rate(date):
    runs = runs_of(["2019-05-01", date], shift=0.5)
    comparison = compare(runs, lines.identity_matching(runs))
    assert list(comparison.zones.kind) == ["movement"]
    table = trends(comparison)
    assert not len(table) or table["rate_per_year"].isna().all()


def test_run_without_a_date_that_stands_before_the_reference_is_the_earlier_one():
    runs = runs_of(["", "2019-05-01"], shift=0.5)
    undated = compare(runs, lines.identity_matching(runs, "r1")).zones
    runs[0].attrs["date"] = "2015-05-01"
    pd.testing.assert_frame_equal(undated, compare(runs, lines.identity_matching(runs, "r1")).zones)
    (zone,) = undated.itertuples()
    assert (zone.since, zone.peak_epoch, zone.first_epoch) == ("r0", "r1", "r1")
    assert zone.peak_up_m == pytest.approx(0.5, abs=0.1)
    assert " up " in zone.reasons


def test_first_run_that_shows_a_movement_is_found_without_dates():
    runs = runs_of(["2015-05-01", "", ""], shift=0.3)
    (zone,) = compare(runs, lines.identity_matching(runs, "r2")).zones.itertuples()
    assert zone.first_epoch == "r1"


def test_run_without_a_date_keeps_its_place_among_runs_that_are_put_in_order():
    runs = runs_of(["2023-05-01", "", "2015-05-01"])
    assert list(compare(runs, lines.identity_matching(runs)).dataset.epoch.values) == ["r2", "r1", "r0"]
