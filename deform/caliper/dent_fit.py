"""Readings around a candidate in, the fitted dent out: sizes with sigma that hold the section, the offset and the arm spacing.

Notes
-----
Dent, undamaged section and the tool's offset in every scan are estimated together by least squares (the section is smooth
along the pipe, the offset is free), so that the covariance knows that a broad dent looks like ovality and a near one like an
offset. Readings that stand off are down-weighted: gently inside the dent, where no smooth shape is quite true, and fully
outside of it.

With arms further apart than a dent is narrow the deepest reading lies beside the apex, and one row of readings is explained by
many dents: width, clock and fullness are then taken from their joint posterior (`dent_posterior`). With arms dense enough to
see the shape, what they read above or below the smooth shape corrects its depth (`dent_residual`).

What is known beforehand: dents are a third to six times as long as wide; what pressed a dent is as blunt one way as the
other; their fullness is that of a bell, or more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deform.caliper.dent_posterior import Prior, first_guess, posterior
from deform.caliper.dent_residual import corrected
from deform.caliper.dent_samples import DentSamples, wall_marks
from deform.caliper.dent_section import Projector, SectionModel, roughness
from deform.caliper.dent_shape import (
    ALONG,
    AROUND,
    CLOCK,
    DEPTH,
    LEAST_FULL,
    LENGTH,
    MOST_FULL,
    PLACE,
    WIDTH,
    DentFit,
    inward,
    inward_with_slopes,
    wrap,
)

PRIOR = Prior()
_ROUNDS = 30
_HOLE = 1.2  # of the length: what lies within belongs to the dent and says nothing of the section
_SETTLED = 6  # rounds after which the dent is known well enough to judge the section
_SMALL = 0.02  # of its sigma: a step below this in all unknowns ends the iteration
_LARGEST_STEP = np.array([0.5, 0.1, 0.15, 0.35, 0.35, 0.6, 0.6])  # of each unknown in one round; place and clock in sizes
_GENTLE, _FIRM = 3.0, 6.0  # sigma: from where readings lose weight inside, and have none outside
_LEAST_SOUND = 6  # scans beside the dent that can tell the section
_LEAST_CORE = 3  # readings: a sharp dent crossed by a single arm has no more, and its sigmas say so
_RIM = 1.2  # of the size at a tenth of the depth: what lies inside belongs to the dent
# Arm spacing over width from which on the posterior is looked at as a whole. Half a spacing beside the apex a bell then still has
# 10^-0.22^2 = 0.89 of its depth; below it the depth depends little on the width, and the least-squares covariance is used.
_SPARSE = 0.22


@dataclass(frozen=True)
class _State:
    """What the iteration has: unknowns of the dent, of the section, offsets, and the weights that go with them."""

    dent: np.ndarray
    section: np.ndarray
    right: np.ndarray
    up: np.ndarray


def fit_dent(
    samples: DentSamples, centre: float, clock: float, depth: float, sigma: float, outer_radius: float, length: float = 0.4
) -> DentFit | None:
    """Fit the shape; None when there is too little sound wall or too few readings.

    Parameters
    ----------
    samples : readings of the dent and of sound wall on both sides.
    centre, clock, depth : where to begin (m, rad, m).
    sigma : standard deviation of one reading (m).
    outer_radius : of the pipe (m).
    length : stretch (m) about the centre that the dent takes at first sight.
    """
    problem = _Problem.of(samples, (centre, clock, depth), sigma, outer_radius, length)
    return None if problem is None else problem.solve()


@dataclass
class _Problem:
    samples: DentSamples
    sigma: np.ndarray  # (n, arms), inf where an arm gave nothing
    step: float | None
    state: _State
    model: SectionModel
    outer_radius: float
    spacing: float  # rad
    extent: float  # m, of the candidate

    @classmethod
    def of(cls, samples: DentSamples, start: tuple[float, float, float], sigma: float, outer_radius: float, length: float):
        spread = np.where(np.isfinite(samples.radius), sigma / np.sqrt(samples.count)[:, None], np.inf)
        radius, clocks = samples.centred(samples.right, samples.up)
        sound = np.where(np.abs(wrap(clocks - start[1])) > 1.0, radius, np.nan)
        there = np.isfinite(sound).sum(axis=1)
        if (there >= 4).sum() < 8:
            return None
        with np.errstate(all="ignore"):
            level = np.where(there >= 4, np.nanmedian(sound, axis=1), np.nan)
        noise = 1.2533 * sigma / np.sqrt(samples.count * np.maximum(there, 1))
        step, bead = wall_marks(samples.place, level, noise)
        spread[bead] = np.inf
        spacing = 2 * np.pi / samples.arms
        begun = _begin(samples, spread, step, start, length, spacing)
        if begun is None:
            return None
        state, model = begun
        return cls(samples, spread, step, state, model, outer_radius, spacing, length)

    def solve(self) -> DentFit | None:
        for turn in range(_ROUNDS):
            found = self._round(turn)
            if found is None:
                return None
            shift, covariance, fixed = found
            small = np.all(np.abs(shift) < _SMALL * np.sqrt(np.diag(covariance)))
            if turn == _SETTLED:
                self._smoothness()
            elif turn > _SETTLED + 2 and small:
                break
        else:
            fit = self._result(covariance + np.outer(shift, shift), fixed)
            return None if fit is None else replace(fit, settled=False)
        return self._result(covariance, fixed)

    def _smoothness(self) -> None:
        """Choose anew where the section may bend, and how fast, now that the dent is nearly known."""
        state, samples = self.state, self.samples
        radius, clock = samples.centred(state.right, state.up)
        half = 0.5 * _HOLE * float(np.exp(state.dent[LENGTH]))
        hole = (state.dent[PLACE] - half, state.dent[PLACE] + half)
        outside = (samples.place < hole[0]) | (samples.place > hole[1])
        root = self._root(self._left(radius, clock), clock, _SETTLED) * outside[:, None]
        if root.any(axis=1).sum() < _LEAST_SOUND:  # the dent fills its window: what was chosen at first sight stays
            return
        rough = roughness(samples.place, clock, np.nan_to_num(radius), root, hole, self.step)
        self.model, before = SectionModel.build(samples.place, hole, self.step, rough), self.model
        fitted = before.hats @ state.section.reshape(3, -1).T
        solution, *_ = np.linalg.lstsq(self.model.hats, fitted, rcond=None)
        self.state = replace(state, section=solution.T.ravel())

    def _left(self, radius: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """What dent and section leave of the readings."""
        u = inward(self.state.dent, self.samples.place[:, None], clock)
        return np.where(np.isfinite(self.sigma), np.nan_to_num(radius) - self.model.design(clock) @ self.state.section + u, 0.0)

    def _round(self, turn: int) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """One step of all unknowns; the step of the dent's, their covariance, and that if the section were known."""
        state, samples = self.state, self.samples
        radius, clock = samples.centred(state.right, state.up)
        seen = np.isfinite(self.sigma)
        design = self.model.design(clock)
        u, slopes = inward_with_slopes(state.dent, samples.place[:, None], clock)
        residual = np.where(seen, np.nan_to_num(radius) - design @ state.section + u, 0.0)
        root = self._root(residual, clock, turn)
        project = Projector(clock, root)
        values = np.concatenate([-slopes, design], axis=2)
        a = project(values).reshape(-1, values.shape[2])
        e = project(residual).ravel()
        prior, pull = PRIOR.normal(state.dent, self.outer_radius)
        normal, right = a.T @ a, a.T @ e
        size = len(state.dent)
        normal[:size, :size] += prior
        right[:size] += pull
        normal[size:, size:] += self.model.penalty
        right[size:] -= self.model.penalty @ state.section
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
        try:
            inverse = np.linalg.inv(normal * scale[:, None] * scale[None, :] + 1e-10 * np.eye(len(normal)))
        except np.linalg.LinAlgError:
            return None
        covariance = inverse * scale[:, None] * scale[None, :]
        plain = (slopes * root[:, :, None]).reshape(-1, size)
        fixed = np.linalg.inv(plain.T @ plain + prior + 1e-12 * np.eye(size))
        shift = covariance @ right
        if not np.isfinite(shift).all():
            return None
        most = _LARGEST_STEP.copy()
        most[PLACE] *= np.exp(state.dent[LENGTH])
        most[CLOCK] *= np.exp(state.dent[WIDTH])
        limited = np.clip(shift[:size], -most, most)
        part = float(np.min(np.where(shift[:size] != 0, limited / np.where(shift[:size] != 0, shift[:size], 1.0), 1.0)))
        dent = state.dent + part * shift[:size]
        dent[ALONG:] = np.clip(dent[ALONG:], LEAST_FULL, MOST_FULL)
        section = state.section + shift[size:]
        left = residual - design @ (section - state.section) + inward(dent, samples.place[:, None], clock) - u
        more_right, more_up = project.offset(left)
        ok = root.astype(bool).sum(axis=1) >= 4
        self.state = _State(dent, section, state.right + np.where(ok, more_right, 0.0), state.up + np.where(ok, more_up, 0.0))
        return part * shift[:size], covariance[:size, :size], fixed

    def _root(self, residual: np.ndarray, clock: np.ndarray, turn: int) -> np.ndarray:
        """Square roots of the weights of all readings."""
        sizes = residual / self.sigma
        gentle = 1.0 / np.sqrt(1.0 + (sizes / _GENTLE) ** 2)
        wide = self.state.dent.copy()
        wide[[LENGTH, WIDTH]] += np.log(_RIM)
        inside = inward(wide, self.samples.place[:, None], clock) > 0.1 * np.exp(wide[DEPTH])
        firm = np.clip(1.0 - (sizes / _FIRM) ** 2, 0.0, None) ** 2
        weight = gentle if turn < 3 else np.where(inside, gentle, firm)
        return np.sqrt(weight) / self.sigma

    def _result(self, covariance: np.ndarray, fixed: np.ndarray) -> DentFit | None:
        state, samples = self.state, self.samples
        radius, clock = samples.centred(state.right, state.up)
        undamaged = self.model.design(clock) @ state.section
        departure = np.where(np.isfinite(self.sigma), undamaged - np.nan_to_num(radius), np.nan)
        u = inward(state.dent, samples.place[:, None], clock)
        core = np.isfinite(departure) & (u > 0.1 * np.exp(state.dent[DEPTH]))
        if core.sum() < _LEAST_CORE:
            return None
        off = ((departure - u) / self.sigma)[core]
        misfit = float(np.sqrt(np.mean(np.minimum(off**2, 100.0))))
        sigma = np.sqrt(np.diag(covariance)) * max(1.0, misfit)
        depth, length, width = np.exp(state.dent[DEPTH]), np.exp(state.dent[LENGTH]), np.exp(state.dent[WIDTH])
        fit = DentFit(
            centre=float(state.dent[PLACE]),
            clock=float(state.dent[CLOCK] % (2 * np.pi)),
            depth=float(depth),
            length=float(length),
            width=float(width * self.outer_radius),
            clock_sigma=float(sigma[CLOCK]),
            depth_sigma=float(depth * sigma[DEPTH]),
            length_sigma=float(length * sigma[LENGTH]),
            width_sigma=float(width * self.outer_radius * sigma[WIDTH]),
            outer_radius=self.outer_radius,
            along_power=float(state.dent[ALONG]),
            around_power=float(state.dent[AROUND]),
        )
        if self.spacing > _SPARSE * width:
            more = np.maximum(np.diag(covariance) - np.diag(fixed), 0.0)[[DEPTH, CLOCK, WIDTH]] * max(1.0, misfit) ** 2
            more *= np.array([depth, 1.0, width * self.outer_radius]) ** 2
            fit = posterior(fit, samples.place, clock, departure, self.sigma, PRIOR, more)
        excess = departure - fit.at(samples.place[:, None], clock)
        fit = corrected(fit, samples.place, clock, excess, self.sigma, self.extent)
        floor = 0.1 * float(np.min(self.sigma) * np.sqrt(samples.count.max()))
        return replace(fit, depth_sigma=float(np.sqrt(fit.depth_sigma**2 + floor**2 + self.model.under**2)))


