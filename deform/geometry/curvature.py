"""Azimuth and pitch on regular chainage in, curvature over a gauge length out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from deform.errors import InputError

Floats = NDArray[Any]


def curvature(chainage: ArrayLike, azimuth: ArrayLike, pitch: ArrayLike, gauge_length: float) -> tuple[Floats, Floats]:
    """Return horizontal and vertical curvature (1/m) averaged over a gauge length about each place.

    Parameters
    ----------
    chainage : regular and rising, shape (n,) (metre).
    azimuth : clockwise from north, shape (n,) (degree); it may wrap.
    pitch : positive where the pipe climbs, shape (n,) (degree).
    gauge_length : length over which the turn is taken (metre).

    Returns
    -------
    horizontal : positive to the right; shape (n,), NaN where the gauge leaves the axis or meets a NaN.
    vertical : positive for a sag; shape (n,).

    Raises
    ------
    InputError
        When the chainage is not regular and rising or the gauge length is below one step.

    Notes
    -----
    Horizontal is the integral of cos(pitch) d azimuth over the gauge, vertical that of d pitch, each divided by the gauge
    length. Porter prints the reciprocal names: his R in 3-89 and 3-90 is a curvature.

    References
    ----------
    Porter (1990), eq. 3-89 to 3-92.

    Examples
    --------
    >>> s = np.arange(0.0, 5.01, 0.1)
    >>> horizontal, vertical = curvature(s, 90.0 + np.degrees(s / 100.0), np.zeros_like(s), 2.0)
    >>> round(float(horizontal[25]), 12), round(float(vertical[25]), 12)
    (0.01, 0.0)
    """
    chainage = np.asarray(chainage, float)
    azimuth, pitch = np.ascontiguousarray(azimuth, float), np.ascontiguousarray(pitch, float)
    step = regular_step(chainage)
    if not gauge_length >= step:
        raise InputError(f"gauge length {gauge_length} m: must be at least one step of the chainage, {step:.6g} m")
    if azimuth.shape != chainage.shape or pitch.shape != chainage.shape:
        raise InputError(f"azimuth {azimuth.shape} and pitch {pitch.shape} do not fit the chainage {chainage.shape}")
    horizontal, vertical = np.empty(chainage.size), np.empty(chainage.size)
    _fill_curvature(azimuth, pitch, float(gauge_length) / step, step, horizontal, vertical)
    return horizontal, vertical


def regular_step(chainage: Floats) -> float:
    """Return the step of a regular rising axis.

    Raises
    ------
    InputError
        When it is not regular to a thousandth of its step.
    """
    if chainage.ndim != 1 or chainage.size < 2:
        raise InputError(f"chainage of shape {chainage.shape}: wanted two places at least")
    step = float(chainage[-1] - chainage[0]) / (chainage.size - 1)
    worst = float(_worst_step(np.ascontiguousarray(chainage, float), step))
    if not (step > 0 and worst < 1e-3 * step):
        raise InputError(f"chainage: must rise in equal steps; the mean step is {step:.6g} m, the worst departs by {worst:.3g} m")
    return step


@njit(cache=True, error_model="numpy")
def _worst_step(chainage, step):
    """Largest departure of a step from the mean one; infinite where a place is not finite."""
    worst = 0.0
    for i in range(1, chainage.shape[0]):
        apart = abs(chainage[i] - chainage[i - 1] - step)
        if not apart <= worst:
            worst = apart if np.isfinite(apart) else np.inf
    return worst


@njit(cache=True, error_model="numpy")
def _fill_curvature(azimuth, pitch, gauge_steps, step, horizontal, vertical):
    """One pass: the turn up to each place is summed, and half a gauge later the difference over the gauge is taken."""
    n = azimuth.shape[0]
    half = 0.5 * gauge_steps
    whole = int(np.floor(half))
    rest = half - whole
    reach = whole + (1 if rest > 1e-9 else 0)
    size = 2 * reach + 1
    ring = np.zeros(size)
    turned = 0.0
    to_rad = np.pi / 180.0
    scale = 1.0 / (gauge_steps * step)
    slot = 0
    before_cosine = np.cos(pitch[0] * to_rad)
    for j in range(n):
        if j > 0:
            turn = azimuth[j] - azimuth[j - 1]
            turn -= 360.0 * np.floor(turn / 360.0 + 0.5)
            cosine = np.cos(pitch[j] * to_rad)
            turned += 0.5 * (cosine + before_cosine) * turn * to_rad
            before_cosine = cosine
        ring[slot] = turned
        i = j - reach
        if i >= reach:
            oldest = slot + 1 if slot + 1 < size else 0
            newest = ring[slot]
            first = ring[oldest]
            up_new, up_old = pitch[j], pitch[j - 2 * reach]
            if rest > 1e-9:
                inner = slot - 1 if slot > 0 else size - 1
                second = oldest + 1 if oldest + 1 < size else 0
                newest = rest * newest + (1.0 - rest) * ring[inner]
                first = rest * first + (1.0 - rest) * ring[second]
                up_new = rest * up_new + (1.0 - rest) * pitch[j - 1]
                up_old = rest * up_old + (1.0 - rest) * pitch[j - 2 * reach + 1]
            horizontal[i] = (newest - first) * scale
            vertical[i] = (up_new - up_old) * to_rad * scale
        slot = slot + 1 if slot + 1 < size else 0
    for i in range(min(reach, n)):
        horizontal[i] = vertical[i] = np.nan
        horizontal[n - 1 - i] = vertical[n - 1 - i] = np.nan
