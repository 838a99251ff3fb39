"""A solution in; the path by gyros, odometer and marks alone, and where it contradicts the smoothed one, out."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from deform.geometry import earth
from deform.nav import _kernels_state as kernels
from deform.nav.dead_reckoning import dead_reckon
from deform.nav.marks import correct_between_marks
from deform.nav.solution import Solution

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

SHARE = 0.005  # of the distance to the nearest mark by which dead reckoning through marks may stray
LIMIT_SIGMA = 5.0


def reckoning_difference(solution: Solution) -> Floats:
    """Return dead reckoning through the marks minus smoothed path at the bounds (bound, 3), east, north, up (m).

    Notes
    -----
    From the smoothed first attitude, mounting, sag and scale, then by gyros and odometer, turned and stretched between the marks
    that carry weight: nothing of the accelerometers after the first attitude. A difference beyond five sigma, the sigma being
    that of the smoother with 0.5 % of the distance to the nearest mark, is logged as a warning with its place.

    References
    ----------
    CN103727938A, steps 2 and 5.
    """
    problem, states = solution.problem, solution.smoothed.states
    first = states[0]
    mounting = np.array([first[kernels.MOUNTING], 1.0, first[kernels.MOUNTING + 1]])
    reckoned = dead_reckon(problem.epochs, first[:3], first[6:15].reshape(3, 3), mounting, 1.0 + first[kernels.SCALE])
    origin = (np.degrees(first[0]), np.degrees(first[1]), first[2])
    path = np.column_stack(earth.enu_difference(np.degrees(states[:, 0]), np.degrees(states[:, 1]), states[:, 2], *origin))
    use = problem.marks.weight > 0.5
    use &= np.concatenate([[True], np.diff(problem.marks.epoch) > 0])
    epoch = problem.marks.epoch[use]
    if epoch.size < 2:
        return np.column_stack(
            earth.enu_difference(
                np.degrees(reckoned.places[:, 0]), np.degrees(reckoned.places[:, 1]), reckoned.places[:, 2],
                np.degrees(states[:, 0]), np.degrees(states[:, 1]), states[:, 2],
            )
        )  # fmt: skip
    marks = path[epoch] - solution.closed[use]
    sigma = np.sqrt(problem.marks.variance[use])
    found = correct_between_marks(reckoned.steps, epoch, marks, sigma, gate=np.inf)
    difference = found.path - path
    _warn(solution, difference, epoch)
    return difference


def _warn(solution: Solution, difference: Floats, epoch: NDArray[np.int64]) -> None:
    travel = np.concatenate([[0.0], np.cumsum(solution.problem.epochs.travel)])
    right = np.clip(np.searchsorted(epoch, np.arange(travel.size)), 1, epoch.size - 1)
    at = travel[epoch]
    away = np.minimum(np.abs(travel - at[right - 1]), np.abs(travel - at[right]))
    mark = np.sqrt(solution.problem.marks.variance.max())
    sigma = np.sqrt(solution.smoothed.sigma[:, :3] ** 2 + mark**2 + (SHARE * away / LIMIT_SIGMA)[:, None] ** 2)
    size = np.max(np.abs(difference) / sigma, axis=1)
    worst = int(np.argmax(size))
    if size[worst] > LIMIT_SIGMA:
        far, when = float(np.linalg.norm(difference[worst])), float(solution.problem.epochs.time[worst])
        text = "dead reckoning through the marks strays from the smoothed path by %.2f m at t=%.1f s, %.1f sigma"
        log.warning(text, far, when, float(size[worst]))
