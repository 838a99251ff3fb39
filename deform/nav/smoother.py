"""A filter's problem and its forward pass in; states with standard deviations at every epoch, from all data, out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_smoother as kernels
from deform.nav._kernels_state import STATE_COLUMNS
from deform.nav.filter import BLOCK_EPOCHS, Buffers, Filtered, Innovations, Problem, blocks, run_block

Floats = NDArray[np.float64]
NOTHING = np.empty((0, 3))


@dataclass(frozen=True)
class Smoothed:
    """States from all data.

    Parameters
    ----------
    states : (bound, STATE_COLUMNS).
    sigma : (bound, n) standard deviations of the error state: position east, north, up (m), velocity, turning error (radian), ...
    """

    states: Floats
    sigma: Floats


def smooth(problem: Problem, filtered: Filtered) -> Smoothed:
    """Run backwards over the blocks of the forward pass.

    Notes
    -----
    Fixed-interval smoothing in the form of Bryson and Frazier (1963), modified by Bierman (1977): x_s = x - P λ and
    P_s = P - P Λ P, where λ and Λ are carried backwards through measurements, λ ← (I - K H)'λ - H'ν/s, and transitions,
    λ ← Φ'λ. It gives what Rauch, Tung and Striebel give without inverting a covariance. Each block is filtered anew from its
    checkpoint, so that memory holds two blocks, whatever the length of the run.

    References
    ----------
    Li (2014), eq. 26 to 30; Bierman (1977), Factorization Methods, chapter 10.
    """
    n, n_bounds = problem.model.size, problem.epochs.bounds.size
    result = Smoothed(np.empty((n_bounds, STATE_COLUMNS)), np.empty((n_bounds, n)))
    wanted = result.states, result.sigma
    adjoint, information = np.zeros(n), np.zeros((n, n))
    fixed = problem.moves, problem.spans.arguments, problem.model.arguments
    parts = list(zip(blocks(n_bounds), filtered.checkpoints, strict=True))[::-1]
    both = [Buffers.of(n, min(n_bounds, BLOCK_EPOCHS)) for _ in parts[:2]]
    again = Innovations.of(problem)

    def filtered_again(i: int) -> tuple[int, int, Buffers]:
        (first, last), (x, P) = parts[i]
        run_block(problem, first, last, x.copy(), P.copy(), both[i % 2], again)
        return first, last, both[i % 2]

    with ThreadPoolExecutor(1) as beside:  # the next block is filtered while this one is smoothed
        coming = beside.submit(filtered_again, 0)
        for i in range(len(parts)):
            first, last, buffers = coming.result()
            if i + 1 < len(parts):
                coming = beside.submit(filtered_again, i + 1)
            kernels.backward(
                first, last, *fixed, buffers.arguments, adjoint, information, *wanted, NOTHING, np.empty(0), np.empty(0)
            )
    return result


@dataclass(frozen=True)
class Slopes:
    """How the log-likelihood of a problem changes with its noise.

    Parameters
    ----------
    score : log-likelihood of the innovations of the travel.
    pull : (epoch, 3) its slope to the variances of the displacement along, right, up; zero where there was none.
    drive : (n,) its slope to the logarithm of each state's noise, first covariance of the wobble included.
    recalled : (2,) its slope to the logarithms of the lengths of the wobble's mean, right and up.
    """

    score: float
    pull: Floats
    drive: Floats
    recalled: Floats


def slopes(problem: Problem, buffers: Buffers) -> Slopes:
    """Return log-likelihood and its exact slopes from one pass to and fro; the buffers must hold all bounds.

    References
    ----------
    Koopman and Shephard (1992), Biometrika 79, 823-826: Exact score for time series models in state space form.
    """
    model, last, out = problem.model, problem.epochs.bounds.size - 1, Innovations.of(problem)
    n = model.size
    run_block(problem, 0, last, problem.start.state.copy(), problem.start.covariance.copy(), buffers, out)
    adjoint, information, pull, drive, recalled = np.zeros(n), np.zeros((n, n)), np.zeros((last, 3)), np.zeros(n), np.zeros(2)
    nowhere = np.empty((0, STATE_COLUMNS)), np.empty((0, n))
    fixed = problem.moves, problem.spans.arguments, model.arguments, buffers.arguments
    kernels.backward(0, last, *fixed, adjoint, information, *nowhere, pull, drive, recalled)
    u = np.arange(n)[model.index("sway")]
    push = np.outer(adjoint, adjoint) - information
    for axis in (0, 1):  # the first covariance of the wobble is that of the long run
        here = model.ride_states(axis)
        pushed = push[np.ix_(here, here)]
        for component in range(u.size // 2):
            drive[u[2 * component + axis]] += 0.5 * float(np.sum(pushed * model.ride_covariance(axis, component)))
        recalled[axis] += 0.5 * float(np.sum(pushed * model.ride_slope(axis)))
    return Slopes(float(out.score.sum()), pull, drive, recalled)
