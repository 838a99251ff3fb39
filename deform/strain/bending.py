"""A centreline with azimuth and pitch in, curvature and bending strain with sigma and tension side added out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from deform.geometry.curvature import curvature
from deform.geometry.resample import MAD_TO_SIGMA
from deform.options import StrainOptions
from deform.run import build

Floats = NDArray[Any]

_SIGMA_WINDOW_M = 200.0  # length over which the noise of curvature is taken as one


def add_bending(centreline: xr.Dataset, *, outside_diameter: float, options: StrainOptions | None = None) -> xr.Dataset:
    """Return the centreline with curvature and bending strain, each with its sigma.

    Parameters
    ----------
    centreline : group ``centreline`` with ``azimuth`` and ``pitch`` (degree); without them it is returned as it came.
    outside_diameter : of the pipe (metre).
    options : gauge length.

    Returns
    -------
    The centreline with ``curvature_horizontal`` (positive to the right), ``curvature_vertical`` (positive sag), with attribute
    ``gauge_length_m``, ``bending_strain_*`` = curvature × OD / 2, their root sum of squares, and the clock of the tension side;
    ``bending_strain_long_*`` over the long gauge beside them.

    References
    ----------
    Porter (1990), section 3.6.
    """
    options = options or StrainOptions()
    if "azimuth" not in centreline or "pitch" not in centreline:
        return centreline
    gauge = options.gauge_length_m
    horizontal, vertical = curvature(
        centreline["chainage"].values, centreline["azimuth"].values, centreline["pitch"].values, gauge
    )
    sigmas = [_sigma(centreline[name], gauge, k) for name, k in (("azimuth", horizontal), ("pitch", vertical))]
    values = _variables(horizontal, vertical, sigmas[0], sigmas[1], 0.5 * outside_diameter)
    out = build.add(centreline, "centreline", values)
    for name in values:
        out[name].attrs["gauge_length_m"] = gauge
    return _add_long(out, options.long_gauge_length_m, 0.5 * outside_diameter)


def _add_long(line: xr.Dataset, gauge: float, reach: float) -> xr.Dataset:
    """Add the bending strains over the long gauge."""
    s = line["chainage"].values
    if gauge >= s[-1] - s[0]:
        return line
    both = curvature(s, line["azimuth"].values, line["pitch"].values, gauge)
    values = {}
    for name, source, k in zip(("horizontal", "vertical"), ("azimuth", "pitch"), both, strict=True):
        values[f"bending_strain_long_{name}"] = reach * k
        values[f"bending_strain_long_{name}_sigma"] = reach * _sigma(line[source], gauge, k)
    out = build.add(line, "centreline", values)
    for name in values:
        out[name].attrs["gauge_length_m"] = gauge
    return out


def _sigma(direction: xr.DataArray, gauge: float, values: Floats) -> Floats:
    """Sigma of curvature from what navigation says about turns over the gauge, else from the curvature's own unrest."""
    if "turn_sigma_deg" in direction.attrs:
        sigma = np.full(values.shape, np.radians(stated_turn_sigma(direction, gauge)) / gauge)
        return np.hypot(sigma, _unseen_sigma(direction, gauge))
    step = float(np.diff(direction["chainage"].values[:2])[0])
    return noise_sigma(values, max(round(_SIGMA_WINDOW_M / step), 10), max(round(4.0 * gauge / step), 1))


def _unseen_sigma(direction: xr.DataArray, gauge: float) -> Floats:
    """Sigma of curvature where the gauge meets pipe that the inertial unit passed without recording it, zero elsewhere."""
    place, sigma = direction["chainage"].values, np.zeros(direction.size)
    ends = np.reshape(direction.attrs.get("unseen_m", []), (-1, 2))
    for (begin, end), turn in zip(ends, np.atleast_1d(direction.attrs.get("unseen_turn_deg", [])), strict=True):
        met = np.minimum(place + 0.5 * gauge, end) - np.maximum(place - 0.5 * gauge, begin)
        sigma = np.hypot(sigma, np.radians(turn) * np.sqrt(np.maximum(met, 0.0)) / gauge)
    return sigma


