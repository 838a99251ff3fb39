"""One joint replaced by two is a cut-out where all runs to one side of a date say so, else a missed or an invented weld."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.correlate import match_runs
from tests.correlate.lines import JointList, build_line, cut_out, observe, run_of


def replacements(seed: int, *lines: JointList) -> pd.DataFrame:
    """Replaced stretches that runs show, in the order of time, of lines whose welds are nearly all seen, none invented."""
    rng = np.random.default_rng(seed)
    seen = [observe(rng, line, missed=0.003, false=0.0, noise=0.01) for line in lines]
    runs = [run_of(str(2015 + k), one, probability=np.full(one.n, 0.99999)) for k, one in enumerate(seen)]  # by three channels
    edits = match_runs(runs).edits
    return edits[edits["kind"].isin(["cutout", "reroute"])]


@pytest.mark.parametrize("seed", range(3))
def test_one_joint_replaced_by_two_is_a_cut_out_when_all_runs_say_so(seed):
    before = build_line(np.random.default_rng(seed), 300, equal=0.1)
    joint = 150 + int(np.argmax(np.diff(before.place)[150:160]))  # a long one
    after = cut_out(np.random.default_rng(seed + 10), before, joint, 1, 2)
    edits = replacements(seed, before, before, before, after)
    assert list(zip(edits["kind"], edits["run"], edits["n_old"], edits["n_new"], strict=True)) == [("cutout", "2018", 1, 2)]
    assert abs(float(edits["start_m"].iloc[0]) - before.place[joint]) < 1.0
    back = replacements(seed, after, before, before, before)
    assert list(zip(back["kind"], back["run"], back["n_old"], back["n_new"], strict=True)) == [("cutout", "2016", 2, 1)]


def test_a_further_weld_that_one_run_in_the_middle_or_one_of_two_shows_is_no_cut_out():
    before = build_line(np.random.default_rng(1), 300, equal=0.1)
    joint = 150 + int(np.argmax(np.diff(before.place)[150:160]))
    other = cut_out(np.random.default_rng(11), before, joint, 1, 2)
    assert replacements(1, before, other, before, before).empty
    assert replacements(1, before, other).empty
