"""Runs of a line with known movement: what is found, where, how large, and what is not said."""

from __future__ import annotations

import re

import change_lines as lines
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.change.axial_zones import strings_of
from deform.change.compare import compare
from deform.change.joint_change import Elongation
from deform.change.neighbours import between
from deform.change.trend import trends
from deform.errors import InputError
from deform.options import ChangeOptions
from deform.run.schema import dataset_faults


@pytest.fixture(scope="module")
def slide():
    """A line of 3 km: 0.4 then 0.8 m to the right over 120 m by 2021 and 2023, 0.25 m down over 40 m only by 2023."""
    line = lines.make_line(3000.0, seed=3)
    s = line.chainage
    way = lines.bump(s, 1700.0, 120.0, 1.0)
    later = [lines.moved(line, lateral=0.4 * way), lines.moved(line, lateral=0.8 * way, up=-lines.bump(s, 900.0, 40.0, 0.25))]
    runs = [lines.make_run(at, f"r{2019 + 2 * k}", f"{2019 + 2 * k}-07-01", seed=20 + k) for k, at in enumerate([line, *later])]
    return line, later, runs, compare(runs, lines.identity_matching(runs))


def test_both_movements_are_found_in_the_right_year_and_nothing_else(slide):
    zones = slide[3].zones
    assert list(zones.kind) == ["movement", "movement"]
    settled, slid = zones.iloc[0], zones.iloc[1]
    assert (settled.first_epoch, slid.first_epoch) == ("r2023", "r2021")
    assert abs(settled.peak_displacement_m - 0.25) < 0.1
    assert abs(slid.peak_displacement_m - 0.8) < 0.1
    assert np.isnan(settled.direction_deg)
    right = (np.interp(1700.0, slide[0].chainage, slide[0].azimuth) + 90.0) % 360.0
    assert abs(slid.direction_deg - right) < 20.0
    for zone, start, end in ((settled, 880.0, 920.0), (slid, 1640.0, 1760.0)):
        common = min(zone.end_m, end) - max(zone.start_m, start)
        assert common / (max(zone.end_m, end) - min(zone.start_m, start)) >= 0.6
    assert (zones.confidence > 0.99).all()
    assert "towards" in slid.reasons
    assert "down" in settled.reasons


def test_sigma_of_a_zone_does_not_grow_with_the_number_of_runs_that_show_it(slide):
    _, _, runs, comparison = slide
    alone = compare([runs[0], runs[2]], lines.identity_matching([runs[0], runs[2]]))
    inside = np.abs(comparison.dataset.chainage.values - 1700.0) < 40.0
    both = [c.dataset["displacement_lateral_sigma"].values[-1, inside] for c in (comparison, alone)]
    assert np.median(both[0] / both[1]) == pytest.approx(1.0, abs=0.4)


def test_markers_of_the_runs_do_not_enter_the_displacement_of_stable_pipe(slide):
    _, _, runs, comparison = slide
    raw = runs[2]["centreline"]["height"].values - runs[0]["centreline"]["height"].values
    still = comparison.dataset["stable"].values[2]
    up = comparison.dataset["displacement_up"].values[2]
    assert raw[still].std() > 0.15
    assert np.sqrt(np.nanmean(up[still] ** 2)) < 0.05
    assert still.mean() > 0.85


def test_stated_sigma_of_displacement_and_strain_is_honest_on_stable_pipe(slide):
    ds = slide[3].dataset
    away = (np.abs(ds.chainage.values - 1700) > 80) & (np.abs(ds.chainage.values - 900) > 40)
    for name in ("displacement_east", "displacement_north", "displacement_up", "displacement_lateral"):
        share = np.abs(ds[name].values[2][away]) <= 1.96 * ds[f"{name}_sigma"].values[2][away]
        assert 0.85 <= share.mean() <= 1.0, name
    for name in ("bending_strain_change_horizontal", "bending_strain_change_vertical"):
        z = ds[name].values[2][away] / ds[f"{name}_sigma"].values[2][away]
        assert 0.9 <= np.mean(np.abs(z[np.isfinite(z)]) <= 1.96) <= 0.99, name


def test_change_dataset_follows_the_vocabulary_and_is_zero_for_the_reference(slide):
    ds = slide[3].dataset
    assert not dataset_faults("comparison", ds)
    assert ds.attrs["reference"] == "r2019"
    assert (ds["displacement_up"].values[0] == 0).all()
    assert ds["bending_strain_change_vertical"].attrs["gauge_length_m"] == lines.GAUGE
    assert list(ds.date.values) == ["2019-07-01", "2021-07-01", "2023-07-01"]


