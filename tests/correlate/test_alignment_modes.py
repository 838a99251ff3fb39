"""The alignment of two weld lists where it could fail: drifting scales, equal joints, re-routes, poor lists, strangers, locks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.correlate.alignment import align
from deform.correlate.evidence import Locks
from deform.errors import InputError, WrongLineError
from deform.synthetic.lists import Seen
from tests.correlate.lines import OPTIONS, aligned, bare, build_line, cut_out, cut_outs, observe, score, traits_of


def test_scale_that_drifts_inside_a_run_does_not_break_the_match():
    rng = np.random.default_rng(3)
    true = build_line(rng, 2000)
    drift = bare(true.place * (1 + 0.02 * true.place / true.place[-1]), true.weld)
    a, b = observe(rng, true), observe(rng, drift, wander=0.01)
    recall, precision, _ = score(aligned(a, b).partner, a, b)
    assert recall > 0.995
    assert precision > 0.998


def test_a_long_run_of_equal_joints_without_a_pup_is_carried_by_its_ends():
    rng = np.random.default_rng(4)
    joints = np.concatenate([np.diff(build_line(rng, 150).place), np.full(400, 12.2), np.diff(build_line(rng, 150).place)])
    true = bare(np.concatenate([[0.0], np.cumsum(joints)]), np.arange(701))
    a, b = observe(rng, true), observe(rng, true, scale=1.01)
    recall, precision, _ = score(aligned(a, b).partner, a, b)
    assert recall > 0.97
    assert precision > 0.98


@pytest.mark.parametrize("n_new", [300, 420, 900])
def test_a_reroute_longer_than_the_look_back_of_the_chain_is_bridged(n_new):
    rng = np.random.default_rng(6)
    true = build_line(rng, 1200)
    later = cut_out(rng, true, 400, 350, n_new, longer=(n_new - 350) * 11.4)
    a, b = observe(rng, true), observe(rng, later)
    found = aligned(a, b)
    recall, _, wrong = score(found.partner, a, b)
    assert recall > 0.99
    assert wrong <= 4  # joints beside the ends that are alike by chance: the probability says so
    pairs = zip(found.i, found.j, found.posterior, strict=True)
    assert not [p for i, j, p in pairs if p > 0.99 and (a.weld[i] < 0 or a.weld[i] != b.weld[j])]
    inside = [i for i, j in enumerate(found.partner) if j >= 0 and 410 < a.weld[i] < 740]
    assert not inside  # no island of chance pairs within the new pipe


def test_five_percent_of_false_welds_are_left_out():
    rng = np.random.default_rng(7)
    true = build_line(rng, 2000)
    a, b = observe(rng, true, false=0.05), observe(rng, true, false=0.05)
    recall, precision, _ = score(aligned(a, b).partner, a, b)
    assert recall > 0.99
    assert precision > 0.998


def test_two_missed_welds_side_by_side_are_one_joint_against_three():
    rng = np.random.default_rng(8)
    true = build_line(rng, 200, equal=0.1)
    a = observe(rng, true, missed=0, false=0)
    b = bare(np.delete(a.place, [90, 91]), np.delete(a.weld, [90, 91]))
    found = aligned(a, b)
    assert found.partner[89] == 89
    assert found.partner[92] == 90
    assert (found.partner[[90, 91]] == -1).all()


def test_lengths_rounded_to_a_tenth_of_a_foot_are_matched():
    rng = np.random.default_rng(9)
    true = build_line(rng, 1000)
    a, b = observe(rng, true, noise=0.01), observe(rng, true, noise=0.01)
    joints = np.round(np.diff(b.place) / 0.03048) * 0.03048
    b = bare(np.concatenate([[0.0], np.cumsum(joints)]), b.weld)
    recall, precision, _ = score(aligned(a, b).partner, a, b)
    assert recall > 0.995
    assert precision > 0.998


def test_joints_of_one_line_laid_from_few_mills_are_refused_as_those_of_a_loop_line():
    for seed in range(15):
        rng = np.random.default_rng(100 + seed)
        a, b = (observe(rng, build_line(rng, 400, equal=0.7)) for _ in range(2))
        with pytest.raises(WrongLineError, match="welds"):
            aligned(a, b)


def test_two_pieces_of_a_line_that_do_not_overlap_are_refused():
    rng = np.random.default_rng(19)
    seen = observe(rng, build_line(rng, 800))
    with pytest.raises(WrongLineError, match="welds"):
        aligned(seen.take(slice(0, 390)), seen.take(slice(410, None)))


@pytest.mark.parametrize("joints", [2, 3, 5, 8, 15])
def test_a_short_line_is_matched_or_refused_but_never_wrong_and_sure(joints):
    claimed = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        true = build_line(rng, joints, pups=0.3)
        a, b = observe(rng, true, missed=0, false=0, noise=0.01), observe(rng, true, missed=0, false=0, noise=0.01)
        try:
            found = aligned(a, b)
        except WrongLineError:
            continue
        claimed += int((found.partner >= 0).sum())
        wrong = (a.weld[found.i] != b.weld[found.j]) & (found.posterior > 0.99)
        assert not wrong.any()
    assert claimed > 0 or joints < 8


@pytest.mark.parametrize("name", ["wall", "label"])
def test_traits_given_to_the_upstream_instead_of_the_downstream_weld_do_not_move_the_match(name):
    """A vendor writes length, wall and number of a joint beside its end: every trait of run B stands one weld too late."""
    rng = np.random.default_rng(20)
    true = build_line(rng, 600)
    a, b = observe(rng, true, traits=Seen()), observe(rng, true, traits=Seen())
    traits = [replace(traits_of(v), label=np.asarray([str(10 * w) for w in v.weld], object)) for v in (a, b)]
    late = {name: np.roll(getattr(traits[1], name), 1)}
    found = aligned(a, b, traits=(traits[0], replace(traits[1], **late)))
    recall, _, wrong = score(found.partner, a, b)
    assert recall > 0.995
    assert wrong <= 2


def test_numbers_that_a_vendor_carried_on_over_new_pipe_are_overruled_by_the_lengths():
    rng = np.random.default_rng(21)
    true = build_line(rng, 600, equal=0.1)
    later = cut_out(rng, true, 300, 8, 8)
    a, b = observe(rng, true, missed=0, false=0), observe(rng, later, missed=0, false=0)
    numbers = np.asarray([str(10 * k) for k in range(a.n)], object)
    found = aligned(a, b, traits=(replace(traits_of(a), label=numbers), replace(traits_of(b), label=numbers)))
    assert score(found.partner, a, b)[0] > 0.995
    assert (found.partner[302:307] == -1).all()


def test_feet_read_as_metres_are_matched_and_said(caplog):
    rng = np.random.default_rng(10)
    true = build_line(rng, 500)
    a, b = observe(rng, true), observe(rng, true)
    found = aligned(a, bare(b.place / 0.3048, b.weld))
    assert score(found.partner, a, b)[0] > 0.995
    assert found.scale == pytest.approx(1 / 0.3048, rel=0.01)
    assert "feet" in caplog.text


def test_a_displaced_weld_keeps_its_partner():
    rng = np.random.default_rng(12)
    true = build_line(rng, 300)
    a, b = observe(rng, true, missed=0, false=0), observe(rng, true, missed=0, false=0)
    moved = b.place.copy()
    moved[150] -= 1.06
    found = aligned(a, bare(moved, b.weld))
    assert found.partner[150] == 150
    at = np.flatnonzero((found.i == 150) & (found.j == 150))
    assert found.shifted[at] > 0.9 * found.posterior[at]


def test_a_run_over_a_part_of_the_line_is_placed_within_it():
    rng = np.random.default_rng(13)
    true = build_line(rng, 1500)
    a, whole = observe(rng, true), observe(rng, true)
    b = bare(whole.place[600:760] - whole.place[600], whole.weld[600:760])
    recall, _, wrong = score(aligned(a, b).partner, a, b)
    assert recall > 0.98
    assert wrong <= 1


def test_a_list_with_a_tenth_of_the_welds_is_refused_with_the_numbers():
    rng = np.random.default_rng(14)
    true = build_line(rng, 1000)
    a, b = observe(rng, true), observe(rng, true, missed=0.9)
    with pytest.raises(WrongLineError, match=rf"{b.place.size} welds.*lacks most of its welds"):
        aligned(a, b)


def test_locked_and_forbidden_pairs_are_honoured():
    rng = np.random.default_rng(15)
    true = build_line(rng, 200)
    a, b = observe(rng, true, missed=0, false=0), observe(rng, true, missed=0, false=0)
    forced = Locks(np.asarray([[100, 101]]), np.asarray([[50, 50]]))
    for reverse in (False, True):
        given = bare(-b.place[::-1], b.weld[::-1]) if reverse else b
        locks = Locks(np.asarray([[100, given.place.size - 102 if reverse else 101]]), np.asarray([[50, 150 if reverse else 50]]))
        found = align(a.place, given.place, OPTIONS, locks=locks if reverse else forced)
        assert given.weld[found.partner[100]] == 101
        assert found.partner[50] == -1 or given.weld[found.partner[50]] != 50
        assert given.weld[found.partner[10]] == 10
        assert given.weld[found.partner[190]] == 190


def test_locks_against_the_direction_of_the_runs_are_named_and_not_called_another_line():
    rng = np.random.default_rng(16)
    true = build_line(rng, 60)
    a, b = observe(rng, true, missed=0, false=0), observe(rng, true, missed=0, false=0)
    ends = np.arange(2, 58, 4)
    locks = Locks(np.stack([ends, b.place.size - 1 - ends], axis=1), np.empty((0, 2), np.int64))
    with pytest.raises(InputError, match="lie against the direction of the runs") as caught:
        align(a.place, b.place, OPTIONS, locks=locks)
    assert not isinstance(caught.value, WrongLineError)


def test_a_lock_is_no_evidence_that_two_runs_are_one_line():
    rng = np.random.default_rng(17)
    true = build_line(rng, 100)
    a, b = observe(rng, true, missed=0, false=0), observe(rng, true, missed=0, false=0)
    right = np.flatnonzero(np.isin(a.weld, b.weld))[10:90:10]
    partner = np.searchsorted(b.weld, a.weld[right])
    locks = Locks(np.stack([right, partner], axis=1), np.empty((0, 2), np.int64))
    free, locked = align(a.place, b.place, OPTIONS), align(a.place, b.place, OPTIONS, locks=locks)
    assert (locked.partner[right] == partner).all()
    assert locked.evidence_nats == pytest.approx(free.evidence_nats, abs=1.0)


def test_matching_does_not_depend_on_where_chainage_begins():
    rng = np.random.default_rng(16)
    true = build_line(rng, 300)
    a, b = observe(rng, true), observe(rng, true)
    one = aligned(a, b)
    other = aligned(bare(a.place + 1e5, a.weld), bare(b.place - 4e4, b.weld))
    np.testing.assert_array_equal(one.partner, other.partner)


def test_swapping_the_two_runs_gives_the_same_pairs():
    rng = np.random.default_rng(17)
    true = build_line(rng, 500)
    later, _ = cut_outs(rng, true, 3)
    a, b = observe(rng, true), observe(rng, later)
    one, other = aligned(a, b).partner, aligned(b, a).partner
    there = np.flatnonzero(one >= 0)
    agree = other[one[there]] == there
    assert agree.mean() > 0.995
