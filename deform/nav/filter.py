"""Epochs, aids and an error model in; one forward pass of the filter, block by block, with its innovations out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_filter as kernels
from deform.nav.aiding import MarkAid, TravelAid
from deform.nav.error_model import ErrorModel
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
BLOCK_EPOCHS = 512
NO_PATH = np.empty((0, 9))
GATE = 4.0


@dataclass(frozen=True)
class Start:
    """State and variances at the first bound.

    Parameters
    ----------
    state : (STATE_COLUMNS,) place, velocity, matrix, parameters of the instruments.
    variance : (n,) of the error state.
    """

    state: Floats
    variance: Floats


@dataclass(frozen=True)
class Problem:
    """Everything that filter and smoother work on."""

    epochs: Epochs
    travel: TravelAid
    marks: MarkAid
    model: ErrorModel
    start: Start

    def arguments(self) -> tuple:
        """Arguments of the kernels that are common to both directions."""
        return self.epochs.table, self.travel.speeds, self.travel.tilt, self.travel.variance


@dataclass(frozen=True)
class Filtered:
    """Result of the forward pass.

    Parameters
    ----------
    checkpoints : states and covariances before the measurements of the first bound of each block.
    news : (epoch, 3) normalised innovations of the travel along, right, up; NaN where there was none.
    mark_news : (mark, 6) innovations along, across, up, then their variances.
    end : state behind the last measurement.
    covariance : its covariance.
    score : (3,) log-likelihood of the innovations of the travel along, right, up.
    """

    checkpoints: tuple[tuple[Floats, Floats], ...]
    news: Floats
    mark_news: Floats
    end: Floats
    covariance: Floats
    score: Floats


@dataclass
class Buffers:
    """Work sheet of one block."""

    states: Floats
    covariances: Floats
    counts: NDArray[np.int64]
    H: Floats
    K: Floats
    news: Floats

    @classmethod
    def of(cls, n: int, size: int = BLOCK_EPOCHS) -> Buffers:
        """Return empty buffers for ``n`` error states."""
        m = kernels.MOST_SCALARS
        return cls(
            np.empty((size, kernels.STATE_COLUMNS)),
            np.empty((size, n, n)),
            np.zeros(size, np.int64),
            np.empty((size, m, n)),
            np.empty((size, m, n)),
            np.empty((size, m, 3)),
        )

    @property
    def arguments(self) -> tuple:
        """In the order of the kernels."""
        return self.states, self.covariances, self.counts, self.H, self.K, self.news


def blocks(n_bounds: int) -> list[tuple[int, int]]:
    """First and last bound of each block."""
    return [(i, min(i + BLOCK_EPOCHS, n_bounds) - 1) for i in range(0, n_bounds, BLOCK_EPOCHS)]


def run_block(problem: Problem, first: int, last: int, x: Floats, P: Floats, keep: bool, buffers: Buffers, residuals: Floats,
              mark_news: Floats, score: Floats, turned: Floats = NO_PATH) -> None:  # fmt: skip
    """Filter one block; x and P are led on, the buffers filled when ``keep``, the log-likelihood added to ``score`` (3,)."""
    marks, model = problem.marks, problem.model
    aids = (marks.epoch, marks.place, marks.used_variance, marks.late)
    noise = (model.at, model.reckoned, GATE, *model.arguments)
    arguments = (*problem.arguments(), *aids, x, P, *noise, keep, *buffers.arguments, residuals, mark_news, score, turned)
    kernels.forward(first, last, *arguments)


def run_forward(problem: Problem, turned: Floats = NO_PATH) -> Filtered:
    """Filter all epochs, keeping a state per block only; ``turned`` (bound, 9) takes the attitudes.

    Notes
    -----
    At each bound the marks passed there, then the displacement by the odometer over the epoch that begins there, in three
    scalar measurements along, right and up of the tool. The innovation gate lets the variance of an outlier grow with it.

    References
    ----------
    Porter (1990), eq. 3-62 to 3-76; CN103727938A, step 3; Li (2014), eq. 19 to 25.
    """
    x, P = problem.start.state.copy(), np.diag(problem.start.variance)
    n_bounds = problem.epochs.bounds.size
    residuals, mark_news = np.full((len(problem.epochs.table), 3), np.nan), np.full((problem.marks.epoch.size, 6), np.nan)
    buffers = Buffers.of(problem.model.size, 1)
    checkpoints, score = [], np.zeros(3)
    for first, last in blocks(n_bounds):
        checkpoints.append((x.copy(), P.copy()))
        run_block(problem, first, last, x, P, False, buffers, residuals, mark_news, score, turned)
    return Filtered(tuple(checkpoints), residuals, mark_news, x, P, score)
