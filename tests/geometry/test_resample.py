"""Resampling against its naive twins and the integrals it must keep."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deform.errors import InputError
from deform.geometry import resample
from tests.naive import resample as naive

SEED = st.integers(0, 2**31)


def _line(seed, size=40):
    rng = np.random.default_rng(seed)
    return rng, np.cumsum(rng.uniform(0.01, 1.0, size)), rng.normal(size=size)


@given(SEED)
def test_interpolation_is_the_naive_one(seed):
    rng, axis, values = _line(seed)
    x = rng.uniform(axis[0] - 1, axis[-1] + 1, 200)
    assert np.allclose(resample.interpolate(x, axis, values), naive.interpolate(x, axis, values), equal_nan=True, atol=1e-12)
    assert np.allclose(
        resample.interpolate(x, axis[::-1], values[::-1]), naive.interpolate(x, axis, values), equal_nan=True, atol=1e-12
    )


def test_nothing_is_extrapolated_and_the_ends_are_kept():
    assert np.isnan(resample.interpolate([-0.01, 2.01, np.nan], [0, 1, 2], [1, 2, 3])).all()
    assert resample.interpolate([0, 1, 2], [0, 1, 2], [1, 2, 3]).tolist() == [1, 2, 3]


def test_a_gap_stays_a_gap_and_reaches_no_further_than_its_neighbours():
    out = resample.interpolate([0.5, 1.0, 1.5, 2.5, 3.0], [0, 1, 2, 3], [1, 2, np.nan, 4])
    assert np.isnan(out).tolist() == [False, False, True, True, False]


def test_columns_are_interpolated_together():
    out = resample.interpolate([[0.5], [1.5]], [0, 1, 2], np.array([[0, 10], [1, 20], [2, 30]]))
    assert out.tolist() == [[[0.5, 15]], [[1.5, 25]]]


def test_angles_go_the_short_way_round():
    assert resample.interpolate_angle([0.25, 0.75], [0, 1], [350, 10]) == pytest.approx([355, 5])
    assert resample.interpolate_angle(0.5, [0, 1], [-3.1, 3.1], period=2 * np.pi) == pytest.approx(np.pi, abs=1e-12)


@given(SEED, st.floats(0.05, 5.0))
def test_box_average_is_the_naive_one(seed, length):
    rng, axis, values = _line(seed)
    centre = rng.uniform(axis[0] - 1, axis[-1] + 1, 100)
    wanted = naive.box_average(centre, axis, values, length)
    assert np.allclose(resample.box_average(centre, axis, values, length), wanted, equal_nan=True, atol=1e-10)


@given(SEED)
def test_average_over_the_whole_line_is_its_integral(seed):
    _, axis, values = _line(seed)
    length = axis[-1] - axis[0]
    mean = resample.box_average([0.5 * (axis[0] + axis[-1])], axis, values, length)
    assert mean[0] * length == pytest.approx(np.trapezoid(values, axis), abs=1e-10)


def test_average_of_a_straight_line_is_its_middle():
    axis = np.linspace(0, 10, 1001)
    assert resample.box_average([2.0, 5.0], axis, 3 * axis, 2.5) == pytest.approx([6, 15])


def test_a_box_that_meets_a_gap_is_empty_and_its_neighbours_are_not():
    axis, values = np.arange(11.0), np.ones(11)
    values[5] = np.nan
    out = resample.box_average(np.arange(11.0), axis, values, 2.0)
    assert np.flatnonzero(np.isnan(out)).tolist() == [0, 4, 5, 6, 10]


def test_a_turning_axis_is_refused_with_its_place():
    with pytest.raises(InputError, match="from 2 to 1 at 2"):
        resample.interpolate([0.5], [0, 2, 1, 3], [0, 0, 0, 0])
    with pytest.raises(InputError, match="wanted"):
        resample.interpolate([0.5], [0, 1], [0, 0, 0])
    with pytest.raises(InputError, match="positive"):
        resample.box_average([0.5], [0, 1], [0, 0], 0.0)


def test_grid_holds_the_multiples_of_its_step():
    assert resample.regular_grid(0.0, 0.3, 0.1).tolist() == [0.0, 0.1, 0.2, 0.3]
    assert resample.regular_grid(-0.25, 0.25, 0.25).tolist() == [-0.25, 0.0, 0.25]
    assert resample.regular_grid(0.0, 1.0, 0.3) == pytest.approx([0, 0.3, 0.6, 0.9])
    assert resample.regular_grid(0.01, 0.09, 0.1).size == 0


def test_robust_sigma_is_that_of_the_majority():
    values = np.random.default_rng(2).normal(0, 3, 20_000)
    values[:1000] = 1e6
    assert resample.robust_sigma(values) == pytest.approx(3, rel=0.1)
    assert np.isnan(resample.robust_sigma([np.nan]))
    assert resample.robust_sigma(np.array([[1.0, 2, 3], [4, 4, 4]]), axis=1) == pytest.approx([1.4826, 0], abs=1e-4)
