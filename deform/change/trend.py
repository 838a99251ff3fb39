"""A comparison of several runs in, rates per year with intervals, what their shape is, forecasts of limits and a ranking out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import norm

from deform.change.regression import Line, fit_line, shape_of, theil_sen
from deform.change.series import Series, dent_series, zone_series
from deform.options import TrendOptions
from deform.run import build

Floats = NDArray[Any]
_YEAR = 365.2425


@dataclass(frozen=True)
class Forecast:
    """When a limit is reached at a rate: the day since 1970 (NaN when never), and the probability within the horizon."""

    day: float
    probability: float


def trends(comparison: Any, options: TrendOptions | None = None) -> pd.DataFrame:
    """Return the table ``trends``: one row per zone and quantity and per dent that changed.

    Parameters
    ----------
    comparison : `change.compare.Comparison`.
    options : interval, horizon and limits.

    Notes
    -----
    Weighted least squares with the reference epoch's own noise as common offset, beside the Theil–Sen slope; three epochs or
    more give a rate with an interval from their scatter (but not below the stated sigma), two give a difference over the time
    between. A step or an acceleration is called when it explains the epochs significantly better than a steady rate. A
    forecast holds the rate as normal with its sigma and gives the probability that the limit is passed within the horizon.
    Rank: by the probability, then by the part of the limit that is used up, then by the size of the rate against its sigma.
    """
    options = options or TrendOptions()
    rows = []
    for series in [*zone_series(comparison), *dent_series(comparison)]:
        row = _row(series, options)
        if row is not None:
            rows.append(row)
    order = sorted(range(len(rows)), key=lambda i: rows[i].pop("_urgency"), reverse=True)
    for rank, i in enumerate(order):
        rows[i]["rank"] = rank + 1
    return build.table("trends", pd.DataFrame([rows[i] for i in order]))


def _row(series: Series, options: TrendOptions) -> dict | None:
    year = series.day / _YEAR
    good = np.isfinite(year) & np.isfinite(series.value) & np.isfinite(series.sigma)
    if good.sum() < 2 or np.ptp(year[good]) <= 0:
        return None
    year, value, sigma = year[good], series.value[good], series.sigma[good]
    line = fit_line(year, value, sigma, options.interval_probability)
    limit_name, limit = _limit(series, options)
    last_day = float(series.day[good][-1])
    words = _remarks(year, value, sigma, line)
    steady = not any("step" in word for word in words)
    forecast = forecast_limit(line, value[-1], sigma[-1], limit, last_day, options.horizon_years)
    used = abs(value[-1]) / limit if np.isfinite(limit) and limit > 0 else 0.0
    if not steady:
        words.append("no forecast: what came at once gives no rate")
        forecast = Forecast(float("nan") if used < 1.0 else last_day, 0.0 if used < 1.0 else 1.0)
    if used >= 1.0:
        words.append("limit is passed already")
    return {
        "subject": series.subject,
        "kind": series.kind,
        "n_epochs": int(good.sum()),
        "rate_per_year": line.rate,
        "rate_sigma_per_year": line.rate_sigma,
        "rate_low_per_year": line.low,
        "rate_high_per_year": line.high,
        "interval_probability": options.interval_probability,
        "last_value": float(value[-1]),
        "limit_name": limit_name,
        "limit_value": limit,
        "forecast_date": _date(forecast.day),
        "forecast_probability": forecast.probability,
        "remark": "; ".join(words),
        "theil_sen_per_year": theil_sen(year, value),
        "limit_used": used,
        "_urgency": (round(forecast.probability, 3), used, abs(line.rate) / max(line.rate_sigma, 1e-12)),
    }


def forecast_limit(line: Line, last: float, last_sigma: float, limit: float, last_day: float, horizon_years: float) -> Forecast:
    """Return when the size of a quantity reaches a limit at a steady rate.

    Parameters
    ----------
    line : fitted line; its rate is taken as normal.
    last, last_sigma : value at the last epoch and its sigma.
    limit : on the size of the value.
    last_day : of the last epoch (days since 1970).
    horizon_years : how far the probability looks ahead.

    Notes
    -----
    Growth away from zero counts: the value is taken with the sign of the last one. P = Φ((last + rate h - limit) / σ) with
    σ² = σ_last² + (h σ_rate)²; the day is that of the rate itself, none when it does not lead there within two horizons.
    """
    if not np.isfinite(limit):
        return Forecast(float("nan"), 0.0)
    sign = -1.0 if last < 0 else 1.0
    size, rate = sign * last, sign * line.rate
    if size >= limit:
        return Forecast(last_day, 1.0)
    ahead = size + rate * horizon_years
    spread = np.hypot(last_sigma, horizon_years * line.rate_sigma)
    probability = float(norm.sf((limit - ahead) / max(spread, 1e-12)))
    years = (limit - size) / rate if rate > 0 else np.inf
    return Forecast(last_day + years * _YEAR if years <= 2.0 * horizon_years else float("nan"), probability)


def _limit(series: Series, options: TrendOptions) -> tuple[str, float]:
    limits = {
        "displacement": ("displacement", options.displacement_limit_m),
        "bending strain": ("change of bending strain", options.bending_strain_change_limit),
        "dent depth": ("dent depth", options.dent_depth_limit_od * series.outside_diameter),
    }
    name, value = limits[series.kind]
    return f"{name} ({options.limit_basis})", float(value)


def _remarks(year: Floats, value: Floats, sigma: Floats, line: Line) -> list[str]:
    words = []
    if year.size == 2:
        words.append("two epochs give a difference, no proof of a steady rate")
    else:
        words += shape_of(year, value, sigma)
    if abs(line.rate) < 2.0 * line.rate_sigma:
        words.append("rate is not significant")
    return words


def _date(day: float) -> str:
    return str(np.datetime64(int(day), "D")) if np.isfinite(day) else ""
