"""A filter's problem in; the same with the noise of wobble, ride and odometer that makes the data most likely out."""

from __future__ import annotations

import logging
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from deform.nav._kernels_state import TILT, WAVES, WOBBLE
from deform.nav.aiding import REST_VARIANCE, RIDE_DENSITY, SpanAid
from deform.nav.error_model import BIAS_CORRELATION_S, MEAN_M, WOBBLE_DEG, WOBBLE_LENGTHS_M
from deform.nav.filter import BLOCK_EPOCHS, NO_STATES, Buffers, Filtered, Problem, Start, run_forward
from deform.nav.smoother import slopes
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

STRETCH_EPOCHS, MOST_STRETCHES = 4 * BLOCK_EPOCHS, 2
LEAST_EPOCHS = 200  # in motion, in a stretch that may teach
DOUBT = 2.0  # factor on the sigmas of the state at the beginning of a stretch
OUTLIER = 4.5  # sigma beyond which a displacement teaches nothing
ROUNDS, MOST_STEP = 7, 2.5  # a round lets a logarithm go so far
ITERATIONS, PRECISION = (12, 40), 3e-7  # of the first round, which only tells what is an outlier, and of the others
SHORTER = (0.3, 0.1, 0.03)  # of the wobble's mean: parts of its length at which the likelihood may have another summit
# Noise of the velocity within an epoch moves the tool as well, and the filter lets it begin at the epoch's end; errors of a wheel
# last longer than an epoch. A noise of the displacement below these parts of the usual one would stand for these only.
LEAST_PART, LEAST_ALONG = 0.08, 0.04
LEAST_LONE = 4e-4  # the same of a lone wheel, whose usual noise is that of slips: two parts in 10,000 of the way, hardly less
LEAST_MEAN_M = 10.0  # a shorter mean would only be one more shape of the components

# What is expected of a tool: spreads of logarithms of powers and variances before the data have spoken
WOBBLE_SPREAD, SHAPE_SPREAD = 2.0, 2.0  # of the wobble's variances against a usual tool's; of neighbours, and of right and up
RIDE_SPREAD, ALONG_SPREAD, REST_SPREAD = 3.0, 3.0, 3.0
BIAS_SPREAD = 2.0  # of the correlation times of the biases
MEAN_SPREAD = 1.5  # of the length of the wobble's mean


@dataclass(frozen=True)
class Noise:
    """What is learned.

    Parameters
    ----------
    wobble : (component, right and up) variance of the wobble (radian²).
    ride : (2,) density of the noise of the path across the pipe, right and up (m² per m).
    along : factor on the odometer's own variance.
    bias_s : (2,) correlation times of gyro and accelerometer bias (s).
    rest : variance of the displacement at rest within an epoch (m²).
    mean : (2,) length over which the wobble is about zero in the mean, right and up (m).
    """

    wobble: Floats
    ride: Floats
    along: float
    bias_s: Floats
    rest: float
    mean: Floats

    @property
    def logs(self) -> Floats:
        """Logarithms, as the search uses them."""
        return np.log(np.concatenate([self.wobble.ravel(), self.ride, [self.along], self.bias_s, [self.rest], self.mean]))

    @classmethod
    def of(cls, logs: Floats) -> Noise:
        """Return the noise of such logarithms."""
        rest = np.exp(logs[2 * WAVES :])
        return cls(np.exp(logs[: 2 * WAVES]).reshape(WAVES, 2), rest[:2], float(rest[2]), rest[3:5], float(rest[5]), rest[6:8])

    @classmethod
    def usual(cls) -> Noise:
        """Noise of a usual tool."""
        wobble = np.repeat(np.radians(WOBBLE_DEG)[:, None] ** 2, 2, axis=1)
        return cls(wobble, np.full(2, RIDE_DENSITY), 1.0, np.full(2, BIAS_CORRELATION_S), REST_VARIANCE, np.full(2, MEAN_M))


