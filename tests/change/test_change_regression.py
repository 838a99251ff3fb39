"""Rates against statsmodels, scipy and pymannkendall, and what is said of their shape."""

from __future__ import annotations

import numpy as np
import pymannkendall
import pytest
import statsmodels.api as sm
from scipy.stats import chi2, theilslopes

from deform.change.regression import fit_line, mann_kendall, shape_of, theil_sen
from deform.change.trend import forecast_limit


@pytest.mark.parametrize("seed", range(5))
def test_weighted_rate_equals_statsmodels(seed):
    rng = np.random.default_rng(seed)
    year, sigma = np.sort(rng.uniform(0, 12, 7)), rng.uniform(0.02, 0.1, 7)
    value = 0.05 * year + 3.0 * sigma * rng.standard_normal(7)
    line = fit_line(year, value, sigma, 0.95)
    oracle = sm.WLS(value, sm.add_constant(year), weights=sigma**-2.0).fit()
    assert line.rate == pytest.approx(oracle.params[1], rel=1e-10)
    if chi2.sf(line.chi_square, line.freedom) < 0.05:
        assert line.rate_sigma == pytest.approx(oracle.bse[1], rel=1e-9)
        assert (line.low, line.high) == pytest.approx(tuple(oracle.conf_int()[1]), rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_robust_rate_equals_scipy_and_pymannkendall(seed):
    rng = np.random.default_rng(seed)
    year = np.arange(9.0)
    value = np.round(0.1 * year + rng.normal(0, 0.3, 9), 1)
    assert theil_sen(year, value) == pytest.approx(theilslopes(value, year).slope, abs=1e-12)
    oracle = pymannkendall.original_test(value)
    z, p = mann_kendall(value)
    assert z == pytest.approx(oracle.z, abs=1e-9)
    assert p == pytest.approx(oracle.p, abs=1e-9)
    assert theil_sen(year, value) == pytest.approx(oracle.slope, abs=1e-12)


def test_two_epochs_keep_the_stated_sigma():
    line = fit_line(np.array([0.0, 4.0]), np.array([0.0, 0.4]), np.array([0.03, 0.04]), 0.95)
    assert line.rate == pytest.approx(0.1)
    assert line.rate_sigma == pytest.approx(0.05 / 4.0)
    assert line.high - line.rate == pytest.approx(1.959964 * line.rate_sigma, rel=1e-6)


def test_interval_of_the_rate_holds_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(11)
    year, sigma = np.array([0.0, 2.0, 4.0, 7.0]), np.array([0.02, 0.03, 0.02, 0.04])
    inside = 0
    for _ in range(800):
        line = fit_line(year, 0.02 * year + sigma * rng.standard_normal(4), sigma, 0.9)
        inside += line.low <= 0.02 <= line.high
    assert 0.87 <= inside / 800 <= 0.99


def test_step_steady_rate_and_acceleration_are_told_apart():
    year, sigma = np.arange(0.0, 12.0, 2.0), np.full(6, 0.02)
    assert shape_of(year, 0.1 * year, sigma) == []
    assert "single step between 1976 and 1978" in shape_of(year, np.where(year > 7, 0.4, 0.0), sigma)[0]
    assert shape_of(year, 0.01 * year**2, sigma) == ["the rate is growing"]
    assert shape_of(year, 0.4 * np.sqrt(year), sigma) == ["the rate is falling"]


def test_forecast_counts_growth_away_from_zero_whatever_the_sign():
    year = np.array([0.0, 2.0, 4.0])
    days = 4.0 * 365.2425
    for sign in (1.0, -1.0):
        line = fit_line(year, sign * np.array([0.0, 0.2, 0.4]), np.full(3, 0.01), 0.95)
        forecast = forecast_limit(line, sign * 0.4, 0.01, 0.6, days, 20.0)
        assert forecast.day == pytest.approx(6.0 * 365.2425, rel=1e-3)
        assert forecast.probability > 0.99
    still = fit_line(year, np.zeros(3), np.full(3, 0.01), 0.95)
    assert np.isnan(forecast_limit(still, 0.0, 0.01, 0.6, days, 20.0).day)


def test_limit_that_is_passed_is_certain():
    line = fit_line(np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.full(2, 0.1), 0.95)
    assert forecast_limit(line, 2.0, 0.1, 1.0, 365.0, 10.0).probability == 1.0
