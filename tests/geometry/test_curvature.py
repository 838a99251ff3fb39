"""Curvature of circles, waves and noise against closed forms and a naive twin."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.geometry.curvature import curvature
from tests.naive.curvature import curvature as naive_curvature

S = np.round(np.arange(0.0, 60.05, 0.1), 10)


def test_straight_pipe_has_zero_curvature():
    horizontal, vertical = curvature(S, np.full(S.size, 12.0), np.full(S.size, -3.0), 2.0)
    inside = np.isfinite(horizontal)
    assert inside.sum() == S.size - 20
    assert np.abs(horizontal[inside]).max() == 0.0
    assert np.abs(vertical[inside]).max() == 0.0


@pytest.mark.parametrize("gauge", [0.1, 1.0, 1.5, 2.0, 3.14])
def test_level_circle_to_the_right_has_its_inverse_radius_across_north(gauge):
    azimuth = (350.0 + np.degrees(S / 100.0)) % 360.0
    horizontal, vertical = curvature(S, azimuth, np.zeros(S.size), gauge)
    inside = np.isfinite(horizontal)
    assert inside[30:-30].all()
    np.testing.assert_allclose(horizontal[inside], 0.01, atol=1e-12)
    np.testing.assert_array_equal(vertical[inside], 0.0)


def test_sag_is_positive():
    _, vertical = curvature(S, np.zeros(S.size), np.degrees((S - 30.0) / 200.0), 2.0)
    np.testing.assert_allclose(vertical[10:-10], 1.0 / 200.0, atol=1e-12)


def test_climbing_helix_has_the_horizontal_curvature_of_its_turn_times_the_cosine_of_its_pitch():
    pitch = 20.0
    horizontal, _ = curvature(S, np.degrees(0.02 * S), np.full(S.size, pitch), 2.0)
    np.testing.assert_allclose(horizontal[10:-10], 0.02 * np.cos(np.radians(pitch)), rtol=1e-12)


def test_curvature_of_a_wave_is_its_mean_over_the_gauge():
    k = 2.0 * np.pi / 25.0
    azimuth = np.degrees(0.02 * np.sin(k * S))
    horizontal, _ = curvature(S, azimuth, np.zeros(S.size), 2.0)
    expected = 0.02 * (np.sin(k * (S + 1.0)) - np.sin(k * (S - 1.0))) / 2.0
    np.testing.assert_allclose(horizontal[10:-10], expected[10:-10], atol=1e-12)


def test_looking_from_the_other_end_turns_neither_a_bend_up_nor_its_size():
    rng = np.random.default_rng(3)
    azimuth, pitch = np.cumsum(rng.normal(0, 0.1, S.size)), np.cumsum(rng.normal(0, 0.1, S.size))
    horizontal, vertical = curvature(S, azimuth, pitch, 2.0)
    back_horizontal, back_vertical = curvature(S, azimuth[::-1] + 180.0, -pitch[::-1], 2.0)
    np.testing.assert_allclose(back_horizontal[::-1], -horizontal, atol=1e-12)
    np.testing.assert_allclose(back_vertical[::-1], vertical, atol=1e-12)


@pytest.mark.parametrize("gauge", [0.1, 0.3, 1.97, 2.0, 5.0])
def test_one_pass_equals_the_naive_twin(gauge):
    rng = np.random.default_rng(4)
    azimuth, pitch = np.cumsum(rng.normal(0, 5.0, S.size)) % 360.0, np.cumsum(rng.normal(0, 1.0, S.size))
    for ours, plain in zip(curvature(S, azimuth, pitch, gauge), naive_curvature(S, azimuth, pitch, gauge), strict=True):
        np.testing.assert_allclose(ours, plain, atol=1e-11, equal_nan=True)


def test_axis_with_unequal_steps_is_refused():
    with pytest.raises(InputError, match="equal steps"):
        curvature([0.0, 0.1, 0.25], [0.0] * 3, [0.0] * 3, 0.1)


def test_gauge_below_one_step_is_refused():
    with pytest.raises(InputError, match="at least one step"):
        curvature(S, S, S, 0.01)


def test_missing_direction_does_not_reach_beyond_its_gauge():
    pitch = np.zeros(S.size)
    pitch[300] = np.nan
    _, vertical = curvature(S, np.zeros(S.size), pitch, 2.0)
    assert np.isnan(vertical[[290, 310]]).all()
    assert np.isfinite(vertical[[280, 320]]).all()
