"""A filter's problem in; the smoothed states, with noise learned from the data and contradicted marks down-weighted, out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deform.geometry import earth
from deform.nav import _kernels_state as kernels
from deform.nav._kernels import GAP_TURN
from deform.nav.aiding import MarkAid
from deform.nav.arm_tilt import tilt_per_epoch
from deform.nav.error_model import SCALE_WALK
from deform.nav.filter import Filtered, Problem, run_forward
from deform.nav.gap_path import about_reckoning
from deform.nav.gaps import turned_as
from deform.nav.noise import learn
from deform.nav.reverse import compared
from deform.nav.smoother import Smoothed, smooth

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

CONTRADICTED = 4.5  # misclosure without the mark over its sigma beyond which a mark is gross
NO_WEIGHT = 1e-8
WANDERS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # of a lone wheel's scale, against the usual one
WANDER_PENALTY = 3.0  # of the logarithm of the likelihood, against more wander than usual
MARK_GATE = 4.0  # sigma beyond which the innovation of a mark counts by Huber's density
COARSE_RAD = math.radians(3.0)  # attitude so uncertain, at first or behind a gap, that all is linear about the smoothed path
SETTLED_RAD, MOST_ROUNDS = math.radians(0.05), 8  # of the attitudes, beyond which a path is solved about anew


@dataclass(frozen=True)
class Solution:
    """Smoothed states and how they came about.

    Parameters
    ----------
    problem : with learned noise and final weights of the marks.
    filtered, smoothed : last passes.
    left_out : (mark, 3) east, north, up of trajectory minus mark when the mark does not count (m).
    left_out_sigma : (mark, 3) its standard deviation.
    closed : (mark, 3) final trajectory minus mark.
    """

    problem: Problem
    filtered: Filtered
    smoothed: Smoothed
    left_out: Floats
    left_out_sigma: Floats
    closed: Floats


def solve(problem: Problem, arms: tuple[Floats, Floats] | None = None) -> Solution:
    """Filter and smooth until noise, weights and first attitude stand.

    Parameters
    ----------
    problem : with noise as it is before the data have spoken.
    arms : times and slopes of the pipe's centre along the tool from `arm_tilt.ring_centres`.

    Notes
    -----
    A mark is judged by its misclosure against all other data: with r = path - mark behind the smoother and P the smoothed
    variance, path without the mark minus mark is r R / (R - P), of variance R² / (R - P) (data snooping, Baarda 1968). The
    worst one beyond the limit loses its weight and everything is solved anew, so that one bad mark does not condemn its
    neighbours.
    """
    lost = float(problem.epochs.table[:, GAP_TURN].max(initial=0.0))
    coarse = max(float(np.max(np.diag(problem.start.covariance)[6:9])), lost) > COARSE_RAD**2
    if lost > COARSE_RAD**2:
        problem = about_reckoning(problem)
    if coarse:
        problem = _about_its_path(problem)
    turned = np.empty((problem.epochs.bounds.size, 9))
    filtered = run_forward(problem, turned)
    if arms is not None:
        tilt = tilt_per_epoch(problem.epochs, turned.reshape(-1, 3, 3), *arms, problem.travel.stationary)
        problem = replace(problem, travel=replace(problem.travel, tilt=tilt))
    problem = learn(problem, filtered)
    if coarse:
        problem = _about_its_path(problem)
    every = problem
    problem, filtered, smoothed = _without_gross(problem, *_pass(problem))
    if problem.travel.lone and (problem.marks.weight <= 0.5).sum() > 1:  # one mark may be wrong; of several it is the wheel
        problem = _wandering(every)
        problem, filtered, smoothed = _without_gross(problem, *_pass(problem))
    return Solution(problem, filtered, smoothed, *misclosures(problem.marks, smoothed))


def misclosures(marks: MarkAid, smoothed: Smoothed) -> tuple[Floats, Floats, Floats]:
    """Return misclosures without the mark itself, their sigma, and those of the final path (mark, 3), east, north, up."""
    places, P = smoothed.states[marks.epoch, :3], smoothed.sigma[marks.epoch, :3] ** 2
    velocity = smoothed.states[marks.epoch, 3:6]
    closed = np.column_stack(
        earth.enu_difference(
            np.degrees(places[:, 0]), np.degrees(places[:, 1]), places[:, 2],
            np.degrees(marks.place[:, 0]), np.degrees(marks.place[:, 1]), marks.place[:, 2],
        )
    )  # fmt: skip
    closed = closed.reshape(-1, 3) + velocity * marks.late[:, None]
    R = np.column_stack([marks.variance[:, :2].mean(axis=1), marks.variance[:, :2].mean(axis=1), marks.variance[:, 2]])
    R = np.maximum(R, 1e-8)
    R_used = R / marks.weight[:, None]
    share = np.maximum(1.0 - P / R_used, 1e-6)
    left_out = closed / share
    without = P / share  # variance of the path without the mark
    return left_out, np.sqrt(R + without), closed


def _pass(problem: Problem) -> tuple[Filtered, Smoothed]:
    filtered = run_forward(problem, at=compared(problem))
    return filtered, smooth(problem, filtered)


def _without_gross(problem: Problem, filtered: Filtered, smoothed: Smoothed) -> tuple[Problem, Filtered, Smoothed]:
    """Drop marks that the other data contradict, the worst first; take back those that agree once the gross ones are out."""
    for _ in range(problem.marks.epoch.size):
        worst = _extreme(problem.marks, smoothed, dropped=False)
        if worst is None or (problem.marks.weight > 0.5).sum() < 3:
            break
        problem = _weighted(problem, worst, NO_WEIGHT)
        filtered, smoothed = _pass(problem)
    for _ in range(problem.marks.epoch.size):
        agrees = _extreme(problem.marks, smoothed, dropped=True)
        if agrees is None:
            break
        problem = _weighted(problem, agrees, 1.0)
        filtered, smoothed = _pass(problem)
    return problem, filtered, smoothed


def _extreme(marks: MarkAid, smoothed: Smoothed, *, dropped: bool) -> int | None:
    """Return the mark in use that is contradicted most, or of those ``dropped`` the one that agrees best; None without any."""
    left_out, sigma, _ = misclosures(marks, smoothed)
    size = np.max(np.abs(left_out) / sigma, axis=1, initial=0.0)
    candidates = (marks.weight <= 0.5) & (size < CONTRADICTED) if dropped else (marks.weight > 0.5) & (size >= CONTRADICTED)
    if not candidates.any():
        return None
    return int(np.argmin(np.where(candidates, size, np.inf)) if dropped else np.argmax(np.where(candidates, size, -np.inf)))


def _weighted(problem: Problem, mark: int, factor: float) -> Problem:
    weight = problem.marks.weight.copy()
    weight[mark] = factor
    return replace(problem, marks=problem.marks.weighted(weight))


def _wandering(problem: Problem) -> Problem:
    """Let the scale of a lone wheel wander by as much as makes the marks most likely.

    Notes
    -----
    A wheel that slips by little for minutes is believed by the inertial unit, whose velocity is not known better by then. No
    other wheel shows it; the marks do, each by its innovation. One of them that is grossly wrong counts by Huber's density, and
    is not explained by a wander that would have to spoil all the others. The travel itself is not asked: its likelihood takes any
    error of the wheel for wander, and would leave the way to the accelerometers.
    """
    scores = []
    for factor in WANDERS:
        filtered = run_forward(replace(problem, model=problem.model.with_wander(factor * SCALE_WALK)))
        variance = np.maximum(filtered.mark_news[:, 3:], 1e-12)
        size = np.abs(filtered.mark_news[:, :3]) / np.sqrt(variance)
        square = np.where(size < MARK_GATE, size**2, MARK_GATE * (2.0 * size - MARK_GATE))
        scores.append(-0.5 * float(np.nansum(np.log(variance) + square)) - WANDER_PENALTY * (factor > 1.0))
    best = WANDERS[int(np.argmax(scores))]
    log.info("scale of the lone wheel wanders by %.0e a root metre; scores %s", best * SCALE_WALK, np.round(scores, 1))
    return replace(problem, model=problem.model.with_wander(best * SCALE_WALK))


def _about_its_path(problem: Problem) -> Problem:
    """Take everything as linear about the smoothed path, until it stands.

    Notes
    -----
    Iterated smoothing (Bell 1994, SIAM J. Optim. 4, 626-636): where the first azimuth is unknown by degrees, or drifts by degrees
    unseen between marks, the path that the filter was linear about is not the one that the marks leave. Behind a gap of the
    inertial unit, where attitude and velocity are lost together, a filter that is linear about its own estimates takes what it
    corrects from one to the next for a force, and believes within seconds that it knows the azimuth.
    """
    for _ in range(MOST_ROUNDS):
        smoothed, before = _pass(problem)[1], problem.about
        problem = replace(problem, about=smoothed.states, epochs=turned_as(problem.epochs, smoothed.states, smoothed.sigma))
        if not len(before):
            continue
        turned = _most_turned(smoothed.states, before)
        log.info("solved about the smoothed path; attitudes moved by %.2f degree", math.degrees(turned))
        if turned < SETTLED_RAD:
            break
    return problem


def _most_turned(states: Floats, others: Floats) -> float:
    """Greatest angle (radian) between the attitudes of states at the same bounds."""
    matrix = slice(kernels.MATRIX, kernels.MATRIX + 9)
    apart = np.sum((states[:, matrix] - others[:, matrix]) ** 2, axis=1)  # of two rotations: 8 sin² of half the angle
    return 2.0 * math.asin(min(math.sqrt(float(apart.max()) / 8.0), 1.0))
