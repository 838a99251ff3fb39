"""Gaps of the inertial unit: closed forms of the turn, chord and bow over one, and its variances on a grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from deform.geometry.rotation import rotation_vector_to_matrix
from deform.nav import _kernels as k
from deform.nav._kernels_arc import arc_stretch
from deform.nav._kernels_model import bend_gap
from deform.nav._kernels_state import STATE_COLUMNS
from deform.nav.gaps import BOW_TURN, Unseen, remarks, turned_as
from deform.nav.profile import Profile
from deform.nav.reverse import reversed_epochs
from deform.nav.strapdown import Counts, Epochs, preintegrate
from deform.strain.bending import add_bending

RATE, GAP_S, SPEED = 100.0, 5.0, 1.1


def tilted_run(pitch, roll, heading=0.0):
    """Counts of a unit that moves straight on, is turned inside a gap of five seconds, and moves on; the true turn."""
    one = np.arange(1, 301) / RATE
    time = np.concatenate([one, one + one[-1] + GAP_S])
    turn = (
        rotation_vector_to_matrix([0.0, 0.0, heading])
        @ rotation_vector_to_matrix([pitch, 0.0, 0.0])
        @ rotation_vector_to_matrix([0.0, roll, 0.0])
    )
    up = np.array([0.0, 0.0, 9.81])
    force = np.concatenate([np.tile(up, (300, 1)), np.tile(turn.T @ up, (300, 1))])
    table = np.zeros((15, 3))
    table[9:12] = table[12:15] = np.eye(3)
    accel = np.round(force / RATE / 1e-8).astype(np.int32)
    return Counts(time, np.zeros((600, 3), np.int32), accel, 1e-9, 1e-8, table, 1.0 / RATE), turn


def travel():
    even = np.arange(0.0, 12.0, 0.1)
    return Profile.through(even, SPEED * even)


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.7), (-0.3, 0.5)])
def test_pitch_and_roll_over_a_gap_follow_gravity(pitch, roll):
    counts, turn = tilted_run(pitch, roll)
    row = preintegrate(counts, travel(), np.array([0, 599])).table[0]
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(row[:9].reshape(3, 3) @ turn.T @ up, up, atol=2e-6)
    assert row[k.GAP] == pytest.approx(GAP_S + 1.0 / RATE)
    if not pitch * roll:
        np.testing.assert_allclose(row[:9].reshape(3, 3), turn, atol=2e-6)


def test_chord_of_a_regular_arc_against_its_end_tangents():
    for turn in (1e-9, 0.1, 0.8, 1.5):
        chord, tangents = math.sin(0.5 * turn) / (0.5 * turn), math.cos(0.5 * turn)
        assert arc_stretch(math.cos(turn)) == pytest.approx(chord / tangents, rel=1e-9)


def epochs_with_turn(heading):
    counts, _ = tilted_run(0.1, 0.4)
    epochs = preintegrate(counts, travel(), np.array([0, 299, 300, 599]))
    states = np.zeros((4, STATE_COLUMNS))
    behind = rotation_vector_to_matrix([0.0, 0.0, heading]) @ epochs.table[1, :9].reshape(3, 3)
    states[:, 6:15] = [np.eye(3).ravel(), np.eye(3).ravel(), behind.ravel(), behind.ravel()]
    return epochs, states


def test_turn_found_over_a_gap_keeps_what_was_expected_beside_it():
    epochs, states = epochs_with_turn(-0.8)
    twice = turned_as(turned_as(epochs, states, np.zeros((4, 9))), states, np.zeros((4, 9)))
    row, before = twice.table[1], epochs.table[1]
    np.testing.assert_allclose(row[:9], states[2, 6:15], atol=1e-12)
    expected = rotation_vector_to_matrix(row[k.GAP_EXPECTED : k.GAP_EXPECTED + 3]) @ row[:9].reshape(3, 3)
    np.testing.assert_allclose(expected, before[:9].reshape(3, 3), atol=1e-12)
    np.testing.assert_array_equal(np.delete(twice.table, 1, axis=0), np.delete(epochs.table, 1, axis=0))
    way = row[k.GAP_TRAVEL]
    assert way == pytest.approx(SPEED * (GAP_S + 1.0 / RATE), rel=1e-6)
    path = row[k.ATTITUDE_TRAVEL : k.ATTITUDE_TRAVEL + 9].reshape(3, 3)[:, 1]
    arc = np.arccos(row[4])
    assert np.linalg.norm(path) == pytest.approx(way * math.sin(arc / 2) / (arc / 2), rel=1e-6)
    assert row[k.GAP_BOW] == pytest.approx(BOW_TURN * way + arc**2, rel=1e-9)
    back = reversed_epochs(reversed_epochs(twice)).table[1]
    np.testing.assert_allclose(back[k.GAP_TRAVEL :], row[k.GAP_TRAVEL :], atol=1e-12)


def test_a_bend_in_a_gap_is_told_and_a_straight_pipe_is_not():
    epochs, states = epochs_with_turn(-0.8)
    assert "turns there by 47 degree within 5.5 m" in remarks(turned_as(epochs, states, np.zeros((4, 9))))[0]
    assert remarks(epochs) == []


def test_path_over_a_gap_bends_with_the_turn_as_finite_differences():
    row, before = np.zeros(k.COLUMNS), rotation_vector_to_matrix([0.1, 0.2, -0.4])
    after = rotation_vector_to_matrix([0.0, 0.3, 0.9])
    row[k.GAP_TRAVEL], row[k.GAP_TURN] = 6.0, 0.09
    row[k.GAP_EXPECTED : k.GAP_EXPECTED + 3] = 1e-6, -2e-6, 3e-6
    P, dx = np.zeros((9, 9)), np.zeros(9)
    bend_gap(row, before, after, P, dx)

    def path(turn):
        return 3.0 * (before[:, 1] + rotation_vector_to_matrix(turn) @ after[:, 1])

    J = np.stack([(path(h) - path(-h)) / 2e-6 for h in 1e-6 * np.eye(3)], axis=1)
    np.testing.assert_allclose(P[:3, 6:], 0.09 * J, atol=1e-8)
    np.testing.assert_allclose(P[:3, :3], 0.09 * J @ J.T, atol=1e-8)
    np.testing.assert_allclose(dx[6:], before @ row[k.GAP_EXPECTED : k.GAP_EXPECTED + 3], rtol=1e-12)
    np.testing.assert_allclose(dx[:3], J @ dx[6:], atol=1e-12)


def test_direction_and_place_in_a_gap_are_as_open_as_a_kink_anywhere_in_it():
    rng = np.random.default_rng(5)
    time = np.concatenate([np.arange(0.0, 50.0, 0.05), np.arange(60.0, 100.0, 0.05)])
    turn = np.where(time > 55.0, 0.6, 0.0)
    found = Unseen.of(time, SPEED * time, turn, np.zeros(time.size))
    assert found.behind.tolist() == [1000]
    begin, end = found.ends[0]
    grid = np.linspace(begin, end, 51)
    direction, place = found.variances(np.concatenate([[begin - 1.0], grid[1:-1], [end + 1.0]]))
    assert direction[0] == direction[-1] == place[0] == 0.0
    kink = rng.uniform(begin, end, 20_000)[:, None]
    spread = np.where(grid[1:-1] > kink, 0.6, 0.0).std(axis=0)
    np.testing.assert_allclose(np.sqrt(direction[1:-1]), np.hypot(spread, np.sqrt(direction[1:-1] - spread**2)), rtol=1e-9)
    assert np.sqrt(direction[25]) == pytest.approx(math.hypot(spread[24], math.sqrt(BOW_TURN * (end - begin)) / 2), rel=0.02)
    assert np.sqrt(place[25]) == pytest.approx(math.sqrt(found.turn[0] * (end - begin)) * (end - begin) / 8, rel=0.01)


def test_curvature_says_that_it_does_not_know_the_pipe_in_a_gap():
    s = np.arange(0.0, 60.0, 0.1)
    line = xr.Dataset({n: ("chainage", np.zeros(s.size)) for n in ("azimuth", "pitch")}, {"chainage": s})
    told = {"turn_lag_m": [1.0, 4.0], "turn_sigma_deg": [1e-3, 1e-3], "unseen_m": [30.0, 36.0], "unseen_turn_deg": [2.0]}
    for name in ("azimuth", "pitch"):
        line[name].attrs |= told
    out = add_bending(line, outside_diameter=0.5)
    sigma, gauge = out["curvature_vertical_sigma"].values, out["curvature_vertical"].attrs["gauge_length_m"]
    usual = math.radians(1e-3) / gauge
    assert sigma[s < 30.0 - gauge].max() == pytest.approx(usual, rel=1e-6)
    assert sigma[330] == pytest.approx(math.hypot(usual, math.radians(2.0) / math.sqrt(gauge)), rel=1e-6)


def test_epochs_without_a_gap_stay_as_they_are():
    table = np.zeros((3, k.COLUMNS))
    epochs = Epochs(np.arange(4), np.arange(4.0), table)
    assert turned_as(epochs, np.zeros((4, STATE_COLUMNS)), np.zeros((4, 9))).table is not table
    np.testing.assert_array_equal(turned_as(epochs, np.zeros((4, STATE_COLUMNS)), np.zeros((4, 9))).table, table)
