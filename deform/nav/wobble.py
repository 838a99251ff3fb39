"""Spectra of the tool's wobble and of the path's noise in; the smoother's model of them, and the sigma it leaves, out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm, solve_continuous_lyapunov
from scipy.optimize import least_squares
from scipy.signal import csd, welch

from deform.nav.tones import Tone
from deform.run.raw import ImuHeader

Floats = NDArray[Any]

SEGMENT_M = 256.0  # length of the pieces whose spectra are averaged
_PIECE_M = 50.0  # the same for the attitude by itself, and for what it has in common with the departure
_PATH_FREQUENCIES = 1.0 / 3000.0, 1.0 / 3.0  # 1/m, between which the model of the path's error is to be that of its spectrum
USUAL = (math.radians(0.2), 10.0, 1e-3)  # wobble (rad), its length (m), shift (m) where a run is too short to tell


@dataclass(frozen=True)
class Wobble:
    """Wobble on a grid (radian), its sigma, and the sigma of its turn over given lags."""

    value: Floats
    sigma: Floats
    turn_sigma: Floats

    @classmethod
    def absent(cls, n: int, lags: int) -> Wobble:
        """No knowledge about the wobble: zero with the sigma of a usual tool."""
        return cls(np.zeros(n), np.full(n, USUAL[0]), np.full(lags, math.sqrt(2.0) * USUAL[0]))


@dataclass(frozen=True)
class Chain:
    """Equal poles in a row (1/m), driven by white noise of an intensity (rad²/m)."""

    drive: float
    rate: float
    poles: int

    def spectrum(self, omega: Floats) -> Floats:
        """One-sided power spectral density (rad² m) at wave numbers (rad/m)."""
        return 2.0 * self.drive * self.rate ** (2 * self.poles - 2) / (omega**2 + self.rate**2) ** self.poles


@dataclass(frozen=True)
class WobbleModel:
    """Spectra of wobble and noise along the pipe.

    Attributes
    ----------
    drive : intensity of the white noise that drives the wobble (rad²/m).
    rate : decay of each pole (1/m).
    order : number of poles.
    shift_variance : variance of the tool's shift in the pipe, and of its shaking, at one node (m²).
    ride : intensity of the white noise of the path's direction: the tool's shift as it wanders (rad² m).
    path_drive : intensity of the random walk of the path's direction: accelerometer noise over speed (rad²/m).
    tilt_drive : the same of its second derivative: gravity times the random walk of the tilt over speed squared (rad²/m³).
    turn_drive : random walk of the gyros per metre (rad²/m).
    tones : narrow lines of wobble and shift beside the smooth spectra; each has states of its own in the smoother.
    lines : others, of which the smooth spectra take off what they should.
    """

    drive: float
    rate: float
    order: int
    shift_variance: float
    ride: float
    path_drive: float
    tilt_drive: float
    turn_drive: float
    tones: tuple[Tone, ...] = ()
    lines: tuple[Tone, ...] = ()

    @property
    def sigma(self) -> float:
        """Standard deviation of the wobble without its tones (rad)."""
        frequency = np.geomspace(1e-5, 5.0, 4000)
        return math.sqrt(float(np.trapezoid(self.wobble_spectrum(frequency), frequency)))

    def wobble_spectrum(self, frequency: Floats) -> Floats:
        """One-sided power spectral density of the wobble without its tones (rad² m)."""
        return Chain(self.drive, self.rate, self.order).spectrum(2.0 * np.pi * frequency)

    def noise_spectrum(self, frequency: Floats, node: float) -> Floats:
        """One-sided power spectral density of what else is in the departure, without tones (rad² m)."""
        drift = _drift_spectrum(frequency, self.path_drive, self.tilt_drive)
        return _ride_spectrum(frequency, self.shift_variance, self.ride, node) + drift

    def shown_spectrum(self, frequency: Floats, node: float) -> Floats:
        """The same of the departure that the navigation shows: of long waves of the wobble it has taken a part for path."""
        wobble, drift = self.wobble_spectrum(frequency), _drift_spectrum(frequency, self.path_drive, self.tilt_drive)
        return wobble**2 / (wobble + drift) + _ride_spectrum(frequency, self.shift_variance, self.ride, node)

    def taken(self, tone: Tone, node: float, shift_sigma: float, ring_sigma: float, lever: float) -> complex:
        """Share of a tone's departure that a smoother of the smooth spectra takes for wobble.

        Wiener's filter of the model of `discrete`, at the tone: from the departure w + e - u' alone, and with a ring at
        ``lever`` (m, 0 for none) from its offset u + lever w too.
        """
        omega = 2.0 * math.pi * tone.frequency
        turned = 1j * omega
        wobble = float(2.0 * self.drive * self.rate ** (2 * self.order - 2) / (omega**2 + 0.25 * self.rate**2) ** self.order)
        drift = float(sum(chain.spectrum(np.array([omega]))[0] for chain in self.path_error()))
        if lever == 0.0:
            shift = float(self.wobble_spectrum(np.array([tone.frequency]))[0]) * (shift_sigma / self.sigma) ** 2
        else:
            shift = 4.0 * 0.1 * self.rate * 5.0 * shift_sigma**2 / (omega**2 + (0.1 * self.rate) ** 2)
        ride = 2.0 * self.ride + omega**2 * 2.0 * node * self.shift_variance
        both = np.array([[wobble + drift + omega**2 * shift + ride, lever * wobble - turned * shift],
                         [lever * wobble + turned * shift, shift + lever**2 * wobble + 2.0 * node * ring_sigma**2]])  # fmt: skip
        seen = np.array([1.0, (tone.share - 1.0) / turned + lever * tone.share])
        rank = 1 if lever == 0.0 else 2
        weights = np.linalg.solve(both[:rank, :rank].T, np.array([1.0, lever])[:rank] * wobble)
        return complex(weights @ seen[:rank])

    def discrete(self, node: float, shift_sigma: float, shift_order: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Transition, noise, noise of the path, first covariance of [integral, wobble, poles, path error, shift, poles, tones].

        Notes
        -----
        The navigation's path already weighs the accelerometers against the wobble: its error at long waves is what
        S_w S_n / (S_w + S_n) leaves, a process of that power and fall here (`path_error`; were it stronger in waves of tens of
        metres, a ring would be believed there, which sees the tool's shift too). The wobble enters with its short waves only
        (poles at half the rate, same fall), lest it be counted twice. ``shift_sigma`` (m) is the tool's slow shift in the
        pipe. Unseen it has the shape of the wobble, for both come from how the tool rides on its cups, and ``shift_order`` is
        that of the wobble; seen by a ring of arms it may have short waves of its own, and 1 lets them through. Its long waves are
        then left free: the navigation has used the arms for them already.
        """
        p, own = self.order, self.shift_state
        m = own + shift_order
        A, L, push = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
        A[0, 1] = A[0, p + 1] = A[0, p + 2] = 1.0
        L[0, 0] = self.ride
        slow = 0.5 * self.rate
        _chain(A, 1, p, slow)
        L[p, p] = self.drive * (self.rate / slow) ** (2 * p - 2)
        walk, tilt = self.path_error()
        _chain(A, p + 1, 1, walk.rate)
        _chain(A, p + 2, 2, tilt.rate)
        push[p + 1, p + 1], push[own - 1, own - 1] = walk.drive, tilt.drive
        rate = self.rate
        if shift_order == 1:
            rate, shift_sigma = 0.1 * self.rate, shift_sigma * math.sqrt(5.0)  # fall of a pole at half the rate
        _chain(A, own, shift_order, rate)
        unit = solve_continuous_lyapunov(A[own:, own:], -_corner(shift_order))[0, 0]
        L[m - 1, m - 1] = shift_sigma**2 / unit
        P0 = np.zeros((m, m))
        P0[1:, 1:] = solve_continuous_lyapunov(A[1:, 1:], -(L + push)[1:, 1:])
        P0[0, 0] = 100.0 * self.shift_variance
        for tone in self.tones:
            A, L, push, P0 = (block_diag(whole, more) for whole, more in
                              ((A, tone.turning), (L, tone.drive), (push, np.zeros((2, 2))),
                               (P0, tone.variance * np.eye(2))))  # fmt: skip
            A[0, -2:] = tone.wobble
        F, Q = _van_loan(A, L, node)
        return F, Q, _van_loan(A, push, node)[1], P0

    @property
    def shift_state(self) -> int:
        """Where the tool's shift stands in the state of `discrete`."""
        return self.order + 4

    def path_error(self) -> tuple[Chain, Chain]:
        """Error of the path's direction, S_w S_n / (S_w + S_n), as a sum of one pole and two.

        One falls as the random walk of the accelerometers does, two as the tilt of the gyros' does. Least squares of logarithms.
        """
        frequency = np.geomspace(*_PATH_FREQUENCIES, 60)
        omega, wobble = 2.0 * np.pi * frequency, self.wobble_spectrum(frequency)
        drift = _drift_spectrum(frequency, self.path_drive, self.tilt_drive)
        left = wobble * drift / (wobble + drift)
        top = float(left[0])

        def chains(x: Floats) -> tuple[Chain, Chain]:
            one, two = np.exp(x[:2])
            return Chain(0.5 * top * np.exp(x[2]) * one**2, one, 1), Chain(0.5 * top * np.exp(x[3]) * two**2, two, 2)

        def misfit(x: Floats) -> Floats:
            return np.log(sum(chain.spectrum(omega) for chain in chains(x)) / left)

        crossed = np.log([max(2.0 * self.path_drive / top, 1e-30) ** 0.5, max(2.0 * self.tilt_drive / top, 1e-30) ** 0.25])
        low, high = np.array([*np.log([1e-4, 1e-4]), -12.0, -12.0]), np.array([*np.log([3.0, 3.0]), 1.0, 1.0])
        start = np.clip([*crossed, -1.0, -1.0], low + 1e-3, high - 1e-3)
        return chains(least_squares(misfit, start, bounds=(low, high)).x)

    def left_spectrum(self, frequency: Floats, node: float, shift_sigma: float, ring_sigma: float, lever: float = 0.0) -> Floats:
        """One-sided spectrum of the error that the smoother leaves in the direction (rad² m): S_w S_n / (S_w + S_n).

        The shift of the tool slopes the path: by all of it where it is not seen, by the error of the ring where it is. Of a tone
        of spectrum S_T the share g is wobble, and S_x - |S_xy|² / S_y is left, with S_x = S_w + |g|² S_T, S_xy = S_w + g S_T and
        S_y = S_w + S_n + S_T; then what is not known of the shares, and what is left in lines that are no tones.
        """
        wobble, noise = self.wobble_spectrum(frequency), self._noise(frequency, node, shift_sigma, ring_sigma)
        own, whole = wobble, wobble + noise
        if not self.tones + self.lines:
            return wobble * noise / whole
        cross, unknown = wobble, np.zeros(frequency.size)
        for tone in self.tones:
            power = tone.spectrum(frequency)
            own, whole = own + abs(tone.share) ** 2 * power, whole + power
            cross = cross + tone.share * power
        for tone in self.tones + self.lines:
            unknown += 2.0 * tone.share_sigma**2 * tone.spectrum(frequency)
        for tone in self.lines:
            taken = self.taken(tone, node, shift_sigma, ring_sigma, lever)
            unknown += abs(taken - tone.share) ** 2 * tone.spectrum(frequency)
        return np.maximum(own - np.abs(cross) ** 2 / whole, 0.0) + unknown

    def _noise(self, frequency: Floats, node: float, shift_sigma: float, ring_sigma: float) -> Floats:
        noise = self.noise_spectrum(np.minimum(frequency, 0.5 / node), node)
        omega2 = (2.0 * np.pi * frequency) ** 2
        seen = 2.0 * node * ring_sigma**2 if ring_sigma > 0 else self.wobble_spectrum(frequency) * (shift_sigma / self.sigma) ** 2
        return noise + omega2 * seen


