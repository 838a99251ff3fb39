"""Differences of position of two runs in, their low-frequency drift estimated on pipe that did not move out, with covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels
from deform.geometry.resample import spread_about_zero

Floats = NDArray[Any]
_LAGS = (90.0, 130.0, 190.0, 280.0, 400.0)  # m, where the second difference shows the drift
_NOISE_LAG = 10.0  # m, where it shows the short noise
_LEAST_WALK = 1e-16  # rad²/m: a drift of 0.6 mm over 1 km; keeps the covariance regular


@dataclass(frozen=True)
class DriftModel:
    """Statistics of the difference of two smoothed trajectories.

    Attributes
    ----------
    walk : (3,) intensities of the random walks of relative heading and pitch (rad²/m) and of relative scale (1/m).
    noise : (3,) variances of the short noise of lateral, up and axial, taken as white at `step` (m²).
    step : spacing of the nodes for which ``noise`` holds (m).
    """

    walk: Floats
    noise: Floats
    step: float


@dataclass(frozen=True)
class Datum:
    """Drift between two runs on the scan axis.

    Attributes
    ----------
    drift : (n, 3) east, north, up (m); the run minus the reference where nothing moved.
    variance : (n, 3) of the drift at each place (m²).
    model : the statistics it was estimated with.
    score : minus twice the log likelihood of the datum pipe.
    """

    drift: Floats
    variance: Floats
    model: DriftModel
    score: float


def second_difference(values: Floats, lag: int) -> Floats:
    """Return v(s - h) - 2 v(s) + v(s + h) along the first axis, without the ends."""
    return values[: -2 * lag] - 2.0 * values[lag:-lag] + values[2 * lag :]


def drift_model(difference: Floats, tangent: Floats, right: Floats, lift: Floats, step: float, usable: Floats) -> DriftModel:
    """Estimate the statistics of a drift from second differences, robustly and in closed form.

    Parameters
    ----------
    difference : (n, 3) run minus reference, east, north, up (m); NaN where unknown.
    tangent, right, lift : (n, 3) axes of the reference pipe.
    step : spacing of the axis (m).
    usable : (n,) false where the pipe is known to have moved.

    Notes
    -----
    A relative heading that walks at random with intensity q makes a lateral drift whose second difference over the lag h has
    the variance 2 q h³ / 3; white noise r adds 6 r. The median of the squared second difference (as 1.4826 MAD) leaves out
    what moved. The short noise is read at 10 m, the drift at the lags from 90 to 400 m that the line can show; of these the
    largest counts, since markers and odometer hold a drift back over long lags, and the sigma of a bridge over a zone needs
    the short ones.
    """
    value = np.where(usable[:, None], difference, np.nan)
    axes = (right / np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-9), lift, tangent)
    near = max(round(_NOISE_LAG / step), 1)
    walk, noise = np.full(3, _LEAST_WALK), np.full(3, 1e-6)
    lags = [h for h in _LAGS if 2.5 * h < step * len(value)]
    for m, axis in enumerate(axes):
        noise[m] = max(_spread(value, axis, near) ** 2 / 6.0, 1e-8)
        found = [(_spread(value, axis, round(h / step)) ** 2 - 6.0 * noise[m]) / (2.0 * h**3 / 3.0) for h in lags]
        found = [q for q in found if np.isfinite(q)]
        if found:
            walk[m] = max(max(found), _LEAST_WALK)
    return DriftModel(walk=walk, noise=noise, step=_NOISE_LAG)


def _spread(value: Floats, axis: Floats, lag: int) -> float:
    if 2 * lag + 8 > len(value):
        return float("nan")
    second = np.einsum("ij,ij->i", second_difference(value, lag), axis[lag:-lag])
    second = second[np.isfinite(second)]
    return spread_about_zero(second) if second.size > 4 else float("nan")


def fit_drift(
    place: Floats,
    difference: Floats,
    axes: tuple[Floats, Floats, Floats],
    stable: Floats,
    model: DriftModel,
) -> Datum:
    """Estimate the drift on stable pipe and carry it over the rest.

    Parameters
    ----------
    place : (n,) scan axis (m), rising.
    difference : (n, 3) run minus reference, east, north, up (m); NaN where unknown.
    axes : tangent, right and lift of the reference pipe, each (n, 3).
    stable : (n,) true where the pipe serves as datum.
    model : statistics of the drift.

    Returns
    -------
    Datum on the scan axis.

    Notes
    -----
    State: drift of the place and relative heading, pitch and scale; d(drift)/ds = heading * right + pitch * lift + scale *
    tangent, the last three random walks. Kalman filter and Rauch–Tung–Striebel smoother over nodes that are means over about
    ten metres, with a diffuse beginning: the datum is carried by the stable pipe alone (an S-transformation onto it), so that
    the markers of the two runs have no part in the difference beyond the drift, and pipe that moved has none in the datum.

    References
    ----------
    Baarda (1973), S-transformations and criterion matrices; Rauch, Tung, Striebel (1965); Wahba (1990) for the equality of the
    smoothed integrated random walk with the cubic smoothing spline.
    """
    size = max(round(model.step / (place[1] - place[0])), 1)
    count = -(-len(place) // size)
    known = stable & np.isfinite(difference).all(axis=1)
    columns = np.column_stack([np.where(known[:, None], difference, np.nan), *axes, place])
    node = np.empty((count, columns.shape[1]))
    _kernels.block_means(columns, size, node)
    at = _kernels_place(place, size, count)
    used = np.isfinite(node[:, 0])
    tangent, right, lift = (np.ascontiguousarray(np.nan_to_num(node[:, k : k + 3])) for k in (3, 6, 9))
    noise = _east_north_up(model.noise, tangent, right)
    state, cover = np.zeros((count, 6)), np.zeros((count, 6, 6))
    ahead, ahead_cover = np.zeros((count, 6)), np.zeros((count, 6, 6))
    value = np.ascontiguousarray(np.nan_to_num(node[:, :3]))
    score = _kernels.drift_filter(at, tangent, right, lift, value, noise, used, model.walk, state, cover, ahead, ahead_cover)
    _kernels.drift_smooth(at, tangent, right, lift, state, cover, ahead, ahead_cover)
    drift = np.column_stack([np.interp(place, at, state[:, m]) for m in range(3)])
    variance = np.column_stack([np.interp(place, at, cover[:, m, m]) for m in range(3)])
    return Datum(drift=drift, variance=variance, model=model, score=float(score))


def _kernels_place(place: Floats, size: int, count: int) -> Floats:
    """Middle of each block of the axis."""
    ends = np.minimum(np.arange(1, count + 1) * size, len(place)) - 1
    return 0.5 * (place[np.arange(count) * size] + place[ends])


def _east_north_up(noise: Floats, tangent: Floats, right: Floats) -> Floats:
    """Variances of east, north, up of noise that is known along the pipe's own axes."""
    level = np.hypot(tangent[:, 0], tangent[:, 1])
    sine2 = np.where(level > 1e-6, tangent[:, 0] ** 2 / np.maximum(level**2, 1e-12), 0.5)
    lateral, up, axial = noise
    east = axial * sine2 + lateral * (1.0 - sine2)
    north = axial * (1.0 - sine2) + lateral * sine2
    return np.ascontiguousarray(np.column_stack([east, north, np.full(len(level), up)]))
