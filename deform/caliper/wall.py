"""Scans in, the wall on chainage × pipe clock out: coarse along the whole line, fine around dents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import xarray as xr

from deform.caliper._kernels import fill_bins
from deform.caliper.cross_section import ScanLog, SectionFitter, scan_ranges, to_pipe_clock
from deform.caliper.dent_shape import DentFit
from deform.caliper.scans import ScanBlock, ScanReader
from deform.run import build
from deform.vocabulary import variable

_ROUND = 1e-5  # m: a hundredth of the noise of one reading is enough, and packs three times better


class WallMap:
    """Mean radius about the section's centre in cells of chainage × clock; memory grows with the line, not with the scans.

    Parameters
    ----------
    start, stop : chainage (m) of the first and behind the last row.
    step : length of a row (m).
    bins : clock bins; bin k is centred on k * 360 / bins degree.
    """

    def __init__(self, start: float, stop: float, step: float, bins: int):
        self.start, self.step, self.bins = start, step, bins
        rows = max(1, int(np.ceil((stop - start) / step)))
        self.total = np.zeros((rows, bins), np.float32)
        self.count = np.zeros((rows, bins), np.uint16)
        self.relief: np.ndarray | float = 0.0
        self._formed = False

    @property
    def chainage(self) -> np.ndarray:
        """Centre of each row (m)."""
        return self.start + (np.arange(len(self.total)) + 0.5) * self.step

    def add(self, reader: ScanReader, ring: int, block: ScanBlock, right: np.ndarray, up: np.ndarray, use: np.ndarray) -> None:
        """Add the scans of a block where ``use`` is true; right, up (m) are the centre seen from the tool axis."""
        row = np.floor((block.chainage - self.start) / self.step)
        inside = use & (row >= 0) & (row < len(self.total))
        row = np.where(inside, row, -1).astype(np.int64)
        angle = reader.angle_rad[ring]
        fill_bins(row, angle, reader.sign, block.roll, block.radius, right, up, self.bins, self.total, self.count)

    def radius(self) -> np.ndarray:
        """Mean radius (rows, bins) in metre, NaN where nothing was measured; float32, and formed in the place of the sums."""
        if not self._formed:
            with np.errstate(invalid="ignore", divide="ignore"):
                np.divide(self.total, self.count, out=self.total)
            self.total[self.count == 0] = np.nan
            if not np.isscalar(self.relief):
                self.total -= self.relief
            np.divide(self.total, _ROUND, out=self.total)
            np.rint(self.total, out=self.total)
            np.multiply(self.total, _ROUND, out=self.total)
            self._formed = True
        return self.total


def detail_maps(
    reader: ScanReader,
    logs: list[ScanLog],
    fitters: list[SectionFitter],
    windows: Iterable[tuple[float, float]],
    fits: list[DentFit],
    step: float,
    bins: int,
) -> list[WallMap]:
    """Read the scans of each window (start, end chainage in metre) again and map them at a fine step.

    Between two arms a straight line would cut off the apex of a dent. The fitted shapes are therefore taken off the
    readings, what is left is mapped, and the shapes are put back at the cells.
    """
    maps = []
    for start, stop in windows:
        wall = WallMap(start, stop, step, bins)
        near = [f for f in fits if start < f.centre < stop]
        for ring, (log, fitter) in enumerate(zip(logs, fitters, strict=True)):
            for first, last in scan_ranges(log, start, stop):
                block = reader.read(ring, first, last)
                clock = centred_clock(reader, ring, block, log.right[first:last], log.up[first:last])
                flat = replace(block, radius=block.radius + relief(near, block.chainage[:, None], clock))
                harmonics, *_ = fitter.fit(flat.radius)
                _, right, up, *_ = to_pipe_clock(harmonics, block.roll, reader.sign)
                wall.add(reader, ring, flat, right, up, log.good[first:last])
        wall.relief = relief(near, wall.chainage[:, None], np.arange(bins)[None, :] * 2 * np.pi / bins)
        maps.append(wall)
    return maps


def relieve(reader: ScanReader, logs: list[ScanLog], fitters: list[SectionFitter], fits: list[DentFit]) -> None:
    """Fit the scans across each dent again with its shape taken off, so that it sits neither in the ovality nor in the offset."""
    for fit in fits:
        for ring, (log, fitter) in enumerate(zip(logs, fitters, strict=True)):
            for first, last in scan_ranges(log, fit.centre - fit.length, fit.centre + fit.length):
                block = reader.read(ring, first, last)
                near = [f for f in fits if abs(f.centre - fit.centre) < fit.length + f.length]
                clock = centred_clock(reader, ring, block, log.right[first:last], log.up[first:last])
                harmonics, _, spread, used = fitter.fit(block.radius + relief(near, block.chainage[:, None], clock))
                values = (*to_pipe_clock(harmonics, block.roll, reader.sign), spread, used)
                names = ("radius", "right", "up", "oval_cos", "oval_sin", "spread", "used")
                for name, value in zip(names, values, strict=True):
                    getattr(log, name)[first:last] = value


def centred_clock(reader: ScanReader, ring: int, block: ScanBlock, right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Clock (n, arms) in rad of each arm, seen from the centre of the pipe at right, up (m) of the tool."""
    clock = reader.sign * (reader.angle_rad[ring][None, :] + block.roll[:, None])
    mean = np.nanmean(block.radius)
    return np.arctan2(mean * np.sin(clock) - right[:, None], mean * np.cos(clock) - up[:, None])


