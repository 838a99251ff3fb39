"""Scans in, the wall on chainage × pipe clock out: coarse along the whole line, fine around dents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from mmap import mmap

import numpy as np
import xarray as xr

from deform.caliper._kernels import fill_bins
from deform.caliper.cross_section import Records, ScanLog, scan_ranges, sections_of
from deform.caliper.dent_shape import DentFit, relief
from deform.caliper.scans import ScanBlock, ScanReader
from deform.geometry.harmonics import HarmonicFitter
from deform.run import build
from deform.vocabulary import variable

_ROUND = 1e-5  # m: a hundredth of the noise of one reading is enough, and packs three times better
_CHUNK = 8192  # rows that are settled, and given away, together
_BEHIND_M = 5.0  # rows this near to the tool are still open: rings follow each other, and a tool may roll back


class WallMap:
    """Mean radius about the section's centre in cells of chainage × clock.

    Sums are kept only of the rows near the tool; rows that it has left are settled to their mean. A row that the tool
    comes back to after that enters its new mean as one reading more.

    Parameters
    ----------
    start, stop : chainage (m) of the first and behind the last row.
    step : length of a row (m).
    bins : clock bins; bin k is centred on k * 360 / bins degree.
    """

    def __init__(self, start: float, stop: float, step: float, bins: int):
        self.start, self.step, self.bins = start, step, bins
        self.rows = max(1, int(np.ceil((stop - start) / step)))
        self._settled: list[np.ndarray | None] = [None] * (-(-self.rows // _CHUNK))
        self._first = 0
        self._total, self._count = np.zeros((0, bins)), np.zeros((0, bins))

    @property
    def chainage(self) -> np.ndarray:
        """Centre of each row (m)."""
        return self.start + (np.arange(self.rows) + 0.5) * self.step

    def add(self, reader: ScanReader, ring: int, block: ScanBlock, right: np.ndarray, up: np.ndarray, use: np.ndarray) -> None:
        """Add the scans of a block where ``use`` is true; right, up (m) are the centre seen from the tool axis."""
        row = np.floor((block.chainage - self.start) / self.step)
        inside = use & (row >= 0) & (row < self.rows)
        if not inside.any():
            return
        self._open(int(row[inside].min()), int(row[inside].max()) + 1)
        row = np.where(inside, row - self._first, -1).astype(np.int64)
        angle = reader.angle_rad[ring]
        fill_bins(row, angle, reader.sign, block.roll, block.radius, right, up, self.bins, self._total, self._count)

    def settle(self, place: float | None = None) -> None:
        """Settle the open rows, all of them or those far from a place (m)."""
        if place is not None:
            row = int((place - self.start) / self.step) - self._first
            far = int(_BEHIND_M / self.step)
            keep = slice(max(0, row - far), max(0, min(len(self._total), row + far)))
        else:
            keep = slice(0, 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.rint(self._total / np.where(self._count > 0, self._count, np.nan) / _ROUND) * _ROUND
        for first, last in ((0, keep.start), (keep.stop, len(mean))):
            self._write(self._first + first, mean[first:last])
        self._total, self._count = self._total[keep].copy(), self._count[keep].copy()
        self._first += keep.start

    def mean(self, first: int, last: int) -> np.ndarray:
        """Settled mean radius (last - first, bins) in metre; NaN where nothing was measured."""
        found = np.full((last - first, self.bins), np.nan, np.float32)
        for k in range(first // _CHUNK, -(-last // _CHUNK)):
            chunk, low = self._settled[k], k * _CHUNK
            if chunk is not None:
                a, b = max(first, low), min(last, low + len(chunk))
                found[a - first : b - first] = chunk[a - low : b - low]
        return found

    def known(self) -> np.ndarray:
        """True for rows that hold anything (rows,)."""
        parts = [self.mean(r, min(r + _CHUNK, self.rows)) for r in range(0, self.rows, _CHUNK)]
        return np.concatenate([np.isfinite(p).any(axis=1) for p in parts])

    def give(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield the settled rows piece by piece and forget them, so that they are never held twice."""
        for k in range(len(self._settled)):
            rows = slice(k * _CHUNK, min((k + 1) * _CHUNK, self.rows))
            yield rows, self.mean(rows.start, rows.stop)
            self._settled[k] = None

    def _open(self, low: int, high: int) -> None:
        """Take rows low to high among the open ones."""
        if not len(self._total):
            self._first = low
        first, last = min(low, self._first), max(high, self._first + len(self._total))
        if first == self._first and last == first + len(self._total):
            return
        mean = self.mean(first, last).astype(float)
        count = np.isfinite(mean).astype(float)
        total = np.nan_to_num(mean)
        old = slice(self._first - first, self._first - first + len(self._total))
        total[old], count[old] = self._total, self._count
        self._first, self._total, self._count = first, total, count

    def _write(self, first: int, mean: np.ndarray) -> None:
        for k in range(first // _CHUNK, -(-(first + len(mean)) // _CHUNK) if len(mean) else 0):
            low = k * _CHUNK
            chunk = self._settled[k]
            if chunk is None:
                chunk = self._settled[k] = _room(min(_CHUNK, self.rows - low), self.bins)
            a, b = max(first, low), min(first + len(mean), low + len(chunk))
            chunk[a - low : b - low] = mean[a - first : b - first]


def _room(rows: int, bins: int) -> np.ndarray:
    """NaN (rows, bins) in pages of their own, which go back to the system when they are let go; the heap would keep them."""
    room = np.frombuffer(mmap(-1, 4 * rows * bins), np.float32).reshape(rows, bins)
    room[:] = np.nan
    return room


def detail_maps(
    reader: ScanReader,
    logs: list[ScanLog],
    fitters: list[HarmonicFitter],
    windows: Iterable[tuple[float, float]],
    fits: list[DentFit],
    step: float,
    bins: int,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Read the scans of each window (start, end chainage in metre) again and map them at a fine step.

    Between two arms a straight line would cut off the apex of a dent. The fitted shapes are therefore taken off the
    readings, what is left is mapped, and the shapes are put back at the cells.

    Returns
    -------
    Chainage (rows,) and radius (rows, bins) of each window, in metre.
    """
    maps = []
    clock = np.arange(bins)[None, :] * 2 * np.pi / bins
    for start, stop in windows:
        wall = WallMap(start, stop, step, bins)
        near = [f for f in fits if start < f.centre < stop]
        for log, fitter in zip(logs, fitters, strict=True):
            for first, last in scan_ranges(reader, log, start, stop):
                flat, found = _flattened(reader, log, fitter, near, first, last)
                wall.add(reader, log.ring, flat, found.right, found.up, log.good[first:last])
        wall.settle()
        place = wall.chainage
        maps.append((place, wall.mean(0, wall.rows) - np.float32(relief(near, place[:, None], clock))))
    return maps


def relieve(reader: ScanReader, logs: list[ScanLog], fitters: list[HarmonicFitter], fits: list[DentFit]) -> None:
    """Fit the scans across each dent again with its shape taken off, so that it sits neither in the ovality nor in the offset."""
    for fit in fits:
        near = [f for f in fits if abs(f.centre - fit.centre) < fit.length + f.length]
        for log, fitter in zip(logs, fitters, strict=True):
            for first, last in scan_ranges(reader, log, fit.centre - fit.length, fit.centre + fit.length):
                _, found = _flattened(reader, log, fitter, near, first, last)
                log.write(first, found)


def _flattened(
    reader: ScanReader, log: ScanLog, fitter: HarmonicFitter, near: list[DentFit], first: int, last: int
) -> tuple[ScanBlock, Records]:
    """Scans with the fitted dents taken off their readings, and their sections."""
    block = reader.read(log.ring, first, last)
    right, up = (getattr(log, n)[first:last].astype(float) for n in ("right", "up"))
    clock = centred_clock(reader, log.ring, block, right, up)
    flat = replace(block, radius=block.radius + relief(near, block.chainage[:, None], clock))
    return flat, sections_of(reader, flat, fitter)


def centred_clock(reader: ScanReader, ring: int, block: ScanBlock, right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Clock (n, arms) in rad of each arm, seen from the centre of the pipe at right, up (m) of the tool."""
    clock = reader.sign * (reader.angle_rad[ring][None, :] + block.roll[:, None])
    mean = np.nanmean(block.radius)
    return np.arctan2(mean * np.sin(clock) - right[:, None], mean * np.cos(clock) - up[:, None])


def wall_dataset(
    coarse: WallMap, fine: list[tuple[np.ndarray, np.ndarray]], step: float, sections: xr.Dataset, pose: xr.Dataset
) -> xr.Dataset:
    """Join the maps to the group ``caliper``: fine rows (``step`` metre) replace the coarse ones where both exist.

    The axis is irregular: attribute ``wall_step_m`` is the step of the whole line, ``detail_step_m`` that around dents.
    """
    coarse.settle()
    chainage = coarse.chainage
    keep = coarse.known()
    for place, _ in fine:
        keep &= ~((chainage >= place[0] - 0.5 * step) & (chainage < place[-1] + 0.5 * step))
    there = [np.isfinite(radius).any(axis=1) for _, radius in fine]
    place = np.concatenate([chainage[keep], *(at[rows] for (at, _), rows in zip(fine, there, strict=True))])
    order = np.argsort(place, kind="stable")
    target = np.empty(order.size, np.int64)
    target[order] = np.arange(order.size)
    shape = np.empty((place.size, coarse.bins), np.float32)
    first = 0
    for rows, radius in coarse.give():
        last = first + int(keep[rows].sum())
        shape[target[first:last]] = radius[keep[rows]]
        first = last
    for (_, radius), rows in zip(fine, there, strict=True):
        last = first + int(rows.sum())
        shape[target[first:last]] = np.rint(radius[rows] / _ROUND) * _ROUND
        first = last
    place = place[order]
    known = sections.sizes["chainage"] > 0
    reference = np.interp(place, sections["chainage"].values, sections["diameter_mean"].values / 2) if known else place * np.nan
    clock = np.arange(coarse.bins) * 360.0 / coarse.bins
    values = {"chainage": place, "clock": clock, "reference_radius": reference, **_offsets(place, pose)}
    ds = build.dataset("caliper", values, wall_step_m=coarse.step, detail_step_m=step if fine else coarse.step)
    ds["radius"] = (("scan", "clock"), shape, variable("caliper", "radius").attrs)  # float32: it is the largest array of a run
    return ds


def _offsets(place: np.ndarray, pose: xr.Dataset) -> dict[str, np.ndarray]:
    """Tool offset at the rows, through the chainage of the foremost ring."""
    at = pose["ring_chainage"].values if "ring_chainage" in pose else pose["chainage"].values
    order = np.argsort(at, kind="stable")
    names = ("offset_right", "offset_up", "offset_right_sigma", "offset_up_sigma")
    return {name: np.interp(place, at[order], pose[name].values[order]) for name in names}
