"""Figures of a match: what they show is what the table says."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.report.match_figures import drift, length_differences, match_data, probability_strip, ribbon


@pytest.fixture(scope="module")
def data():
    """Two runs of 60 welds; the second is 1 % longer, missed one weld, and has one joint 0.4 m longer."""
    rng = np.random.default_rng(0)
    place = np.cumsum(rng.uniform(8, 12, 60))
    second = 1.01 * place + np.where(np.arange(60) > 30, 0.4, 0.0)
    rows = []
    for k in range(60):
        missed = k == 45
        rows.append((f"W{k}", "a", k, place[k], place[k], 0.99, "matched"))
        rows.append((f"W{k}", "b", None if missed else k, second[k], place[k], 0.99, "missed" if missed else "matched"))
    columns = ["weld_id", "run", "index", "chainage_m", "reference_chainage_m", "probability", "status"]
    return match_data(pd.DataFrame(rows, columns=columns), "a", "b")


def test_a_missed_weld_has_no_place_in_its_run_and_no_probability(data):
    assert data.sizes["weld"] == 60
    assert np.isnan(data["chainage_b"].values[45])
    assert np.isnan(data["probability"].values[45])
    assert data["status_b"].values[45] == "missed"


def test_length_differences_show_the_longer_joint_and_no_joint_at_the_missed_weld(data):
    axes = length_differences(data).axes[0]
    drawn = np.concatenate([line.get_xdata() for line in axes.lines])
    assert drawn.size == 59 - 2
    beyond = axes.lines[1]
    assert beyond.get_xdata().size == 1
    assert beyond.get_xdata()[0] == pytest.approx(data["reference_chainage"].values[30])


def test_drift_takes_one_scale_out(data):
    line = drift(data).axes[0].lines[0]
    assert np.abs(line.get_ydata()).max() < 0.4
    assert line.get_xdata().size == 59


def test_ribbon_and_strip_draw_every_pair_once(data):
    figure = ribbon(data)
    links = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2 and line.get_xdata()[0] == line.get_xdata()[1]]
    assert len(links) == 34  # from twenty welds before the missed one, 45, to the end
    assert probability_strip(data).axes[0].lines[0].get_xdata().size == 59
