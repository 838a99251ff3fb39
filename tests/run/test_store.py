"""Runs on disk come back as they were, are written whole or not at all, and say what is wrong with them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.errors import InputError, NewerSchemaError, SchemaError
from deform.run import build, schema, store

ATTRS = {"id": "x-2019", "date": "2019-07-02", "source": "raw"}


@pytest.fixture
def run():
    chainage = np.arange(200) * 0.1
    line = {
        "chainage": chainage,
        "time": 600.0 + chainage / 1.1,
        "pitch": np.linspace(-2, 2, 200),
        "pitch_sigma": np.full(200, 0.01),
    }
    welds = {"chainage": [1.0, 13.2], "probability": [0.99, 0.5], "label": ["20", "Ä 30"]}
    radius = 0.15 + 0.001 * np.sin(np.arange(50 * 24).reshape(50, 24))
    wall = {"chainage": np.arange(50) * 0.02, "clock": np.arange(24) * 15.0, "radius": radius}
    groups = {"centreline": line, "welds": welds, "caliper": wall}
    return build.run_tree(ATTRS, **{name: build.dataset(name, values) for name, values in groups.items()})


@pytest.mark.parametrize("end", [".nc", ".zarr"])
def test_run_comes_back_as_it_was_written(run, tmp_path, end):
    again = store.read_run(store.write_run(run, tmp_path / f"run{end}"))
    assert set(again.children) == set(run.children)
    assert again.attrs["id"] == "x-2019"
    for group in run.children:
        for name, variable in run[group].to_dataset().variables.items():
            back = again[group][name]
            if variable.dtype.kind == "f":
                step = build.vocabulary.variable(group, name).packed or 1e-12
                np.testing.assert_allclose(back.values, variable.values, atol=step / 2 * 1.001, rtol=0)
            else:
                assert list(back.values) == list(variable.values)
            assert back.attrs["long_name"] == variable.attrs["long_name"]


def test_run_that_was_read_can_be_written_again(run, tmp_path):
    first = store.read_run(store.write_run(run, tmp_path / "a.nc"))
    second = store.read_run(store.write_run(first, tmp_path / "b.nc"))
    np.testing.assert_array_equal(first["caliper"]["radius"], second["caliper"]["radius"])


def test_only_the_groups_asked_for_are_read(run, tmp_path):
    path = store.write_run(run, tmp_path / "run.nc")
    assert set(store.read_run(path, groups=["welds"]).children) == {"welds"}


@pytest.mark.parametrize("end", [".nc", ".zarr"])
def test_only_the_variables_asked_for_are_read_and_scans_come_from_the_file(run, tmp_path, end):
    path = store.write_run(run, tmp_path / f"run{end}")
    lean = store.read_run(path, variables={"centreline": ("pitch", "ovality"), "caliper": ("chainage", "clock")})
    assert set(lean["centreline"].to_dataset().variables) == {"chainage", "pitch"}
    assert set(lean["caliper"].to_dataset().variables) == {"chainage", "clock"}
    assert set(lean["welds"].data_vars) == set(run["welds"].data_vars)
    assert lean["caliper"].to_dataset().encoding["source"] == str(path)
    scans = store.read_scans(path, slice(10, 13))
    np.testing.assert_allclose(scans["radius"].values, run["caliper"]["radius"].values[10:13], atol=0.51e-6)
    with pytest.raises(InputError, match=r"gone.*caliper: cannot be read"):
        store.read_scans(tmp_path / f"gone{end}", slice(0, 5))


@pytest.mark.parametrize("end", [".nc", ".zarr"])
def test_a_run_without_a_wall_is_told_from_one_that_cannot_be_read(run, tmp_path, end):
    path = store.write_run(run, tmp_path / f"run{end}")
    assert store.read_wall(path, 0.5, 0.1).sizes["scan"] == 10
    assert store.read_wall(path, 40.0, 0.1) is None
    bare = xr.DataTree(xr.Dataset(attrs=run.attrs), children={"welds": xr.DataTree(run["welds"].to_dataset())})
    assert store.read_wall(store.write_run(bare, tmp_path / f"bare{end}"), 0.5, 0.1) is None
    with pytest.raises(InputError, match="no such file"):
        store.read_wall(tmp_path / f"gone{end}", 0.5, 0.1)


def test_a_wall_of_a_file_that_is_cut_off_is_an_error(run, tmp_path):
    path = store.write_run(run, tmp_path / "run.nc")
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"run\.nc: cannot be opened"):
        store.read_wall(path, 0.5, 0.1)


def test_all_faults_of_a_run_are_listed_at_once(run):
    welds = run["welds"].to_dataset()
    welds["chainage"] = ("weld", [13.2, 1.0], {"units": "ft"})
    welds["probability"] = ("weld", [1.5, 0.5], welds.probability.attrs)
    bad = build.run_tree({"id": "x"}, welds=welds)
    with pytest.raises(SchemaError) as caught:
        schema.validate_run(bad)
    text = str(caught.value)
    for part in ("date: is missing", "has units 'ft'", "runs from 0.5 to 1.5", "goes from 13.2 to 1 at 1", "source: is missing"):
        assert part in text


def test_run_that_breaks_the_schema_is_not_written(run, tmp_path):
    run["welds"] = run["welds"].to_dataset().drop_vars("probability")
    with pytest.raises(SchemaError, match="probability: is missing"):
        store.write_run(run, tmp_path / "run.nc")
    assert list(tmp_path.iterdir()) == []


def test_writing_that_fails_leaves_the_old_file_and_nothing_else(run, tmp_path, monkeypatch):
    path = store.write_run(run, tmp_path / "run.nc")
    before = path.read_bytes()

    def stops(self, place, **kwargs):
        place.write_bytes(b"half")
        raise OSError("disk is full")

    monkeypatch.setattr("xarray.DataTree.to_netcdf", stops)
    with pytest.raises(OSError, match="disk is full"):
        store.write_run(run, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_file_of_a_newer_schema_is_refused_with_both_versions(run, tmp_path):
    run.attrs["schema_version"] = 99
    path = tmp_path / "run.nc"
    run.to_netcdf(path)
    with pytest.raises(NewerSchemaError, match=r"schema version 99, this toolkit reads up to 1.*newer deform-ili"):
        store.read_run(path)


def test_truncated_file_is_an_error_that_names_the_file(run, tmp_path):
    path = store.write_run(run, tmp_path / "run.nc")
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"run\.nc: cannot be opened as a run"):
        store.read_run(path)


def test_missing_file_is_an_error_that_names_the_file(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.nc: no such file"):
        store.read_run(tmp_path / "nothing.nc")


def test_table_keeps_text_as_text_and_the_order_of_the_contract(tmp_path):
    frame = pd.DataFrame({"run": ["2019", "2019"], "weld_id": ["007", "008"], "index": [0, None], "note": ["", "x"]})
    path = store.write_table(frame, tmp_path / "welds.csv", "welds")
    again = store.read_table(path, "welds")
    assert list(again.weld_id) == ["007", "008"]
    assert list(again.run) == ["2019", "2019"]
    assert again["index"].isna().tolist() == [False, True]
    assert list(again.columns)[:3] == ["weld_id", "run", "index"]
    assert "note" in again.columns


def test_dataset_with_shapes_that_do_not_meet_is_refused():
    with pytest.raises(SchemaError, match="probability has 3 along 'weld', the other variables have 2"):
        build.dataset("welds", {"chainage": [1.0, 2.0], "probability": [1.0, 1.0, 1.0]})


def test_numbers_that_are_not_finite_become_null_in_json(tmp_path):
    path = store.write_json({"a": float("nan"), "b": [np.float64(1.5), np.int64(2)]}, tmp_path / "x.json")
    assert path.read_text().split() == ["{", '"a":', "null,", '"b":', "[", "1.5,", "2", "]", "}"]


def test_comparison_is_stored_in_steps_with_its_sigma_and_what_does_not_fit_whole(tmp_path):
    rng = np.random.default_rng(4)
    size = (2, 50)
    up, sigma, east = rng.normal(0, 0.3, size), rng.uniform(0.001, 0.1, size), rng.normal(0, 1.0, size)
    up[0, 3] = sigma[0, 3] = np.nan
    east[1, 7] = 5000.0  # metres: more steps of a micrometre than 32 bits hold
    values = {"epoch": ["a", "b"], "chainage": np.arange(50) * 0.1, "run_chainage": np.tile(np.arange(50) * 0.1, (2, 1))}
    values |= {"displacement_up": up, "displacement_up_sigma": sigma, "displacement_east": east}
    path = store.write_dataset(build.dataset("comparison", values, reference="a"), tmp_path / "comparison.nc", "comparison")
    back = store.read_dataset(path)
    for name, value in (("displacement_up", up), ("displacement_up_sigma", sigma)):
        np.testing.assert_allclose(back[name].values, value, rtol=0, atol=0.501e-6)
    np.testing.assert_array_equal(back["displacement_east"].values, east)
