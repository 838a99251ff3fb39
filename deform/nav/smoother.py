"""A filter's problem and its forward pass in; states with standard deviations at every epoch, from all data, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_filter as kernels
from deform.nav.filter import Buffers, Filtered, Problem, blocks, run_block

Floats = NDArray[np.float64]


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
    checkpoint, so that memory holds one block, whatever the length of the run.

    References
    ----------
    Li (2014), eq. 26 to 30; Bierman (1977), Factorization Methods, chapter 10.
    """
    n, n_bounds = problem.model.size, problem.epochs.bounds.size
    states, sigma = np.empty((n_bounds, kernels.STATE_COLUMNS)), np.empty((n_bounds, n))
    adjoint, information = np.zeros(n), np.zeros((n, n))
    buffers = Buffers.of(n)
    residuals, mark_news = np.empty((len(problem.epochs.table), 3)), np.empty((problem.marks.epoch.size, 6))
    model = problem.model
    for (first, last), (x, P) in zip(reversed(blocks(n_bounds)), reversed(filtered.checkpoints), strict=True):
        run_block(problem, first, last, x.copy(), P.copy(), True, buffers, residuals, mark_news, np.zeros(3))
        noise = (model.at, model.reckoned, *model.arguments)
        arguments = (*problem.arguments(), *noise, *buffers.arguments, adjoint, information, states, sigma)
        kernels.backward(first, last, *arguments)
    return Smoothed(states, sigma)