def relief(fits: list[DentFit], place: np.ndarray, clock: np.ndarray) -> np.ndarray | float:
    """Sum of the fitted dents (m, positive inward) at places (m) and clocks (rad)."""
    total: np.ndarray | float = 0.0
    for fit in fits:
        total = total + fit.at(place, clock)
    return total


def wall_dataset(coarse: WallMap, fine: list[WallMap], sections: xr.Dataset, pose: xr.Dataset) -> xr.Dataset:
    """Join the maps to the group ``caliper``: fine rows replace the coarse ones where both exist.

    The axis is irregular: attribute ``wall_step_m`` is the step of the whole line, ``detail_step_m`` that around dents.
    """
    chainage = coarse.chainage
    keep = (coarse.count > 0).any(axis=1)
    for wall in fine:
        keep &= ~((chainage >= wall.start) & (chainage < wall.start + len(wall.total) * wall.step))
    there = [(wall.count > 0).any(axis=1) for wall in fine]
    place = np.concatenate([chainage[keep], *(wall.chainage[rows] for wall, rows in zip(fine, there, strict=True))])
    order = np.argsort(place, kind="stable")
    target = np.empty(order.size, np.int64)
    target[order] = np.arange(order.size)
    shape = np.empty((place.size, coarse.bins), np.float32)
    first = 0
    for wall, rows in zip([coarse, *fine], [keep, *there], strict=True):
        last = first + int(rows.sum())
        shape[target[first:last]] = wall.radius()[rows]
        first = last
    place = place[order]
    known = sections.sizes["chainage"] > 0
    reference = np.interp(place, sections["chainage"].values, sections["diameter_mean"].values / 2) if known else place * np.nan
    clock = np.arange(coarse.bins) * 360.0 / coarse.bins
    values = {"chainage": place, "clock": clock, "reference_radius": reference, **_offsets(place, pose)}
    ds = build.dataset("caliper", values, wall_step_m=coarse.step, detail_step_m=fine[0].step if fine else coarse.step)
    ds["radius"] = (("scan", "clock"), shape, variable("caliper", "radius").attrs)  # float32: it is the largest array of a run
    return ds


def _offsets(place: np.ndarray, pose: xr.Dataset) -> dict[str, np.ndarray]:
    """Tool offset at the rows, through the chainage of the foremost ring."""
    at = pose["ring_chainage"].values if "ring_chainage" in pose else pose["chainage"].values
    order = np.argsort(at, kind="stable")
    names = ("offset_right", "offset_up", "offset_right_sigma", "offset_up_sigma")
    return {name: np.interp(place, at[order], pose[name].values[order]) for name in names}
