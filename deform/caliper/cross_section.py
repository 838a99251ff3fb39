"""Blocks of scans in, one record per scan out: mean radius, centre, oval, spread, and the deepest inward departure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deform.caliper._kernels import fit_scans, inward_running
from deform.caliper.scans import ScanBlock, ScanReader

_LEAST_ARMS = 6
_KINDS: dict[str, type] = {
    **dict.fromkeys(("time", "chainage"), np.float64),
    **dict.fromkeys(("radius", "right", "up", "oval_cos", "oval_sin"), np.float32),
    **dict.fromkeys(("spread", "used", "dip", "dip_clock", "bulge", "bulge_clock"), np.float16),  # three digits are enough
    "moving": np.bool_,
}
_CELL = 2048  # scans over which the reach of the chainage is kept
_DIP_HALF = 2  # scans on either side over which an inward departure is averaged


@dataclass(frozen=True)
class ScanLog:
    """One record per scan of a ring, in order of time; clocks are the pipe's, looking downstream.

    Attributes
    ----------
    time, chainage : (n,) s, m of the ring.
    radius : (n,) m, mean inner radius; NaN where too many arms are lost.
    right, up : (n,) m, centre of the section seen from the tool axis.
    oval_cos, oval_sin : (n,) m, radius varies as oval_cos * cos(2 clock) + oval_sin * sin(2 clock).
    spread : (n,) m, standard deviation of the arms about the section, dents left out.
    used : (n,) weight of arms in use.
    dip, dip_clock : (n,) m and rad, deepest inward departure after a short running mean, and its clock.
    bulge, bulge_clock : (n,) m and rad, farthest outward departure likewise.
    moving : (n,) false while the tool stands.
    arms : number of arms of the ring.
    """

    time: np.ndarray
    chainage: np.ndarray
    radius: np.ndarray
    right: np.ndarray
    up: np.ndarray
    oval_cos: np.ndarray
    oval_sin: np.ndarray
    spread: np.ndarray
    used: np.ndarray
    dip: np.ndarray
    dip_clock: np.ndarray
    bulge: np.ndarray
    bulge_clock: np.ndarray
    moving: np.ndarray
    arms: int

    @property
    def good(self) -> np.ndarray:
        """True where the section stands and the tool moves."""
        return np.isfinite(self.radius) & self.moving

    @property
    def reading_sigma(self) -> np.ndarray:
        """Standard deviation (m) of the mean radius of each scan."""
        return self.spread.astype(np.float32) / np.sqrt(np.maximum(self.used.astype(np.float32), 1.0))

    @cached_property
    def reach(self) -> np.ndarray:
        """Least and greatest chainage (cells, 2) of every 2048 scans, to find places without looking at all scans."""
        starts = np.arange(0, self.chainage.size, _CELL)
        return np.stack([np.minimum.reduceat(self.chainage, starts), np.maximum.reduceat(self.chainage, starts)], axis=1)


class SectionFitter:
    """Robust section of each scan of one ring: circle, offset and oval by harmonics, dents down-weighted.

    Notes
    -----
    radius(angle) = R + right' sin + up' cos + oval. A circle seen from a point off its centre by e also shows
    -e^2 / 4R (1 - cos 2(angle - direction)); this second-order part is taken out of R and of the oval.
    The full adjustment with covariance is `deform.geometry.circle.adjust_ellipse`; to first order in oval and offset the
    two are equal, and this one is what a hundred kilometres of scans can afford.
    """

    def __init__(self, angle_rad: np.ndarray, sigma: float, largest_lost: float = 0.34):
        self.angle, self.sigma = np.asarray(angle_rad, float), float(sigma)
        self.basis = harmonic_basis(self.angle)
        self._inverse = np.linalg.pinv(self.basis)
        self._least = max(_LEAST_ARMS, int(np.ceil((1.0 - largest_lost) * len(self.angle))))

    def fit(self, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return harmonics (n, 5) in the tool's frame, residual (n, arms), spread (n,), used (n,), all in metre."""
        n, arms = radius.shape
        harmonics, residual, spread, used = np.empty((n, 5)), np.empty((n, arms)), np.empty(n), np.empty(n)
        whole = np.ascontiguousarray(radius)
        fit_scans(whole, self.basis, self._inverse, self.sigma, self._least, harmonics, residual, spread, used)
        return harmonics, residual, spread, used


