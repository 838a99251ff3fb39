"""Scans around a candidate in, readings about the centre of the pipe out, thinned, with steps of the wall and beads marked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import median_filter

from deform.caliper.cross_section import ScanLog, scan_ranges
from deform.caliper.dent_shape import DentFit, relief, wrap
from deform.caliper.scans import ScanReader

_MOST_ROWS = 200  # scans that a fit looks at; more are averaged
_LEAST_STEP_M = 1.5e-4  # steps of the wall below this are left to the smooth section
_BEAD_M = 3e-4  # a scan whose arms all stand in by more than this, and more than their noise, rides over a weld


@dataclass(frozen=True)
class DentSamples:
    """Readings around a dent.

    Attributes
    ----------
    place : (n,) m, chainage of each scan.
    clock : (n, arms) rad, pipe clock of each ray from the tool axis.
    radius : (n, arms) m, tool axis to wall, NaN where missing.
    right, up : (n,) m, about where the centre of the pipe is seen from the tool axis.
    count : (n,) scans that were averaged into each.
    """

    place: np.ndarray
    clock: np.ndarray
    radius: np.ndarray
    right: np.ndarray
    up: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, place: np.ndarray, clock: np.ndarray, radius: np.ndarray) -> DentSamples:
        """Readings of a tool that runs near the centre of the pipe."""
        zero = np.zeros(len(place))
        return cls(np.asarray(place, float), np.asarray(clock, float), np.asarray(radius, float), zero, zero, zero + 1.0)

    @property
    def arms(self) -> int:
        """Arms of a ring."""
        return self.radius.shape[1]

    def centred(self, right: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (m) from the centre of the pipe, and clock (rad) seen from there, both (n, arms)."""
        x = self.radius * np.sin(self.clock) - right[:, None]
        z = self.radius * np.cos(self.clock) - up[:, None]
        return np.hypot(x, z), np.where(np.isfinite(x), np.arctan2(x, z), self.clock)

    def without(self, others: Sequence[DentFit]) -> DentSamples:
        """The readings as they would be without other dents."""
        if not others:
            return self
        _, clock = self.centred(self.right, self.up)
        return replace(self, radius=self.radius + relief(others, self.place[:, None], clock))


def gather(reader: ScanReader, logs: list[ScanLog], start: float, end: float, flank: float) -> DentSamples | None:
    """Read all scans of all rings from ``flank`` before the stretch to ``flank`` behind it; None where there are none."""
    parts = []
    for log in logs:
        for first, last in scan_ranges(reader, log, start - flank, end + flank):
            block = reader.read(log.ring, first, last)
            clock = reader.sign * (reader.angle_rad[log.ring][None, :] + block.roll[:, None])
            right, up = (getattr(log, n)[first:last].astype(float) for n in ("right", "up"))
            good = log.good[first:last] & np.isfinite(right)
            one = DentSamples(block.chainage, clock, block.radius, right, up, np.ones(len(right)))
            parts.append(_thinned(_rows(one, good), (end - start + 2 * flank) / _MOST_ROWS * len(logs)))
    parts = [p for p in parts if len(p.place)]
    if not parts:
        return None
    return DentSamples(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(DentSamples)))


def _rows(samples: DentSamples, pick: np.ndarray) -> DentSamples:
    return DentSamples(*(getattr(samples, f.name)[pick] for f in fields(DentSamples)))


def _thinned(samples: DentSamples, step: float) -> DentSamples:
    """Neighbouring scans averaged until they stand ``step`` (m) apart."""
    if len(samples.place) < 3:
        return samples
    pitch = float(np.median(np.abs(np.diff(samples.place))))
    size = int(step / max(pitch, 1e-6))
    if size < 2:
        return samples
    starts = np.arange(0, len(samples.place), size)
    scans = np.diff(np.append(starts, len(samples.place)))
    there = np.isfinite(samples.radius)
    many = np.add.reduceat(there.astype(float), starts)
    with np.errstate(invalid="ignore"):
        radius = np.add.reduceat(np.where(there, samples.radius, 0.0), starts) / np.where(
            many > 0.5 * scans[:, None], many, np.nan
        )
    first = samples.clock[starts]
    turn = np.add.reduceat(wrap(samples.clock - np.repeat(first, scans, axis=0)), starts) / scans[:, None]
    place, right, up = (np.add.reduceat(v, starts) / scans for v in (samples.place, samples.right, samples.up))
    return DentSamples(place, first + turn, radius, right, up, np.add.reduceat(samples.count, starts))


def wall_marks(place: np.ndarray, level: np.ndarray, noise: np.ndarray) -> tuple[float | None, np.ndarray]:
    """Where the wall steps from pipe to pipe, and which scans ride over a weld bead.

    Parameters
    ----------
    place : (n,) m.
    level : (n,) m, radius of the sound arms of each scan.
    noise : (n,) m, its sigma.

    Returns
    -------
    step : m, place of the greatest step that noise cannot make, or None.
    bead : (n,) true for scans that stand in over their neighbours.
    """
    order = np.argsort(place, kind="stable")
    value, sigma = level[order], noise[order]
    good = np.isfinite(value)
    bead = np.zeros(place.size, bool)
    if good.sum() < 12:
        return None, bead
    smooth = median_filter(np.interp(np.arange(value.size), np.flatnonzero(good), value[good]), 9, mode="nearest")
    bead[order] = good & (value - smooth < -np.maximum(_BEAD_M, 5.0 * sigma))
    use = np.flatnonzero(good & ~bead[order])
    split, jump, spread = _split(value[use])
    if split is None or abs(jump) < max(_LEAST_STEP_M, 5.0 * spread):
        return None, bead
    at = place[order][use]
    return float(0.5 * (at[split - 1] + at[split])), bead


def _split(value: np.ndarray) -> tuple[int | None, float, float]:
    """Where a series falls best into two levels, by how much they differ near there, and the sigma of that."""
    n = value.size
    if n < 12:
        return None, 0.0, 0.0
    centred = value - value.mean()
    left = np.arange(5, n - 5)
    gain = np.cumsum(centred)[left - 1] ** 2 * n / (left * (n - left))
    split = int(left[np.argmax(gain)])
    before, behind = value[max(0, split - 25) : split], value[split : split + 25]
    spread = 1.4826 * np.median(np.abs(np.diff(value))) / np.sqrt(2.0)
    return split, float(np.median(behind) - np.median(before)), spread * float(np.sqrt(1 / before.size + 1 / behind.size)) * 1.25
