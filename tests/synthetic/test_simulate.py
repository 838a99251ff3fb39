"""The folders that a simulation leaves: the format of raw runs, the truth beside them, the same bytes again."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.errors import OptionError
from deform.options import (
    DentOptions,
    MovementOptions,
    ReplacementOptions,
    RouteOptions,
    RunOptions,
    SimulateOptions,
    ToolOptions,
    simulate_options_from,
)
from deform.readers.reader import read_source
from deform.synthetic.simulate import simulate


def _options() -> SimulateOptions:
    tool = ToolOptions(static_start_s=20.0, static_end_s=10.0, stops=0, gross_markers=2, unheard=0.2, caliper_rate_hz=30.0)
    two_rings = ToolOptions(
        static_start_s=20.0, stops=0, imu="porter-1990", arms=12, ring_offset_m=(-0.6, -1.0), caliper_rate_hz=30.0
    )
    return SimulateOptions(
        line="small",
        seed=3,
        route=RouteOptions(
            length_m=300.0, crossings=0, induction_bends_deg=(30.0,), marker_spacing_m=60.0, valve_spacing_m=200.0
        ),
        tool=tool,
        runs=(
            RunOptions(id="a", date=datetime.date(2018, 1, 2)),
            RunOptions(id="b", date=datetime.date(2020, 1, 2), direction="upstream", tool=two_rings),
        ),
        movements=(MovementOptions(id="LS1", start_m=120.0, length_m=60.0, amplitude_m=0.3),),
        replacements=(ReplacementOptions(id="C1", start_m=215.0, length_m=40.0),),
        dents=(DentOptions(id="D1", chainage_m=80.0, clock_deg=30.0, depths_od=(0.02, 0.03)),),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("small")
    done: list[float] = []
    assert simulate(_options(), place, progress=done.append) == ["a", "b"]
    assert done[-1] == 1.0
    assert done == sorted(done)
    return place


def test_same_options_write_the_same_bytes(folder, tmp_path):
    simulate(_options(), tmp_path)
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    assert len(files) == 2 * 6 + 2 * 7
    for name in files:
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_the_reader_of_raw_folders_takes_every_run(folder):
    for run in ("a", "b"):
        raw = read_source(folder / run)
        assert raw.id == run
        assert raw.imu.sizes["sample"] > 1000
        assert [r for r in raw.repairs if "markers.csv" not in r] == []  # a marker with a wrong time is part of the play


def test_truth_has_the_files_names_columns_and_units_of_the_demonstration_data(folder, demo):
    ours, theirs = folder / "truth" / "b", demo / "truth" / "demo-2023"
    assert {p.name for p in ours.iterdir()} == {p.name for p in theirs.iterdir()}
    for path in theirs.glob("*.csv"):
        assert list(pd.read_csv(ours / path.name).columns) == list(pd.read_csv(path).columns), path.name
    with xr.open_dataset(ours / "truth.nc") as here, xr.open_dataset(theirs / "truth.nc") as there:
        assert set(here.variables) == set(there.variables)
        assert set(there.attrs) == set(here.attrs)
        for name in there.variables:
            assert here[name].attrs.get("units") == there[name].attrs.get("units"), name
            assert here[name].dims == there[name].dims
    for name in ("imu.nc", "odometer.nc", "caliper.nc"):
        kept = {"mask_and_scale": False}
        with xr.open_dataset(folder / "a" / name, **kept) as here, xr.open_dataset(demo / "demo-2019" / name, **kept) as there:
            assert {n: (v.dims, v.dtype) for n, v in here.variables.items()} == {
                n: (v.dims, v.dtype) for n, v in there.variables.items()
            }
            assert set(there.attrs) <= set(here.attrs)


def test_upstream_run_has_falling_chainage_and_the_far_end_as_launcher(folder):
    truth = xr.load_dataset(folder / "truth" / "b" / "truth.nc")
    assert truth.attrs["direction"] == "upstream"
    assert truth.chainage[0] > truth.chainage[-1]
    markers = pd.read_csv(folder / "b" / "markers.csv")
    assert markers.kind.iloc[0] == "launcher"
    assert markers.time_s.iloc[0] == markers.time_s.min()
    welds = pd.read_csv(folder / "truth" / "b" / "welds_truth.csv")
    at = np.interp(welds.time_s.dropna(), truth.time, truth.chainage)
    assert at == pytest.approx(welds.chainage_m[welds.time_s.notna()], abs=0.02)


def test_truth_of_both_runs_is_one_line_where_nothing_happened(folder):
    first, second = (xr.load_dataset(folder / "truth" / run / "truth.nc") for run in ("a", "b"))
    material = np.arange(0.0, 118.0, 0.5)
    for name in ("grid_latitude", "grid_longitude", "grid_height", "curvature_total"):
        a = np.interp(material, first.grid_epoch0_chainage, first[name])
        b = np.interp(material, second.grid_epoch0_chainage, second[name])
        assert a == pytest.approx(b, abs=1e-9), name
    assert float(np.abs(first.displacement_east).max()) == 0.0
    assert float(np.hypot(second.displacement_east, second.displacement_north).max()) > 0.25


def test_gross_markers_are_named_in_the_truth_and_wrong_in_the_run(folder):
    truth, heard = pd.read_csv(folder / "truth" / "a" / "markers_truth.csv"), pd.read_csv(folder / "a" / "markers.csv")
    wrong = truth.gross_error.notna()
    assert sorted(truth.gross_error[wrong]) == ["coordinates", "time"]
    off = np.hypot((heard.latitude_deg - truth.latitude_deg) * 111e3, (heard.longitude_deg - truth.longitude_deg) * 54e3)
    late = (heard.time_s - truth.true_time_s).abs()
    assert off[truth.gross_error == "coordinates"].min() > 10.0
    assert off[~wrong].max() < 2.0
    assert late[~wrong].max() < 0.2


def test_dents_and_replaced_joints_are_in_the_truth(folder):
    dents = [pd.read_csv(folder / "truth" / run / "dents_truth.csv") for run in ("a", "b")]
    assert dents[1].depth_m[0] == pytest.approx(1.5 * dents[0].depth_m[0])
    joints = pd.read_csv(folder / "truth" / "b" / "joints_truth.csv")
    assert (joints.is_replaced == 1).sum() >= 3
    assert (joints.start_m.diff().dropna() > 0).all()


def test_options_come_from_a_file_and_an_unknown_key_is_named_with_the_known_ones(tmp_path):
    path = tmp_path / "line.toml"
    path.write_text(
        'line = "north"\nseed = 4\n[route]\nlength_m = 500.0\n[tool]\nimu = "tactical"\n'
        '[[runs]]\nid = "n1"\ndate = 2020-05-01\n[[runs]]\nid = "n2"\ndate = 2024-05-01\ndirection = "upstream"\n'
        '[[movements]]\nid = "LS"\nstart_m = 200.0\nlength_m = 80.0\namplitude_m = 0.4\n',
        encoding="utf-8",
    )
    options = simulate_options_from(path)
    assert options.runs[1].direction == "upstream"
    assert options.movements[0].history == "linear"
    path.write_text("[route]\nlenght_m = 500.0\n", encoding="utf-8")
    with pytest.raises(OptionError, match=r"route.lenght_m: unknown option; known here are length_m"):
        simulate_options_from(path)
