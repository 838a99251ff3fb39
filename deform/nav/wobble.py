"""The path's departure from the attitude in; a model of the tool's wobble in the pipe, fitted by its spectrum, out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import least_squares
from scipy.signal import welch

from deform.run.raw import ImuHeader

Floats = NDArray[Any]

_STANDARD_GRAVITY = 9.80665
_SEGMENT_M = 256.0  # length of the pieces whose spectra are averaged
_PIECE_M = 50.0  # the same for the attitude by itself
_MOST_WEIGHT = 30.0  # values of the periodogram that a band counts for; more of them do not make the model better
_ORDERS = (1, 2, 3, 4)  # poles of the wobble: how sharply it fades towards short waves
_DEFAULT = (math.radians(0.2), 10.0, 1e-3)  # wobble (rad), its length (m), shift (m) where a run is too short to tell


@dataclass(frozen=True)
class Wobble:
    """Wobble on a grid (radian), its sigma, and the sigma of its turn over given lags."""

    value: Floats
    sigma: Floats
    turn_sigma: Floats

    @classmethod
    def absent(cls, n: int, lags: int) -> Wobble:
        """No knowledge about the wobble: zero with the sigma of a usual tool."""
        return cls(np.zeros(n), np.full(n, _DEFAULT[0]), np.full(lags, math.sqrt(2.0) * _DEFAULT[0]))


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
    """

    drive: float
    rate: float
    order: int
    shift_variance: float
    ride: float
    path_drive: float
    tilt_drive: float
    turn_drive: float

    @property
    def sigma(self) -> float:
        """Standard deviation of the wobble (rad)."""
        frequency = np.geomspace(1e-5, 5.0, 4000)
        return math.sqrt(float(np.trapezoid(self.wobble_spectrum(frequency), frequency)))

    def wobble_spectrum(self, frequency: Floats) -> Floats:
        """One-sided power spectral density of the wobble (rad² m)."""
        return _wobble_spectrum(frequency, self.drive, self.rate, self.order)

    def noise_spectrum(self, frequency: Floats, node: float) -> Floats:
        """One-sided power spectral density of what else is in the departure (rad² m)."""
        drift = _drift_spectrum(frequency, self.path_drive, self.tilt_drive)
        return _ride_spectrum(frequency, self.shift_variance, self.ride, node) + drift

    def discrete(self, node: float, shift_sigma: float, shift_order: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Transition, noise, noise of the path, first covariance of [integral, wobble and its poles, path error, shift and its].

        Notes
        -----
        The navigation's path already weighs the accelerometers against the wobble: its error at long waves is what
        S_w S_n / (S_w + S_n) leaves, an Ornstein-Uhlenbeck process of that power here, and the wobble enters with its short waves
        only (poles at half the rate, same fall), lest it be counted twice. ``shift_sigma`` (m) is the tool's slow shift in the
        pipe. Unseen it has the shape of the wobble, for both come from how the tool rides on its cups, and ``shift_order`` is
        that of the wobble; seen by a ring of arms it may have short waves of its own, and 1 lets them through. Its long waves are
        then left free: the navigation has used the arms for them already.
        """
        p = self.order
        m = p + 2 + shift_order
        A, L, push = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
        A[0, 1] = A[0, p + 1] = 1.0
        L[0, 0] = self.ride
        slow = 0.5 * self.rate
        _chain(A, 1, p, slow)
        L[p, p] = self.drive * (self.rate / slow) ** (2 * p - 2)
        error, length = self.path_error()
        A[p + 1, p + 1] = -1.0 / length
        push[p + 1, p + 1] = 2.0 * error**2 / length
        rate = self.rate
        if shift_order == 1:
            rate, shift_sigma = 0.1 * self.rate, shift_sigma * math.sqrt(5.0)  # fall of a pole at half the rate
        _chain(A, p + 2, shift_order, rate)
        unit = solve_continuous_lyapunov(A[p + 2 :, p + 2 :], -_corner(shift_order))[0, 0]
        L[m - 1, m - 1] = shift_sigma**2 / unit
        F, Q = _van_loan(A, L, node)
        P0 = np.zeros((m, m))
        P0[1:, 1:] = solve_continuous_lyapunov(A[1:, 1:], -(L + push)[1:, 1:])
        P0[0, 0] = 100.0 * self.shift_variance
        return F, Q, _van_loan(A, push, node)[1], P0

    def path_error(self) -> tuple[float, float]:
        """Sigma (rad) and length (m) of the error of the path's direction in long waves."""
        frequency = np.geomspace(1e-5, 1.0, 4000)
        wobble = self.wobble_spectrum(frequency)
        drift = _drift_spectrum(frequency, self.path_drive, self.tilt_drive)
        left = wobble * drift / (wobble + drift)
        error = math.sqrt(max(float(np.trapezoid(left, frequency)), 1e-16))
        return error, float(np.clip(left[0] / (4.0 * error**2), 2.0, 500.0))

    def left_spectrum(self, frequency: Floats, node: float, shift_sigma: float, ring_sigma: float) -> Floats:
        """One-sided spectrum of the error that the smoother leaves in the direction (rad² m): S_w S_n / (S_w + S_n).

        The shift of the tool slopes the path: by all of it where it is not seen, by the error of the ring where it is.
        """
        wobble, noise = self.wobble_spectrum(frequency), self.noise_spectrum(np.minimum(frequency, 0.5 / node), node)
        omega2 = (2.0 * np.pi * frequency) ** 2
        noise = noise + omega2 * (2.0 * node * ring_sigma**2 if ring_sigma > 0 else wobble * (shift_sigma / self.sigma) ** 2)
        return wobble * noise / (wobble + noise)


def fit_wobble(total: Floats, node: float, speed: float, imu: ImuHeader) -> WobbleModel:
    """Return the model whose spectrum is that of the run.

    Parameters
    ----------
    total : attitude minus path, summed along the pipe, at nodes (m); NaN where there is none.
    node : spacing of the nodes (m).
    speed : usual speed (m/s).
    imu : maker's figures; the accelerometers' random walk sets the error of the path, it is not fitted.

    Notes
    -----
    The navigation that made the path knows of the wobble too: of waves in which the accelerometers drift by more than the tool
    wobbles it shows the share S_w / (S_w + S_drift) only, and the model is compared with what is shown.
    Averaged periodograms in bands of equal ratio, compared by their logarithms: wobble of 1 to 4 equal poles, plus the shift of
    the tool as white noise and as random walk of the path. The number of poles with the least misfit is taken.
    """
    path = max(imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 * _STANDARD_GRAVITY, 1e-7) ** 2 / max(speed, 0.05) ** 3
    turn = gyro_walk(imu, speed)
    tilt = turn * _STANDARD_GRAVITY**2 / max(speed, 0.05) ** 4
    sigma, length, shift = _DEFAULT
    fallback = WobbleModel(2.0 * sigma**2 / length, 1.0 / length, 1, shift**2, 0.0, path, tilt, turn)
    frequency, power, weight = _spectrum(total, node)
    if frequency.size < 6:
        return fallback
    best, least = fallback, np.inf
    for order in _ORDERS:
        for rate in (0.03, 0.3):
            model, misfit = _fit_order(frequency, power, weight, order, rate * order, node, (path, tilt, turn))
            if misfit < least:
                best, least = model, misfit
    return best


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
    shift: tuple[float, float],
) -> Floats:
    """Return the sigma (rad) of the turn of the pipe between two places these lags (m) apart.

    Parameters
    ----------
    model : fitted to ``total``.
    lags : metre.
    total, node : as for `fit_wobble`.
    direction, step : direction of the tool (rad) on the grid of the result, and its step (m).
    shift : sigma of the tool's slow shift in the pipe, and that of a ring that sees it, 0 without one (m).

    Notes
    -----
    Where the wobble stands above the noise of the path, the two-sided smoother leaves S_w S_n / (S_w + S_n). Shorter waves of the
    wobble hide below that noise. Neither the departure of the path nor the attitude itself can hold less than the wobble that
    is in them, so that the lesser of their spectra stands for the error; of the departure half, as nothing tells wobble from
    ride there. (Medians over pieces of the line keep bends out; what the straight pipe bends in short waves is counted as
    error.) A turn over a lag l passes 2 (1 - cos 2π f l) of the spectrum; the random walk of the gyros comes on top.
    """
    highest = 0.5 / step
    frequency = np.unique(np.concatenate([np.geomspace(1e-4, highest, 3000), np.linspace(0.01, highest, 3000)]))
    wobble, noise = model.wobble_spectrum(frequency), model.noise_spectrum(np.minimum(frequency, 0.5 / node), node)
    left = model.left_spectrum(frequency, node, *shift)
    most = np.full(frequency.size, np.inf)
    for slopes, spacing, longest, order in ((_slope(total) / node, node, _SEGMENT_M, 0), (np.diff(direction), step, _PIECE_M, 1)):
        at, power = _median_spectrum(slopes, spacing, longest)
        if at.size > 4:
            power = power / (2.0 * np.sin(np.pi * at * spacing)) ** 2 if order else 0.5 * power
            inside = frequency <= at[-1]
            most[inside] = np.minimum(most[inside], np.interp(frequency[inside], at, power))
    hidden = (wobble < noise) & np.isfinite(most)
    left[hidden] = np.maximum(left, most)[hidden]
    passed = 2.0 * (1.0 - np.cos(2.0 * np.pi * frequency * np.asarray(lags)[:, None]))
    return np.sqrt(np.trapezoid(left * passed, frequency, axis=1) + model.turn_drive * lags)


