"""A filter's problem in; the same with the noise of odometer and ride that makes the data most likely out."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from deform.nav.aiding import RIDE_DENSITY
from deform.nav.filter import Problem, run_forward
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

LEARNING_EPOCHS = 3000
LEAST_EPOCHS = 200
LEAST_RIDE = 1e-7  # m² per m: below it a tool could not bounce by a millimetre over ten metres
_BOUNDS = (
    (math.radians(0.005), math.radians(3.0)),
    (math.radians(0.005), math.radians(3.0)),
    (0.5, 200.0),
    (1e-9, 1e-3),
    (1e-9, 1e-3),
)


def learn(problem: Problem) -> Problem:
    """Return the problem with wobble (sigma right and up, length), rides and odometer factor of greatest likelihood.

    Notes
    -----
    The likelihood of the innovations of the odometer's displacement, -½ Σ (ln s + ν²/s), outliers counted at the gate, over a
    stretch in motion. The inertial unit is the witness: over seconds to a minute it knows the direction of travel better than the
    tool's axis does. What the wobble does over longer waves follows from its model, not from the residuals, in which the filter
    has already made its peace with them.

    References
    ----------
    Mehra (1970), IEEE Trans. AC-15, 175-184.
    """
    part = stretch(problem)
    if part is None or not part.model.index("wobble").stop:
        return problem
    x = np.log([math.radians(0.1) / 6.0**1.5, math.radians(0.1) / 6.0**1.5, 6.0, RIDE_DENSITY, RIDE_DENSITY])
    low, high = np.log(_BOUNDS).T

    def misfit(logs: Floats, along: float) -> float:
        values = _wobble(logs)
        beyond = np.sum(np.clip(low - np.log(values), 0.0, None) ** 2 + np.clip(np.log(values) - high, 0.0, None) ** 2)
        return -float(run_forward(apply(part, values, along)).score.sum()) + 100.0 * float(beyond)

    along = _along(part, x, 1.0)
    simplex = x[:4] + np.vstack([np.zeros(4), np.diag([0.5, 0.5, 0.4, 1.2])])
    options = {"initial_simplex": simplex, "maxfev": 70, "xatol": 0.05, "fatol": 0.5}
    best = minimize(lambda four: misfit(np.append(four, four[3]), along), x[:4], method="Nelder-Mead", options=options)
    x = np.append(best.x, best.x[3])
    x = _polished(misfit, x, along)
    along = _along(part, x, along)
    values = _wobble(x)
    log.info("wobble of the tool %.3f degree right, %.3f up over %.1f m, ride %.1e, %.1e m²/m, odometer's sigma x %.2f",
             math.degrees(values[0]), math.degrees(values[1]), values[2], values[3], values[4], math.sqrt(along))  # fmt: skip
    return apply(problem, values, along)


def apply(problem: Problem, wobble: Floats, along: float) -> Problem:
    """Return the problem with wobble (sigma right, up, length; rides) and a factor on the odometer's variance."""
    model = problem.model.with_wobble(wobble[0], wobble[1], wobble[2])
    variance = problem.start.variance.copy()
    here = model.index("wobble")
    variance[here] = model.variance[here]
    return replace(
        problem,
        model=model,
        travel=problem.travel.with_noise(along, max(wobble[3], LEAST_RIDE), max(wobble[4], LEAST_RIDE)),
        start=replace(problem.start, variance=variance),
    )


def stretch(problem: Problem) -> Problem | None:
    """Return the first `LEARNING_EPOCHS` in motion and the rest before, without marks; None with too few."""
    moving = np.flatnonzero(~problem.travel.stationary)
    if moving.size < LEAST_EPOCHS:
        return None
    end = int(moving[min(LEARNING_EPOCHS, moving.size) - 1]) + 1
    epochs, travel, marks = problem.epochs, problem.travel, problem.marks
    return replace(
        problem,
        epochs=Epochs(epochs.bounds[: end + 1], epochs.time[: end + 1], epochs.table[:end]),
        travel=replace(travel, speeds=travel.speeds[: end + 1], variance=travel.variance[:end],
                       stationary=travel.stationary[:end],
                       along_shape=travel.along_shape[:end], travel=travel.travel[:end], tilt=travel.tilt[:end]),
        marks=marks.only(np.zeros(marks.epoch.size, bool)),
    )  # fmt: skip


def _wobble(logs: Floats) -> Floats:
    """Wobble (sigma right, up, length) and ride from the logarithms that the search uses.

    The data see the short waves, whose size is sigma / length^1.5, far better than sigma and length by themselves.
    """
    right, up, reach, ride, ride_up = np.exp(logs)
    return np.array([right * reach**1.5, up * reach**1.5, reach, ride, ride_up])


def _polished(misfit: Callable[[Floats, float], float], x: Floats, along: float) -> Floats:
    """Each direction's ride and short waves once more by themselves: the simplex held one ride for both."""
    x = x.copy()
    for i in (3, 4, 0, 1):

        def alone(value: float, i: int = i) -> float:
            return misfit(np.where(np.arange(x.size) == i, value, x), along)

        found = minimize_scalar(alone, bounds=(x[i] - 2.5, x[i] + 2.0), method="bounded", options={"xatol": 0.03, "maxiter": 10})
        if found.fun < misfit(x, along):
            x[i] = float(found.x)
    return x


def _along(part: Problem, logs: Floats, start: float) -> float:
    values = _wobble(logs)

    def misfit(log_factor: float) -> float:
        return -float(run_forward(apply(part, values, math.exp(log_factor))).score.sum())

    middle = math.log(start)
    found = minimize_scalar(misfit, bounds=(middle - 5.0, middle + 4.0), method="bounded", options={"xatol": 0.1, "maxiter": 12})
    return math.exp(float(found.x))
