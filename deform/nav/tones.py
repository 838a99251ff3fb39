"""The slope of the path's departure and the attitude in; tones of the tool, narrow lines in their spectra, out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import minimize
from scipy.signal import get_window
from scipy.stats import beta

Floats = NDArray[Any]
Spectrum = Callable[[Floats], Floats]

MOST_TONES = 4  # in one axis; each is two states more
FALSE_ALARM = 1e-3  # of a line in the smooth noise of a whole axis
_PIECES_M = (128.0, 256.0, 512.0, 1024.0)  # a drifting tone stands out best in short pieces, a steady one in long ones
_LEAST_PIECES = 4  # of such a length, without overlap
_LEAST_CYCLES = 4.0  # of a tone in a piece
_SHORTEST_M = 2.0  # wavelength
_LEAST_RATIO = 3.0  # of a line to the smooth spectrum, which is a model and no better known
_LEAST_QUALITY = 20.0  # angular frequency over twice the decay; what is wider is several tones
_SHARE_DOUBT = 2.0  # a line has as much more of shift, against wobble, as the tool at large


@dataclass(frozen=True)
class Tone:
    """Narrow line in the departure of the path from the attitude: a damped oscillator driven by white noise.

    Attributes
    ----------
    frequency : of the oscillator (1/m).
    decay : rate at which it forgets its phase (1/m); it covers a drift of the wavelength too.
    variance : of the departure by it (rad²).
    share : how much of it is wobble, in size and phase: the attitude's own tone over that of the departure. One for a tool that
        turns about the IMU, zero for one that shifts without turning.
    share_sigma : its standard deviation in each component.
    """

    frequency: float
    decay: float
    variance: float
    share: complex = 1.0 + 0.0j
    share_sigma: float = 0.0

    def spectrum(self, frequency: Floats) -> Floats:
        """One-sided power spectral density (rad² m): 8 γ ω₀² σ² / ((ω₀² - ω²)² + 4 γ² ω²)."""
        own, omega2 = (2.0 * np.pi * self.frequency) ** 2, (2.0 * np.pi * frequency) ** 2
        return 8.0 * self.decay * own * self.variance / ((own - omega2) ** 2 + 4.0 * self.decay**2 * omega2)

    def covariance(self, lag: Floats) -> Floats:
        """Covariance at lags (m): σ² exp(-γ d) (cos ω d + γ / ω sin ω d), ω² = ω₀² - γ²."""
        omega, far = math.sqrt((2.0 * math.pi * self.frequency) ** 2 - self.decay**2), np.abs(lag)
        return self.variance * np.exp(-self.decay * far) * (np.cos(omega * far) + self.decay / omega * np.sin(omega * far))

    def periodogram(self, size: int, node: float) -> Floats:
        """Mean periodogram (rad² m) of `pieces` of it: transform of covariance times correlation of the window with itself."""
        seen = self.covariance(node * np.arange(size)) * _overlap(size)
        return np.maximum(np.fft.rfft(seen, 2 * size).real[::2], 0.0) * (4.0 * node)

    @property
    def turning(self) -> Floats:
        """System matrix (1/m) of the two states: departure, and its slope over ω₀."""
        omega = 2.0 * math.pi * self.frequency
        return np.array([[0.0, omega], [-omega, -2.0 * self.decay]])

    @property
    def drive(self) -> Floats:
        """Intensity of the white noise that keeps them at ``variance`` each (rad²/m)."""
        return np.diag([0.0, 4.0 * self.decay * self.variance])

    @property
    def wobble(self) -> Floats:
        """Row that gives the wobble of it (rad)."""
        return _row(self.share)

    @property
    def shift(self) -> Floats:
        """Row that gives the shift of it (m): its slope is the wobble less the departure."""
        return _row((self.share - 1.0) / (2.0j * math.pi * self.frequency))


def _row(factor: complex) -> Floats:
    """Row of the states that gives the real part of a factor times the amplitude z, of which the states are Re z and -Im z."""
    return np.array([factor.real, factor.imag])


def find_tone(slope: Floats, node: float, smooth: Spectrum, known: Sequence[Tone] = ()) -> Tone | None:
    """Return the line that stands most above a smooth spectrum and the lines known before, None where there is none.

    Parameters
    ----------
    slope : departure between nodes (rad).
    node : spacing (m).
    smooth : one-sided power spectral density expected without lines (rad² m).
    known : lines found before.

    Notes
    -----
    In pieces of several lengths (Hann window, half overlap) the median of the periodograms over the pieces, free of what happens
    in a few of them, is held against the background: the smooth spectrum, or the median of the neighbouring frequencies where
    that is more, for a line is narrow. In noise of K pieces the m-th smallest of K exponential variables lies above t times their
    mean with the probability that K - m + 1 of them do, whose inverse is that of the beta distribution; t is such that a line at
    any frequency, in pieces of any length, is found with probability `FALSE_ALARM`.
    """
    sizes = [round(piece / node) for piece in _PIECES_M if slope.size >= _LEAST_PIECES * round(piece / node)]
    bands = [_band(size, node) for size in sizes]
    tests = sum(band.size for band in bands)
    best, found = 1.0, None
    for size, band in zip(sizes, bands, strict=True):
        power = np.abs(pieces(slope, size)) ** 2 * (2.0 * node)
        middle = (power.shape[0] + 1) // 2
        least = -math.log(beta.ppf(FALSE_ALARM / tests, power.shape[0] - middle + 1, middle))
        median = np.partition(power, middle - 1, axis=0)[middle - 1]
        local = np.exp(median_filter(np.log(median + 1e-300), max(15, 2 * (band.size // 16) + 1), mode="nearest"))
        usual = np.maximum(_expected(smooth, known, size, node)[band], local[band] / math.log(2.0))
        ratio = median[band] / usual / max(least, _LEAST_RATIO * math.log(2.0))
        top = int(np.argmax(ratio))
        if ratio[top] > best:
            best, found = ratio[top], (band[top] / (size * node), size)
    return None if found is None else _fitted(slope, node, _expected(smooth, known, sizes[-1], node), *found)


def with_share(tone: Tone, slope: Floats, node: float, attitude: Floats, ring: tuple[float, Floats] | None, shift: float) -> Tone:
    """Return the tone with the share of it that is wobble.

    Parameters
    ----------
    tone : found in ``slope``.
    slope : departure between nodes (rad).
    node : spacing (m).
    attitude : direction of the tool at the same places (rad).
    ring : place of a ring of arms along the tool, and the offset that it sees at the nodes (m), or None.
    shift : usual shift of the tool over its usual wobble (m).

    Notes
    -----
    A wobble w and a shift u make the departure w - u', and the offset u + y w at a ring at y. What a tool of this shift and
    wobble is expected to have of both at this wavelength is one witness. The attitude is another, with the pipe as noise: its
    cross-spectrum with the departure over the departure's own. The ring is the third: it sees c times the summed departure, and
    the share is (c + 1) / (1 + i ω y). An attitude that contradicts the others is the pipe's, which bends with the same wave; it
    is not asked.
    """
    omega = 2.0 * math.pi * tone.frequency
    ratio = (_SHARE_DOUBT * omega * shift) ** 2
    share, variance = complex(1.0 / (1.0 + ratio)), max(0.5 * ratio / (1.0 + ratio) ** 2, 1e-6)
    witnesses = []
    if ring is not None:
        known = np.isfinite(ring[1])
        offset = np.interp(np.arange(known.size), np.flatnonzero(known), ring[1][known])
        seen, sigma = _transfer(tone, np.diff(slope), np.diff(offset, 2) / node, node)
        lever = 1.0 + 1j * omega * ring[0]
        witnesses.append(((seen + 1.0) / lever, sigma / abs(lever)))
    witnesses.append(_transfer(tone, np.diff(slope), np.diff(attitude), node))
    for seen, sigma in witnesses:
        if abs(seen - share) ** 2 < 9.0 * 2.0 * (variance + sigma**2):
            weight = variance / (variance + sigma**2)
            share, variance = share + weight * (seen - share), (1.0 - weight) * variance
    return replace(tone, share=share, share_sigma=math.sqrt(variance))


def _transfer(tone: Tone, slope: Floats, other: Floats, node: float) -> tuple[complex, float]:
    """Factor of a series on the departure at a tone, and sigma of its components; pieces count by what is left in them."""
    size = min(round(_PIECES_M[2] / node), slope.size // _LEAST_PIECES)
    near = np.abs(np.fft.rfftfreq(size, node) - tone.frequency) < 1.5 / (size * node) + tone.decay / (2.0 * np.pi)
    ours, its = (pieces(series, size)[:, near] for series in (slope, other))
    own, factor, sigma = np.sum(np.abs(ours) ** 2, axis=1), 1.0 + 0.0j, 1.0
    for _ in range(10):
        left = np.sum(np.abs(its - factor * ours) ** 2, axis=1)
        weight = 1.0 / (left + 0.1 * np.median(left) + 1e-12 * own)
        total = float(np.sum(weight * own))
        factor = complex(np.sum(weight[:, None] * np.conj(ours) * its) / total)
        sigma = math.sqrt(0.5 * float(np.sum(weight**2 * own * left))) / total
    return factor, sigma


def pieces(series: Floats, size: int) -> NDArray[np.complex128]:
    """Fourier transforms (piece, frequency) of overlapping pieces under a Hann window of unit power, each without its mean."""
    window = get_window("hann", size)
    cut = np.lib.stride_tricks.sliding_window_view(series, size)[:: size // 2]
    return np.fft.rfft((cut - cut.mean(axis=1, keepdims=True)) * (window / math.sqrt(float(np.sum(window**2)))), axis=1)


@lru_cache(maxsize=16)
def _overlap(size: int) -> Floats:
    """Correlation of the window of `pieces` with itself at lags of whole nodes, half of it at lag zero."""
    window = get_window("hann", size)
    overlap = np.fft.irfft(np.abs(np.fft.rfft(window, 2 * size)) ** 2)[:size] / np.sum(window**2)
    overlap[0] *= 0.5
    return overlap


def _band(size: int, node: float) -> NDArray[np.intp]:
    """Indices of the frequencies of a piece in which a tone is looked for."""
    frequency = np.fft.rfftfreq(size, node)
    return np.flatnonzero((frequency >= _LEAST_CYCLES / (size * node)) & (frequency <= min(1.0 / _SHORTEST_M, 0.4 / node)))


def _expected(smooth: Spectrum, lines: Sequence[Tone], size: int, node: float) -> Floats:
    """Mean periodogram of pieces (rad² m) at their frequencies."""
    frequency = np.maximum(np.fft.rfftfreq(size, node), 0.5 / (size * node))
    return smooth(frequency) + sum(line.periodogram(size, node) for line in lines)


def _fitted(slope: Floats, node: float, background: Floats, frequency: float, seen_in: int) -> Tone:
    """Tone of greatest likelihood (Whittle) near a frequency.

    A power of the pieces beyond three times the usual counts as three times.
    """
    size = 2 * (background.size - 1)
    axis = np.fft.rfftfreq(size, node)
    near = np.flatnonzero((np.abs(axis - frequency) < 4.0 / (seen_in * node)) & (axis > 0))
    power = np.abs(pieces(slope, size)[:, near]) ** 2 * (2.0 * node)
    whole = power.sum(axis=1)
    power = (power * np.minimum(1.0, 3.0 * np.median(whole) / np.maximum(whole, 1e-300))[:, None]).mean(axis=0)
    usual = background[near]
    rates = np.log([0.25 / (size * node), max(math.pi * frequency / _LEAST_QUALITY, 0.5 / (size * node))])
    lag = node * np.arange(size)
    transform = 4.0 * node * _overlap(size) * np.cos(2.0 * np.pi * axis[near, None] * lag)

    def tone_of(x: Floats) -> Tone:
        return Tone(frequency + x[0] / (seen_in * node), math.exp(np.clip(x[1], *rates)), math.exp(min(x[2], 0.0)))

    def misfit(x: Floats) -> float:
        expected = usual + np.maximum(transform @ tone_of(x).covariance(lag), 0.0)
        outside = max(abs(x[0]) - 2.0, 0.0) + abs(x[1] - np.clip(x[1], *rates))
        return float(np.sum(np.log(expected) + power / expected) + outside)

    excess = max(float(np.sum(power - usual)) / (size * node), 1e-16)
    start = np.array([0.0, rates.mean(), math.log(excess)])
    simplex = start + np.vstack([np.zeros(3), np.diag([0.5, 0.7, 0.7])])
    options = {"xatol": 0.01, "fatol": 0.01, "initial_simplex": simplex}
    found = minimize(misfit, start, method="Nelder-Mead", options=options)
    return tone_of(found.x)