def learn(problem: Problem, filtered: Filtered) -> Problem:
    """Return the problem with the noise of greatest posterior probability.

    Parameters
    ----------
    problem : with noise as it is before the data have spoken.
    filtered : its forward pass, whose checkpoints the stretches start from.

    Notes
    -----
    The likelihood of the innovations of the odometer's displacement over stretches in motion spread over the run, without
    marks: the inertial unit is the witness. Its slopes are exact and come from one smoothing pass, so that a quasi-Newton search
    needs some tens of passes. A broad prior holds what the data cannot see: long waves on a short line, or under a poor unit.

    The components of the wobble have fixed lengths: their variances are sought, and the length over which their sum is about zero
    in the mean. So the spectrum rises towards long waves, with the fourth power of the wavelength at most, and falls beyond the
    length of the mean with its square.

    A displacement beyond `OUTLIER` sigma is left out, and the search begun anew, until the same ones are out. (To count it at a
    bound instead rewards a small sigma as soon as many lie beyond: with the heading lost in a gap the noise then collapsed.)

    References
    ----------
    Mehra (1970), IEEE Trans. AC-15, 175-184; Koopman and Shephard (1992), Biometrika 79, 823-826.
    """
    parts = stretches(problem, filtered)
    if not parts or not problem.model.index("wobble").stop:
        return problem
    buffers = [Buffers.of(problem.model.size, p.epochs.bounds.size) for p in parts]
    usual = Noise.usual().logs
    least_along = LEAST_LONE if problem.travel.lone else LEAST_ALONG
    part = np.repeat([0.0, LEAST_PART, least_along, 0.0, LEAST_PART, LEAST_MEAN_M / MEAN_M], [2 * WAVES, 2, 1, 2, 1, 2])
    with np.errstate(divide="ignore"):
        least = usual + np.log(part)
    x, used, settled, probed = usual.copy(), [np.zeros((0, 3), bool)] * len(parts), False, False
    for turn in range(ROUNDS):
        before, used = used, [_plausible(apply(p, Noise.of(x))) for p in parts]
        if settled and all((a == b).mean() > 0.999 for a, b in zip(before, used, strict=True)):
            break
        taught = [_only(p, use) for p, use in zip(parts, used, strict=True)]
        options = {"maxiter": ITERATIONS[min(turn, 1)], "ftol": PRECISION}
        bounds = np.column_stack([np.maximum(x - MOST_STEP, least), x + MOST_STEP])
        found = minimize(_misfit, x, (taught, usual, buffers), "L-BFGS-B", jac=True, bounds=bounds, options=options)
        stopped = (np.abs(found.x - x) > 0.999 * MOST_STEP) & (found.x > least + 1e-3)
        settled, x = bool(found.success) and not stopped.any(), found.x
        if settled and not probed:
            x, probed = _shorter_mean(x, float(found.fun), least, (taught, usual, buffers)), True
            settled = bool(np.all(x == found.x))
    noise = Noise.of(x)
    _tell(noise)
    return apply(problem, noise)


def _shorter_mean(x: Floats, value: float, least: Floats, arguments: tuple) -> Floats:
    """Return the logarithms with the length of the wobble's mean, right or up, where it is much shorter and likelier."""
    for i in (-2, -1):
        for part in SHORTER:
            tried = x.copy()
            tried[i] = max(tried[i] + math.log(part), least[i])
            there = _misfit(tried, *arguments)[0]
            if there < value - 1.0:
                x, value = tried, there
                break
    return x


def wobble_spectrum(variance: Floats, mean: Floats, wavelength: Floats) -> Floats:
    """Return the two-sided power spectral density (radian² m) of the wobble at wavelengths (m), right and up: (wavelength, 2).

    ``variance`` (component, 2) of the components, ``mean`` (2,) length of the mean that is taken off (m).
    """
    lengths, k = np.array(WOBBLE_LENGTHS_M), 2.0 * np.pi / np.asarray(wavelength, float)[:, None]
    kept = 1.0 - 1.0 / (1.0 + (k * mean) ** 2)
    return kept * (4.0 * lengths / (1.0 + (k * lengths) ** 2) ** 2 @ variance)


def apply(problem: Problem, noise: Noise) -> Problem:
    """Return the problem with such noise."""
    model = problem.model.with_wobble(noise.wobble).with_mean(noise.mean).with_biases(noise.bias_s)
    here = np.r_[model.index("wobble"), model.index("sway"), model.index("mean")]
    P = problem.start.covariance.copy()
    P[here, :] = P[:, here] = 0.0
    P[np.ix_(here, here)] = model.first_covariance()[np.ix_(here, here)]
    travel = problem.travel.with_noise(noise.along, float(noise.ride[0]), float(noise.ride[1]), noise.rest)
    return replace(problem, model=model, travel=travel, start=replace(problem.start, covariance=P))


def stretches(problem: Problem, filtered: Filtered) -> list[Problem]:
    """Return up to `MOST_STRETCHES` pieces of the run in motion, evenly spread, free of gaps, without marks and joints.

    Each begins at a checkpoint of a forward pass, with its covariance widened and the wobble unknown.
    """
    n = problem.epochs.bounds.size - 1
    moving = ~problem.travel.stationary & (problem.travel.variance[:, 0] > 0)
    broken = np.flatnonzero(problem.epochs.gap > 0)
    chosen: list[tuple[int, int]] = []
    for first in range(0, n, BLOCK_EPOCHS):
        last = min(first + STRETCH_EPOCHS, n, *broken[broken >= first][:1])
        free = not chosen or first >= chosen[-1][1]  # one behind the other, as many as fit
        if free and moving[first:last].sum() >= LEAST_EPOCHS:
            chosen.append((first, last))
    if len(chosen) > MOST_STRETCHES:
        chosen = [chosen[i] for i in np.round(np.linspace(0, len(chosen) - 1, MOST_STRETCHES)).astype(int)]
    return [_piece(problem, filtered, first, last) for first, last in chosen]


