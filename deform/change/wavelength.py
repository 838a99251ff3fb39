"""Differences of position and curvature in, the amplitude of a movement of each wavelength at each place out, from both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels
from deform.change.datum import DriftModel
from deform.change.noise_floor import spread
from deform.change.signals import Nodes, Signals
from deform.change.significance import caution_factor, few_looks_factor
from deform.geometry.resample import spread_about_zero

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
    free : (m,) true where the wave lies in quiet pipe. looks : independent amplitudes there.
    typical : (2,) sigma over quiet pipe (m). caution : (2,) factor on the threshold of each component: its noise is known from
        few places, and its tails may be wider than normal (`with_tails`).
    """

    length: float
    place: Floats
    amplitude: Floats
    sigma: Floats
    position: Floats
    position_sigma: Floats
    curvature: Floats
    curvature_sigma: Floats
    free: Floats
    looks: float
    typical: Floats
    caution: Floats

    @property
    def statistic(self) -> Floats:
        """Twice the log likelihood ratio of a movement against none, lateral and up together: chi-square with 2 degrees in the
        tails, where it is held against a threshold.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nansum(np.where(self.sigma > 0, self.amplitude / (self.caution * self.sigma), np.nan) ** 2, axis=1)

    @property
    def noise(self) -> WaveNoise:
        """What the amplitudes tell of the noise, without them."""
        parts = [np.array([_middle(part[:, m]) for m in range(2)]) for part in (self.position_sigma, self.curvature_sigma)]
        return WaveNoise(self.length, self.typical, self.caution, *parts)


@dataclass(frozen=True)
class WaveNoise:
    """Noise of the amplitudes of one wavelength.

    Attributes
    ----------
    length : wavelength (m). typical, caution : (2,) as in `Waves`. position, curvature : (2,) median sigma of each alone (m).
    """

    length: float
    typical: Floats
    caution: Floats
    position: Floats
    curvature: Floats


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


def scan(signals: Signals, model: DriftModel, lengths: Floats, quiet: Floats, *, reach: float) -> list[Waves]:
    """Return the amplitude of a movement of every wavelength at every place.

    Parameters
    ----------
    signals : differences on the scan axis.
    model : statistics of the drift between the runs.
    lengths : wavelengths (m).
    quiet : (n,) true where the pipe may serve for the noise floor.
    reach : how far out the threshold lies (sigma).

    Notes
    -----
    Position and curvature are combined by their variances. No variance is that of a model: each is the robust spread (1.4826
    MAD) of the amplitudes themselves over the quiet pipe of this pair, and that of the combination is taken from the combination:
    position and curvature come from one inertial unit, and share errors.
    """
    nodes: dict[int, Nodes] = {}
    found = []
    for length in map(float, lengths):
        size = max(int(length / _TAPS / signals.step), 1)
        if size not in nodes:
            nodes[size] = Nodes.of(signals, quiet, size)
        found.append(_wave(signals, nodes[size], model, length, reach))
    return found


def with_tails(waves: list[Waves], reach: float) -> list[Waves]:
    """Return waves with the threshold raised where the tails of the noise are wider than normal.

    While movements are still in the quiet pipe they are its tails, and would hide themselves: not to be called then.
    """
    raised = []
    for wave in waves:
        with np.errstate(invalid="ignore", divide="ignore"):
            z = (wave.amplitude / wave.sigma)[wave.free]
        raised.append(replace(wave, caution=np.array([caution_factor(z[:, m], wave.looks, reach) for m in range(2)])))
    return raised


def _wave(signals: Signals, node: Nodes, model: DriftModel, length: float, reach: float) -> Waves:
    position, shifted = _from_position(node, model, length)
    curvature, weight = _from_curvature(signals, length, node.size, node.place.size)
    free = node.still & ~_near(~node.still, round(0.5 * length / node.step))
    with np.errstate(invalid="ignore", divide="ignore"):
        formal = 1.0 / np.sqrt(weight)
        rougher = _rougher(formal, free)
        position_sigma = _position_sigma(position / rougher, shifted, free, np.sqrt(model.noise[2])) * rougher
        curvature_sigma = formal * [_spread(curvature[:, m] / formal[:, m], free) for m in range(2)]
        known_p, known_c = (
            np.isfinite(a) & np.isfinite(s) for a, s in ((position, position_sigma), (curvature, curvature_sigma))
        )
        wp, wc = np.where(known_p, 1.0 / position_sigma**2, 0.0), np.where(known_c, 1.0 / curvature_sigma**2, 0.0)
        total = wp + wc
        amplitude = (np.where(known_p, position, 0.0) * wp + np.where(known_c, curvature, 0.0) * wc) / total
        sigma = 1.0 / np.sqrt(total)
        sigma = sigma * [_spread(amplitude[:, m] / sigma[:, m], free) for m in range(2)]
    looks = _LOOKS * free.sum() * node.step / length
    typical = np.array([_middle(sigma[free, m]) for m in range(2)])
    parts = position, position_sigma, curvature, curvature_sigma
    return Waves(length, node.place, amplitude, sigma, *parts, free, looks, typical, np.full(2, few_looks_factor(looks, reach)))


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


def _from_position(node: Nodes, model: DriftModel, length: float) -> tuple[Floats, Floats]:
    """Amplitudes (m, 2) from positions, NaN within 1.5 wavelengths of unknown pipe, and those that a shift of both runs against
    each other of one metre along the pipe would show.
    """
    out, shifted = np.full((node.place.size, 2), np.nan), np.full((node.place.size, 2), np.nan)
    if node.unknown.all():
        return out, shifted
    step = node.step
    pair = [position_weights(length, step, model.walk[m], model.noise[m] * model.step / step) for m in range(2)]
    if pair[0].size > node.place.size:
        return out, shifted
    gone = _near(node.unknown, pair[0].size // 2)
    for into, source in ((out, node.value), (shifted, node.shift)):
        for m, (weights, axis) in enumerate(zip(pair, (node.right, node.lift), strict=True)):
            _kernels.weighted_across(source, axis, weights, gone, into[:, m])
    return out, shifted


def _from_curvature(signals: Signals, length: float, size: int, count: int) -> tuple[Floats, Floats]:
    """Amplitudes (m, 2) from curvature and their formal weights (1/m²) in the middle of each of so many pieces."""
    amplitude, weight = np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    if not np.isfinite(signals.curvature).any():
        return amplitude, weight
    shape = curvature_shape(length, signals.step, signals.gauge_length)
    if shape.size > len(signals.place):
        return amplitude, weight
    for m in range(2):
        top = _correlated(signals.weighted_curvature[:, m], shape, size, count)
        bottom = _correlated(signals.curvature_weight[:, m], shape**2, size, count)
        least = _LEAST_WEIGHT * np.sum(shape**2) * signals.usual_weight[m]
        weight[:, m] = np.where(bottom > least, bottom, np.nan)
        with np.errstate(invalid="ignore"):
            amplitude[:, m] = top / weight[:, m]
    return amplitude, weight


def _correlated(values: Floats, shape: Floats, size: int, count: int) -> Floats:
    """Sum of values times a shape of odd length about the middle of each piece, nothing beyond the ends of the values."""
    out = np.empty(count)
    _kernels.weighted_every(np.pad(values, shape.size // 2), shape, size, out)
    return out


def _spread(values: Floats, free: Floats) -> float:
    """Robust spread about zero over quiet pipe."""
    chosen = values[free & np.isfinite(values)]
    if chosen.size < 4:
        chosen = values[np.isfinite(values)]
    if chosen.size < 4:
        return float("nan")
    return max(spread_about_zero(chosen), 1e-12)


def _near(flag: Floats, reach: int) -> Floats:
    """True within ``reach`` places of a flag."""
    if reach < 1 or not flag.any():
        return flag.copy()
    summed = np.concatenate([[0], np.cumsum(flag)])
    index = np.arange(flag.size)
    return summed[np.minimum(index + reach + 1, flag.size)] > summed[np.maximum(index - reach, 0)]
