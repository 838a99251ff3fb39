"""Weld lists for tests of matching."""

from __future__ import annotations

import numpy as np
import pytest

from deform.synthetic.lists import Seen, build_line, cut_out, cut_outs, observe, turned


def test_same_seed_gives_the_same_lists_and_another_one_others():
    first, again, other = (observe(np.random.default_rng(s), build_line(np.random.default_rng(s), 200)) for s in (4, 4, 5))
    assert (first.place == again.place).all()
    assert first.n != other.n or (first.place != other.place).any()


@pytest.mark.parametrize("same_mill", [True, False])
def test_welds_that_stay_keep_their_identity_their_traits_and_their_places(same_mill):
    rng = np.random.default_rng(1)
    old = build_line(rng, 500)
    new, ends = cut_outs(rng, old, 5, same_mill=same_mill)
    both, in_old, in_new = np.intersect1d(old.weld, new.weld, return_indices=True)
    assert 440 < both.size < 500
    np.testing.assert_allclose(old.place[in_old], new.place[in_new], atol=1e-9)  # every cut-out keeps its length
    first = np.isin(both, [e[0] for e in ends])  # a new joint begins here
    assert (old.seam[in_old][~first] == new.seam[in_new][~first]).all()
    assert (old.seam[in_old][first] != new.seam[in_new][first]).all()
    assert new.weld.size == np.unique(new.weld).size
    assert np.diff(new.place).min() > 0.5


def test_a_cut_out_has_the_joints_it_was_asked_for_and_may_be_longer():
    rng = np.random.default_rng(2)
    old = build_line(rng, 100)
    new = cut_out(rng, old, 40, 6, 7, longer=9.0)
    assert new.n == old.n + 1
    assert new.place[-1] - old.place[-1] == pytest.approx(9.0)
    assert (new.weld[41:47] > old.weld.max()).all()


def test_shares_of_missed_and_false_welds_are_as_asked():
    rng = np.random.default_rng(3)
    true = build_line(rng, 20_000)
    seen = observe(rng, true, missed=0.03, false=0.02)
    assert np.isclose((seen.weld < 0).sum() / true.n, 0.02, atol=0.004)
    assert np.isclose(np.isin(true.weld, seen.weld).mean(), 0.97, atol=0.006)


def test_a_third_of_the_joints_are_equal_within_a_centimetre():
    joints = np.diff(build_line(np.random.default_rng(4), 20_000).place)
    assert np.isclose((np.abs(joints - 12.2) <= 0.005).mean(), 0.35, atol=0.02)


def test_a_list_made_in_the_other_direction_turns_order_and_clocks():
    rng = np.random.default_rng(5)
    seen = observe(rng, build_line(rng, 50), missed=0, false=0, traits=Seen(seam_absent=0.0))
    other = turned(seen)
    assert (other.weld == seen.weld[::-1]).all()
    np.testing.assert_allclose(np.diff(other.place), np.diff(seen.place)[::-1])
    np.testing.assert_allclose(other.seam[:-1], (360.0 - seen.seam[:-1][::-1]) % 360.0)
    again = turned(other)
    np.testing.assert_allclose(again.seam[:-1], seen.seam[:-1])


def test_traits_are_seen_with_the_errors_asked_for():
    rng = np.random.default_rng(6)
    true = build_line(rng, 20_000)
    seen = observe(rng, true, missed=0, false=0, traits=Seen(roll=30.0, seam_wrong=0.0))
    apart = (seen.seam - true.seam - 30.0 + 180.0) % 360.0 - 180.0
    assert np.isclose(np.isnan(seen.seam).mean(), 0.05, atol=0.01)
    assert np.isclose(np.nanstd(apart), 5.0, rtol=0.05)
    assert np.isclose((seen.wall != true.wall).mean(), 0.02 * 2 / 3, atol=0.004)