def harmonic_basis(angle: np.ndarray) -> np.ndarray:
    """Columns 1, cos, sin, cos 2, sin 2 of the angles (rad); shape (arms, 5)."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], axis=-1)


def to_pipe_clock(harmonics: np.ndarray, roll: np.ndarray, sign: int) -> tuple[np.ndarray, ...]:
    """Turn harmonics of the tool's angle into those of the pipe's clock = sign * (angle + roll).

    Returns radius, right, up, oval_cos, oval_sin (m), the second-order part of the offset taken out.
    """
    first = (harmonics[:, 1] - 1j * harmonics[:, 2]) * np.exp(-1j * roll)
    second = (harmonics[:, 3] - 1j * harmonics[:, 4]) * np.exp(-2j * roll)
    radius = harmonics[:, 0]
    second = second - first**2 / (4 * radius)
    radius = radius + np.abs(first) ** 2 / (4 * radius)
    return radius, -sign * first.imag, first.real, second.real, -sign * second.imag


def log_scans(
    reader: ScanReader, ring: int, fitter: SectionFitter, each: Callable[[ScanBlock, dict[str, np.ndarray]], None] | None = None
) -> ScanLog:
    """Fit every scan of a ring; ``each`` sees every block with its records (for the wall map)."""
    records: dict[str, Any] = {name: np.empty(reader.scans, kind) for name, kind in _KINDS.items()}
    for block in reader.blocks(ring):
        found = _records(reader, block, fitter)
        if each is not None:
            each(block, found)
        for name, values in found.items():
            records[name][block.start : block.start + len(block.time)] = values
    return ScanLog(**records, arms=len(fitter.angle))


def scan_ranges(log: ScanLog, start: float, stop: float) -> list[tuple[int, int]]:
    """Ranges of scans (first, behind the last) whose chainage lies between start and stop; one for each passage."""
    cells = np.flatnonzero((log.reach[:, 1] >= start) & (log.reach[:, 0] < stop))
    parts = [_inside(log, int(c) * _CELL, start, stop) for c in cells]
    inside = np.concatenate(parts) if parts else np.empty(0, np.int64)
    if not inside.size:
        return []
    breaks = np.flatnonzero(np.diff(inside) > 200)
    firsts = inside[np.concatenate([[0], breaks + 1])]
    lasts = inside[np.concatenate([breaks, [inside.size - 1]])]
    return [(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _inside(log: ScanLog, first: int, start: float, stop: float) -> np.ndarray:
    part = slice(first, first + _CELL)
    place = log.chainage[part]
    return first + np.flatnonzero((place >= start) & (place < stop) & np.isfinite(log.radius[part]) & log.moving[part])


def _records(reader: ScanReader, block: ScanBlock, fitter: SectionFitter) -> dict[str, np.ndarray]:
    harmonics, residual, spread, used = fitter.fit(block.radius)
    radius, right, up, oval_cos, oval_sin = to_pipe_clock(harmonics, block.roll, reader.sign)
    n = len(block.time)
    departures = {}
    for name, side in (("dip", residual), ("bulge", -residual)):
        size, arm = np.empty(n), np.empty(n, np.int64)
        inward_running(side, _DIP_HALF, size, arm)
        departures[name] = np.where(np.isfinite(radius), size, np.nan)
        departures[f"{name}_clock"] = np.mod(reader.sign * (fitter.angle[np.maximum(arm, 0)] + block.roll), 2 * np.pi)
    return {
        "time": block.time,
        "chainage": block.chainage,
        "radius": radius,
        "right": right,
        "up": up,
        "oval_cos": oval_cos,
        "oval_sin": oval_sin,
        "spread": spread,
        "used": used,
        **departures,
        "moving": reader.moving(block.time),
    }
