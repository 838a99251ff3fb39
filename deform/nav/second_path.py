"""A solution in; the path by gyros, odometer and marks alone, its sigma, and where it contradicts the smoothed one, out."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from deform.geometry import earth
from deform.geometry.rotation import matrix_to_attitude
from deform.nav import _kernels_state as kernels
from deform.nav._kernels import GAP_BOW, GAP_TRAVEL
from deform.nav.dead_reckoning import Reckoning, dead_reckon
from deform.nav.error_model import ErrorModel
from deform.nav.marks import correct_between_marks
from deform.nav.solution import Solution
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

LIMIT_SIGMA = 5.0


@dataclass(frozen=True)
class SecondPath:
    """Dead reckoning through the marks beside the smoothed path.

    Parameters
    ----------
    time : (bound,) s.
    difference : (bound, 3) dead reckoning minus smoothed path, east, north, up (m).
    sigma : (bound, 3) standard deviation of the difference.
    """

    time: Floats
    difference: Floats
    sigma: Floats

    def remark(self) -> str:
        """Say where both paths contradict each other; empty when they agree."""
        size = np.max(np.abs(self.difference) / self.sigma, axis=1)
        worst = int(np.argmax(size))
        if size[worst] < LIMIT_SIGMA:
            return ""
        far = float(np.linalg.norm(self.difference[worst]))
        return (
            f"dead reckoning through the marks strays from the smoothed path by {far:.2f} m at t={self.time[worst]:.1f} s, "
            f"{size[worst]:.1f} sigma: look for slipped wheels, a wrong marker or a disturbed sensor there"
        )


def second_path(solution: Solution, epochs: Epochs) -> SecondPath:
    """Return dead reckoning through the marks beside the smoothed path.

    Parameters
    ----------
    solution : final.
    epochs : of its problem, with the way that slipped wheels lost (`slips.SlipsSeen`).

    Notes
    -----
    From the smoothed first attitude, mounting, sag and scale, then by gyros and odometer, turned and stretched between the marks
    that carry weight (iterated there until it meets them): nothing of the accelerometers after the first attitude. Its sigma
    away from the marks: the wobble as a random walk that both marks hold, the odometer's noise alike, the gyros' drift and random
    walk as the bow that is left when both ends are met, their scale by the turn between the marks, the bow of gaps between them
    (the turn over a gap is that of the smoothed path); outside the outer marks all of them grow freely.
    Sigmas of marks and of the smoothed path are added.

    References
    ----------
    CN103727938A, steps 2 and 5.
    """
    problem, states = solution.problem, solution.smoothed.states
    first = states[0]
    mounting = np.array([first[kernels.MOUNTING], 1.0, first[kernels.MOUNTING + 1]])
    reckoned = dead_reckon(epochs, first[:3], first[6:15].reshape(3, 3), mounting, 1.0 + first[kernels.SCALE])
    use = problem.marks.weight > 0.5
    use &= np.concatenate([[True], np.diff(problem.marks.epoch) > 0])
    epoch = problem.marks.epoch[use]
    if epoch.size < 2:
        epoch = np.zeros(1, np.int64)
        difference = np.column_stack(earth.enu_difference(*_degrees(reckoned.places), *_degrees(states)))
    else:
        path = earth.enu_path(*_degrees(states))
        marks = path[epoch] - solution.closed[use]
        found = correct_between_marks(reckoned.steps, epoch, marks, np.sqrt(problem.marks.variance[use]), gate=np.inf)
        difference = found.path - path
    return SecondPath(problem.epochs.time, difference, _sigma(solution, reckoned, epoch))


def swung(model: ErrorModel, way: Floats) -> Floats:
    """Variance (m²) of the path across the pipe by the wobble summed over a way (m), of the worse of right and up.

    The wobble is its length L times the change of its mean m (`error_model.compose`): summed up it is L (m(s) - m(0)).
    """
    worst = np.zeros(np.shape(way))
    for axis in (0, 1) if model.index("wobble").stop else ():
        A, P = model.ride_system(axis), model.ride_covariance(axis)
        grid = np.geomspace(1e-3, 30.0, 200) / -A[-1, -1]
        variance = 2.0 * (P[-1, -1] - (expm(A * grid[:, None, None]) @ P)[:, -1, -1]) / A[-1, -1] ** 2
        worst = np.maximum(worst, np.interp(way, np.append(0.0, grid), np.append(0.0, variance)))
    return worst


def _degrees(places: Floats) -> tuple[Floats, Floats, Floats]:
    return np.degrees(places[:, 0]), np.degrees(places[:, 1]), places[:, 2]


def _sigma(solution: Solution, reckoned: Reckoning, epoch: NDArray[np.int64]) -> Floats:
    problem, model = solution.problem, solution.problem.model
    travel = np.concatenate([[0.0], np.cumsum(np.abs(problem.epochs.travel))])
    bowed = problem.epochs.table[:, GAP_TRAVEL] ** 2 * problem.epochs.table[:, GAP_BOW] / 12.0
    noise = np.concatenate([[0.0], np.cumsum(problem.travel.variance[:, 0])])
    turned = np.unwrap(np.radians(matrix_to_attitude(reckoned.attitudes)[0]))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turned)))])
    drift, scale = (float(np.sqrt(model.variance[model.index(b)].max(initial=0.0))) for b in ("gyro_bias", "gyro_scale"))
    moving = problem.epochs.duration[~problem.travel.stationary]
    speed = travel[-1] / max(float(moving.sum()), 1.0)
    density = float(np.max(problem.travel.variance[:, 1:].sum(axis=0))) / max(travel[-1], 1.0)
    before, behind = _to_marks(problem.epochs.time, epoch)
    bow = 0.5 * drift * speed * _product(before, behind)
    bend = np.sqrt(model.walk[6] / 3.0) * speed * _product(before, behind) / np.sqrt(_sum(before, behind))
    away = _held(*_to_marks(travel, epoch))
    bent = _sum(*_to_marks(np.concatenate([[0.0], np.cumsum(bowed)]), epoch))
    twist = scale * _sum(*_to_marks(turned, epoch)) * away
    across = density * away + bent + swung(model, away) + bow**2 + bend**2 + twist**2
    along = _held(*_to_marks(noise, epoch))
    mark = float(problem.marks.variance.max(initial=0.0))
    if epoch.size < 2:  # nothing holds the path: the first attitude turns it about its begin
        across = across + (solution.smoothed.sigma[0, 6:9].max() * travel) ** 2
    level = across + along
    return np.sqrt(solution.smoothed.sigma[:, :3] ** 2 + mark + np.column_stack([level, level, across]))


def _to_marks(values: Floats, epoch: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """What a rising quantity gained since the mark before, and gains to the one behind; infinite where there is none."""
    right = np.searchsorted(epoch, np.arange(values.size), side="left")
    at = np.concatenate([[-np.inf], values[epoch], [np.inf]])
    behind = at[right + 1] - values
    return values - at[right], behind


def _held(before: Floats, behind: Floats) -> Floats:
    """Variance of a random walk that is held at both ends, or at the nearer one."""
    return 1.0 / np.maximum(1.0 / np.maximum(before, 1e-9) + 1.0 / np.maximum(behind, 1e-9), 1e-12)


def _product(before: Floats, behind: Floats) -> Floats:
    """Product of both, the square of the finite one where the other is infinite."""
    near = np.minimum(before, behind)
    far = np.where(np.isfinite(before) & np.isfinite(behind), np.maximum(before, behind), near)
    return near * far


def _sum(before: Floats, behind: Floats) -> Floats:
    near = np.minimum(before, behind)
    return np.maximum(np.where(np.isfinite(before) & np.isfinite(behind), before + behind, near), 1e-9)
