"""Dents followed through the runs: identity by weld-relative place and clock, status with its significance."""

from __future__ import annotations

import change_lines as lines
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.change.dent_change import compare_dents
from deform.change.dent_surface import depth_at, surface_difference
from deform.change.stack import READ
from deform.errors import InputError
from deform.options import ChangeOptions
from deform.run import build, store

JOINTS = pd.DataFrame({"joint_id": ["J1", "J2"], "reference_chainage_m": [0.0, 500.0]})


def run_of(name, dents=None, *, wall=None, source="raw", welds=(0.0, 500.0, 1000.0)):
    """A run with dents given as (chainage, clock, depth[, length, width]); None = a run without a list of dents."""
    attrs = {"id": name, "date": "2020-01-01", "source": source, "outside_diameter_m": 0.3239}
    group = None
    if dents is not None:
        rows = np.array([(*d, 0.3, 0.2)[:5] for d in dents], float).reshape(-1, 5).T
        values = dict(zip(("chainage", "clock", "depth", "length", "width"), rows, strict=True))
        if source == "raw":
            values |= {"depth_sigma": np.full(rows.shape[1], 0.0004)}
        group = build.dataset("dents", values)
    track = build.dataset("welds", {"chainage": np.array(welds), "probability": np.ones(len(welds))})
    return build.run_tree(attrs, welds=track, dents=group, caliper=wall)


def table(runs, broken=()):
    maps = {}
    base = runs[0]["welds"]["chainage"].values
    for k, run in enumerate(runs):
        maps[run.attrs["id"]] = lines.PlainMap(base, run["welds"]["chainage"].values, tuple(broken) if k else ())
    matching = lines.PlainMatching(runs[0].attrs["id"], maps)
    found = compare_dents(runs, matching, ChangeOptions(), JOINTS)
    return {(row.dent_id, row.run): row for row in found.itertuples()}, found


def test_growth_beyond_its_sigma_is_grown_and_less_is_stable():
    rows, _ = table([run_of("a", [(100, 90, 0.008), (200, 90, 0.008)]), run_of("b", [(100, 91, 0.0115), (200, 89, 0.0088)])])
    assert rows["D0001", "b"].status == "grown"
    assert rows["D0001", "b"].depth_change_m == pytest.approx(0.0035)
    assert rows["D0001", "b"].depth_change_sigma_m == pytest.approx(0.0004 * np.sqrt(2))
    assert rows["D0002", "b"].status == "stable"
    assert "not significant" in rows["D0002", "b"].reason


def test_growth_is_material_only_above_the_least_growth():
    big = run_of("b", [(100, 90, 0.0088)])
    big["dents"]["depth_sigma"][:] = 1e-5
    first = run_of("a", [(100, 90, 0.008)])
    first["dents"]["depth_sigma"][:] = 1e-5
    assert table([first, big])[0]["D0001", "b"].status == "stable"


def test_shallower_dent_has_rerounded():
    assert table([run_of("a", [(100, 90, 0.02)]), run_of("b", [(100, 90, 0.012)])])[0]["D0001", "b"].status == "rerounded"


def test_two_dents_at_one_place_are_told_by_their_clock_over_the_top():
    rows, _ = table([run_of("a", [(100, 355, 0.01), (100, 40, 0.006)]), run_of("b", [(100.02, 3, 0.01), (100.01, 44, 0.006)])])
    by_depth = {depth: {r.dent_id for r in rows.values() if r.depth_m == depth} for depth in (0.01, 0.006)}
    assert all(len(ids) == 1 for ids in by_depth.values())
    assert by_depth[0.01] != by_depth[0.006]


def test_dents_are_paired_by_the_welds_not_by_the_runs_own_chainage():
    rows, _ = table([run_of("a", [(250, 90, 0.01)]), run_of("b", [(252.5, 90, 0.01)], welds=(0.0, 505.0, 1010.0))])
    assert rows["D0001", "b"].status == "stable"
    assert rows["D0001", "b"].reference_chainage_m == pytest.approx(250.0)


def test_dent_in_cut_out_pipe_is_removed_and_one_on_new_pipe_is_new():
    rows, _ = table([run_of("a", [(100, 90, 0.01)]), run_of("b", [(100.1, 92, 0.01)])], broken=[(80.0, 130.0)])
    assert rows["D0001", "b"].status == "removed"
    assert rows["D0002", "b"].status == "new"
    assert np.isnan(rows["D0001", "b"].depth_m)


def test_dent_that_a_run_without_caliper_passes_is_unmeasured_and_not_gone():
    rows, _ = table([run_of("a", [(100, 90, 0.01)]), run_of("b"), run_of("c", [(100, 90, 0.0145)])])
    assert rows["D0001", "b"].status == "unmeasured"
    assert rows["D0001", "c"].status == "grown"
    assert "since a" in rows["D0001", "c"].reason


def test_dent_first_listed_where_no_earlier_run_lists_dents_is_not_called_new():
    rows, _ = table([run_of("a"), run_of("b", [(100, 90, 0.01)])])
    assert rows["D0001", "b"].status == "stable"
    assert "nothing earlier" in rows["D0001", "b"].reason


