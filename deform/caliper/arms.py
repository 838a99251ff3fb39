"""A scan reader in, its arms' state out: constant offsets, dead, stuck and noisy arms, the noise of one reading."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from deform.caliper.cross_section import least_arms
from deform.caliper.scans import STUCK_SHARE, ScanReader
from deform.errors import Fault, InputError
from deform.geometry.harmonics import HarmonicFitter

logger = logging.getLogger(__name__)

_SAMPLES, _SCANS = 48, 600  # stretches looked at, scans of each
_DEAD_SHARE = 0.5  # of the readings missing
_NOISY = 4.0  # times the usual scatter about the section
_SURE = 4.0  # sigma that an offset must have to be taken off
_WORTH_M = 2e-5  # offsets below this are left alone


@dataclass(frozen=True)
class ArmState:
    """State of the arms of all rings, in the order of the reader.

    Attributes
    ----------
    offset : (rings, arms) m, to be taken off each reading.
    dead : (rings, arms) true for arms that are not used.
    sigma : (rings,) m, standard deviation of one reading about the section.
    reasons : what was found, in words.
    """

    offset: np.ndarray
    dead: np.ndarray
    sigma: np.ndarray
    reasons: tuple[str, ...]


def examine_arms(reader: ScanReader, stated_sigma: float, largest_lost: float) -> ArmState:
    """Look at stretches spread over the run and judge each arm.

    Parameters
    ----------
    stated_sigma : m, the maker's noise of a reading.
    largest_lost : share of the arms of a ring that may be out of use.

    Raises
    ------
    InputError
        When a ring lost more arms than that, with the arms named.

    Notes
    -----
    The offset of an arm is its median residual about the robust sections, dents being rare. Residuals know nothing of the
    mean, the first and the second harmonic of the offsets: the mean is part of the diameter, the first of the tool's place,
    and the second is told from the pipe's ovality by the tool's roll (`_oval_of_arms`) where the tool rolled enough.
    """
    shape = reader.angle_rad.shape
    offset, dead = np.zeros(shape), np.zeros(shape, bool)
    sigma, reasons, faults = np.full(shape[0], stated_sigma), [], []
    for ring in range(shape[0]):
        radius, roll = _sample(reader, ring)
        if not len(radius):
            continue
        why = _out_of_use(radius)
        dead[ring] = [bool(w) for w in why]
        named = [
            f"ring {ring + 1} arm at {np.degrees(a):.0f} degree: {w}"
            for a, w in zip(reader.angle_rad[ring], why, strict=True)
            if w
        ]
        if dead[ring].mean() > largest_lost or (~dead[ring]).sum() < 6:
            faults.append(
                Fault(
                    f"{reader.raw.id}/caliper.nc",
                    f"ring {ring + 1}",
                    f"{dead[ring].sum()} of {shape[1]} arms out of use",
                    "; ".join(named),
                )
            )
            continue
        offset[ring], sigma[ring], noisy = _offsets(reader.angle_rad[ring], radius, roll, dead[ring], stated_sigma, largest_lost)
        named += [
            f"ring {ring + 1} arm at {np.degrees(a):.0f} degree: noisy" for a in reader.angle_rad[ring][noisy & ~dead[ring]]
        ]
        dead[ring] |= noisy
        large = np.abs(offset[ring]).max() if np.isfinite(offset[ring]).any() else 0.0
        if large > stated_sigma:
            named.append(f"ring {ring + 1}: arm offsets up to {large * 1e3:.2f} mm taken off")
        if not 0.4 < sigma[ring] / stated_sigma < 2.5:
            named.append(
                f"ring {ring + 1}: a reading scatters by {sigma[ring] * 1e3:.2f} mm, run.toml says {stated_sigma * 1e3:.2f} mm"
            )
        reasons += named
    if faults:
        raise InputError(faults)
    for reason in reasons:
        logger.warning("%s: caliper %s", reader.raw.id, reason)
    return ArmState(offset, dead, sigma, tuple(reasons))


def _sample(reader: ScanReader, ring: int) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n, arms) and roll (n,) of stretches spread over the moving part of the run."""
    radii, rolls = [], []
    for start in np.linspace(0, max(0, reader.scans - _SCANS), _SAMPLES).astype(int):
        block = reader.read(ring, int(start), min(int(start) + _SCANS, reader.scans))
        use = reader.moving(block.time)
        if use.sum() > 50:
            radii.append(block.radius[use])
            rolls.append(block.roll[use])
    arms = reader.angle_rad.shape[1]
    return (np.concatenate(radii), np.concatenate(rolls)) if radii else (np.empty((0, arms)), np.empty(0))


