"""Blocks of scans in, one record per scan out: mean radius and centre, and the few scans with a departure from the section."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from deform.caliper._kernels import departures
from deform.caliper.scans import SEGMENT, ScanBlock, ScanReader
from deform.geometry.harmonics import HarmonicFitter

_LEAST_ARMS = 6
_CELL = 2048  # scans over which the reach of the chainage is kept
_MARGIN = 512  # scans of the neighbours that a block sees on either side
MEAN_HALF = 2  # scans on either side over which a departure is averaged
_AROUND_M = 3.0  # length over which the usual section is the median; dents up to half of it do not draw it
_CELL_M = 0.1  # cells in which that median is formed
_PIECE = 500_000  # scans summed at once
KEPT: dict[str, type] = {
    "radius": np.float32,
    **dict.fromkeys(("right", "up", "oval_cos", "oval_sin", "sigma"), np.float16),
    "good": np.bool_,
}


@dataclass(frozen=True)
class Records:
    """Sections of the scans of one block; clocks are the pipe's, looking downstream.

    Attributes
    ----------
    radius : (n,) m, mean inner radius; NaN where too many arms are lost.
    right, up : (n,) m, centre of the section seen from the tool axis.
    oval_cos, oval_sin : (n,) m, radius varies as oval_cos * cos(2 clock) + oval_sin * sin(2 clock).
    sigma : (n,) m, standard deviation of the mean radius.
    residual : (n, arms) m, measured minus section.
    good : (n,) true where the section stands and the tool moves.
    """

    radius: np.ndarray
    right: np.ndarray
    up: np.ndarray
    oval_cos: np.ndarray
    oval_sin: np.ndarray
    sigma: np.ndarray
    residual: np.ndarray
    good: np.ndarray

    def part(self, rows: slice) -> Records:
        """The records of some of the scans."""
        return Records(*(getattr(self, f.name)[rows] for f in fields(self)))


@dataclass(frozen=True)
class Departures:
    """Scans in which some arm stands off the section by more than noise.

    Attributes
    ----------
    index : (n,) of the scan.
    size : (n,) m, greatest departure after a short running mean.
    clock : (n,) rad, of that arm in the pipe.
    """

    index: np.ndarray
    size: np.ndarray
    clock: np.ndarray


@dataclass(frozen=True)
class ScanLog:
    """What is kept of every scan of a ring, in order of time: fifteen bytes.

    Attributes
    ----------
    ring : index of the ring.
    radius : (n,) m, mean inner radius; NaN where too many arms are lost.
    right, up, oval_cos, oval_sin, sigma : (n,) m, as in `Records`; kept to a few micrometres (float16).
    good : (n,) true where the section stands and the tool moves.
    reach : (cells, 2) m, least and greatest chainage of every 2048 scans, to find places without looking at all scans.
    dips, bulges : inward and outward departures.
    """

    ring: int
    radius: np.ndarray
    right: np.ndarray
    up: np.ndarray
    oval_cos: np.ndarray
    oval_sin: np.ndarray
    sigma: np.ndarray
    good: np.ndarray
    reach: np.ndarray
    dips: Departures
    bulges: Departures

    def write(self, first: int, found: Records) -> None:
        """Keep the records of the scans from ``first`` on."""
        for name in KEPT:
            getattr(self, name)[first : first + found.radius.size] = getattr(found, name)

    def pieces(self, reader: ScanReader) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield slices of all scans, and the chainage (m) of theirs, so that sums over a long line need little room."""
        for first in range(0, self.radius.size, _PIECE):
            part = slice(first, min(first + _PIECE, self.radius.size))
            yield part, reader.chainage(reader.time[part], self.ring)


@dataclass(frozen=True)
class Limits:
    """Departures (m) from which on a scan is remembered.

    Attributes
    ----------
    dip : inward, from the section of the scan itself; a dent between two arms shows little of itself.
    broad : inward, from the usual section of the pipe around; a dent may be so broad that it draws the section of its own scans.
    bulge : outward.
    """

    dip: float
    broad: float
    bulge: float


def section_fitters(reader: ScanReader, sigma: np.ndarray, largest_lost: float) -> list[HarmonicFitter]:
    """One fitter per ring; ``sigma`` (rings,) m, ``largest_lost`` the share of arms beyond which a section is refused."""
    least = least_arms(reader.angle_rad.shape[1], largest_lost)
    return [HarmonicFitter(angle, s, least=least) for angle, s in zip(reader.angle_rad, sigma, strict=True)]