def stated_turn_sigma(direction: xr.DataArray, lag: float) -> float:
    """Return the sigma (degree) of a turn over a ``lag`` (metre) from the attributes of azimuth or pitch, NaN without them."""
    if "turn_sigma_deg" not in direction.attrs:
        return np.nan
    lags, sigma = (np.asarray(direction.attrs[name], float) for name in ("turn_lag_m", "turn_sigma_deg"))
    return float(np.exp(np.interp(np.log(lag), np.log(lags), np.log(np.maximum(sigma, 1e-12)))))


def standardised_percent(curvature_per_m: Floats | float, outside_diameter: float) -> Floats:
    """Return Porter's standardised curvature: pipe radius over bend radius, in percent; the bending strain in percent.

    References
    ----------
    Porter (1990), eq. 3-91 and 3-92.

    Examples
    --------
    >>> float(standardised_percent(1 / 100.0, 0.5))
    0.25
    """
    return 100.0 * 0.5 * outside_diameter * np.asarray(curvature_per_m, float)


def tension_clock(horizontal: ArrayLike, vertical: ArrayLike) -> Floats:
    """Return the clock of the tension side (degree, 0 = top, clockwise looking downstream) of two components of bending.

    Examples
    --------
    >>> float(tension_clock(0.0, 1.0)), float(tension_clock(1.0, 0.0))
    (180.0, 270.0)
    """
    return np.degrees(np.arctan2(-np.asarray(horizontal), -np.asarray(vertical))) % 360.0


def noise_sigma(values: Floats, window: int, lag: int) -> Floats:
    """Return the noise of a component along the line from its differences over a lag, robust against bends.

    Notes
    -----
    Half-overlapping blocks of ``window`` values: 1.4826 × median |k(s + lag) - k(s)| / sqrt(2), with a lag beyond the
    correlation of the noise. Real curvature adds to it, so that this is an upper limit; bends fill less than half of a window.
    """
    difference = np.abs(values[lag:] - values[:-lag]) / np.sqrt(2.0)
    starts = np.arange(0, max(difference.size - window // 2, 1), max(window // 2, 1))
    sigma = np.array([_middle(difference[a : a + window]) for a in starts])
    known = np.isfinite(sigma)
    if not known.any():
        return np.full(values.shape, np.nan)
    centre = starts + 0.5 * window + 0.5 * lag
    return np.interp(np.arange(values.size), centre[known], sigma[known])


def _middle(block: Floats) -> float:
    block = block[np.isfinite(block)]
    return MAD_TO_SIGMA * float(np.median(block)) if block.size else np.nan


def _variables(
    horizontal: Floats, vertical: Floats, horizontal_sigma: Floats, vertical_sigma: Floats, reach: float
) -> dict[str, Floats]:
    """All variables of bending from the two components; ``reach`` turns a curvature into a strain (metre)."""
    total = np.hypot(horizontal, vertical)
    with np.errstate(invalid="ignore", divide="ignore"):
        blend = np.where(total > 0, np.hypot(horizontal * horizontal_sigma, vertical * vertical_sigma) / total, 0.0)
    total_sigma = np.where(total > 0, blend, np.hypot(horizontal_sigma, vertical_sigma) / np.sqrt(2.0))
    return {
        "curvature_horizontal": horizontal,
        "curvature_vertical": vertical,
        "curvature_horizontal_sigma": horizontal_sigma,
        "curvature_vertical_sigma": vertical_sigma,
        "bending_strain_horizontal": reach * horizontal,
        "bending_strain_vertical": reach * vertical,
        "bending_strain_horizontal_sigma": reach * horizontal_sigma,
        "bending_strain_vertical_sigma": reach * vertical_sigma,
        "bending_strain": reach * total,
        "bending_strain_sigma": reach * total_sigma,
        "bending_strain_clock": tension_clock(horizontal, vertical),
    }
