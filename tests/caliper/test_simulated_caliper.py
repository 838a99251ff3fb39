"""Simulated runs with truth, unlike the demonstration: two rings, an upstream run with dead arms, a large pipe."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from caliper_runs import demo_run, true_trajectory

from deform.caliper.measure import measure, on_chainage
from deform.options import DentOptions, RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.run.schema import dataset_faults
from deform.synthetic.simulate import simulate

DENTS = (
    DentOptions(id="D1", chainage_m=60.0, clock_deg=10.0, depths_od=(0.012,)),
    DentOptions(id="D2", chainage_m=150.0, clock_deg=355.0, depths_od=(0.03,), length_m=0.22, width_m=0.16),
    DentOptions(id="D3", chainage_m=310.0, clock_deg=120.0, depths_od=(0.02,), length_m=0.5, width_m=0.3),
)
TOOLS = {
    "two-rings": ("downstream", {}, {"ring_offset_m": (0.7, -0.7)}),
    "upstream": ("upstream", {}, {"arms": 64, "dead_arms": (7, 31), "ring_offset_m": (0.9,)}),
    "large": ("downstream", {"outside_diameter_m": 0.762, "wall_m": 0.0127}, {"arms": 48, "arm_noise_m": 0.0005}),
}


@pytest.fixture(scope="module", params=list(TOOLS))
def run(request, tmp_path_factory):
    direction, route, tool = TOOLS[request.param]
    folder = Path(tmp_path_factory.mktemp(request.param))
    options = SimulateOptions(
        line=request.param,
        seed=11,
        route=RouteOptions(length_m=400.0, induction_bends_deg=(30.0,), **route),
        tool=ToolOptions(static_start_s=60.0, static_end_s=20.0, stops=1, **tool),
        runs=(RunOptions(id="r", date=datetime.date(2020, 1, 1), direction=direction),),
        dents=DENTS,
    )
    simulate(options, folder)
    raw, trajectory = demo_run(folder, "r"), true_trajectory(folder, "r")
    with xr.open_dataset(folder / "truth" / "r" / "truth.nc", decode_times=False) as t:
        truth = t.load()
    tables = {n: pd.read_csv(folder / "truth" / "r" / f"{n}_truth.csv") for n in ("dents", "welds", "joints")}
    return request.param, raw, trajectory, measure(raw, trajectory), truth, tables


def test_the_groups_follow_the_vocabulary(run):
    m = run[3]
    groups = {
        "welds": m.welds,
        "sections": m.sections,
        "caliper": m.wall,
        "pose": m.pose,
        "dents": m.dents,
        "features": m.features,
    }
    assert [f for name, ds in groups.items() for f in dataset_faults(name, ds)] == []


def test_all_dents_are_there_and_no_other(run):
    m, tables = run[3], run[5]
    dents, true = m.dents, tables["dents"]
    assert dents.sizes["dent"] == len(true)
    assert np.abs(dents.chainage.values - true.chainage_m).max() < 0.05
    assert np.abs((dents.clock.values - true.clock_deg + 180) % 360 - 180).max() < 3
    assert np.abs(dents.depth.values - true.depth_m).max() < 2e-3
    assert np.abs((dents.depth.values - true.depth_m) / dents.depth_sigma.values).max() < 4
    assert np.abs(dents.length.values / true.length_m - 1).max() < 0.2
    assert np.abs(dents.width.values / true.width_m - 1).max() < 0.3


def test_all_welds_are_there_and_no_other(run):
    m, true = run[3], run[5]["welds"].chainage_m.to_numpy()
    sure = m.welds.chainage.values[m.welds.probability.values >= 0.5]
    apart = np.abs(sure[:, None] - true[None, :])
    assert (apart.min(axis=0) < 0.05).all()
    assert (apart.min(axis=1) < 0.05).all()


def test_the_wall_of_each_joint_is_that_of_the_truth(run):
    m, joints = run[3], run[5]["joints"]
    nearest = np.abs(m.welds.chainage.values[:, None] - joints.start_m.to_numpy()).argmin(axis=1)
    error = m.welds.wall_thickness.values - joints.wall_m.to_numpy()[nearest]
    assert np.isfinite(error).mean() > 0.9
    assert np.nanmax(np.abs(error)) < 1e-4


def test_ovality_is_right_and_its_sigma_too(run):
    m, truth = run[3], run[4]
    section = on_chainage(m, truth.grid_chainage.values)
    error = section.ovality.values - truth.ovality.values
    assert np.sqrt(np.nanmean(error**2)) < 6e-4
    assert np.nanmean(np.abs(error) < 1.96 * section.ovality_sigma.values) > 0.85


def test_two_rings_tell_how_the_tool_stands_in_the_pipe(run):
    name, _, _, m, truth, _ = run
    if name != "two-rings":
        assert "yaw" not in m.pose
        return
    moving = np.interp(m.pose.time, truth.time, truth.speed) > 0.1
    for angle, true in (("yaw", truth.tool_azimuth - truth.pipe_azimuth), ("pitch", truth.tool_pitch - truth.pipe_pitch)):
        error = (m.pose[angle].values - np.interp(m.pose.time, truth.time, (true + 180) % 360 - 180))[moving]
        assert np.sqrt(np.mean(error**2)) < 0.005
        assert np.std(error) / float(m.pose[f"{angle}_sigma"].median()) == pytest.approx(1.0, abs=0.25)


def test_the_induction_bend_is_a_feature(run):
    bends = run[3].features.isel(feature=run[3].features.kind.values == "bend")
    hot = ["induction" in t for t in bends.text.values]
    assert bends.value.values[hot] == pytest.approx([30.0], abs=0.7)
