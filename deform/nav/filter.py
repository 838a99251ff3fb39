"""Epochs, aids and an error model in; one forward pass of the filter, block by block, with its innovations out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_filter as kernels
from deform.nav._kernels_state import STATE_COLUMNS
from deform.nav.aiding import MarkAid, SpanAid, TravelAid
from deform.nav.error_model import ErrorModel
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
BLOCK_EPOCHS = 512
NO_PATH, NO_STATES = np.empty((0, 9)), np.empty((0, STATE_COLUMNS))
GATE = 4.0


@dataclass(frozen=True)
class Start:
    """State and covariance at the first bound.

    Parameters
    ----------
    state : (STATE_COLUMNS,) place, velocity, matrix, parameters of the instruments.
    covariance : (n, n) of the error state.
    """

    state: Floats
    covariance: Floats


@dataclass(frozen=True)
class Problem:
    """Everything that filter and smoother work on.

    ``about`` (bound, STATE_COLUMNS): states about which all is taken as linear; without rows about those that the filter finds.
    """

    epochs: Epochs
    travel: TravelAid
    marks: MarkAid
    model: ErrorModel
    start: Start
    spans: SpanAid = field(default_factory=SpanAid)
    about: Floats = field(default_factory=lambda: NO_STATES)

    @property
    def moves(self) -> tuple:
        """Epochs and the travel in them, as the kernels take them."""
        return self.epochs.table, self.travel.speeds, self.travel.tilt, self.travel.variance, self.travel.far


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
    passed : states and covariances before the measurements of the bounds that were asked for.
    """

    checkpoints: tuple[tuple[Floats, Floats], ...]
    news: Floats
    mark_news: Floats
    end: Floats
    covariance: Floats
    score: Floats
    passed: tuple[tuple[Floats, Floats], ...] = ()


@dataclass
class Buffers:
    """What the filter keeps of a block for the smoother; without rows it keeps nothing."""

    states: Floats
    covariances: Floats
    counts: NDArray[np.int64]
    H: Floats
    K: Floats
    news: Floats
    errors: Floats

    @classmethod
    def of(cls, n: int, size: int = BLOCK_EPOCHS) -> Buffers:
        """Return empty buffers for ``n`` error states."""
        m = kernels.MOST_SCALARS
        return cls(
            np.empty((size, STATE_COLUMNS)),
            np.empty((size, n, n)),
            np.zeros(size, np.int64),
            np.empty((size, m, n)),
            np.empty((size, m, n)),
            np.empty((size, m, 3)),
            np.zeros((size, n)),
        )

    @property
    def arguments(self) -> tuple:
        """In the order of the kernels."""
        return self.states, self.covariances, self.counts, self.H, self.K, self.news, self.errors


@dataclass(frozen=True)
class Innovations:
    """What a pass of the filter writes down: see `Filtered`."""

    news: Floats
    mark_news: Floats
    score: Floats

    @classmethod
    def of(cls, problem: Problem) -> Innovations:
        """Return empty ones."""
        epochs, marks = len(problem.epochs.table), problem.marks.epoch.size
        return cls(np.full((epochs, 3), np.nan), np.full((marks, 6), np.nan), np.zeros(3))


def blocks(n_bounds: int) -> list[tuple[int, int]]:
    """First and last bound of each block."""
    return [(i, min(i + BLOCK_EPOCHS, n_bounds) - 1) for i in range(0, n_bounds, BLOCK_EPOCHS)]


def run_block(problem: Problem, first: int, last: int, x: Floats, P: Floats, buffers: Buffers, out: Innovations,
              turned: Floats = NO_PATH) -> None:  # fmt: skip
    """Filter one block; x and P are led on, the buffers filled where they have rows, innovations and score added to ``out``."""
    marks, spans, model = problem.marks, problem.spans, problem.model
    mark = marks.epoch, marks.place, marks.used_variance, marks.late
    arguments = (problem.moves, mark, spans.arguments, x, P, model.arguments, GATE, buffers.arguments)
    kernels.forward(first, last, *arguments, out.news, out.mark_news, out.score, turned, problem.about)


def run_forward(problem: Problem, turned: Floats = NO_PATH, at: Sequence[int] = ()) -> Filtered:
    """Filter all epochs, keeping a state per block and at rising bounds ``at`` only; ``turned`` (bound, 9) takes the attitudes.

    Notes
    -----
    At each bound the joint that ends there, the azimuth of a straight stretch, the marks passed, then the displacement by the
    odometer over the epoch that begins there, in three scalar measurements along, right and up of the tool. The innovation gate
    lets the variance of an outlier grow with it.

    References
    ----------
    Porter (1990), eq. 3-62 to 3-76; CN103727938A, step 3; Li (2014), eq. 19 to 25.
    """
    x, P = problem.start.state.copy(), problem.start.covariance.copy()
    out, nothing, checkpoints, passed = Innovations.of(problem), Buffers.of(problem.model.size, 0), [], []
    for first, last in blocks(problem.epochs.bounds.size):
        checkpoints.append((x.copy(), P.copy()))
        reached = first
        for bound in (b for b in at if first <= b <= last):
            if bound > reached:
                run_block(problem, reached, bound - 1, x, P, nothing, out, turned)
                reached = bound
            passed.append((x.copy(), P.copy()))
        run_block(problem, reached, last, x, P, nothing, out, turned)
    return Filtered(tuple(checkpoints), out.news, out.mark_news, x, P, out.score, tuple(passed))