def _fit_order(
    frequency: Floats, power: Floats, weight: Floats, order: int, rate: float, node: float, inertial: tuple[float, float, float]
) -> tuple[WobbleModel, float]:
    """Least squares of the logarithms over wobble power, decay, shift and ride, begun at a decay."""
    variance = max(float(np.trapezoid(power, frequency)), 1e-14)
    steep = 2.0 * node * (2.0 * np.sin(np.pi * np.minimum(frequency[-3:] * node, 0.5)) / node) ** 2
    shift, ride = float((power[-3:] / steep).mean()), 0.5 * float(power.min())

    def model_of(x):
        size, decay, spread, white = np.exp(x)
        return WobbleModel(size * decay, decay, order, spread, white, *inertial)

    def misfit(x):
        model = model_of(x)
        wobble, drift = model.wobble_spectrum(frequency), _drift_spectrum(frequency, model.path_drive, model.tilt_drive)
        seen = wobble**2 / (wobble + drift) + _ride_spectrum(frequency, model.shift_variance, model.ride, node)
        return np.sqrt(weight) * np.log(seen / power)

    low, high = np.log([1e-16, 1e-3, 1e-15, 1e-16]), np.log([1.0, 2.0 * order, 1.0, 1.0])
    start = np.log([variance, rate, max(shift, 1e-14), max(ride, 1e-15)])
    found = least_squares(misfit, np.clip(start, low + 1e-3, high - 1e-3), bounds=(low, high))
    return model_of(found.x), 2.0 * float(found.cost)


