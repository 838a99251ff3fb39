"""Scan records of one or two rings in, the tool's offset in the pipe out; with two rings also its pitch and yaw."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.caliper.cross_section import ScanLog
from deform.caliper.scans import ScanReader
from deform.run import build


def pose(reader: ScanReader, logs: list[ScanLog], window_s: float = 0.1) -> xr.Dataset:
    """Return group ``pose`` at a step of ``window_s``: where the tool's axis is in the pipe.

    Parameters
    ----------
    reader : gives chainage and the rings' places along the tool.
    logs : scan log of each ring; all rings are scanned at the same times.
    window_s : scans within this time (s) are averaged.

    Notes
    -----
    A ring sees the centre of the pipe at (right, up) from the tool axis, so the axis is at minus that in the pipe. From
    one ring the offset at its place is all there is. Two rings at y1 > y2 along the body give the slope of the axis
    against the pipe's chord between them, d offset / d y; it is turned to look downstream for a run made upstream.
    Attribute ``ring_offset_m`` is the place of the foremost ring, to which the offset refers, ``ring_base_m`` how far the
    hindmost is behind it. The pitch and yaw are against
    the chord of the pipe between the rings: in a bend of curvature k the chord leaves the tangent at the IMU by
    k (y1 + y2) / 2.

    References
    ----------
    Porter 1990, section 1 and 2.2: two rings yield the pig-to-pipe translation and attitude corrections.
    """
    fore = int(np.argmax(reader.ring_offset))
    grid, offsets = _averaged(reader, logs, window_s)
    right, up, sigma = offsets[fore]
    values = {
        "time": grid,
        "chainage": reader.chainage(grid, fore) - reader.sign * reader.ring_offset[fore],
        "offset_right": -right,
        "offset_up": -up,
        "offset_right_sigma": sigma,
        "offset_up_sigma": sigma,
    }
    if len(logs) > 1:
        aft = int(np.argmin(reader.ring_offset))
        base = reader.ring_offset[fore] - reader.ring_offset[aft]
        right_aft, up_aft, sigma_aft = offsets[aft]
        angle_sigma = np.degrees(np.hypot(sigma, sigma_aft) / base)
        values["yaw"] = np.degrees(np.arctan2(reader.sign * (right_aft - right), base))
        values["pitch"] = np.degrees(np.arctan2(reader.sign * (up_aft - up), base))
        values["yaw_sigma"] = values["pitch_sigma"] = angle_sigma
    result = build.dataset("pose", values, ring_offset_m=float(reader.ring_offset[fore]))
    if len(logs) > 1:
        result.attrs["ring_base_m"] = float(base)
    return result.assign_coords(
        ring_chainage=("time", reader.chainage(grid, fore), {"units": "m", "long_name": "chainage of the ring"})
    )


def _averaged(reader: ScanReader, logs: list[ScanLog], window: float):
    """Mean centre of each ring in windows of time where all rings have a section, and its sigma."""
    begin = reader.time[0] if reader.scans else 0.0
    cells = int((reader.time[-1] - begin) / window) + 1 if reader.scans else 0
    count, total = np.zeros(cells), np.zeros(cells)
    sums = np.zeros((len(logs), 3, cells))
    for part, _ in logs[0].pieces(reader):
        there = np.logical_and.reduce([np.isfinite(log.radius[part]) for log in logs])
        if not there.any():
            continue
        time = reader.time[part][there]
        cell = ((time - begin) / window).astype(np.int64)
        own = slice(cell[0], cell[-1] + 1)  # the clock rises
        cell -= cell[0]
        count[own] += np.bincount(cell)
        total[own] += np.bincount(cell, time)
        for k, log in enumerate(logs):
            right, up, sigma = (getattr(log, n)[part][there].astype(float) for n in ("right", "up", "sigma"))
            for j, value in enumerate((right, up, 2.0 * sigma**2)):
                sums[k, j, own] += np.bincount(cell, value)
    use = count > 0
    count = count[use]
    offsets = [(right[use] / count, up[use] / count, np.sqrt(square[use]) / count) for right, up, square in sums]
    return total[use] / count, offsets
