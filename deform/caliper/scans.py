"""A raw run and its trajectory in, blocks of scans out: metres, arms in order, each ring on its own chainage and roll."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from deform.caliper._kernels import unrest
from deform.errors import Fault, InputError
from deform.run.raw import RawRun

if TYPE_CHECKING:
    from deform.caliper.scan_clock import ClockError

logger = logging.getLogger(__name__)

SEGMENT = 2048  # scans over which an arm is judged to stand still
STUCK_SHARE = 0.15  # of the usual step from scan to scan
_STILL_M_S = 0.02  # slower than this a tool stands, where navigation has not said so
_FEW = 200  # scans in motion below which an arm is not judged


@dataclass(frozen=True)
class ScanBlock:
    """Scans of one ring.

    Attributes
    ----------
    start : index of the first scan in the file.
    time : (n,) s.
    chainage : (n,) m, of the ring.
    roll : (n,) rad, of the tool.
    radius : (n, arms) m, tool axis to wall, NaN where an arm gave nothing.
    """

    start: int
    time: np.ndarray
    chainage: np.ndarray
    roll: np.ndarray
    radius: np.ndarray


def motion(trajectory: xr.Dataset) -> np.ndarray:
    """One where the tool moves, zero where it stands, at the samples of the trajectory."""
    if "stationary" in trajectory:
        return 1.0 - np.asarray(trajectory["stationary"].values, float)
    return (np.abs(np.asarray(trajectory["speed"].values, float)) > _STILL_M_S).astype(float)


class ScanReader:
    """Reads the arms of a raw run in blocks; memory is bounded by the block.

    Attributes
    ----------
    angle_rad : (rings, arms) angle of the arms, rising.
    sign : +1 when the tool ran downstream, -1 upstream; clock = sign * (angle + roll).
    time : (scans,) s, on the clock of the inertial unit.
    stuck : (rings, segments, arms) true where an arm stood still over `SEGMENT` scans; its readings there are dropped.
    """

    def __init__(self, raw: RawRun, trajectory: xr.Dataset, block_scans: int = 100_000):
        if raw.arms is None or raw.header.caliper is None:
            raise InputError(Fault(raw.id, "caliper", "the run has no caliper"))
        self.raw, self.block_scans, self.sign = raw, block_scans, raw.header.travel_sign
        self._arms = raw.arms
        self._radius = raw.arms["radius"]
        self.rings = int(self._radius.sizes.get("ring", 1))
        angle = np.atleast_2d(np.asarray(raw.arms["arm_angle"].values, float))
        angle = np.broadcast_to(angle, (self.rings, angle.shape[-1])) % (2 * np.pi)
        self._order = np.argsort(angle, axis=1, kind="stable")
        self._all_angles = np.take_along_axis(angle, self._order, axis=1)
        self._offset = np.zeros_like(self._all_angles)
        self._dead = np.zeros(self._all_angles.shape, bool)
        self.ring_offset = tuple(raw.header.caliper.ring_offset_m)
        self.scans = int(raw.arms.sizes["scan"])
        self.time = np.asarray(raw.arms["time"].values, float)
        self.stuck = np.zeros((self.rings, -(-self.scans // SEGMENT), self._all_angles.shape[1]), bool)
        self._interpolate(trajectory)
        self._check()

    @property
    def angle_rad(self) -> np.ndarray:
        """(rings, arms) angle of the arms, rising."""
        return self._all_angles

    def calibrate(self, offset: np.ndarray, dead: np.ndarray) -> None:
        """Take arm offsets (rings, arms) in metre off every reading from now on, and drop dead arms."""
        self._offset, self._dead = np.where(np.isfinite(offset), offset, 0.0), dead

    def correct_clock(self, error: ClockError) -> None:
        """Put the scans on the clock of the inertial unit, and the rings in their place, from now on."""
        self.time = error.right(self.time)
        self.ring_offset = tuple(y + error.ahead for y in self.ring_offset)

    def chainage(self, time: np.ndarray, ring: int) -> np.ndarray:
        """Chainage (m) of a ring: that of the IMU, moved along the pipe by the ring's distance from it."""
        return np.interp(time, self._time, self._chainage) + self.sign * self.ring_offset[ring]

    def roll(self, time: np.ndarray) -> np.ndarray:
        """Roll (rad) of the tool."""
        return np.interp(time, self._time, self._roll)

    def moving(self, time: np.ndarray) -> np.ndarray:
        """True where the tool moves."""
        return np.interp(time, self._time, self._moving) > 0.5

    def span(self) -> tuple[float, float]:
        """Least and greatest chainage (m) that any ring reaches."""
        shifts = [self.sign * y for y in self.ring_offset]
        return float(self._chainage.min() + min(shifts)), float(self._chainage.max() + max(shifts))

    def read(self, ring: int, start: int, stop: int) -> ScanBlock:
        """Read scans ``start`` to ``stop`` of a ring."""
        part = self._radius.isel(scan=slice(start, stop))
        if "ring" in part.dims:
            part = part.isel(ring=ring)
        return self._block(ring, start, part.transpose("scan", "arm").values)

    def read_rings(self, start: int, stop: int) -> list[ScanBlock]:
        """Read scans ``start`` to ``stop`` of all rings, the file once."""
        part = self._radius.isel(scan=slice(start, stop))
        if "ring" not in part.dims:
            return [self._block(0, start, part.transpose("scan", "arm").values)]
        counts = part.transpose("ring", "scan", "arm").values
        return [self._block(ring, start, counts[ring]) for ring in range(self.rings)]

    def find_stuck(self, blocks: list[ScanBlock], first: int, last: int) -> None:
        """Judge the arms segment by segment between two scans, and drop what stuck arms said in these blocks.

        An arm that hardly moves from scan to scan while the others do is stuck there.
        """
        for ring, block in enumerate(blocks):
            step, count = np.empty(block.radius.shape[1]), np.empty(block.radius.shape[1])
            for segment in range(first // SEGMENT, -(-last // SEGMENT)):
                rows = slice(max(segment * SEGMENT, first) - block.start, min((segment + 1) * SEGMENT, last) - block.start)
                unrest(block.radius[rows], self.moving(block.time[rows]), step, count)
                known = count > _FEW
                if known.sum() > 3:
                    stuck = known & (step < STUCK_SHARE * np.median(step[known]))
                    self.stuck[ring, segment] |= stuck  # what an earlier pass dropped shows no unrest in this one
                    block.radius[rows, stuck] = np.nan

    def _block(self, ring: int, start: int, counts: np.ndarray) -> ScanBlock:
        radius = self._decode(counts)[:, self._order[ring]]
        radius -= self._offset[ring]
        if self._dead[ring].any():
            radius[:, self._dead[ring]] = np.nan
        for segment in range(start // SEGMENT, -(-(start + len(radius)) // SEGMENT)):
            if self.stuck[ring, segment].any():
                rows = slice(max(0, segment * SEGMENT - start), (segment + 1) * SEGMENT - start)
                radius[rows, self.stuck[ring, segment]] = np.nan
        time = self.time[start : start + len(radius)]
        return ScanBlock(start, time, self.chainage(time, ring), self.roll(time), radius)

    def _decode(self, counts: np.ndarray) -> np.ndarray:
        attrs = self._radius.attrs
        radius = counts.astype(float)
        if "_FillValue" in attrs:
            radius[counts == attrs["_FillValue"]] = np.nan
        radius = radius * float(attrs.get("scale_factor", 1.0)) + float(attrs.get("add_offset", 0.0))
        radius[(radius < self._least) | (radius > self._greatest)] = np.nan
        return radius

    @property
    def _least(self) -> float:
        return 0.2 * self.raw.header.pipe.outside_diameter_m

    @property
    def _greatest(self) -> float:
        return 0.75 * self.raw.header.pipe.outside_diameter_m

    def _interpolate(self, trajectory: xr.Dataset) -> None:
        self._time = np.asarray(trajectory["time"].values, float)
        self._chainage = np.asarray(trajectory["chainage"].values, float)
        self._roll = np.unwrap(np.radians(np.asarray(trajectory["roll"].values, float)))
        self._moving = motion(trajectory)

    def _check(self) -> None:
        """Name everything that makes the readings useless before any of them is used."""
        where, faults = f"{self.raw.id}/caliper.nc", []
        if len(self.ring_offset) != self.rings:
            rule = f"{self.rings} rings in the file, {len(self.ring_offset)} values of ring_offset_m in run.toml"
            faults.append(Fault(where, "ring", rule))
        if self._all_angles.shape[1] < 6:
            faults.append(Fault(where, "arm", f"{self._all_angles.shape[1]} arms; at least 6 are needed for an ellipse"))
        time = self.time
        if not np.isfinite(time).all() or (np.diff(time) < 0).any():
            i = int(np.flatnonzero(~(np.diff(time, prepend=-np.inf) >= 0))[0])
            faults.append(Fault(where, "time", f"is not rising at scan {i} ({time[i]:.3f} s)", "sort or repair the scan clock"))
        elif time.size and (time[-1] < self._time[0] or time[0] > self._time[-1]):
            rule = (
                f"runs from {time[0]:.1f} to {time[-1]:.1f} s, the trajectory from {self._time[0]:.1f} to {self._time[-1]:.1f} s"
            )
            faults.append(Fault(where, "time", rule, "scan clock and IMU clock differ"))
        faults += self._unit_faults(where)
        if faults:
            raise InputError(faults)
        if time.size and (time[-1] < self._time[-1] - 60.0):
            logger.warning(
                "%s: caliper ends at %.0f s, the trajectory at %.0f s: nothing is known behind", where, time[-1], self._time[-1]
            )

    def _unit_faults(self, where: str) -> list[Fault]:
        """Compare the median reading with the pipe's radius: a factor of 1000 or 25.4 is a wrong unit."""
        attrs = self._radius.attrs
        stride = slice(None, None, max(1, self.scans // 64))
        counts = self._radius.isel(scan=stride).values
        readings = counts.astype(float)
        if "_FillValue" in attrs:
            readings[counts == attrs["_FillValue"]] = np.nan
        readings = readings * float(attrs.get("scale_factor", 1.0)) + float(attrs.get("add_offset", 0.0))
        if not np.isfinite(readings).any():
            return [Fault(where, "radius", "holds no reading")]
        middle, wanted = float(np.nanmedian(readings)), self.raw.header.pipe.outside_diameter_m / 2
        if 0.5 * wanted < middle < 1.3 * wanted:
            return []
        rule = f"median {middle:.4g}, the pipe's outer radius is {wanted:.4g} m"
        guess = [name for name, f in (("mm", 1000.0), ("inch", 1 / 0.0254), ("cm", 100.0)) if 0.5 < middle / f / wanted < 1.3]
        return [
            Fault(
                where, "radius", rule, f"it looks like {guess[0]}; give metre" if guess else "check scale_factor and add_offset"
            )
        ]
