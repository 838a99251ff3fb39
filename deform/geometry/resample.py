"""Values on a monotone axis in, values on another axis, on a regular grid, or averaged over a gauge length out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deform.errors import InputError
from deform.geometry import _kernels_resample as kernels

Floats = NDArray[Any]

MAD_TO_SIGMA = 1.4826022185056018  # 1 / Φ⁻¹(3/4): median absolute deviation of a normal variable to its sigma


def interpolate(x: ArrayLike, axis: ArrayLike, values: ArrayLike) -> Floats:
    """Return values between the points of an axis; NaN outside it, nothing is extrapolated.

    Parameters
    ----------
    x : where values are wanted, any order and shape.
    axis : shape (m,), rising or falling.
    values : shape (m,) or (m, k); a NaN reaches up to its neighbours.

    Returns
    -------
    array of shape ``x.shape`` or ``x.shape + (k,)``.

    Raises
    ------
    InputError
        When the axis turns, has equal neighbours, or does not fit the values.

    Examples
    --------
    >>> interpolate([0.5, 3.0], [0.0, 1.0, 2.0], [10.0, 20.0, 30.0])
    array([15., nan])
    """
    return _interpolate(x, axis, values, 0.0)


def interpolate_angle(x: ArrayLike, axis: ArrayLike, angles: ArrayLike, period: float = 360.0) -> Floats:
    """Return angles between the points of an axis, the short way round, in [0, period); NaN outside.

    Examples
    --------
    >>> interpolate_angle([0.5], [0.0, 1.0], [350.0, 20.0])
    array([5.])
    """
    return _interpolate(x, axis, angles, period) % period


def regular_grid(start: float, stop: float, step: float) -> Floats:
    """Return the multiples of a step from start to stop, both included when they are multiples.

    Examples
    --------
    >>> regular_grid(0.05, 0.45, 0.1)
    array([0.1, 0.2, 0.3, 0.4])
    """
    if not (step > 0 and np.isfinite([start, stop]).all()):
        raise InputError(f"grid from {start} to {stop} by {step}: ends must be finite and the step positive")
    first = int(np.ceil(start / step - 1e-6))
    last = int(np.floor(stop / step + 1e-6))
    per_unit = round(1.0 / step)
    indices = np.arange(first, last + 1)
    return indices / per_unit if per_unit and abs(step * per_unit - 1.0) < 1e-12 else indices * step


def box_average(centre: ArrayLike, axis: ArrayLike, values: ArrayLike, length: float) -> Floats:
    """Return the mean of the broken line through the values over a gauge length about each centre.

    Parameters
    ----------
    centre : where the mean is wanted, shape (n,).
    axis : shape (m,), rising or falling.
    values : shape (m,) or (m, k).
    length : length of the box, in the unit of the axis.

    Returns
    -------
    array of shape (n,) or (n, k): NaN where the box leaves the axis or meets a NaN.

    Notes
    -----
    Mean = (F(x + L/2) - F(x - L/2)) / L with F the exact integral of the broken line: one pass, whatever the length.
    """
    if not length > 0:
        raise InputError(f"gauge length {length}: must be positive")
    axis, columns, single = _prepared(axis, values)
    integral = np.empty_like(columns)
    kernels.cumulative(axis, columns, integral)
    gaps = np.cumsum(~np.isfinite(columns), axis=0)
    centre = np.atleast_1d(np.asarray(centre, float))
    out = np.empty((centre.size, columns.shape[1]))
    kernels.box_average(centre, float(length), axis, columns, integral, gaps, out)
    return out[:, 0] if single else out


def robust_sigma(values: ArrayLike, axis: int | None = None) -> Any:
    """Return 1.4826 times the median absolute deviation from the median: sigma of the honest majority; NaN are left out.

    Examples
    --------
    >>> float(robust_sigma([1.0, 2.0, 3.0, 1000.0, float("nan")]).round(4))
    1.4826
    """
    values = np.asarray(values, float)
    if not np.isfinite(values).any():
        return np.nan
    middle = np.nanmedian(values, axis=axis, keepdims=True)
    return MAD_TO_SIGMA * np.nanmedian(np.abs(values - middle), axis=axis)


def spread_about_zero(values: ArrayLike) -> float:
    """Return 1.4826 times the median absolute value: sigma of the honest majority of what has the mean zero; NaN are left out.

    Examples
    --------
    >>> round(spread_about_zero([-1.0, 1.0, -2.0, 1000.0, float("nan")]), 4)
    2.2239
    """
    size = np.abs(np.asarray(values, float))
    size = size[np.isfinite(size)]
    return float(MAD_TO_SIGMA * np.median(size)) if size.size else float("nan")


def _interpolate(x: ArrayLike, axis: ArrayLike, values: ArrayLike, period: float) -> Floats:
    axis, columns, single = _prepared(axis, values)
    x = np.asarray(x, float)
    out = np.empty((x.size, columns.shape[1]))
    kernels.interpolate(np.ascontiguousarray(x).ravel(), axis, columns, float(period), out)
    return out[:, 0].reshape(x.shape) if single else out.reshape(*x.shape, columns.shape[1])


def _prepared(axis: ArrayLike, values: ArrayLike) -> tuple[Floats, Floats, bool]:
    """Rising axis (m,), values (m, k) beside it, and whether the values came as one column."""
    axis, values = np.asarray(axis, float), np.asarray(values, float)
    single = values.ndim == 1
    if axis.ndim != 1 or axis.size < 2 or values.shape[:1] != axis.shape or values.ndim > 2:
        raise InputError(f"axis of shape {axis.shape} and values of shape {values.shape}: wanted (m,) and (m,) or (m, k), m > 1")
    columns = values[:, None] if single else values
    if axis[0] > axis[-1]:
        axis, columns = axis[::-1], columns[::-1]
    steps = np.diff(axis)
    if not (steps > 0).all():
        i = int(np.flatnonzero(~(steps > 0))[0])
        raise InputError(f"axis goes from {axis[i]:.9g} to {axis[i + 1]:.9g} at {i + 1}; it must rise or fall throughout")
    return np.ascontiguousarray(axis), np.ascontiguousarray(columns), single
