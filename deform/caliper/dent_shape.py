"""All readings around one dent in, its shape out: depth, place, length, width with sigma, the arm spacing in it.

Notes
-----
With arms further apart than a dent is narrow, the deepest reading lies beside the apex. The undamaged section is therefore
interpolated from sound wall on both sides, the tool's offset taken scan by scan from the arms that do not touch the dent, and
a smooth shape is fitted to every reading that does:

    u(s, w) = depth * exp(-ln 10 * (|2 s / length|^p + |2 w / width|^q)),

so that length and width are the full extents at a tenth of the depth; p and q, the fullness along and around, are unknowns
(2 is a bell, larger is fuller). Along the pipe the scans are dense and p is well determined; around it the arms may be few, so q
is held near p by a prior: what pressed a dent is as blunt one way as the other. A wide prior of width over length keeps the
solution finite where one arm alone saw the dent; the depth then has the large sigma that it deserves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares

from deform.caliper.cross_section import ScanLog, harmonic_basis, scan_ranges
from deform.caliper.scans import ScanReader

_FULLNESS, _FULLNESS_SIGMA, _FULLNESS_ALIKE = 2.2, 0.8, 0.4
_ASPECT, _ASPECT_SIGMA = -0.2, 0.8  # log of width over length: real dents run from a third to six
_MOST_READINGS = 6000  # of one dent; more are thinned
_DEEPEST = 3.0  # times what one arm saw: no dent hides more of itself between two arms
_LN10 = np.log(10.0)


@dataclass(frozen=True)
class DentSamples:
    """Readings around a dent.

    Attributes
    ----------
    place : (n,) m, chainage of each scan.
    clock : (n, arms) rad, pipe clock of each arm.
    radius : (n, arms) m, tool axis to wall, NaN where missing.
    inner : (n,) true where the scan lies in the candidate's stretch.
    """

    place: np.ndarray
    clock: np.ndarray
    radius: np.ndarray
    inner: np.ndarray


@dataclass(frozen=True)
class DentFit:
    """A fitted dent; m and rad. ``shape`` is its class."""

    NUMBERS: ClassVar[tuple[str, ...]] = (
        "centre", "clock", "depth", "length", "width", "clock_sigma", "depth_sigma", "length_sigma", "width_sigma",
    )  # fmt: skip
    centre: float
    clock: float
    depth: float
    length: float
    width: float
    clock_sigma: float
    depth_sigma: float
    length_sigma: float
    width_sigma: float
    mean_radius: float
    misfit: float
    along_power: float = 2.0
    around_power: float = 2.0
    shape: str = "plain"

    def at(self, place: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """Inward departure (m) of the fitted shape at places (m) and clocks (rad), which broadcast."""
        unknowns = np.array([self.depth, self.centre, 0.0, self.length, self.width, self.along_power, self.around_power])
        return shape(unknowns, np.asarray(place), _wrap(clock - self.clock) * self.mean_radius)


def gather(reader: ScanReader, logs: list[ScanLog], start: float, end: float, flank: float) -> DentSamples | None:
    """Read all scans of all rings from ``flank`` before the stretch to ``flank`` behind it."""
    places, clocks, radii = [], [], []
    for ring, log in enumerate(logs):
        for first, last in scan_ranges(log, start - flank, end + flank):
            block = reader.read(ring, first, last)
            places.append(block.chainage)
            clocks.append(reader.sign * (reader.angle_rad[ring][None, :] + block.roll[:, None]))
            radii.append(block.radius)
    if not places:
        return None
    place = np.concatenate(places)
    margin = 0.5 * (end - start) + 0.05
    inner = (place >= start - margin) & (place <= end + margin)
    return DentSamples(place, np.concatenate(clocks), np.concatenate(radii), inner)


def fit_dent(samples: DentSamples, centre: float, clock: float, depth: float, sigma: float) -> DentFit | None:
    """Fit the shape; None when there is too little sound wall or too few readings.

    Parameters
    ----------
    centre, clock, depth : where to begin (m, rad, m).
    sigma : standard deviation of one reading (m).
    """
    mean_radius = float(np.nanmedian(samples.radius))
    spacing = 2 * np.pi * mean_radius / samples.radius.shape[1]
    half_sector = 0.75
    guess = np.array([depth, centre, 0.0, 0.25, 0.2, _FULLNESS, _FULLNESS])
    solution, clock_shift = None, 0.0
    for _ in range(3):
        seen = inward_departure(samples, clock, half_sector)
        if seen is None:
            return None
        inward, clocks = seen
        around = _wrap(np.nan_to_num(clocks) - clock) * mean_radius
        use = np.isfinite(inward) & (np.abs(around) < 2.0 * mean_radius)
        use &= np.abs(samples.place[:, None] - centre) < 1.2 * max(guess[3], 0.15)
        if use.sum() < 12:
            return None
        pick = _some(int(use.sum()))
        along = np.broadcast_to(samples.place[:, None], use.shape)[use]
        deepest = _DEEPEST * max(depth, float(np.quantile(inward[use], 0.995)))  # a broad dent draws the candidate's section in
        solution = _solve(along[pick], around[use][pick], inward[use][pick], guess, sigma, (deepest, 1.25 * spacing))
        if solution is None:
            return None
        guess = solution.x.copy()
        clock_shift = guess[2]
        clock += guess[2] / mean_radius
        centre = guess[1]
        guess[2] = 0.0
        half_sector = float(np.clip(0.75 * guess[4] / mean_radius, 0.35, 1.4))
    side = around[use] - clock_shift
    peak = _peak_above_model(solution, along, side, inward[use], sigma, spacing)
    return _result(solution, clock, mean_radius, sigma, peak)


def _some(count: int) -> np.ndarray:
    """Indices of at most `_MOST_READINGS` readings, drawn evenly but in no step with the arms."""
    if count <= _MOST_READINGS:
        return np.arange(count)
    return np.sort(np.random.default_rng(count).choice(count, _MOST_READINGS, replace=False))


def shape(unknowns: np.ndarray, along: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Inward departure (m) of the smooth dent at places (m) along and around the pipe."""
    depth, centre, side, length, width, p, q = unknowns
    first = np.abs(2.0 * (along - centre) / length)
    second = np.abs(2.0 * (around - side) / width)
    return depth * np.exp(-_LN10 * (first**p + second**q))


