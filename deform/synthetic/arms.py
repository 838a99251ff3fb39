"""A motion, joints and dents in, what the caliper's arms measure and what the weld detector fires out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.options import ToolOptions
from deform.synthetic import _kernels
from deform.synthetic._kernels import ABOVE, RIGHT, ROLL, TILT, YAW
from deform.synthetic.motion import Motion
from deform.synthetic.route import Line, stream

Floats = NDArray[Any]

BLOCK = 50_000  # scans
FILL = 65535
PACKING_M = 1e-4


def scans(
    motion: Motion,
    dents: pd.DataFrame,
    tool: ToolOptions,
    seed: int,
    name: str,
    mirrored: bool,
    fittings: pd.DataFrame | None = None,
) -> Iterator[tuple[Floats, NDArray[np.uint16]]]:
    """Yield blocks of time (n,) and packed ranges (n, ring, arm), `FILL` where an arm gave nothing.

    Parameters
    ----------
    motion : the tool in the line as it lies in the direction of travel.
    dents : of this run, chainage and clock looking downstream of the line.
    tool : its arms, rings, noise, drop-outs and dead arms.
    mirrored : true for an upstream run: the clock in the direction of travel is the mirror image.
    fittings : tees and wrinkles, as the dents.
    """
    rng = stream(seed, name, "arms")
    total = int(motion.duration * tool.caliper_rate_hz + 1e-6) + 1
    angles = arm_angles(tool)
    joints, table = wall_table(motion.line), dent_table(dents, fittings, motion.line, mirrored)
    for first in range(0, total, BLOCK):
        time = np.arange(first, min(first + BLOCK, total)) / tool.caliper_rate_hz
        packed = np.empty((time.size, len(tool.ring_offset_m), tool.arms), np.uint16)
        distance, _ = motion.distance(time)
        at_imu = [motion.line.at(distance, column)[:, 0] for column in (ROLL, YAW, TILT, RIGHT, ABOVE)]
        poses = np.ascontiguousarray(np.stack(at_imu, axis=1))
        for ring, offset in enumerate(tool.ring_offset_m):
            noise = rng.normal(0.0, tool.arm_noise_m, (time.size, tool.arms))
            ranges = np.empty_like(noise)
            places = np.clip(distance + offset, 0.0, motion.line.length)
            _kernels.arm_ranges(places, poses, angles, float(offset), joints, table, noise, ranges)
            packed[:, ring] = np.round(ranges / PACKING_M).clip(0, FILL - 1)
            packed[:, ring][_lost(time.size, tool, rng)] = FILL
        yield time, packed


def arm_angles(tool: ToolOptions) -> Floats:
    """Return the angles of the arms in the tool's cross-section (radian, clockwise looking in the direction of travel)."""
    return 2 * np.pi * np.arange(tool.arms) / tool.arms


def wall_table(line: Line) -> Floats:
    """Return one row per joint: start, inner radius, ovality as amplitude of the radius, its clock, bead height, recess."""
    joints = line.joints
    table = np.zeros((len(joints), 6))
    table[:, 0] = joints.start_m
    table[:, 1] = 0.5 * line.outside_diameter - joints.wall_m
    table[:, 2] = 0.25 * joints.ovality * line.outside_diameter
    table[:, 3] = joints.ovality_clock
    table[:, 4] = joints.bead_m
    table[:, 5] = joints.recess_m
    return table


def dent_table(dents: pd.DataFrame, fittings: pd.DataFrame | None, line: Line, mirrored: bool) -> Floats:
    """Return one row per dent, tee and wrinkle in the direction of travel, sorted, as `_kernels.intrusion` takes them.

    Chainage, clock, depth, half length, half width (angle), sharpness, kind. A wrinkle reaches 60° to either side.
    """
    columns = [dents.chainage_m, dents.clock_deg, dents.depth_m, 0.5 * dents.length_m, dents.width_m / line.outside_diameter]
    rows = np.column_stack([*columns, dents.sharpness, np.zeros(len(dents))]).astype(float)
    if fittings is not None and len(fittings):
        wrinkle = (fittings.kind == "wrinkle").to_numpy()
        half_width = np.where(wrinkle, np.radians(60.0), fittings.length_m / line.outside_diameter)
        columns = [fittings.chainage_m, fittings.clock_deg, fittings.height_m, 0.5 * fittings.length_m]
        more = np.column_stack([*columns, half_width, np.zeros(len(fittings)), 1.0 + wrinkle]).astype(float)
        rows = np.vstack([rows, more])
    rows[:, 1] = np.radians(-rows[:, 1] if mirrored else rows[:, 1])
    if mirrored:
        rows[:, 0] = line.length - rows[:, 0]
    return np.ascontiguousarray(rows[np.argsort(rows[:, 0])])


def detect_welds(motion: Motion, tool: ToolOptions, seed: int, name: str) -> tuple[pd.DataFrame, Floats, NDArray[np.bool_]]:
    """Return the detector's events, the true passage of each weld (NaN where there is none), and which were detected."""
    rng = stream(seed, name, "welds")
    true = motion.passage(motion.line.joints.start_m.to_numpy()[1:])
    seen = np.isfinite(true) & (rng.random(true.size) >= tool.weld_miss)
    false = rng.uniform(motion.begin, motion.end, int(rng.poisson(tool.weld_false * true.size)))
    heard = true[seen] + rng.normal(0.0, tool.weld_jitter_s, int(seen.sum()))
    time = np.concatenate([heard, false])
    strength = np.concatenate([rng.lognormal(0.0, 0.25, heard.size), rng.lognormal(-0.4, 0.3, false.size)])
    events = pd.DataFrame({"time_s": time, "amplitude": strength})
    return events.sort_values("time_s").reset_index(drop=True), true, seen


def _lost(count: int, tool: ToolOptions, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Arms that gave nothing: short drop-outs of single arms, and the dead ones."""
    lost = np.zeros((count, tool.arms), bool)
    length = 8
    for start, arm in zip(*np.nonzero(rng.random((count // length + 1, tool.arms)) < tool.arm_dropout), strict=True):
        lost[start * length : (start + 1) * length, arm] = True
    lost[:, list(tool.dead_arms)] = True
    return lost