def _spectrum(total: Floats, node: float) -> tuple[Floats, Floats, Floats]:
    """Robust averaged spectrum of the departure (rad² m) in bands: frequency, power, number of periodograms' values in it."""
    slope = _slope(total) / node
    if slope.size < 128:
        return np.empty(0), np.empty(0), np.empty(0)
    size = min(round(_SEGMENT_M / node), slope.size)
    frequency, power = welch(slope, fs=1.0 / node, nperseg=size, average="median" if slope.size > 4 * size else "mean")
    pieces = max(1.0, slope.size / size)
    edges = np.geomspace(frequency[1] * 0.9, 0.5 / node * 1.001, 28)
    band = np.digitize(frequency, edges)
    rows = [(np.exp(np.log(frequency[b]).mean()), np.exp(np.log(np.maximum(power[b], 1e-30)).mean()), b.sum() * pieces)
            for b in (np.flatnonzero(band == i) for i in range(1, edges.size)) if b.size]  # fmt: skip
    table = np.array(rows)
    return table[:, 0], table[:, 1], np.minimum(table[:, 2], _MOST_WEIGHT)


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


def _slope(total: Floats) -> Floats:
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


def _wobble_spectrum(frequency: Floats, drive: float, rate: float, order: int) -> Floats:
    omega2 = (2.0 * np.pi * frequency) ** 2
    return 2.0 * drive * rate ** (2 * order - 2) / (omega2 + rate**2) ** order


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
