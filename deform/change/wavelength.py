"""Differences of position and curvature in, the amplitude of a movement of each wavelength at each place out, from both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from deform.change import _kernels
from deform.change.datum import DriftModel
from deform.change.noise_floor import spread
from deform.change.significance import caution_factor, few_looks_factor
from deform.geometry.resample import robust_sigma

Floats = NDArray[Any]
COMPONENTS = ("lateral", "up")
_FLANK = 1.0  # of a wavelength: pipe on either side that serves as the local datum
_TAPS = 32  # nodes over one wavelength, at most
_LOOKS = 3.0  # independent amplitudes per wavelength of pipe
_LEAST_BENT = 20  # places in bends that tell how far the two runs are shifted against each other along the pipe
_LEAST_WEIGHT = 0.02  # of that on straight pipe, below which curvature says nothing of a wave
_WIDEST = 0.5  # of the line: longer waves are no longer told from the drift of the runs


@dataclass(frozen=True)
class Waves:
    """Amplitudes of one wavelength on its own coarse axis.

    Attributes
    ----------
    length : wavelength L of w = A/2 (1 + cos 2π(s - c)/L), |s - c| < L/2 (m).
    place : (m,) centres c (m).
    amplitude : (m, 2) best estimate of A, lateral and up (m).
    sigma : (m, 2) its standard deviation.
    position, curvature : (m, 2) the parts from position and from curvature alone, each with `_sigma`.
    typical : (2,) sigma over quiet pipe (m). caution : (2,) factor on the threshold of each component: its noise is known from
        few places, and its tails are wider than normal.
    """

    length: float
    place: Floats
    amplitude: Floats
    sigma: Floats
    position: Floats
    position_sigma: Floats
    curvature: Floats
    curvature_sigma: Floats
    typical: Floats
    caution: Floats

    @property
    def statistic(self) -> Floats:
        """Twice the log likelihood ratio of a movement against none, lateral and up together: chi-square with 2 degrees in the
        tails, where it is held against a threshold.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nansum(np.where(self.sigma > 0, self.amplitude / (self.caution * self.sigma), np.nan) ** 2, axis=1)


def wavelengths(shortest: float, longest: float, line_length: float) -> Floats:
    """Return wavelengths (m) in steps of √2 that a line of this length can show."""
    top = min(longest, _WIDEST * line_length / (1.0 + 2.0 * _FLANK))
    count = int(np.floor(2.0 * np.log2(max(top / shortest, 1.0)))) + 1
    return shortest * 2.0 ** (0.5 * np.arange(count))


def position_weights(length: float, step: float, walk: float, noise: float) -> Floats:
    """Return the weights that turn positions about a place into the amplitude of a movement there.

    Parameters
    ----------
    length : wavelength (m).
    step : spacing of the positions (m).
    walk : intensity of the random walk of the relative heading (rad²/m).
    noise : variance of one position (m²).

    Notes
    -----
    Generalised least squares over 1.5 wavelengths on either side: A = w'M d / w'M w with M = K⁻¹ - K⁻¹X(X'K⁻¹X)⁻¹X'K⁻¹, X =
    (1, s), and K the covariance of an integrated random walk and white noise. The pipe on either side is the datum; constant
    and linear differences of the two runs have no part in the result. Only
    the ratio of walk and noise matters; it is rounded to a power of two, which costs nothing (the variance of the result is taken
    from the data) and lets pairs and rounds share the weights.
    """
    return _weights(float(length), float(step), round(np.log2(max(walk, 1e-30) / max(noise, 1e-30))))


@lru_cache(maxsize=512)
def _weights(length: float, step: float, ratio: int) -> Floats:
    walk, noise = 2.0**ratio, 1.0
    half = max(round((0.5 + _FLANK) * length / step), 2)
    x = np.arange(-half, half + 1) * step
    t = x - x[0]
    low, high = np.minimum.outer(t, t), np.maximum.outer(t, t)
    cover = walk * (low**2 * high / 2.0 - low**3 / 6.0) + noise * np.eye(x.size)
    shape = np.where(np.abs(x) < length / 2, 0.5 * (1.0 + np.cos(2.0 * np.pi * x / length)), 0.0)
    trend = np.column_stack([np.ones_like(x), x / x[-1]])
    solved = np.linalg.solve(cover, np.column_stack([shape, trend]))
    ks, kx = solved[:, 0], solved[:, 1:]
    weights = ks - kx @ np.linalg.solve(trend.T @ kx, trend.T @ ks)
    return weights / (weights @ shape)


