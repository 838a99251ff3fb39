"""Dead reckoning between marks: the path meets them, and one that lies off is left out."""

from __future__ import annotations

import numpy as np

from deform.nav.marks import correct_between_marks


def winding_path(n=2000):
    s = np.arange(n)
    azimuth, pitch = 0.5 + 0.4 * np.sin(s / 150.0), 0.05 * np.sin(s / 90.0)
    return np.column_stack([np.sin(azimuth) * np.cos(pitch), np.cos(azimuth) * np.cos(pitch), np.sin(pitch)])


def measured(steps, azimuth=0.002, pitch=-0.001, scale=0.003):
    level = np.hypot(steps[:, 0], steps[:, 1])
    a, p = np.arctan2(steps[:, 0], steps[:, 1]) + azimuth, np.arctan2(steps[:, 2], level) + pitch
    return np.column_stack([np.sin(a) * np.cos(p), np.cos(a) * np.cos(p), np.sin(p)]) * (1.0 + scale)


def through(epoch, shift=None):
    steps = winding_path()
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    marks = path[epoch].copy()
    if shift is not None:
        marks[shift[0]] += shift[1]
    return path, correct_between_marks(measured(steps), np.array(epoch), marks, np.full((len(epoch), 3), 0.3))


def test_turn_pitch_and_scale_between_marks_are_found_and_the_path_meets_them():
    epoch = [0, 700, 1400, 2000]
    path, found = through(epoch)
    np.testing.assert_allclose(found.turns, np.tile([-0.002, 0.001, 1 / 1.003 - 1], (3, 1)), atol=2e-6)
    assert np.abs(found.path - path).max() < 0.01
    assert found.used.all()


def test_a_mark_twenty_metres_off_is_left_out_and_its_neighbours_stay():
    path, found = through([0, 500, 1000, 1500, 2000], (2, [20.0, 0.0, 0.0]))
    assert found.used.tolist() == [True, True, False, True, True]
    assert np.abs(found.path - path).max() < 0.05
    assert abs(found.misfit[2, 0] + 20.0) < 0.5


def test_without_marks_the_path_is_the_reckoned_one():
    steps = winding_path()
    found = correct_between_marks(steps, np.empty(0, int), np.empty((0, 3)), np.empty((0, 3)))
    np.testing.assert_allclose(found.path[-1], steps.sum(axis=0))