def inward_departure(samples: DentSamples, clock: float, half_sector: float) -> tuple[np.ndarray, np.ndarray] | None:
    """How far each reading stands inside the undamaged section (m, positive inward), and its clock (rad) about the centre.

    The section (mean radius, oval, both linear along the pipe) comes from the scans outside the stretch, the tool's offset
    in each scan from the arms outside the dent's sector.
    """
    flank = ~samples.inner
    free = np.abs(_wrap(samples.clock - clock)) > half_sector
    sound = np.where(flank[:, None] | free, samples.radius, np.nan)
    section = _flank_section(samples, flank)
    if section is None:
        return None
    model = section[0] + section[1] * np.cos(2 * samples.clock) + section[2] * np.sin(2 * samples.clock)
    left = sound - model
    cos, sin = np.cos(samples.clock), np.sin(samples.clock)
    there = np.isfinite(left)
    weight = there.astype(float)
    left = np.where(there, left, 0.0)
    for _ in range(4):
        a, b, c = (np.sum(weight * v, axis=1) for v in (cos * cos, cos * sin, sin * sin))
        x, y = np.sum(weight * cos * left, axis=1), np.sum(weight * sin * left, axis=1)
        determinant = a * c - b * b
        with np.errstate(invalid="ignore", divide="ignore"):
            up, right = (c * x - b * y) / determinant, (a * y - b * x) / determinant
            shift2 = (up**2 + right**2)[:, None]
            bend = (right[:, None] * cos - up[:, None] * sin) ** 2 / (2 * section[0].mean())
        offset = up[:, None] * cos + right[:, None] * sin - bend
        residual = np.where(there, sound - model - offset, 0.0)
        width = 4.685 * max(1.4826 * float(np.median(np.abs(residual[there]))), 1e-5)
        weight = np.where(there, np.clip(1 - (residual / width) ** 2, 0, None) ** 2, 0.0)
        left = np.where(there, sound - model + bend, 0.0)
    good = (determinant > 1e-3) & np.isfinite(shift2[:, 0])
    inward = np.where(good[:, None], model + offset - samples.radius, np.nan)
    with np.errstate(invalid="ignore"):
        centred = np.arctan2(samples.radius * sin - right[:, None], samples.radius * cos - up[:, None])
    return inward, centred