def curvature_shape(length: float, step: float, gauge_length: float) -> Floats:
    """Return the curvature (1/m) of a movement of amplitude 1 m, averaged over the gauge length, on a regular grid."""
    half = max(round(0.5 * length / step), 2)
    x = np.arange(-half, half + 1) * step
    inside = np.where(np.abs(x) <= length / 2, 1.0, 0.0)
    loss = np.sinc(gauge_length / length) if np.isfinite(gauge_length) else 1.0
    return -0.5 * (2.0 * np.pi / length) ** 2 * np.cos(2.0 * np.pi * x / length) * inside * loss


@dataclass(frozen=True)
class Signals:
    """What the search for movement looks at, on the scan axis.

    Attributes
    ----------
    place : (n,) regular scan axis (m).
    difference : (n, 3) run minus reference, east, north, up (m); NaN where unknown.
    right, lift : (n, 3) axes of the reference pipe.
    curvature : (n, 2) change of horizontal and vertical curvature (1/m), NaN where unknown.
    curvature_sigma : (n, 2) its standard deviation.
    gauge_length : of the curvature (m).
    """

    place: Floats
    difference: Floats
    right: Floats
    lift: Floats
    curvature: Floats
    curvature_sigma: Floats
    gauge_length: float

    @property
    def step(self) -> float:
        """Spacing of the scan axis (m)."""
        return float(self.place[1] - self.place[0])


def scan(signals: Signals, model: DriftModel, lengths: Floats, quiet: Floats, *, reach: float, tails: bool) -> list[Waves]:
    """Return the amplitude of a movement of every wavelength at every place.

    Parameters
    ----------
    signals : differences on the scan axis.
    model : statistics of the drift between the runs.
    lengths : wavelengths (m).
    quiet : (n,) true where the pipe may serve for the noise floor.
    reach : how far out the threshold lies (sigma).
    tails : raise the threshold where the tails of the noise are wider than normal. While movements are still in the quiet pipe
        they are its tails, and would hide themselves: leave it out then.

    Notes
    -----
    Position and curvature are combined by their variances. No variance is that of a model: each is the robust spread (1.4826
    MAD) of the amplitudes themselves over the quiet pipe of this pair, and that of the combination is taken from the combination:
    position and curvature come from one inertial unit, and share errors.
    """
    return [_wave(signals, model, float(length), quiet, reach, tails) for length in lengths]


def _wave(signals: Signals, model: DriftModel, length: float, quiet: Floats, reach: float, tails: bool) -> Waves:
    size = max(int(length / _TAPS / signals.step), 1)
    step = size * signals.step
    count = len(signals.place) // size
    columns = np.column_stack([signals.difference, signals.right, signals.lift, signals.place, quiet])
    node = np.empty((count, columns.shape[1]))
    _kernels.block_means(columns, size, node)
    at, still = node[:, 9], node[:, 10] > 0.99
    position, shifted = _from_position(node, model, length, step)
    curvature, weight = _from_curvature(signals, length, size, count)
    free = still & ~_near(~still, round(0.5 * length / step))
    with np.errstate(invalid="ignore", divide="ignore"):
        formal = 1.0 / np.sqrt(weight)
        position_sigma = _position_sigma(position / _rougher(formal, free), shifted, free, np.sqrt(model.noise[2]))
        position_sigma = position_sigma * _rougher(formal, free)
        curvature_sigma = formal * [_spread(curvature[:, m] / formal[:, m], free) for m in range(2)]
        known_p, known_c = (
            np.isfinite(a) & np.isfinite(s) for a, s in ((position, position_sigma), (curvature, curvature_sigma))
        )
        wp, wc = np.where(known_p, position_sigma**-2.0, 0.0), np.where(known_c, curvature_sigma**-2.0, 0.0)
        total = wp + wc
        amplitude = (np.where(known_p, position, 0.0) * wp + np.where(known_c, curvature, 0.0) * wc) / total
        sigma = 1.0 / np.sqrt(total)
        sigma = sigma * [_spread(amplitude[:, m] / sigma[:, m], free) for m in range(2)]
        looks = _LOOKS * free.sum() * step / length
        z = (amplitude / sigma)[free]
        few = few_looks_factor(looks, reach)
        caution = np.array([caution_factor(z[:, m], looks, reach) if tails else few for m in range(2)])
    typical = np.array([_middle(sigma[free, m]) for m in range(2)])
    return Waves(length, at, amplitude, sigma, position, position_sigma, curvature, curvature_sigma, typical, caution)