def least_arms(arms: int, largest_lost: float) -> int:
    """Arms of a ring that a section needs, when at most a share of them may be lost."""
    return max(_LEAST_ARMS, int(np.ceil((1.0 - largest_lost) * arms)))


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


def to_tool_angle(radius, right, up, oval_cos, oval_sin, roll: np.ndarray, sign: int) -> np.ndarray:
    """Harmonics (n, 5) of the tool's angle that a section gives; the inverse of `to_pipe_clock`."""
    first = (up - 1j * sign * right) * np.exp(1j * roll)
    second = (oval_cos - 1j * sign * oval_sin) * np.exp(2j * roll) + first**2 / (4 * radius)
    return np.stack([radius - np.abs(first) ** 2 / (4 * radius), first.real, -first.imag, second.real, -second.imag], axis=1)


def sections_of(reader: ScanReader, block: ScanBlock, fitter: HarmonicFitter) -> Records:
    """Fit the scans of a block."""
    harmonics, residual, spread, used = fitter.fit(block.radius)
    radius, right, up, oval_cos, oval_sin = to_pipe_clock(harmonics, block.roll, reader.sign)
    good = np.isfinite(radius) & reader.moving(block.time)
    sigma = spread / np.sqrt(np.maximum(used, 1.0))
    return Records(radius, right, up, oval_cos, oval_sin, sigma, residual, good)


Sink = Callable[[list[ScanBlock], list[Records]], None]


def log_scans(reader: ScanReader, fitters: list[HarmonicFitter], limits: Limits, each: Sink) -> list[ScanLog]:
    """Fit every scan of every ring in one pass over the file; ``each`` sees every block once, with its records.

    Blocks overlap by `_MARGIN` scans, so that running means and medians have neighbours; what ``each`` sees does not.
    """
    logs = [_Builder(reader, ring) for ring in range(reader.rings)]
    for first, last, blocks in _overlapping(reader):
        start = blocks[0].start
        own = slice(first - start, last - start)
        records = []
        for ring, (block, fitter) in enumerate(zip(blocks, fitters, strict=True)):
            found = sections_of(reader, block, fitter)
            logs[ring].add(block, found, fitter, limits, own)
            records.append(found.part(own))
        each([_cut(block, own) for block in blocks], records)
    return [log.finish() for log in logs]


