"""The demonstration runs with perfect navigation: what the caliper room makes of them against truth."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from caliper_runs import demo_run, true_trajectory

from deform.caliper.measure import measure, on_chainage
from deform.run.schema import dataset_faults

RUNS = ("demo-2019", "demo-2021", "demo-2023")
pytestmark = pytest.mark.demo


@pytest.fixture(scope="module")
def measured(demo):
    return {run: measure(demo_run(demo, run), true_trajectory(demo, run)) for run in RUNS}


def truth(demo, run, name):
    return pd.read_csv(demo / "truth" / run / f"{name}_truth.csv")


@pytest.mark.parametrize("run", RUNS)
def test_every_group_follows_the_vocabulary(measured, run):
    m = measured[run]
    groups = {"welds": m.welds, "sections": m.sections, "caliper": m.wall, "pose": m.pose, "dents": m.dents}
    assert [f for name, ds in groups.items() for f in dataset_faults(name, ds)] == []


@pytest.mark.parametrize("run", RUNS)
def test_every_dent_is_found_and_sized_and_none_is_invented(measured, demo, run):
    dents, true = measured[run].dents, truth(demo, run, "dents")
    assert dents.sizes["dent"] == len(true)
    assert np.abs(dents.chainage.values - true.chainage_m).max() < 0.05
    assert np.abs((dents.clock.values - true.clock_deg + 180) % 360 - 180).max() < 5
    depth = dents.depth.values - true.depth_m.to_numpy()
    assert np.sqrt(np.mean(depth**2)) < 0.6e-3
    assert np.sqrt(np.mean((dents.length.values / true.length_m - 1) ** 2)) < 0.2
    assert np.sqrt(np.mean((dents.width.values / true.width_m - 1) ** 2)) < 0.2


@pytest.mark.parametrize("run", RUNS)
def test_ovality_is_within_a_thousandth_of_the_diameter(measured, demo, run):
    with xr.open_dataset(demo / "truth" / run / "truth.nc", decode_times=False) as t:
        chainage, true = t.grid_chainage.values, t.ovality.values
    section = on_chainage(measured[run], chainage)
    error = section.ovality.values - true
    assert np.isfinite(error).mean() > 0.98
    assert np.sqrt(np.nanmean(error**2)) < 5e-4


@pytest.mark.parametrize("run", RUNS)
def test_the_weld_log_holds_the_welds_and_nothing_else(measured, demo, run):
    welds, true = measured[run].welds, truth(demo, run, "welds").chainage_m.to_numpy()
    sure = welds.chainage.values[welds.probability.values >= 0.5]
    apart = np.abs(sure[:, None] - true[None, :])
    assert (apart.min(axis=0) < 0.1).mean() >= 0.99
    assert (apart.min(axis=1) < 0.1).mean() >= 0.995
    assert ((apart.min(axis=1) > 0.1) & (apart.min(axis=1) < 1.0)).sum() == 0


@pytest.mark.parametrize("run", RUNS)
def test_joint_lengths_are_good_to_millimetres_and_their_sigma_is_honest(measured, demo, run):
    welds, true = measured[run].welds, truth(demo, run, "welds").chainage_m.to_numpy()
    sure = np.flatnonzero(welds.probability.values >= 0.5)
    nearest = np.abs(welds.chainage.values[sure][:, None] - true[None, :]).argmin(axis=1)
    paired = np.diff(nearest) == 1
    length, sigma = welds.joint_length.values[sure][:-1][paired], welds.joint_length_sigma.values[sure][:-1][paired]
    error = length - np.diff(true[nearest])[paired]
    assert error.std() < 0.006
    assert np.abs(error).max() < 0.05
    assert 0.85 < np.mean(np.abs(error) < 1.96 * sigma) <= 1.0