def _middle(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _rougher(formal: Floats, free: Floats) -> Floats:
    """By how much the curvature is worse known at each place than usual (m, 2), 1 at least: in bends and at bad speeds. The path
    is that curvature summed twice, and over one wave is worse there by as much. 1 everywhere in runs without curvature.
    """
    usual = np.array([_middle(column[free]) for column in formal.T])
    worst = _LEAST_WEIGHT**-0.5
    return np.where(np.isfinite(usual), np.clip(np.nan_to_num(formal / usual, nan=worst), 1.0, worst), 1.0)


def _position_sigma(position: Floats, shifted: Floats, free: Floats, axial: float) -> Floats:
    """Sigma (m, 2) of amplitudes from positions: their scatter on straight pipe, and what a shift along the pipe makes in bends.

    ``shifted`` (m, 2) is the amplitude that a shift of one metre looks like, ``axial`` (m) the least sigma of such a shift. In a
    bend a metre along the pipe of one run is a metre across the other: what lies a little wrong along the pipe looks moved there.
    """
    out = np.full(position.shape, np.nan)
    for m in range(2):
        straight = _spread(position[:, m], free & (np.abs(shifted[:, m]) * axial < 0.3 * _spread(position[:, m], free)))
        bent = free & np.isfinite(position[:, m]) & (np.abs(shifted[:, m]) * axial > 0.5 * straight)
        shift = axial
        if bent.sum() >= _LEAST_BENT:
            ratio = position[bent, m] / shifted[bent, m]
            seen = spread(ratio) ** 2 - float(np.median((straight / shifted[bent, m]) ** 2))
            shift = max(axial, np.sqrt(max(seen, 0.0)))
        out[:, m] = np.hypot(straight, shift * shifted[:, m])
    return out


def _from_position(node: Floats, model: DriftModel, length: float, step: float) -> tuple[Floats, Floats]:
    """Amplitudes (m, 2) from positions, NaN within 1.5 wavelengths of unknown pipe, and those that a shift of both runs against
    each other of one metre along the pipe would show.
    """
    out, shifted = np.full((len(node), 2), np.nan), np.full((len(node), 2), np.nan)
    value = node[:, :3]
    if not np.isfinite(value).any():
        return out, shifted
    unknown = np.asarray(~np.isfinite(value).all(axis=1))
    right = node[:, 3:6] / np.maximum(np.linalg.norm(node[:, 3:6], axis=1, keepdims=True), 1e-9)
    filled = np.column_stack([np.nan_to_num(value), np.nan_to_num(np.cross(node[:, 6:9], right))])
    found = []
    for walk, noise in ((model.walk[0], model.noise[0]), (model.walk[1], model.noise[1])):
        weights = position_weights(length, step, walk, noise * model.step / step)
        if weights.size > len(node):
            return out, shifted
        found.append(np.column_stack([fftconvolve(filled[:, m], weights[::-1], mode="same") for m in range(6)]))
    half = weights.size // 2
    unknown[:1] = unknown[-1:] = True
    gone = _near(unknown, half)
    for into, columns in ((out, slice(0, 3)), (shifted, slice(3, 6))):
        into[:, 0] = np.einsum("ij,ij->i", found[0][:, columns], right)
        into[:, 1] = np.einsum("ij,ij->i", found[1][:, columns], node[:, 6:9])
        into[gone] = np.nan
    return out, shifted


def _from_curvature(signals: Signals, length: float, size: int, count: int) -> tuple[Floats, Floats]:
    """Amplitudes (m, 2) from curvature and their formal weights (1/m²)."""
    amplitude, weight = np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    if not np.isfinite(signals.curvature).any():
        return amplitude, weight
    shape = curvature_shape(length, signals.step, signals.gauge_length)
    if shape.size > len(signals.place):
        return amplitude, weight
    centre = np.minimum(np.arange(count) * size + size // 2, len(signals.place) - 1)
    for m in range(2):
        known = np.isfinite(signals.curvature[:, m]) & (signals.curvature_sigma[:, m] > 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            each = np.where(known, signals.curvature_sigma[:, m] ** -2.0, 0.0)
        top = fftconvolve(np.where(known, signals.curvature[:, m], 0.0) * each, shape[::-1], mode="same")[centre]
        bottom = np.maximum(fftconvolve(each, shape**2, mode="same")[centre], 0.0)
        full = np.sum(shape**2) * np.median(each[known]) if known.any() else np.inf
        with np.errstate(invalid="ignore", divide="ignore"):
            weight[:, m] = np.where(bottom > _LEAST_WEIGHT * full, bottom, np.nan)
            amplitude[:, m] = top / weight[:, m]
    return amplitude, weight


def _spread(values: Floats, free: Floats) -> float:
    """Robust spread about zero over quiet pipe."""
    chosen = values[free & np.isfinite(values)]
    if chosen.size < 4:
        chosen = values[np.isfinite(values)]
    if chosen.size < 4:
        return float("nan")
    return max(float(robust_sigma(np.concatenate([chosen, -chosen]))), 1e-12)


def _near(flag: Floats, reach: int) -> Floats:
    """True within ``reach`` places of a flag."""
    if reach < 1 or not flag.any():
        return flag.copy()
    summed = np.concatenate([[0], np.cumsum(flag)])
    index = np.arange(flag.size)
    return summed[np.minimum(index + reach + 1, flag.size)] > summed[np.maximum(index - reach, 0)]