def test_creep_and_step_get_their_own_rates_and_words(slide):
    table = trends(slide[3])
    zones = slide[3].zones
    creep = table[(table.subject == zones.zone_id[1]) & (table.kind == "displacement")].iloc[0]
    assert creep.rate_low_per_year < 0.2 < creep.rate_high_per_year
    assert creep.rate_per_year == pytest.approx(0.2, abs=0.02)
    step = table[(table.subject == zones.zone_id[0]) & (table.kind == "displacement")].iloc[0]
    assert "step between 2021 and 2023" in step.remark
    assert sorted(table["rank"]) == list(range(1, len(table) + 1))


def test_swapped_reference_turns_the_sign_of_the_movement(slide):
    runs = [slide[2][0], slide[2][2]]
    forward = compare(runs, lines.identity_matching(runs, "r2019"))
    back = compare(runs, lines.identity_matching(runs, "r2023"))
    at = int(np.searchsorted(forward.dataset.chainage.values, 1700.0))
    there, again = forward.dataset["displacement_lateral"].values[1, at], back.dataset["displacement_lateral"].values[0, at]
    assert there == pytest.approx(0.8, abs=0.08)
    assert again == pytest.approx(-there, abs=0.05)
    assert back.dataset.attrs["reference"] == "r2023"


def test_pipe_that_did_not_move_gets_no_zone_but_a_detection_limit():
    line = lines.make_line(2000.0, seed=8, bends_per_km=6.0)
    runs = [lines.make_run(line, f"r{k}", f"201{k}-01-01", seed=50 + k) for k in range(2)]
    comparison = compare(runs, lines.identity_matching(runs))
    assert not len(comparison.zones)
    limits = comparison.limits[comparison.limits.limit_displacement_m.notna()]
    assert len(limits) >= 10
    assert (limits.limit_90_displacement_m > limits.limit_displacement_m).all()
    assert (limits.limit_displacement_m > 5.0 * limits.noise_sigma).all()  # the root of the threshold is 5.5
    for _, one in limits.groupby("component"):
        assert one.limit_displacement_m.is_monotonic_increasing
    assert (limits.limit_displacement_m[limits.wavelength_m < 100.0] < 0.15).all()
    assert (limits.limit_displacement_m[limits.wavelength_m < 250.0] < 0.5).all()  # of longer waves this line holds a handful
    strings = comparison.limits[comparison.limits.limit_elongation_m.notna()]
    assert (strings.limit_elongation_m > 4.0 * strings.noise_sigma).all()


def test_limits_of_the_joints_are_those_that_the_search_holds_at_the_rate_that_was_asked_for():
    line = lines.make_line(1200.0, seed=12)
    runs = [lines.make_run(line, f"r{k}", f"201{k}-01-01", seed=80 + k) for k in range(2)]
    for rate in (0.1, 10.0):
        comparison = compare(runs, lines.identity_matching(runs), ChangeOptions(false_alarms_per_100_km=rate))
        stated = comparison.limits.limit_elongation_m.dropna().to_numpy()
        held = strings_of(Elongation(comparison.joints, "r1"), rate)
        assert len(held) > 3
        np.testing.assert_allclose(stated, [s.sigma * s.caution * np.sqrt(s.limit) for s in held])


