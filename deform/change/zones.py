"""Amplitudes of every wavelength in, stretches of pipe that moved out, with the rate of false alarms that the threshold keeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change.significance import limit_of
from deform.change.wavelength import Waves

Floats = NDArray[Any]
TESTS_PER_WAVELENGTH = 8.5  # independent looks per wavelength and scale: six gave 168 false alarms where 120 are stated

JOINT_BOUND = 4.0  # most that the joint lengths may add to twice the log likelihood ratio


@dataclass(frozen=True)
class Candidate:
    """One stretch whose change is significant in one run.

    Attributes
    ----------
    centre, length : of the best fitting wave (m).
    start, end : extent (m).
    statistic : twice the log likelihood ratio.
    amplitude, sigma : (2,) lateral and up of the best wave (m).
    position_score, curvature_score : what position and curvature alone say (chi-square).
    typical : (2,) sigma of such waves over quiet pipe as far as it was known (m).
    joint_score : what the joint lengths add, at most `JOINT_BOUND`.
    start_sigma, end_sigma : of the extent (m).
    evidence : what the extent explains of the curvature (chi-square), 0 when curvature does not show it.
    closed : false for a step: what lies behind it stays displaced.
    """

    centre: float
    length: float
    start: float
    end: float
    statistic: float
    amplitude: Floats
    sigma: Floats
    position_score: float
    curvature_score: float
    typical: Floats
    joint_score: float = 0.0
    start_sigma: float = 0.0
    end_sigma: float = 0.0
    evidence: float = 0.0
    closed: bool = True


def threshold(lengths: Floats, false_alarms_per_100_km: float, joints: bool = False) -> float:
    """Return the value that twice the log likelihood ratio exceeds so often on pipe that did not move.

    Notes
    -----
    The chance of one look is the rate over the number of independent looks in 100 km, 8.5 per wavelength and scale
    (Bonferroni); lateral and up together are chi-square with two degrees of freedom, the elongation of the joints is a third.
    What joints say is bounded, so that one weld set wrong is no movement; three degrees are then on the safe side.
    """
    looks = float(np.sum(TESTS_PER_WAVELENGTH * 1e5 / np.asarray(lengths)))
    return limit_of(false_alarms_per_100_km, looks, 3 if joints else 2)


def peaks(
    waves: list[Waves],
    limit: float,
    blocked: list[tuple[float, float]],
    spent: list[Candidate],
    elongation: Callable[[float, float], tuple[float, float]] | None = None,
) -> list[Candidate]:
    """Return the strongest waves above a limit; one that lies in the flanks of a stronger one waits for the next round.

    Parameters
    ----------
    waves : amplitudes of every wavelength.
    limit : least statistic.
    blocked : stretches already explained. spent : waves that proved to be the remains of a zone; they are not looked at again.
    elongation : gives the elongation of the joints of a stretch and its sigma (m).
    """
    bound = JOINT_BOUND if elongation else 0.0
    rows: list[tuple[float, Waves, int]] = []
    for wave in waves:
        score = wave.statistic
        rows += [(float(score[i]), wave, int(i)) for i in np.flatnonzero(_crests(score) & (score > limit - bound))]
    rows.sort(key=lambda row: -row[0])
    found: list[Candidate] = []
    for top, wave, i in rows:
        at, half = wave.place[i], 0.5 * wave.length
        if any(start < at + 0.5 * half and end > at - 0.5 * half for start, end in blocked):
            continue
        if any(abs(at - c.centre) < 0.5 * wave.length and 0.7 < wave.length / c.length < 1.5 for c in spent):
            continue
        if any(abs(at - c.centre) < 1.5 * max(wave.length, c.length) + 0.5 * min(wave.length, c.length) for c in found):
            continue
        extra = _joint_score(elongation, at - half, at + half)
        if top + extra > limit:
            found.append(replace(_candidate(top, wave, i), joint_score=extra))
    return found


def _joint_score(elongation: Callable[[float, float], tuple[float, float]] | None, start: float, end: float) -> float:
    """What the elongation of the joints of a stretch adds to twice the log likelihood ratio."""
    if elongation is None:
        return 0.0
    longer, sigma = elongation(start, end)
    return float(min((longer / sigma) ** 2, JOINT_BOUND)) if np.isfinite(longer) and sigma > 0 else 0.0


def _crests(score: Floats) -> Floats:
    """True at local maxima of a curve, NaN counting as nothing."""
    level = np.nan_to_num(score, nan=-np.inf)
    padded = np.concatenate([[-np.inf], level, [-np.inf]])
    return (level >= padded[:-2]) & (level > padded[2:]) & np.isfinite(level)


def _candidate(score: float, wave: Waves, i: int) -> Candidate:
    with np.errstate(invalid="ignore", divide="ignore"):
        alone = [
            float(np.nansum((part[i] / sigma[i]) ** 2))
            for part, sigma in ((wave.position, wave.position_sigma), (wave.curvature, wave.curvature_sigma))
        ]
    half = 0.5 * wave.length
    at = float(wave.place[i])
    found = Candidate(
        at, wave.length, at - half, at + half, score, wave.amplitude[i], wave.sigma[i], alone[0], alone[1], wave.typical
    )
    return replace(found, start_sigma=0.25 * half, end_sigma=0.25 * half)


def against(candidate: Candidate, waves: list[Waves]) -> Candidate:
    """Return a candidate with its statistic against the noise as it is now known."""
    wave = min(waves, key=lambda w: abs(w.length - candidate.length))
    ratio = wave.typical / candidate.typical
    ratio = np.where(np.isfinite(ratio), ratio, 1.0)
    sigma = candidate.sigma * ratio
    with np.errstate(invalid="ignore", divide="ignore"):
        statistic = float(np.nansum(np.where(sigma > 0, candidate.amplitude / (wave.caution * sigma), np.nan) ** 2))
    mean = float(np.mean(ratio * wave.caution)) ** 2
    return replace(
        candidate,
        statistic=statistic,
        sigma=sigma,
        typical=wave.typical,
        position_score=candidate.position_score / mean,
        curvature_score=candidate.curvature_score / mean,
    )


def extent(place: Floats, size: Floats, sigma: Floats, candidate: Candidate) -> tuple[float, float, bool]:
    """Return where a movement begins and ends (m), and whether the displacement itself shows it.

    Parameters
    ----------
    place : (n,) scan axis (m).
    size : (n,) size of the displacement, lateral and up together (m).
    sigma : (n,) its standard deviation (m).
    candidate : the wave that was found.

    Notes
    -----
    Hysteresis: from the peak within the wave outward, until the displacement stays below 2 σ, or below three hundredths of the
    peak where that is more, for five metres. Where the displacement does not reach 3 σ the wave itself is the extent.
    """
    inside = (place >= candidate.centre - 0.6 * candidate.length) & (place <= candidate.centre + 0.6 * candidate.length)
    level = np.where(inside, np.nan_to_num(size), 0.0)
    top = int(np.argmax(level))
    if not level[top] > 3.0 * sigma[top]:
        return candidate.centre - 0.5 * candidate.length, candidate.centre + 0.5 * candidate.length, False
    low = np.maximum(2.0 * sigma, 0.03 * level[top])
    step = place[1] - place[0]
    reach, widest = max(round(5.0 / step), 1), round(1.5 * candidate.length / step)
    over = np.nan_to_num(size) > low
    ends = []
    for sign in (-1, 1):
        last = top
        for k in range(1, widest):
            i = top + sign * k
            if i < 0 or i >= place.size:
                break
            if over[i]:
                last = i
            elif abs(i - last) > reach:
                break
        ends.append(float(place[last]))
    return ends[0], ends[1], True
