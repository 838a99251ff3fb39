"""Epochs, aids and an error model in; one forward pass of the filter, block by block, and the noise that the data speak of, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_filter as kernels
from deform.nav.aiding import LEAST_DENSITY, REST_SIGMA_M, MarkAid, TravelAid
from deform.nav.error_model import ErrorModel
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
BLOCK_EPOCHS = 512
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

    def arguments(self, variance: Floats | None = None) -> tuple:
        """Arguments of the kernels that are common to both directions."""
        return self.epochs.table, self.travel.speeds, self.travel.variance if variance is None else variance


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
    """

    checkpoints: tuple[tuple[Floats, Floats], ...]
    news: Floats
    mark_news: Floats
    end: Floats
    covariance: Floats


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
              mark_news: Floats) -> None:  # fmt: skip
    """Filter one block; x and P are led on, the buffers filled when ``keep``."""
    marks, model = problem.marks, problem.model
    kernels.forward(first, last, *problem.arguments(), marks.epoch, marks.place, marks.used_variance, marks.late, x, P, model.at,
                    model.reckoned, GATE, *model.arguments, keep, *buffers.arguments, residuals, mark_news)  # fmt: skip


def run_forward(problem: Problem) -> Filtered:
    """Filter all epochs, keeping a state per block only.

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
    checkpoints = []
    for first, last in blocks(n_bounds):
        checkpoints.append((x.copy(), P.copy()))
        run_block(problem, first, last, x, P, False, buffers, residuals, mark_news)
    return Filtered(tuple(checkpoints), residuals, mark_news, x, P)


def learned_noise(problem: Problem, states: Floats, block_s: float = 12.0) -> TravelAid:
    """Return the travel aid with the densities of noise that smoothed states show along, to the right and up.

    Notes
    -----
    What is left of the odometer's displacement against the smoothed path is summed over stretches longer than the wobble lasts;
    the robust spread of these sums over the root of their travel is the density at long waves, which is what moves a position.
    Shorter than the window in which the inertial unit is the better judge, longer than the wobble: some ten seconds.
    """
    from dataclasses import replace

    epochs, travel = problem.epochs, problem.travel
    left = np.empty((len(epochs.table), 3))
    kernels.travel_residuals(epochs.table, travel.speeds, states, left)
    usable = ~travel.stationary & (epochs.travel > 0.02) & (travel.variance[:, 0] > 0)
    label = np.cumsum(epochs.duration) // block_s
    label = label[usable].astype(np.int64)
    if label.size < 50:
        return travel
    _, group = np.unique(label, return_inverse=True)
    length = np.bincount(group, epochs.travel[usable])
    whole = length > 0.5 * np.median(length)
    variance = travel.variance.copy()
    moving = ~travel.stationary & (variance[:, 0] > 0)
    for axis in range(3):
        sums = np.bincount(group, left[usable, axis])[whole]
        if axis == 0:
            shape = np.bincount(group, travel.along_shape[usable])[whole]
            factor = _robust_square(sums / np.sqrt(shape))
            variance[moving, 0] = factor * travel.along_shape[moving] + REST_SIGMA_M**2
        else:
            density = max(_robust_square(sums / np.sqrt(length[whole])), LEAST_DENSITY)
            slip = (0.02**2) * travel.along_shape[moving]
            variance[moving, axis] = density * epochs.travel[moving] + slip + REST_SIGMA_M**2
    return replace(travel, variance=variance)


def _robust_square(values: Floats) -> float:
    """Variance by the median of the squares (a normal one gives 0.4549)."""
    return float(np.median(values**2) / 0.4549)