@pytest.mark.parametrize(("beside", "kind"), [(0.3, "cutout"), (4.0, "reroute")])
def test_replaced_pipe_is_a_reconfiguration_and_no_movement_and_a_re_route_where_it_left_its_place(beside, kind):
    line = lines.make_line(2000.0, seed=4)
    after = lines.moved(line, lateral=lines.bump(line.chainage, 1030.0, 60.0, beside))
    runs = [lines.make_run(at, f"r{k}", f"201{k}-01-01", seed=60 + k) for k, at in enumerate((line, after))]
    matching = lines.identity_matching(runs)
    edit = {"kind": ["cutout"], "run": ["r1"], "start_m": [1000.0], "end_m": [1060.0], "n_old": [5], "n_new": [5], "reason": [""]}
    chain_map = matching.maps["r1"]
    held = lines.PlainMap(chain_map.reference_chainage, chain_map.run_chainage, ((1000.0, 1060.0),))
    matching = lines.PlainMatching("r0", matching.maps | {"r1": held}, matching.joints, edits=pd.DataFrame(edit))
    comparison = compare(runs, matching)
    assert list(comparison.zones.kind) == ["reconfiguration"]
    assert comparison.zones.confidence.isna().all()  # the matching states none for an edit
    assert list(comparison.edits.kind) == [kind]
    assert comparison.zones.reasons[0].startswith("Cut-out" if kind == "cutout" else "Re-route")
    said = re.search(r"the new pipe lies up to (.+) m \(sigma (.+) m\) beside the old, at (.+) m", comparison.edits.reason[0])
    assert (said is None) == (kind == "cutout")
    if said:
        assert float(said[1]) == pytest.approx(beside, abs=max(0.03, 3.0 * float(said[2])))
        assert float(said[3]) == pytest.approx(1030.0, abs=5.0)
    gone = (comparison.dataset.chainage.values > 1001) & (comparison.dataset.chainage.values < 1059)
    assert np.isnan(comparison.dataset["displacement_up"].values[1, gone]).all()


def test_listing_tells_places_only_and_the_rest_is_left_out():
    line = lines.make_line(1000.0, seed=5)
    first = lines.make_run(line, "tool", "2019-01-01", seed=1)
    listing = xr.DataTree(
        xr.Dataset(attrs={"id": "list", "date": "2015-01-01", "source": "listing"}), children={"welds": first["welds"].copy()}
    )
    comparison = compare([first, listing], lines.identity_matching([first, listing], "tool"))
    assert list(comparison.dataset.epoch.values) == ["list", "tool"]
    assert "displacement_east" not in comparison.dataset
    assert np.isfinite(comparison.dataset["run_chainage"].values[0]).mean() > 0.95
    assert any("no coordinates" in remark for remark in comparison.remarks)


def test_run_over_part_of_the_line_leaves_the_rest_empty_and_says_so():
    line = lines.make_line(1500.0, seed=6)
    runs = [lines.make_run(line, f"r{k}", f"201{k}-01-01", seed=k) for k in range(2)]
    matching = lines.identity_matching(runs)
    chain_map = matching.maps["r1"]
    half = chain_map.reference_chainage < 800
    part = lines.PlainMap(chain_map.reference_chainage[half], chain_map.run_chainage[half])
    comparison = compare(runs, lines.PlainMatching("r0", matching.maps | {"r1": part}, matching.joints))
    far = comparison.dataset.chainage.values > 820
    assert np.isnan(comparison.dataset["displacement_up"].values[1, far]).all()
    assert not comparison.dataset["stable"].values[1, far].any()
    assert any("of the pipe" in remark for remark in comparison.remarks)


def test_run_without_a_chainage_map_is_named():
    line = lines.make_line(500.0, seed=6)
    runs = [lines.make_run(line, f"r{k}", f"201{k}-01-01", seed=k) for k in range(2)]
    matching = lines.identity_matching(runs)
    del matching.maps["r1"]
    with pytest.raises(InputError, match="r1"):
        compare(runs, matching)


@pytest.mark.demo
def test_demonstration_lines_movements_are_found_with_their_extent(demo):
    runs, matching = lines.truth_runs(demo / "truth")
    comparison = compare(runs, matching, ChangeOptions())
    kinds = list(comparison.zones.kind)
    assert kinds == ["movement", "movement", "reconfiguration"]
    assert set(comparison.dents.groupby("run").size()) == {4, 5}
    last = comparison.dents[comparison.dents.run == "demo-2023"]
    assert sorted(last.status) == ["grown", "new", "stable", "stable", "stable"]


def test_change_between_neighbours_is_free_of_the_reference_runs_noise(slide):
    ds = slide[3].dataset
    step = between(ds, "r2021", "r2023")
    at = int(np.searchsorted(ds.chainage.values, 1700.0))
    assert step["displacement_lateral"].values[at] == pytest.approx(0.4, abs=0.08)
    still = step["stable"].values
    z = (step["bending_strain_change_vertical"] / step["bending_strain_change_vertical_sigma"]).values[still]
    assert 0.9 <= np.mean(np.abs(z[np.isfinite(z)]) <= 1.96) <= 0.99
    again = between(ds, "r2019", "r2023")
    np.testing.assert_allclose(again["displacement_up"], ds["displacement_up"].values[2])
    with pytest.raises(InputError, match="r1999"):
        between(ds, "r1999", "r2023")
