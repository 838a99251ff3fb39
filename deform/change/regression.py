"""Values with sigma at a few dates in, rates with intervals and the shape of the change out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm, t

Floats = NDArray[Any]
_SCATTER_LEVEL = 0.05  # chance below which residuals are larger than their sigmas allow
_SHAPE_LEVEL = 0.01  # chance at which a shape is called though the rate is steady


@dataclass(frozen=True)
class Line:
    """Weighted straight line through values over years.

    Attributes
    ----------
    rate, rate_sigma : per year.
    low, high : interval of the rate.
    chi_square, freedom : weighted sum of squared residuals and its degrees of freedom.
    """

    rate: float
    rate_sigma: float
    low: float
    high: float
    chi_square: float
    freedom: int


def fit_line(year: Floats, value: Floats, sigma: Floats, probability: float) -> Line:
    """Return the weighted least-squares rate with an interval.

    Parameters
    ----------
    year, value, sigma : shape (n,), n ≥ 2; independent errors.
    probability : of the interval.

    Notes
    -----
    With f = n - 2 degrees of freedom left the sigma from the weights is widened by √(χ²/f) when the residuals exceed what the
    sigmas allow (five in a hundred), and the interval is then Student's; residuals smaller than stated never narrow it. Two
    epochs keep the stated sigma.

    Examples
    --------
    >>> line = fit_line(np.array([0.0, 2.0, 4.0]), np.array([0.0, 0.4, 0.8]), np.full(3, 0.02), 0.95)
    >>> round(line.rate, 3), round(line.rate_sigma, 5)
    (0.2, 0.00707)
    """
    weight = sigma**-2.0
    middle = np.sum(weight * year) / weight.sum()
    base = np.sum(weight * value) / weight.sum()
    spread = np.sum(weight * (year - middle) ** 2)
    rate = float(np.sum(weight * (year - middle) * (value - base)) / spread)
    residual = value - base - rate * (year - middle)
    chi_square, freedom = float(np.sum(weight * residual**2)), int(year.size - 2)
    formal = float(spread**-0.5)
    if freedom > 0 and chi2.sf(chi_square, freedom) < _SCATTER_LEVEL:
        rate_sigma = formal * np.sqrt(chi_square / freedom)
        reach = t.ppf(0.5 + probability / 2.0, freedom) * rate_sigma
    else:
        rate_sigma = formal
        reach = norm.ppf(0.5 + probability / 2.0) * rate_sigma
    return Line(rate, float(rate_sigma), float(rate - reach), float(rate + reach), chi_square, freedom)


def theil_sen(year: Floats, value: Floats) -> float:
    """Return the median of the slopes between all pairs of epochs (per year).

    References
    ----------
    Theil (1950); Sen (1968).
    """
    i, j = np.triu_indices(year.size, 1)
    apart = year[j] != year[i]
    return float(np.median((value[j] - value[i])[apart] / (year[j] - year[i])[apart])) if apart.any() else float("nan")


def mann_kendall(value: Floats) -> tuple[float, float]:
    """Return the standardised Mann–Kendall statistic of a series in the order of time and its two-sided probability.

    Notes
    -----
    S = Σ sign(x_j - x_i); var S = [n(n-1)(2n+5) - Σ t(t-1)(2t+5)] / 18 over groups of t equal values; Z = (S ∓ 1)/√var.

    References
    ----------
    Mann (1945); Kendall (1975).
    """
    n = value.size
    i, j = np.triu_indices(n, 1)
    s = float(np.sign(value[j] - value[i]).sum())
    _, ties = np.unique(value, return_counts=True)
    variance = (n * (n - 1) * (2 * n + 5) - np.sum(ties * (ties - 1) * (2 * ties + 5))) / 18.0
    if variance <= 0 or s == 0:
        return 0.0, 1.0
    z = (s - np.sign(s)) / np.sqrt(variance)
    return float(z), float(2.0 * norm.sf(abs(z)))


def shape_of(year: Floats, value: Floats, sigma: Floats) -> list[str]:
    """Return what the epochs show beside a steady rate, in words; empty when a steady rate explains them.

    Notes
    -----
    χ² of the steady rate against that of one step between two epochs (as many parameters, so it must fit itself and the line must
    not), and against a parabola (one parameter more, χ² difference with one degree of freedom; four epochs or more).
    """
    steady = _misfit(np.column_stack([np.ones_like(year), year - year.mean()]), value, sigma)
    freedom = year.size - 2
    words = []
    if chi2.sf(steady, freedom) < _SHAPE_LEVEL:
        step, at = min(
            (_misfit(np.column_stack([np.ones_like(year), year > year[k]]), value, sigma), k) for k in range(year.size - 1)
        )
        if chi2.sf(step, freedom) > _SHAPE_LEVEL:
            words.append(f"a single step between {_year(year[at])} and {_year(year[at + 1])} fits, a steady rate does not")
        elif year.size >= 4:
            words += _acceleration(year, value, sigma, steady)
        if not words:
            words.append("the epochs scatter more than their sigma about a steady rate")
    elif year.size >= 4:
        words += _acceleration(year, value, sigma, steady)
    return words


def _acceleration(year: Floats, value: Floats, sigma: Floats, steady: float) -> list[str]:
    x = year - year.mean()
    design = np.column_stack([np.ones_like(x), x, x**2]) / sigma[:, None]
    solution, *_ = np.linalg.lstsq(design, value / sigma, rcond=None)
    bent = float(np.sum((design @ solution - value / sigma) ** 2))
    if chi2.sf(steady - bent, 1) > _SHAPE_LEVEL:
        return []
    faster = solution[2] * (1.0 if value[-1] >= value[0] else -1.0) > 0
    return ["the rate is growing" if faster else "the rate is falling"]


def _misfit(design: Floats, value: Floats, sigma: Floats) -> float:
    weighted = design / sigma[:, None]
    solution, *_ = np.linalg.lstsq(weighted, value / sigma, rcond=None)
    return float(np.sum((weighted @ solution - value / sigma) ** 2))


def _year(year: float) -> int:
    return int(np.floor(1970.0 + year))
