"""A raw run and its trajectory in; welds, sections, wall, tool pose, dents and features out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from deform.caliper import ovality
from deform.caliper.arms import examine_arms
from deform.caliper.cross_section import Limits, Records, ScanLog, log_scans, section_fitters
from deform.caliper.dents import beside_welds, candidates, limits, measure_dents
from deform.caliper.features import features
from deform.caliper.joints import joint_walls, name_joints
from deform.caliper.scan_clock import ClockError, clock_error
from deform.caliper.scans import SEGMENT, ScanBlock, ScanReader
from deform.caliper.tool_pose import pose
from deform.caliper.wall import WallMap, detail_maps, relieve, wall_dataset
from deform.caliper.weld_channels import Channel, accelerometer_channel, arms_channel, detector_channel
from deform.caliper.welds import weld_log
from deform.caliper.wrinkles import wrinkles
from deform.geometry.harmonics import HarmonicFitter
from deform.options import CaliperOptions
from deform.run.raw import RawRun

logger = logging.getLogger(__name__)

_REFUSED_M = 0.1  # shorter stretches without a section are not worth a word


@dataclass(frozen=True)
class Measurement:
    """What the caliper room has to say about one run; all but the welds are None without a caliper.

    Attributes
    ----------
    welds : group ``welds``: the weld log.
    sections : group ``sections``: ovality and diameters on regular chainage.
    wall : group ``caliper``: radius on chainage × clock.
    pose : group ``pose``: the tool's offset in the pipe, with two rings its pitch and yaw.
    dents : group ``dents``.
    features : group ``features``.
    """

    welds: xr.Dataset
    sections: xr.Dataset | None = None
    wall: xr.Dataset | None = None
    pose: xr.Dataset | None = None
    dents: xr.Dataset | None = None
    features: xr.Dataset | None = None


def measure(
    raw: RawRun, trajectory: xr.Dataset, options: CaliperOptions | None = None, progress: Callable[[float], None] | None = None
) -> Measurement:
    """Measure the wall and the joints of one run.

    Parameters
    ----------
    raw : the raw run; its arms are read in blocks.
    trajectory : group ``trajectory`` (dim time): chainage and roll of the tool.
    options : see `CaliperOptions`.
    progress : called with the fraction done.

    Returns
    -------
    Measurement
        Without a caliper only the welds, from detector and accelerometers.

    Raises
    ------
    InputError
        When the arms cannot be used, with every fault found.
    """
    options = options or CaliperOptions()
    tell = progress or (lambda _: None)
    heard = [detector_channel(raw, trajectory), accelerometer_channel(raw, trajectory)]
    joint = raw.header.pipe.nominal_joint_m
    if raw.arms is None or raw.header.caliper is None:
        welds = weld_log([c for c in heard if c is not None], trajectory, options.weld_cluster_m, joint)
        return Measurement(welds=name_joints(welds, None, joint, float(trajectory["chainage"].max())))
    tell(0.05)
    reader = ScanReader(raw, trajectory, options.block_scans)
    state = examine_arms(reader, raw.header.caliper.noise_m or 3e-4, options.largest_lost_arms)
    reader.calibrate(state.offset, state.dead)
    sigma, diameter = float(state.sigma.max()), raw.header.pipe.outside_diameter_m
    least = options.least_dent_depth_od * diameter
    limit = limits(sigma, least)
    fitters = section_fitters(reader, state.sigma, options.largest_lost_arms)
    coarse, logs, arms = _scanned(reader, fitters, limit, options, [c for c in heard if c is not None], trajectory, tell)
    _tell_lost(reader, logs)
    found = candidates(reader, logs, limit.dip)
    dents, fits = measure_dents(reader, logs, found, sigma, diameter, least)
    ripples = wrinkles(reader, logs, found, sigma, diameter)
    relieve(reader, logs, fitters, fits)
    section = ovality.sections(reader, logs, diameter, options.wall_step_m, options.section_window_m, options.ovality_definition)
    tool = pose(reader, logs)
    spans = np.array([(f.centre - 0.6 * f.length, f.centre + 0.6 * f.length) for f in fits]).reshape(-1, 2)
    tell(0.85)
    seen = [c.without(spans) for c in arms]
    welds = weld_log([c for c in (heard[0], *seen, heard[1]) if c is not None], trajectory, options.weld_cluster_m, joint)
    welds, wall_sigma = joint_walls(welds, reader, logs, diameter)
    dents = beside_welds(dents, welds, ripples)
    known = features(welds, wall_sigma, section, reader, logs, ripples, trajectory, diameter, sigma)
    welds = name_joints(welds, known, joint, reader.span()[1])
    windows = _joined([(a - options.detail_margin_m, b + options.detail_margin_m) for a, b in spans])
    fine = detail_maps(reader, logs, fitters, windows, fits, options.detail_step_m, coarse.bins)
    wall = wall_dataset(coarse, fine, options.detail_step_m, section, tool)
    tell(1.0)
    return Measurement(welds=welds, sections=section, wall=wall, pose=tool, dents=dents, features=known)


def on_chainage(measurement: Measurement, chainage: np.ndarray) -> xr.Dataset | None:
    """Ovality and least, mean and greatest diameter with sigma at places (m); None without a caliper.

    Returns
    -------
    Dataset on ``chainage`` with ``ovality``, ``diameter_min``, ``diameter_max``, ``diameter_mean`` and their ``_sigma``; NaN
    further than a metre from any measured section. Attribute ``definition`` says which ovality it is.
    """
    return None if measurement.sections is None else ovality.on_chainage(measurement.sections, chainage)


def _scanned(
    reader: ScanReader,
    fitters: list[HarmonicFitter],
    limit: Limits,
    options: CaliperOptions,
    heard: list[Channel],
    trajectory: xr.Dataset,
    tell: Callable[[float], None],
) -> tuple[WallMap, list[ScanLog], list[Channel]]:
    """The pass over all scans and the welds that each ring saw; a second one where the scan clock had to be put right."""
    error: ClockError | None = None
    while True:
        coarse, logs = _log_and_map(reader, fitters, limit, options, tell)
        arms = [c for c in (arms_channel(reader, log) for log in logs) if c is not None]
        if error is not None or not arms:
            return coarse, logs, arms
        error = clock_error(arms[0], heard, trajectory, reader.sign)
        if error is None:
            return coarse, logs, arms
        logger.warning(
            "%s: by %d welds the scan clock runs %.1f ppm fast, is %.3f s late in the middle of the run, and the rings stand "
            "%.3f m off their place; put right",
            reader.raw.id,
            error.pairs,
            error.rate * 1e6,
            error.late,
            error.ahead,
        )
        reader.correct_clock(error)


def _log_and_map(
    reader: ScanReader, fitters: list[HarmonicFitter], limit: Limits, options: CaliperOptions, tell: Callable[[float], None]
) -> tuple[WallMap, list[ScanLog]]:
    """One pass over all scans: what is kept of every scan, and the coarse wall."""
    start, stop = reader.span()
    bins = max(options.clock_bins, reader.angle_rad.shape[1])
    step = options.wall_step_m
    coarse = WallMap(np.floor(start / step) * step - 0.5 * step, stop + step, step, bins)

    def each(blocks: list[ScanBlock], found: list[Records]) -> None:
        for ring, (block, records) in enumerate(zip(blocks, found, strict=True)):
            coarse.add(reader, ring, block, records.right, records.up, records.good)
        coarse.settle(float(blocks[0].chainage[-1]))
        tell(0.05 + 0.75 * (blocks[0].start + blocks[0].time.size) / reader.scans)

    return coarse, log_scans(reader, fitters, limit, each)


def _tell_lost(reader: ScanReader, logs: list[ScanLog]) -> None:
    """Say where sections were refused because too many arms were lost, and which arms stood still where."""
    for log in logs:
        lost = np.flatnonzero(~np.isfinite(log.radius))
        lost = lost[reader.moving(reader.time[lost])]
        if lost.size:
            groups = np.split(lost, np.flatnonzero(np.diff(lost) > 5) + 1)
            ends = [np.sort(reader.chainage(reader.time[g[[0, -1]]], log.ring)) for g in groups]
            long = [f"{a:.1f} to {b:.1f} m" for a, b in ends if b - a > _REFUSED_M]
            if long:
                more = f" and {len(long) - 5} more" if len(long) > 5 else ""
                logger.warning("%s: too many arms lost for a section at %s%s", reader.raw.id, ", ".join(long[:5]), more)
        for arm in np.flatnonzero(reader.stuck[log.ring].any(axis=0)):
            segments = np.flatnonzero(reader.stuck[log.ring, :, arm])
            scans = np.array([segments[0] * SEGMENT, min((segments[-1] + 1) * SEGMENT, reader.scans) - 1])
            place = np.sort(reader.chainage(reader.time[scans], log.ring))
            where = f"ring {log.ring + 1} arm at {np.degrees(reader.angle_rad[log.ring, arm]):.0f} degree"
            logger.warning(
                "%s: caliper %s stood still between %.1f and %.1f m: dropped there", reader.raw.id, where, place[0], place[1]
            )


def _joined(windows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Windows that overlap become one."""
    joined: list[tuple[float, float]] = []
    for start, stop in sorted(windows):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((start, stop))
    return joined