def gyro_walk(imu: ImuHeader, speed: float) -> float:
    """Random walk of the gyros per metre at a speed (rad²/m)."""
    return (math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0) ** 2 / max(speed, 0.05)


def turn_sigma(
    model: WobbleModel,
    lags: Floats,
    total: Floats,
    node: float,
    direction: Floats,
    step: float,
    attitude: Floats,
    shift: tuple[float, float, float],
) -> Floats:
    """Return the sigma (rad) of the turn of the pipe between two places these lags (m) apart.

    Parameters
    ----------
    model : fitted to ``total``.
    lags : metre.
    total, node : as for `fit_wobble`.
    direction, step : direction of the tool (rad) on the grid of the result, without its tones, and its step (m).
    attitude : the same between the nodes.
    shift : sigma of the tool's slow shift in the pipe, and that of a ring that sees it and its place, 0 without one (m).

    Notes
    -----
    Where the wobble stands above the noise of the path, the two-sided smoother leaves S_w S_n / (S_w + S_n). Shorter waves of the
    wobble hide below that noise. Neither the departure of the path nor the attitude itself can hold less than the wobble that
    is in them, and both hold the same of it: the least of their spectra and their cross-spectrum stands for the error. (Medians
    over pieces of the line keep bends out; what the straight pipe bends in short waves is counted as error where the departure
    does not tell.) A turn over a lag l passes 2 (1 - cos 2π f l) of the spectrum; the random walk of the gyros comes on top.
    """
    highest = 0.5 / step
    frequency = np.unique(np.concatenate([np.geomspace(1e-4, highest, 3000), np.linspace(0.01, highest, 3000)]))
    wobble, noise = model.wobble_spectrum(frequency), model.noise_spectrum(np.minimum(frequency, 0.5 / node), node)
    left = model.left_spectrum(frequency, node, *shift)
    most = np.full(frequency.size, np.inf)
    slope = slope_of(total) / node
    for at, power in (
        _departure_without_lines(model, slope, node),
        _of_differences(*_median_spectrum(np.diff(direction), step, _PIECE_M), step),
        _wobble_told(slope, attitude, node),
    ):
        if at.size > 4:
            inside = frequency <= at[-1]
            most[inside] = np.minimum(most[inside], np.interp(frequency[inside], at, power))
    hidden = (wobble < noise) & np.isfinite(most)
    left[hidden] = np.maximum(left, most)[hidden]
    passed = 2.0 * (1.0 - np.cos(2.0 * np.pi * frequency * np.asarray(lags)[:, None]))
    return np.sqrt(np.trapezoid(left * passed, frequency, axis=1) + model.turn_drive * lags)


