"""Seams, bends and markers add to what the lengths of joints tell of two weld lists."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.synthetic.lists import Seen
from tests.correlate.lines import aligned, build_line, cut_out, observe, score, traits_of, turned


def equal_pipe_with_a_cut_out(seed: int):
    """Two runs over 400 joints of two lengths, of which those from 190 to 210 are equal and six are replaced by equal ones."""
    rng = np.random.default_rng(seed)
    joints = np.where(rng.random(400) < 0.7, 12.2, rng.uniform(3, 11, 400))
    joints[185:215] = 12.2
    true = replace(build_line(rng, 400), place=np.concatenate([[0.0], np.cumsum(joints)]))
    later = cut_out(rng, true, 197, 6, 6, same_mill=False)
    how = Seen(wall_wrong=0.0, seam_absent=0.0, seam_wrong=0.0, fitting_absent=0.0)
    a = observe(rng, true, missed=0, false=0, noise=0.02, traits=how)
    return a, observe(rng, later, missed=0, false=0, noise=0.02, traits=replace(how, roll=70.0))


@pytest.mark.parametrize("reverse", [False, True])
def test_seams_with_one_unknown_roll_pin_the_ends_of_a_cut_out(reverse):
    sure = []
    for seed in range(6):
        a, b = equal_pipe_with_a_cut_out(seed)
        b = turned(b) if reverse else b
        found = aligned(a, b, traits=(traits_of(a), traits_of(b)))
        plain = aligned(a, b)
        assert (found.partner[198:203] == -1).all()
        sure.append([_probability(f, a, b, (197, 203)) for f in (found, plain)])
    with_seams, without = np.median(sure, axis=0)
    assert with_seams > 0.95
    assert without < 0.85  # the last equal joint may as well be new pipe


def _probability(found, a, b, welds) -> float:
    """Least probability of the right pair of these welds."""
    right = {int(a.weld[i]): p for i, j, p in zip(found.i, found.j, found.posterior, strict=True) if a.weld[i] == b.weld[j]}
    return min(right.get(w, 0.0) for w in welds)


def test_bends_and_their_planes_add_to_what_a_line_of_equal_joints_tells():
    rng = np.random.default_rng(31)
    true = build_line(rng, 400, equal=0.95, pups=0.03)
    how = Seen(wall_wrong=0.0, seam_absent=1.0)
    a, b = observe(rng, true, traits=how), observe(rng, true, traits=how)
    with_bends, without = aligned(a, b, traits=(traits_of(a), traits_of(b))), aligned(a, b)
    assert score(with_bends.partner, a, b)[0] > 0.995
    assert 1 - _mean_of_right(with_bends, a, b) < 0.75 * (1 - _mean_of_right(without, a, b))


def _mean_of_right(found, a, b) -> float:
    right = (a.weld[found.i] >= 0) & (a.weld[found.i] == b.weld[found.j])
    return found.posterior[right].sum() / np.intersect1d(a.weld[a.weld >= 0], b.weld).size


def test_markers_that_both_runs_name_alike_are_anchors_and_one_that_was_moved_is_overruled():
    rng = np.random.default_rng(32)
    true = build_line(rng, 500, equal=0.9)
    a, b = observe(rng, true), observe(rng, true)
    known = np.flatnonzero((a.weld % 60 == 30) & np.isin(a.weld, b.weld))
    of_b = np.asarray([np.flatnonzero(b.weld == w)[0] for w in a.weld[known]])
    names = np.asarray([f"AGM {k}" for k in range(known.size)], object)
    marks = {"mark_name": names, "mark_at": known + 0.3}
    moved = of_b + 0.3
    moved[3] += 2.0  # one marker was set up elsewhere
    traits = replace(traits_of(a), **marks), replace(traits_of(b), mark_name=names, mark_at=moved)
    found, plain = aligned(a, b, traits=traits), aligned(a, b)
    assert _mean_of_right(found, a, b) > _mean_of_right(plain, a, b) - 1e-4
    assert score(found.partner, a, b)[0] > 0.99
    assert found.partner[known[3]] == of_b[3]
