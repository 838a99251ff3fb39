"""Weld lists for tests of matching."""

from __future__ import annotations

import time

import numpy as np

from deform.synthetic.epochs import joint_lists


def test_same_seed_gives_the_same_lists_and_another_one_others():
    first, again, other = joint_lists(200, seed=4), joint_lists(200, seed=4), joint_lists(200, seed=5)
    assert (first[1].distance == again[1].distance).all()
    assert first[1].distance.size != other[1].distance.size or (first[1].distance != other[1].distance).any()


def test_welds_that_stay_keep_their_identity_and_their_joint_lengths():
    first, second = joint_lists(500, sigma_m=0.0, scale=0.0, scale_wander=0.0, miss=0.0, false=0.0, cutouts=1)
    both = np.intersect1d(first.identity, second.identity)
    assert 480 < both.size < 501
    a = first.distance[np.searchsorted(first.identity, both)]
    b = np.array([second.distance[second.identity == k][0] for k in both])
    neighbours = np.diff(both) == 1
    assert np.allclose(np.diff(a)[neighbours], np.diff(b)[neighbours], atol=1e-9)


def test_shares_of_missed_and_false_welds_are_as_asked():
    lists = joint_lists(20_000, 2, miss=0.03, false=0.02, cutouts=0)
    for run in lists:
        assert np.isclose(np.mean(run.identity < 0), 0.02, atol=0.005)
        assert np.isclose(np.isin(run.present, run.identity).mean(), 0.97, atol=0.006)


def test_cut_out_and_re_route_change_the_steel_between_their_ends():
    first, second = joint_lists(800, 2, cutouts=2, reroutes=1)
    gone, new = np.setdiff1d(first.present, second.present), np.setdiff1d(second.present, first.present)
    assert gone.size > 40
    assert new.min() > first.present.max()


def test_a_reversed_list_runs_the_other_way():
    plain, turned = joint_lists(300, 2, cutouts=0, false=0.0, reverse=(1,))
    assert (np.diff(plain.identity) > 0).all()
    assert (np.diff(turned.identity) < 0).all()
    assert (np.diff(turned.distance) > -0.5).all()


def test_a_hundred_thousand_joints_take_a_moment():
    start = time.perf_counter()
    assert joint_lists(100_000, 3)[2].distance.size > 90_000
    assert time.perf_counter() - start < 20.0