def _departure_without_lines(model: WobbleModel, slope: Floats, node: float) -> tuple[Floats, Floats]:
    """Frequency and median spectrum of the departure, without the part that is in lines."""
    at, power = _median_spectrum(slope, node, SEGMENT_M)
    lines = model.tones + model.lines
    if not at.size or not lines:
        return at, power
    size, smooth = round(1.0 / (at[0] * node)), model.shown_spectrum(at, node)
    return at, power * smooth / (smooth + sum(line.periodogram(size, node)[1 : at.size + 1] for line in lines))


def _wobble_told(slope: Floats, attitude: Floats, node: float) -> tuple[Floats, Floats]:
    """Frequency and spectrum of the wobble by what departure and attitude have in common.

    The attitude is pipe and wobble, the departure wobble and ride: their cross-spectrum is that of the wobble. Its median is less
    than its mean by what the share of it in both is. What is below zero is chance; to count the rest alone errs by four tenths of
    its scatter, to the safe side.
    """
    size = min(round(_PIECE_M / node), slope.size // 2)
    if size < 16:
        return np.empty(0), np.empty(0)
    both, how = (np.diff(slope), np.diff(attitude)), {"fs": 1.0 / node, "nperseg": size, "average": "median"}
    at, common = csd(*both, **how)
    whole = np.sqrt(welch(both[0], **how)[1] * welch(both[1], **how)[1])
    share = np.linspace(0.0, 1.0, 101)  # of the whole that is common: median of the real part of such products
    told = np.interp(math.log(2.0) * common.real / whole, 0.5 * (1.0 + share) * np.log1p(share), share) * whole
    return _of_differences(at[1:], told[1:], node)


def _of_differences(at: Floats, power: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Frequency and spectrum of a series by that of its differences."""
    return at, power / (2.0 * np.sin(np.pi * at * spacing)) ** 2


def _chain(A: Floats, first: int, poles: int, rate: float) -> None:
    """Lay a cascade of equal poles into a system matrix; its first state is the output, its last is driven."""
    for i in range(first, first + poles):
        A[i, i] = -rate
        if i < first + poles - 1:
            A[i, i + 1] = rate


def _corner(n: int) -> Floats:
    out = np.zeros((n, n))
    out[-1, -1] = 1.0
    return out


def slope_of(total: Floats) -> Floats:
    """Differences of the sum from node to node, gaps bridged."""
    known = np.flatnonzero(np.isfinite(total))
    return np.diff(np.interp(np.arange(total.size), known, total[known])) if known.size > 1 else np.empty(0)


def _median_spectrum(slopes: Floats, spacing: float, longest: float) -> tuple[Floats, Floats]:
    """Frequency and median of the periodograms of pieces, without the lowest frequency."""
    size = min(round(longest / spacing), slopes.size // 2)
    if size < 16:
        return np.empty(0), np.empty(0)
    frequency, power = welch(slopes, fs=1.0 / spacing, nperseg=size, average="median")
    return frequency[1:], power[1:]


def _ride_spectrum(frequency: Floats, shift: float, ride: float, node: float) -> Floats:
    """Slope of the path by the tool's shift: white at the nodes, and wandering."""
    return 2.0 * node * shift * (2.0 * np.sin(np.pi * frequency * node) / node) ** 2 + 2.0 * ride


def _drift_spectrum(frequency: Floats, path: float, tilt: float) -> Floats:
    """Direction of an inertial path by itself: accelerometer noise once, tilt of the gyros' random walk twice integrated."""
    omega2 = (2.0 * np.pi * frequency) ** 2
    return 2.0 * path / omega2 + 2.0 * tilt / omega2**2


def _van_loan(A: Floats, L: Floats, step: float) -> tuple[Floats, Floats]:
    """Transition over a step and the covariance that white noise of intensity L gathers in it (Van Loan 1978)."""
    m = A.shape[0]
    block = np.zeros((2 * m, 2 * m))
    block[:m, :m], block[:m, m:], block[m:, m:] = -A, L, A.T
    exponential = expm(block * step)
    F = exponential[m:, m:].T
    Q = F @ exponential[:m, m:]
    return F, 0.5 * (Q + Q.T)