def _flank_section(samples: DentSamples, flank: np.ndarray) -> np.ndarray | None:
    """Mean radius and oval (3, n, 1) of the undamaged pipe at every scan, linear between the two flanks."""
    radius, clock = samples.radius[flank], samples.clock[flank]
    if flank.sum() < 6:
        return None
    basis = harmonic_basis(clock)
    there = np.isfinite(radius)
    values, places = [], []
    for k in range(len(radius)):
        if there[k].sum() >= 8:
            solution, *_ = np.linalg.lstsq(basis[k][there[k]], radius[k][there[k]], rcond=None)
            first = (solution[1] - 1j * solution[2]) ** 2 / (4 * solution[0])
            solution[3], solution[4] = solution[3] - first.real, solution[4] + first.imag
            solution[0] += abs(first)
            values.append(solution[[0, 3, 4]])
            places.append(samples.place[flank][k])
    if len(values) < 6:
        return None
    table, at = np.array(values), np.array(places)
    middle = float(samples.place[samples.inner].mean()) if samples.inner.any() else float(at.mean())
    before, behind = at < middle, at >= middle
    if before.sum() >= 3 and behind.sum() >= 3:
        levels = [np.median(table[side], axis=0) for side in (before, behind)]
        ends = [at[side].mean() for side in (before, behind)]
        part = np.clip((samples.place - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
        section = (1 - part)[:, None] * levels[0] + part[:, None] * levels[1]
    else:
        section = np.broadcast_to(np.median(table, axis=0), (len(samples.place), 3))
    return section.T[:, :, None]


def _solve(
    along: np.ndarray, around: np.ndarray, inward: np.ndarray, guess: np.ndarray, sigma: float, limits: tuple[float, float]
):
    """Fit the shape; limits are the greatest depth and the least width (m) that the arms can tell."""
    scale = 1.0 / sigma

    def misfit(x):
        aspect = (np.log(x[4] / x[3]) - _ASPECT) / _ASPECT_SIGMA
        prior = [(x[5] - _FULLNESS) / _FULLNESS_SIGMA, (x[6] - x[5]) / _FULLNESS_ALIKE, aspect]
        return np.concatenate([(shape(x, along, around) - inward) * scale, prior])

    low = [0.0, along.min(), around.min(), 0.02, min(limits[1], 0.5), 1.0, 1.0]
    high = [limits[0], along.max(), around.max(), 5.0, 3.0, 6.0, 6.0]
    start = np.clip(guess, np.array(low) + 1e-6, np.array(high) - 1e-6)
    try:
        result = least_squares(
            misfit, start, bounds=(low, high), loss="soft_l1", f_scale=3.0, x_scale=[1e-3, 0.01, 0.01, 0.05, 0.05, 0.3, 0.3]
        )
    except (ValueError, np.linalg.LinAlgError):
        return None
    return result if result.success else None


def _peak_above_model(solution, along: np.ndarray, side: np.ndarray, inward: np.ndarray, sigma: float, spacing: float) -> float:
    """What dense arms read at the apex above the smooth shape (m); 0 where the arms are too far apart to tell, or agree.

    A sharp apex with raised shoulders, as rocks make it, is cut off by any smooth shape; where at least four arms stand
    across the dent they are believed.
    """
    depth, centre, _, length, width, *_ = solution.x
    if spacing > 0.25 * width:
        return 0.0
    near = (np.abs(along - centre) < 0.02 * length) & (np.abs(side) < 0.6 * spacing)
    if near.sum() < 4:
        return 0.0
    model = shape(np.array([depth, centre, 0.0, length, width, solution.x[5], solution.x[6]]), along[near], side[near])
    excess = float(np.mean(inward[near] - model))
    return excess if excess > 4.0 * sigma / np.sqrt(near.sum()) and excess > 0.05 * depth else 0.0


def _result(solution, clock: float, mean_radius: float, sigma: float, peak: float) -> DentFit:
    x, jacobian = solution.x, solution.jac
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    rows = len(solution.fun) - 3
    misfit = float(np.sqrt(np.mean(solution.fun[:rows] ** 2)))
    said = np.sqrt(np.diag(covariance)) * max(1.0, misfit)
    return DentFit(
        centre=float(x[1]),
        clock=float(clock % (2 * np.pi)),
        depth=float(x[0] + peak),
        length=float(x[3]),
        width=float(x[4]),
        clock_sigma=float(said[2] / mean_radius),
        depth_sigma=float(min(np.hypot(said[0], 0.3 * sigma + 0.25 * peak), 0.6 * x[0])),
        length_sigma=float(said[3]),
        width_sigma=float(said[4]),
        mean_radius=mean_radius,
        misfit=misfit,
        along_power=float(x[5]),
        around_power=float(x[6]),
    )


def _wrap(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