def _begin(samples, spread, step, start: tuple[float, float, float], length: float, spacing: float):
    """First unknowns: the section from sound readings, then the dent that explains best what they leave."""
    radius, clocks = samples.centred(samples.right, samples.up)
    hole = (start[0] - 0.5 * length - 0.05, start[0] + 0.5 * length + 0.05)
    inside = (samples.place > hole[0]) & (samples.place < hole[1])
    if (~inside).sum() < _LEAST_SOUND:
        return None
    root = np.where(inside[:, None] & (np.abs(wrap(clocks - start[1])) < 1.2), 0.0, 1.0 / spread)
    rough = roughness(samples.place, clocks, np.nan_to_num(radius), root * ~inside[:, None], hole, step)
    model = SectionModel.build(samples.place, hole, step, rough)
    right, up, section = samples.right, samples.up, np.zeros(1)
    for _ in range(2):
        radius, clocks = samples.centred(right, up)
        project = Projector(clocks, root)
        design = model.design(clocks)
        a, e = project(design).reshape(radius.size, -1), project(np.nan_to_num(radius)).ravel()
        normal = a.T @ a + model.penalty
        section = np.linalg.solve(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)), a.T @ e)
        left = np.where(np.isfinite(radius), radius - design @ section, 0.0)
        more = project.offset(left)
        ok = (root > 0).sum(axis=1) >= 4
        right, up = right + np.where(ok, more[0], 0.0), up + np.where(ok, more[1], 0.0)
    radius, clocks = samples.centred(right, up)
    departure = np.where(np.isfinite(spread), model.design(clocks) @ section - np.nan_to_num(radius), np.nan)
    dent = first_guess(samples.place, clocks, departure, spread, start, spacing)
    return None if dent is None else (_State(dent, section, right, up), model)
