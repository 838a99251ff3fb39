"""Mean radius of the scans around an event in, its shape out: bead of a girth weld, step from pipe to pipe, or neither."""

from __future__ import annotations

import numpy as np

BEAD_HALF_M = 0.03  # a weld bead is not longer than twice this
FLANK_M = 0.25  # wall on either side against which a bead or a step is seen
LEAST_ARM_SCORE = 4.0  # sigma; lower kicks are too many to be listed
_COLLAR_M = 0.09  # this far from its centre a bead has given way to the wall
_LASTING_M = 1.0  # wall looked at on either side of a step
_HOLDS = 0.5  # share of a step, or of a kick, by which the wall may stray and still be that of one pipe


def edge(
    place: np.ndarray, radius: np.ndarray, step: np.ndarray, bead: np.ndarray, i: int
) -> tuple[tuple[float, float, float] | None, float]:
    """Tell what a step of the wall is.

    Parameters
    ----------
    place, radius : (n,) m, scans of one ring, place rising.
    step, bead : (n,) sigma, scores of each scan.
    i : scan near the step.

    Returns
    -------
    event : place (m), score and sigma (m): at its bead where one shows, else the split that fits best; None for the edge of
        a recess or a collar, which has no bead and whose level does not last as that of a pipe does.
    centre : m, of the step.
    """
    first, last = np.searchsorted(place, [place[i] - FLANK_M, place[i] + FLANK_M])
    size = last - first
    value = radius[first:last] - radius[first:last].mean()
    left = np.arange(2, size - 1)
    gain = np.cumsum(value)[left - 1] ** 2 * size / (left * (size - left))
    split = first + int(left[np.argmax(gain)])
    centre = float(0.5 * (place[split - 1] + place[split]))
    lasting = is_lasting(place, radius, centre)
    near = slice(*np.searchsorted(place, [centre - 2 * BEAD_HALF_M, centre + 2 * BEAD_HALF_M]))
    best = near.start + int(np.argmax(bead[near]))
    if bead[best] >= LEAST_ARM_SCORE and (lasting or is_narrow(place, radius, best)):
        score = max(step[i], bead[best]) if lasting else bead[best]
        return (bead_centre(place, radius, best), float(score), 0.0), centre
    if not lasting:
        return None, centre
    jump = abs(radius[split:last].mean() - radius[first:split].mean())
    noise = max(float(np.std(value)), 1e-6)
    pitch = (place[last - 1] - place[first]) / max(size - 1, 1)
    return (centre, float(step[i]), float(pitch * (0.5 + (noise / max(jump, 1e-6)) ** 2))), centre


def is_lasting(place: np.ndarray, radius: np.ndarray, centre: float) -> bool:
    """True when the wall on both sides of a step keeps its level for the better part of a metre, as pipes do.

    Notes
    -----
    Each side is judged by itself: the median from 0.25 m to 1 m off the step must agree with that next to it within half the
    step. A recess of up to 0.6 m fails on its inner side; that median does not see one that begins further off. A side that
    ends sooner (start or end of the scans) is not held against the step.
    """
    levels = []
    for side in (-1.0, 1.0):
        close = _level(place, radius, centre, side * BEAD_HALF_M, side * FLANK_M)
        far = _level(place, radius, centre, side * FLANK_M, side * _LASTING_M)
        levels.append((close, close if np.isnan(far) else far))
    (before, before_far), (behind, behind_far) = levels
    allowed = _HOLDS * abs(behind - before)
    return not (abs(before_far - before) > allowed or abs(behind_far - behind) > allowed)


def is_narrow(place: np.ndarray, radius: np.ndarray, i: int) -> bool:
    """True when an inward kick at scan ``i`` has returned within a hand's breadth on both sides, as a bead does."""
    centre = place[i]
    inner = slice(*np.searchsorted(place, [centre - BEAD_HALF_M / 3, centre + BEAD_HALF_M / 3]))
    lowest = float(np.mean(radius[inner])) if inner.stop > inner.start else float(radius[i])
    close = [_level(place, radius, centre, s * BEAD_HALF_M, s * _COLLAR_M) for s in (-1.0, 1.0)]
    wide = [_mean(place, radius, centre, s * BEAD_HALF_M, s * FLANK_M) for s in (-1.0, 1.0)]
    if not np.isfinite(close).all() or not np.isfinite(wide).all():
        return True
    return min(close) - lowest >= _HOLDS * (min(wide) - lowest)


def bead_centre(place: np.ndarray, radius: np.ndarray, i: int) -> float:
    """Centre of gravity of the metal that stands in over its flanks around scan ``i`` (m)."""
    first, last = np.searchsorted(place, [place[i] - BEAD_HALF_M, place[i] + BEAD_HALF_M])
    wide = [np.searchsorted(place, place[i] + d) for d in (-FLANK_M, -BEAD_HALF_M, BEAD_HALF_M, FLANK_M)]
    level = min(np.median(radius[wide[0] : wide[1]]), np.median(radius[wide[2] : wide[3]]))
    drop = np.maximum(level - radius[first:last], 0.0)
    return float(np.sum(drop * place[first:last]) / np.sum(drop)) if drop.sum() > 0 else float(place[i])


def _between(place: np.ndarray, centre: float, near: float, far: float) -> slice:
    first, last = np.searchsorted(place, [centre + min(near, far), centre + max(near, far)])
    return slice(int(first), int(last))


def _level(place: np.ndarray, radius: np.ndarray, centre: float, near: float, far: float) -> float:
    values = radius[_between(place, centre, near, far)]
    return float(np.median(values)) if values.size >= 2 else np.nan


def _mean(place: np.ndarray, radius: np.ndarray, centre: float, near: float, far: float) -> float:
    values = radius[_between(place, centre, near, far)]
    return float(np.mean(values)) if values.size >= 2 else np.nan