def scan_ranges(reader: ScanReader, log: ScanLog, start: float, stop: float) -> list[tuple[int, int]]:
    """Ranges of scans (first, behind the last) whose chainage lies between start and stop; one for each passage."""
    cells = np.flatnonzero((log.reach[:, 1] >= start) & (log.reach[:, 0] < stop))
    parts = [_inside(reader, log, int(c) * _CELL, start, stop) for c in cells]
    inside = np.concatenate(parts) if parts else np.empty(0, np.int64)
    if not inside.size:
        return []
    breaks = np.flatnonzero(np.diff(inside) > 200)
    firsts = inside[np.concatenate([[0], breaks + 1])]
    lasts = inside[np.concatenate([breaks, [inside.size - 1]])]
    return [(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _inside(reader: ScanReader, log: ScanLog, first: int, start: float, stop: float) -> np.ndarray:
    part = slice(first, first + _CELL)
    place = reader.chainage(reader.time[part], log.ring)
    return first + np.flatnonzero((place >= start) & (place < stop) & log.good[part])


def _overlapping(reader: ScanReader) -> Iterator[tuple[int, int, list[ScanBlock]]]:
    """First and behind-last scan that each block owns, and the block of every ring with its margins."""
    step = max(SEGMENT, reader.block_scans // SEGMENT * SEGMENT)
    for first in range(0, reader.scans, step):
        last = min(first + step, reader.scans)
        blocks = reader.read_rings(max(0, first - _MARGIN), min(last + _MARGIN, reader.scans))
        reader.find_stuck(blocks, first, last)
        yield first, last, blocks


def _cut(block: ScanBlock, own: slice) -> ScanBlock:
    return ScanBlock(block.start + own.start, block.time[own], block.chainage[own], block.roll[own], block.radius[own])


class _Builder:
    """Gathers the log of one ring."""

    def __init__(self, reader: ScanReader, ring: int):
        self.reader, self.ring = reader, ring
        self.kept: dict[str, Any] = {name: np.zeros(reader.scans, kind) for name, kind in KEPT.items()}
        self.dips: list[Departures] = []
        self.bulges: list[Departures] = []

    def add(self, block: ScanBlock, found: Records, fitter: HarmonicFitter, limits: Limits, own: slice) -> None:
        for name, values in self.kept.items():
            values[block.start + own.start : block.start + own.stop] = getattr(found, name)[own]
        inward, outward = self._departures(block, found.residual)
        self.dips += [_above(inward, found.good, limits.dip, own, block.start)]
        self.bulges += [_above(outward, found.good, limits.bulge, own, block.start)]
        broad = self._broad(block, found, fitter, limits)
        if broad is not None:
            self.dips += [_above(broad, found.good, limits.broad, own, block.start)]

    def _departures(self, block: ScanBlock, residual: np.ndarray):
        n, angle = len(residual), self.reader.angle_rad[self.ring]
        dip, bulge = np.empty(n), np.empty(n)
        dip_arm, bulge_arm = np.empty(n, np.int64), np.empty(n, np.int64)
        departures(residual, MEAN_HALF, dip, dip_arm, bulge, bulge_arm)
        turn = self.reader.sign
        return tuple(
            (size, turn * (angle[np.maximum(arm, 0)] + block.roll)) for size, arm in ((dip, dip_arm), (bulge, bulge_arm))
        )

    def _broad(self, block: ScanBlock, found: Records, fitter: HarmonicFitter, limits: Limits):
        """Inward departures from the usual section around, by the middle of the arms where all of them stand in (a bead)."""
        usual = _usual(block.chainage, found)
        if usual is None:
            return None
        radius, right, up, oval_cos, oval_sin = usual
        harmonics = to_tool_angle(radius, right, up, oval_cos, oval_sin, block.roll, self.reader.sign)
        residual = block.radius - harmonics @ fitter.basis.T
        size, _ = self._departures(block, residual)[0]
        some = np.flatnonzero(found.good & (np.nan_to_num(size) > limits.broad))
        if not some.size:
            return None
        rows = np.unique(np.clip(some[:, None] + np.arange(-MEAN_HALF, MEAN_HALF + 1), 0, len(residual) - 1))
        with np.errstate(all="ignore"):
            residual[rows] -= np.nan_to_num(np.nanmedian(residual[rows], axis=1))[:, None]
        return self._departures(block, residual)[0]

    def finish(self) -> ScanLog:
        time = self.reader.time
        cells = range(0, time.size, _CELL)
        spans = [self.reader.chainage(time[c : c + _CELL], self.ring) for c in cells]
        reach = np.array([(s.min(), s.max()) for s in spans]).reshape(-1, 2)
        dips, bulges = _strongest(self.dips), _strongest(self.bulges)
        return ScanLog(self.ring, **self.kept, reach=reach, dips=dips, bulges=bulges)


def _above(departure: tuple[np.ndarray, np.ndarray], good: np.ndarray, limit: float, own: slice, start: int) -> Departures:
    size, clock = departure
    index = own.start + np.flatnonzero(good[own] & (np.nan_to_num(size[own]) > limit))
    clock = np.mod(clock[index], 2 * np.pi).astype(np.float32)
    return Departures(start + index, size[index].astype(np.float32), clock)


def _strongest(parts: list[Departures]) -> Departures:
    """All parts as one, in order of the scans; of two departures of one scan the greater."""
    index, size, clock = (np.concatenate([getattr(p, n) for p in parts]) for n in ("index", "size", "clock"))
    order = np.lexsort((-size, index))
    order = order[np.unique(index[order], return_index=True)[1]]
    return Departures(index[order], size[order], clock[order])


def _usual(place: np.ndarray, found: Records) -> list[np.ndarray] | None:
    """Running medians of radius, right, up, oval_cos, oval_sin over some metres of pipe; None where too little is known."""
    use = np.flatnonzero(found.good)
    if use.size < 20:
        return None
    pitch = max(float(np.median(np.abs(np.diff(place[use])))), 1e-4)
    cell = max(1, round(_CELL_M / pitch))
    starts = np.arange(0, use.size, cell)
    share = np.diff(np.append(starts, use.size))
    middle = np.add.reduceat(use, starts) / share
    window = max(3, round(_AROUND_M / (cell * pitch))) | 1
    usual = []
    for name in ("radius", "right", "up", "oval_cos", "oval_sin"):
        means = np.add.reduceat(getattr(found, name)[use], starts) / share
        usual.append(np.interp(np.arange(place.size), middle, median_filter(means, window, mode="nearest")))
    return usual
