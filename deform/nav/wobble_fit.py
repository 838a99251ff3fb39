"""The path's departure from the attitude in; the model of the tool's wobble and of its tones that has its spectrum out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import welch

from deform.nav.compensation import STANDARD_GRAVITY
from deform.nav.tones import MOST_TONES, Tone, find_tone, with_share
from deform.nav.wobble import SEGMENT_M, USUAL, WobbleModel, gyro_walk, slope_of
from deform.run.raw import ImuHeader

Floats = NDArray[Any]

_MOST_WEIGHT = 30.0  # values of the periodogram that a band counts for; more of them do not make the model better
_ORDERS = (1, 2, 3, 4)  # poles of the wobble: how sharply it fades towards short waves
_MOST_LINES = 8  # looked at in one axis; those that matter become tones
_LEAST_GAIN = math.radians(0.002)  # of the direction by a tone that is known, rms


def fit_wobble(
    total: Floats, node: float, speed: float, imu: ImuHeader, lines: Sequence[Tone] = (), orders: Sequence[int] = _ORDERS
) -> WobbleModel:
    """Return the model whose smooth spectrum is that of the run.

    Parameters
    ----------
    total : attitude minus path, summed along the pipe, at nodes (m); NaN where there is none.
    node : spacing of the nodes (m).
    speed : usual speed (m/s).
    imu : maker's figures; the accelerometers' random walk sets the error of the path, it is not fitted.
    lines : tones, whose frequencies are left out.
    orders : numbers of poles to choose from.

    Notes
    -----
    The navigation that made the path knows of the wobble too: of waves in which the accelerometers drift by more than the tool
    wobbles it shows the share S_w / (S_w + S_drift) only, and the model is compared with what is shown.
    Averaged periodograms in bands of equal ratio, compared by their logarithms: wobble of 1 to 4 equal poles, plus the shift of
    the tool as white noise and as random walk of the path. The number of poles with the least misfit is taken.
    """
    path = max(imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 * STANDARD_GRAVITY, 1e-7) ** 2 / max(speed, 0.05) ** 3
    turn = gyro_walk(imu, speed)
    tilt = turn * STANDARD_GRAVITY**2 / max(speed, 0.05) ** 4
    sigma, length, shift = USUAL
    fallback = WobbleModel(2.0 * sigma**2 / length, 1.0 / length, 1, shift**2, 0.0, path, tilt, turn)
    frequency, power, weight = _spectrum(total, node, lines)
    if frequency.size < 6:
        return fallback
    best, least = fallback, np.inf
    for order in orders:
        for rate in (0.03, 0.3):
            model, misfit = _fit_order(frequency, power, weight, order, rate * order, node, (path, tilt, turn))
            if misfit < least:
                best, least = model, misfit
    return best


def fit_departure(
    total: Floats,
    node: float,
    speed: float,
    imu: ImuHeader,
    attitude: Floats,
    ring: tuple[float, Floats] | None,
    riding: Callable[[WobbleModel], tuple[float, float]],
) -> WobbleModel:
    """Return the model of a run, smooth spectra and tones.

    Parameters
    ----------
    total, node, speed, imu : as for `fit_wobble`.
    attitude : direction of the tool midway between the nodes (rad).
    ring : place of a ring of arms along the tool, and the offset that it sees at the nodes (m), or None.
    riding : of a model: sigma of the tool's slow shift in the pipe, and that of a ring that sees it, 0 without one (m).

    Notes
    -----
    Line by line: the strongest is found against smooth spectrum and the lines before it, and the smooth spectrum fitted anew
    beside them. Tones are those that the smooth spectra by themselves would leave in the direction, or put there, by
    `_LEAST_GAIN` and more, and by more than is unsure of their share. The smooth spectra are fitted beside the tones when these
    are all the lines there are, else to the whole, for they have to stand for the other lines.
    """
    model = fit_wobble(total, node, speed, imu)
    slope, floor = slope_of(total) / node, model
    lines: list[Tone] = []
    while len(lines) < _MOST_LINES:
        tone = find_tone(slope, node, partial(floor.shown_spectrum, node=node), lines)
        if tone is None:
            break
        lines.append(with_share(tone, slope, node, attitude, ring, riding(model)[0] / model.sigma))
        floor = fit_wobble(total, node, speed, imu, lines, (floor.order,))
    lever = 0.0 if ring is None else ring[0]
    off = [abs(model.taken(line, node, *riding(model), lever) - line.share) for line in lines]
    gain = [by * math.sqrt(line.variance) if by > line.share_sigma else 0.0 for by, line in zip(off, lines, strict=True)]
    kept = [i for i in np.argsort(gain)[::-1][:MOST_TONES] if gain[i] > _LEAST_GAIN]
    tones = tuple(lines[i] for i in kept)
    others = tuple(line for i, line in enumerate(lines) if i not in kept and line.variance > _LEAST_GAIN**2)
    if tones and not others:
        model = fit_wobble(total, node, speed, imu, tones)
    return replace(model, tones=tones, lines=others)


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
        return np.sqrt(weight) * np.log(model_of(x).shown_spectrum(frequency, node) / power)

    low, high = np.log([1e-16, 1e-3, 1e-15, 1e-16]), np.log([1.0, 2.0 * order, 1.0, 1.0])
    start = np.log([variance, rate, max(shift, 1e-14), max(ride, 1e-15)])
    found = least_squares(misfit, np.clip(start, low + 1e-3, high - 1e-3), bounds=(low, high))
    return model_of(found.x), 2.0 * float(found.cost)


def _spectrum(total: Floats, node: float, lines: Sequence[Tone] = ()) -> tuple[Floats, Floats, Floats]:
    """Robust averaged spectrum of the departure (rad² m) in bands: frequency, power, number of periodograms' values in it."""
    slope = slope_of(total) / node
    if slope.size < 128:
        return np.empty(0), np.empty(0), np.empty(0)
    size = min(round(SEGMENT_M / node), slope.size)
    frequency, power = welch(slope, fs=1.0 / node, nperseg=size, average="median" if slope.size > 4 * size else "mean")
    for tone in lines:
        away = np.abs(frequency - tone.frequency) > 2.5 / (size * node) + tone.decay / np.pi
        frequency, power = frequency[away], power[away]
    pieces = max(1.0, slope.size / size)
    edges = np.geomspace(frequency[1] * 0.9, 0.5 / node * 1.001, 28)
    band = np.digitize(frequency, edges)
    rows = [(np.exp(np.log(frequency[b]).mean()), np.exp(np.log(np.maximum(power[b], 1e-30)).mean()), b.sum() * pieces)
            for b in (np.flatnonzero(band == i) for i in range(1, edges.size)) if b.size]  # fmt: skip
    table = np.array(rows)
    return table[:, 0], table[:, 1], np.minimum(table[:, 2], _MOST_WEIGHT)