def _piece(problem: Problem, filtered: Filtered, first: int, last: int) -> Problem:
    epochs, travel, marks = problem.epochs, problem.travel, problem.marks
    x, P = filtered.checkpoints[first // BLOCK_EPOCHS]
    x = x.copy() if not len(problem.about) else problem.about[first].copy()  # what the filter had lost the path knows
    here = slice(first, last)
    x[WOBBLE:TILT] = 0.0  # the wobble and what drives it
    return replace(
        problem,
        epochs=Epochs(epochs.bounds[first : last + 1], epochs.time[first : last + 1], epochs.table[here]),
        travel=replace(travel, speeds=travel.speeds[first : last + 1], variance=travel.variance[here],
                       stationary=travel.stationary[here], along_shape=travel.along_shape[here], doubt=travel.doubt[here],
                       travel=travel.travel[here],
                       tilt=travel.tilt[here]),
        marks=marks.only(np.zeros(marks.epoch.size, bool)),
        spans=SpanAid(),
        about=NO_STATES,
        start=Start(x, P * (DOUBT**2 if first else 1.0)),
    )  # fmt: skip


def _plausible(part: Problem) -> NDArray[np.bool_]:
    """Displacements (epoch, 3) whose innovations lie within `OUTLIER` sigma."""
    return ~(np.abs(run_forward(part).news) > OUTLIER)


def _only(part: Problem, use: NDArray[np.bool_]) -> Problem:
    """Return a stretch with only such displacements."""
    return replace(part, travel=replace(part.travel, variance=np.where(use, part.travel.variance, 0.0)))


def _misfit(x: Floats, parts: list[Problem], usual: Floats, buffers: list[Buffers]) -> tuple[float, Floats]:
    """Minus logarithm of the posterior probability, and its slopes; the stretches side by side."""
    noise = Noise.of(x)
    value, slope = _prior(x, usual)
    with ThreadPoolExecutor(len(parts)) as beside:
        for score, pull in beside.map(_likelihood, parts, [noise] * len(parts), buffers):
            value -= score
            slope -= pull
    return value, slope


def _likelihood(part: Problem, noise: Noise, buffers: Buffers) -> tuple[float, Floats]:
    """Log-likelihood of a stretch, and its slopes to the logarithms of the noise."""
    tried = apply(part, noise)
    found, travel, model = slopes(tried, buffers), part.travel, tried.model
    known = travel.variance > 0
    moving = known & ~travel.stationary[:, None]
    ride = [np.sum((found.pull[:, c] * travel.travel)[moving[:, c]]) * noise.ride[c - 1] for c in (1, 2)]
    along = np.sum((found.pull[:, 0] * travel.along_shape)[moving[:, 0]]) * noise.along
    bias = [-found.drive[model.index(name)].sum() for name in ("gyro_bias", "accel_bias")]
    wobble = found.drive[model.index("wobble")] + found.drive[model.index("sway")]
    rest = found.pull[known & travel.stationary[:, None]].sum() * noise.rest
    return found.score, np.concatenate([wobble, ride, [along], bias, [rest], found.recalled])


def _prior(x: Floats, usual: Floats) -> tuple[float, Floats]:
    """Minus logarithm of the prior: variances near usual ones, those of the wobble off alike at neighbouring lengths."""
    spread = np.repeat(
        [WOBBLE_SPREAD, RIDE_SPREAD, ALONG_SPREAD, BIAS_SPREAD, REST_SPREAD, MEAN_SPREAD], [2 * WAVES, 2, 1, 2, 1, 2]
    )
    off = x - usual
    value, slope = 0.5 * float(np.sum((off / spread) ** 2)), off / spread**2
    wobble, pull = off[: 2 * WAVES].reshape(WAVES, 2), np.zeros((WAVES, 2))
    for axis in (0, 1):
        step = np.diff(wobble, axis=axis) / SHAPE_SPREAD**2
        value += 0.5 * SHAPE_SPREAD**2 * float(np.sum(step**2))
        pull += np.insert(step, 0, 0.0, axis=axis) - np.insert(step, step.shape[axis], 0.0, axis=axis)
    slope[: 2 * WAVES] += pull.ravel()
    return value, slope


def _tell(noise: Noise) -> None:
    edges = np.array([10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0])
    waves = np.geomspace(edges[0], edges[-1], 501)
    S = wobble_spectrum(noise.wobble, noise.mean, waves)
    bands = [(waves >= a) & (waves <= b) for a, b in pairwise(edges)]
    rms = [np.degrees(np.sqrt(-2.0 * np.trapezoid(S[b], 1.0 / waves[b], axis=0))) for b in bands]
    right, up = (" ".join(f"{r[c]:.3f}" for r in rms) for c in (0, 1))
    log.info(
        "wobble of the tool in bands %s m: right %s, up %s degree, about zero in the mean over %.0f, %.0f m; "
        "ride %.1e, %.1e m²/m; odometer's sigma x %.2f; biases stand for %.0f, %.0f s; rest %.1e m",
        *("-".join(f"{e:.0f}" for e in edges), right, up, *noise.mean),
        *(*noise.ride, math.sqrt(noise.along), *noise.bias_s, math.sqrt(noise.rest)),
    )
