"""One joint replaced by two is a cut-out where all runs to one side of a date say so, else a missed or an invented weld."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.correlate import match_runs
from deform.run import build
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


def test_what_passes_for_a_weld_at_a_dent_is_no_cut_out():
    rng = np.random.default_rng(0)
    line = build_line(rng, 300, equal=0.1)
    joint = 150 + int(np.argmax(np.diff(line.place)[150:160]))
    seen = [observe(rng, line, missed=0.003, false=0.0, noise=0.01) for _ in range(4)]
    at = float(np.mean(seen[3].place[np.searchsorted(seen[3].weld, joint) :][:2]))
    runs = [run_of(str(2015 + k), one, probability=np.full(one.n, 1.0 - 1e-7)) for k, one in enumerate(seen)]
    welds = np.sort(np.append(seen[3].place, at))
    dents = build.dataset("dents", {"chainage": [at + 0.2], "depth": [0.03], "clock": [340.0]})
    for more, kinds in (({}, ["cutout"]), ({"dents": dents}, [])):
        last = build.dataset("welds", {"chainage": welds, "probability": np.full(welds.size, 1.0 - 1e-7)})
        run = build.run_tree({"id": "2018", "date": "2018", "source": "raw"}, welds=last, **more)
        edits = match_runs([*runs[:3], run]).edits
        assert list(edits["kind"][edits["kind"].isin(["cutout", "reroute"])]) == kinds