def test_sizes_that_a_listing_repeats_to_the_digit_are_copied():
    first = run_of("2015", [(100, 90, 0.0081, 0.31, 0.22), (300, 90, 0.0062, 0.2, 0.1)], source="listing")
    later = run_of("2020", [(100, 90, 0.0081, 0.31, 0.22), (300, 90, 0.0071, 0.21, 0.1)], source="listing")
    rows, _ = table([first, later])
    assert rows["D0001", "2020"].status == "copied"
    assert rows["D0002", "2020"].status == "stable"


def test_lone_depths_are_copied_only_when_many_agree():
    places = np.arange(50.0, 950.0, 100.0)
    first = run_of("2015", [(p, 90, 0.006 + 0.0007 * i, np.nan, np.nan) for i, p in enumerate(places)], source="listing")
    same = run_of("2020", [(p, 90, 0.006 + 0.0007 * i, np.nan, np.nan) for i, p in enumerate(places)], source="listing")
    once = run_of("2020", [(p, 90, 0.006 + 0.0008 * i, np.nan, np.nan) for i, p in enumerate(places)], source="listing")
    assert set(table([first, same])[1].query("run == '2020'").status) == {"copied"}
    assert "copied" not in set(table([first, once])[1].query("run == '2020'").status)


def wall_of(dents, noise=1e-4, seed=0):
    """A wall map about chainage 95 to 105 with Gaussian dents given as (chainage, clock, depth)."""
    chainage, clock = np.arange(95.0, 105.0, 0.02), np.arange(0.0, 360.0, 5.0)
    radius = 0.155 + noise * np.random.default_rng(seed).standard_normal((chainage.size, clock.size))
    for place, turn, depth in dents:
        apart = (clock - turn + 180) % 360 - 180
        radius -= depth * np.exp(-0.5 * ((chainage[:, None] - place) / 0.07) ** 2 - 0.5 * (apart[None, :] / 15.0) ** 2)
    values = {"chainage": chainage, "clock": clock, "radius": radius, "reference_radius": np.full(chainage.size, 0.155)}
    return build.dataset("caliper", values)


def test_dent_that_a_run_does_not_list_is_read_from_its_wall_map():
    seen = run_of("a", [(100, 90, 0.008)], wall=wall_of([(100, 90, 0.008)]))
    unlisted = run_of("b", [], wall=wall_of([(100, 90, 0.008)], seed=1))
    rows, _ = table([seen, unlisted])
    assert rows["D0001", "b"].status == "stable"
    assert rows["D0001", "b"].depth_m == pytest.approx(0.008, abs=0.0008)
    assert "wall map" in rows["D0001", "b"].reason
    flat = run_of("b", [], wall=wall_of([]))
    assert table([seen, flat])[0]["D0001", "b"].status == "rerounded"


def test_new_dent_that_the_wall_map_showed_before_has_grown():
    before = run_of("a", [], wall=wall_of([(100, 90, 0.0025)]))
    after = run_of("b", [(100, 90, 0.009)], wall=wall_of([(100, 90, 0.009)]))
    rows, _ = table([before, after])
    assert rows["D0001", "b"].status == "grown"
    assert rows["D0001", "a"].depth_m == pytest.approx(0.0025, abs=0.0006)
    clean = run_of("a", [], wall=wall_of([]))
    assert table([clean, after])[0]["D0001", "b"].status == "new"


def test_wall_map_that_stays_in_its_file_tells_what_it_tells_in_memory(tmp_path):
    """A comparison of a long line holds no radii; the file is opened for a piece of them and closed again."""
    made = run_of("a", [], wall=wall_of([(100, 90, 0.004)]))
    path = store.write_run(made, tmp_path / "a.nc")
    whole, lean = store.read_run(path), store.read_run(path, variables=READ)
    assert "radius" not in lean["caliper"]
    for clock in (90.0, 270.0):
        assert depth_at(lean, 100.0, clock) == depth_at(whole, 100.0, clock)
    after = run_of("b", [(100, 90, 0.009)], wall=wall_of([(100, 90, 0.009)]))
    assert table([lean, after])[0]["D0001", "b"].status == "grown"
    path.unlink()
    with pytest.raises(InputError, match=r"a\.nc.*caliper: cannot be read"):
        depth_at(lean, 100.0, 90.0)


def test_surface_difference_is_the_growth_at_the_apex_and_nothing_beside():
    before, after = (run_of(n, [], wall=wall_of([(100, 90, d)], seed=s)) for n, d, s in (("a", 0.004, 1), ("b", 0.009, 2)))
    along, turn, deeper = surface_difference(after, 100.0, 90.0, before, 100.0, 90.0)
    apex = deeper[np.argmin(np.abs(along)), np.argmin(np.abs(turn))]
    assert apex == pytest.approx(0.005, abs=0.0006)
    assert np.abs(deeper[np.abs(along) > 0.25]).max() < 0.0008
    assert surface_difference(after, 100.0, 90.0, run_of("c"), 100.0, 90.0)[2].size == 0


def test_depth_from_the_wall_is_unknown_without_a_map():
    assert np.isnan(depth_at(run_of("a"), 100.0, 90.0)[0])
    assert isinstance(run_of("a"), xr.DataTree)
