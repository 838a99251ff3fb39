"""A dead-reckoned path and marks in; the path turned and stretched between the marks, and what had to be done, out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_reckoning

Floats = NDArray[np.float64]
_ITERATIONS, _CLOSED_M = 20, 1e-4
_SHORT_M = 30.0  # below it marks of decimetres would turn the path by degrees


@dataclass(frozen=True)
class MarkCorrection:
    """Path through marks.

    Parameters
    ----------
    path : (epoch + 1, 3) east, north, up (m) from the first mark's frame.
    turns : (interval, 3) azimuth, pitch (radian) and scale laid on each interval between used marks.
    used : (mark,) bool.
    misfit : (mark, 3) path minus mark when the mark does not count (m); NaN at the first and the last.
    """

    path: Floats
    turns: Floats
    used: NDArray[np.bool_]
    misfit: Floats


def correct_between_marks(
    steps: Floats, epoch: NDArray[np.int64], marks: Floats, sigma: Floats, gate: float = 4.0
) -> MarkCorrection:
    """Turn and stretch the path between marks until it meets each of them; a mark that its neighbours contradict is left out.

    Parameters
    ----------
    steps : (epoch, 3) dead-reckoned east, north, up (m).
    epoch : (mark,) index of the bound at which each mark was passed, rising.
    marks : (mark, 3) east, north, up (m).
    sigma : (mark, 3) standard deviations (m).
    gate : misfit over its sigma beyond which a mark is left out.

    Notes
    -----
    Three unknowns per interval, azimuth, pitch and scale, from the three components of what is missing at the mark, iterated
    until < 0.1 mm. A mark is tested by the path from its neighbours without it, in doubt by theirs and 0.05 % of the distance.

    References
    ----------
    CN103727938A, step 5 (his limit is 0.01 m).
    """
    used = np.ones(len(marks), bool)
    misfit = np.full((len(marks), 3), np.nan)
    while True:
        worst, which = 0.0, -1
        for m in range(1, len(marks) - 1):
            near = [*(i for i in np.flatnonzero(used[:m])[-1:]), *(m + 1 + i for i in np.flatnonzero(used[m + 1 :])[:1])]
            if len(near) < 2:
                continue
            a, b = near
            between = _solve(steps[epoch[a] : epoch[b]], marks[b] - marks[a])[1]
            here = marks[a] + between[: epoch[m] - epoch[a]].sum(axis=0)
            far = min(np.abs(steps[epoch[a] : epoch[m]]).sum(), np.abs(steps[epoch[m] : epoch[b]]).sum())
            misfit[m] = here - marks[m]
            size = float(np.max(np.abs(misfit[m]) / np.sqrt(sigma[m] ** 2 + sigma[a] ** 2 + sigma[b] ** 2 + (5e-4 * far) ** 2)))
            if used[m] and size > max(worst, gate):
                worst, which = size, m
        if which < 0:
            break
        used[which] = False
    return _through(steps, epoch, marks, used, misfit)


def _through(steps: Floats, epoch: NDArray, marks: Floats, used: NDArray, misfit: Floats) -> MarkCorrection:
    places = np.flatnonzero(used)
    out, turns = steps.copy(), []
    for a, b in pairwise(places):
        turn, out[epoch[a] : epoch[b]] = _solve(steps[epoch[a] : epoch[b]], marks[b] - marks[a])
        turns.append(turn)
    if turns:  # beyond the outer marks the nearest interval's correction goes on
        for part, turn in ((slice(0, epoch[places[0]]), turns[0]), (slice(epoch[places[-1]], len(steps)), turns[-1])):
            _kernels_reckoning.turned(steps[part], turn[0], turn[1], turn[2], out[part])
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(out, axis=0)])
    if places.size:
        path += marks[places[0]] - path[epoch[places[0]]]
    return MarkCorrection(path, np.array(turns).reshape(-1, 3), used, misfit)


def _solve(steps: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """Azimuth, pitch, scale that lead the steps to the wanted displacement, and the steps so turned."""
    turn, out = np.zeros(3), steps.copy()
    if np.linalg.norm(steps.sum(axis=0)) < _SHORT_M:  # too short to turn: lay the rest on by distance
        size = np.linalg.norm(steps, axis=1)
        share = size / size.sum() if size.sum() > 0 else np.full(len(steps), 1.0 / max(len(steps), 1))
        return turn, steps + share[:, None] * (wanted - steps.sum(axis=0))
    for _ in range(_ITERATIONS):
        rest = wanted - out.sum(axis=0)
        if np.linalg.norm(rest) < _CLOSED_M:
            break
        e, n, u = out.sum(axis=0)
        level = np.maximum(np.hypot(out[:, 0], out[:, 1]), 1e-12)
        climb = np.array([-(out[:, 0] * out[:, 2] / level).sum(), -(out[:, 1] * out[:, 2] / level).sum(), level.sum()])
        J = np.column_stack([[n, -e, 0.0], climb, np.array([e, n, u]) / (1.0 + turn[2])])
        turn += np.linalg.lstsq(J, rest, rcond=1e-6)[0]
        _kernels_reckoning.turned(steps, turn[0], turn[1], turn[2], out)
    return turn, out
