"""Statistics and the number of looks in, the threshold, its factor of caution and the confidence out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm
from scipy.stats import t as student

Floats = NDArray[Any]
_WIDEST_TAIL = 2.0
_TAILS = (0.9, 0.97, 0.99, 0.997, 0.999)
_LEAST_BEYOND = 8.0  # independent values beyond a quantile that may widen a sigma


def limit_of(false_alarms_per_100_km: float, looks_per_100_km: float, freedom: int) -> float:
    """Return the chi-square that noise exceeds so often: the chance of one look is the rate over their number (Bonferroni)."""
    return float(chi2.isf(false_alarms_per_100_km / looks_per_100_km, freedom))


def confidence_of(statistic: float, looks: float, freedom: int) -> float:
    """Return the chance that noise did not exceed a chi-square in any of so many looks, 0 at least (Bonferroni)."""
    return float(max(1.0 - looks * chi2.sf(statistic, freedom), 0.0))


def caution_factor(z: Floats, looks: float, reach: float) -> float:
    """Return by how much a threshold must be raised: its sigma is known from few looks, and the noise has tails.

    Parameters
    ----------
    z : values of quiet pipe over a sigma that holds for their bulk. looks : how many of them are independent.
    reach : how far out the threshold lies (sigma).
    """
    return few_looks_factor(looks, reach) * tail_factor(z, looks, reach)


def tail_factor(z: Floats, independent: float, reach: float) -> float:
    """Return by how much a variable is wider, so far out in its tails, than a normal one of its own bulk; 1 at least.

    Parameters
    ----------
    z : values over a sigma that holds for their bulk.
    independent : how many of them are independent.
    reach : how far out a threshold lies (sigma).

    Notes
    -----
    Ratios of the quantiles of |z| to those of a normal variable, from 0.9 on as long as eight independent values lie beyond; a
    straight line through them over the normal quantile, led on to the threshold. A threshold lies where no line of usual length
    has seen its noise: the tails must be led on, and never below what was seen.
    """
    size = np.abs(z[np.isfinite(z)])
    levels = np.array([p for p in _TAILS if independent * (1.0 - p) >= _LEAST_BEYOND])
    if not levels.size or size.size < 20:
        return 1.0
    normal = norm.ppf(0.5 + 0.5 * levels)
    ratio = np.quantile(size, levels) / normal
    if levels.size < 3:
        return float(max(1.0, ratio.max()))
    slope = max(float(np.polyfit(normal, ratio, 1)[0]), 0.0)
    return float(np.clip(max(ratio.max(), ratio[-1] + slope * (reach - normal[-1])), 1.0, _WIDEST_TAIL))


def few_looks_factor(independent: float, reach: float) -> float:
    """Return by how much a threshold must be raised when the sigma comes from few independent values.

    Notes
    -----
    The ratio of Student's to the normal quantile at the chance of a normal variable beyond ``reach``; a median of absolute values
    is worth 0.37 of its values as degrees of freedom.
    """
    freedom = max(0.37 * independent, 3.0)
    return float(student.isf(norm.sf(reach), freedom) / reach)