def _out_of_use(radius: np.ndarray) -> list[str]:
    """Why each arm is not used; empty for a good one."""
    missing = np.isnan(radius).mean(axis=0)
    step = np.abs(np.diff(radius, axis=0))
    with np.errstate(all="ignore"):
        scatter = np.array([np.nanmean(s) if np.isfinite(s).any() else np.nan for s in step.T])
    usual = np.nanmedian(scatter[missing < _DEAD_SHARE]) if (missing < _DEAD_SHARE).any() else np.nan
    return [
        f"silent in {m:.0%} of the scans" if m > _DEAD_SHARE else "stuck" if s < STUCK_SHARE * usual else ""
        for m, s in zip(missing, scatter, strict=True)
    ]


def _offsets(angle, radius, roll, dead, stated: float, lost: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Offset of each arm (m), noise of a reading (m), and which arms are noisy."""
    offset, noisy, sigma = np.zeros(len(angle)), np.zeros(len(angle), bool), stated
    freedom = np.sqrt(1.0 - 5.0 / max((~dead).sum(), 6))
    for _ in range(3):
        readings = np.where(dead | noisy, np.nan, radius - offset)
        fitter = HarmonicFitter(angle, max(sigma, 0.2 * stated), least=least_arms(len(angle), lost))
        harmonics, residual, *_ = fitter.fit(readings)
        middle = np.array([np.nanmedian(r) if np.isfinite(r).any() else 0.0 for r in residual.T])
        scatter = np.array(
            [
                1.4826 * np.nanmedian(np.abs(r - m)) if np.isfinite(r).any() else np.nan
                for r, m in zip(residual.T, middle, strict=True)
            ]
        )
        sigma = float(np.nanmedian(scatter)) / freedom
        noisy |= np.nan_to_num(scatter) > _NOISY * sigma
        count = np.isfinite(residual).sum(axis=0)
        sure = (np.abs(middle) > _SURE * 1.25 * sigma / np.sqrt(np.maximum(count, 1))) & (np.abs(middle) > _WORTH_M)
        offset = offset + np.where(sure, middle, 0.0)
    oval = _oval_of_arms(harmonics, roll)
    return offset + oval.real * np.cos(2 * angle) + oval.imag * np.sin(2 * angle), max(sigma, 1e-6), noisy


def _oval_of_arms(harmonics: np.ndarray, roll: np.ndarray) -> complex:
    """Second harmonic of the arms' offsets (m): the part of the oval that turns with the tool, not with the pipe."""
    good = np.isfinite(harmonics[:, 0])
    first = harmonics[good, 1] - 1j * harmonics[good, 2]
    seen = harmonics[good, 3] - 1j * harmonics[good, 4] - first**2 / (4 * harmonics[good, 0])
    turning = np.exp(2j * roll[good])
    cell = max(1, good.sum() // _SAMPLES)
    starts = np.arange(0, good.sum() - cell + 1, cell)
    if starts.size < 12:
        return 0j
    seen, turning = (np.add.reduceat(v, starts) / np.diff(np.append(starts, v.size)) for v in (seen, turning))
    design = np.stack([np.ones_like(turning), turning], axis=1)
    if np.linalg.cond(design) > 5.0:
        return 0j
    solution, *_ = np.linalg.lstsq(design, seen, rcond=None)
    scatter = np.std(seen - design @ solution)
    spread = scatter * np.sqrt(np.linalg.inv((design.conj().T @ design).real)[0, 0])
    return complex(np.conj(solution[0])) if abs(solution[0]) > max(_SURE * spread, _WORTH_M) else 0j
