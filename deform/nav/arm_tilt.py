"""The caliper's arms and attitudes of the tool in, the direction of the pipe in the tool per epoch out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_arms
from deform.nav._kernels_state import BANDS
from deform.nav.strapdown import Epochs
from deform.run.raw import RawRun
from deform.run.stamps import usual_step

Floats = NDArray[np.float64]
SCANS_PER_SECOND = 20.0
BLOCK = 100_000
LARGEST_RAD = 0.03
LEAST_LEVER_M = 0.1
LONG_M = 100.0  # waves longer than this are believed by a share of their own
BRIDGED_M = 10.0  # length without scans, or in a bend, over which the tilt is interpolated


def ring_centres(raw: RawRun) -> tuple[Floats, Floats] | None:
    """Return times (s) and slope of the pipe's centre along the tool, right and up in its axes (radian); None without arms.

    Notes
    -----
    At a place y along the tool the arms see the centre of the pipe at offset(y) from the tool's axis. Two rings give the slope
    between them. One ring at y gives offset / y, as if the tool turned about the inertial unit: true but for the tool's own
    sideways play, whence the filter estimates which share of it to believe (block ``tilt`` of the error model).

    References
    ----------
    Porter (1990), section 2.2 (tool-to-pipe attitude from two rings).
    """
    if raw.arms is None or raw.header.caliper is None:
        return None
    radius, places = raw.arms["radius"], raw.header.caliper.ring_offset_m
    levers = np.array(places, float)
    if "ring" in radius.dims and np.ptp(levers) > LEAST_LEVER_M:
        rings = [int(np.argmax(levers)), int(np.argmin(levers))]
        base = levers[rings[0]] - levers[rings[1]]
    elif abs(levers[0]) > LEAST_LEVER_M:
        rings, base = [0], levers[0]
    else:
        return None
    time = raw.arms["time"].values
    if time.size < 10:
        return None
    step = max(1, int(1.0 / (SCANS_PER_SECOND * usual_step(time))))
    centres = [_centres(raw, ring if "ring" in radius.dims else None, step) for ring in rings]
    slope = (centres[0] - centres[1] if len(centres) > 1 else centres[0]) / base
    return time[::step], slope


def _centres(raw: RawRun, ring: int | None, step: int) -> Floats:
    radius = raw.arms["radius"]  # type: ignore[index]  # asked before
    scale, offset = float(radius.attrs.get("scale_factor", 1.0)), float(radius.attrs.get("add_offset", 0.0))
    fill = float(radius.attrs.get("_FillValue", np.nan))
    angle = raw.arms["arm_angle"].values.astype(float)  # type: ignore[index]  # the caller has arms
    n = radius.sizes["scan"]
    out = np.empty((-(-n // step), 2))
    for first in range(0, n, BLOCK * step):
        part = radius.isel(scan=slice(first, min(first + BLOCK * step, n)))
        part = part if ring is None else part.isel(ring=ring)
        counts = np.ascontiguousarray(part.transpose("scan", "arm").values[::step], float)
        _kernels_arms.ring_centres(counts, scale, offset, fill, angle, out[first // step : first // step + len(counts)])
    return out


def tilt_per_epoch(epochs: Epochs, attitudes: Floats, time: Floats, slope: Floats, stationary: NDArray[np.bool_]) -> Floats:
    """Return the direction of the pipe against the tool's axis, to the right and up in the level frame (radian), in wave bands.

    Parameters
    ----------
    attitudes : (bound, 3, 3) body to east, north, up.
    time, slope : from `ring_centres`.

    Returns
    -------
    (epoch, 4) : right and up of waves longer than about `LONG_M`, then of the shorter ones.

    Notes
    -----
    The median over the motion is taken off: a constant one is sag or mounting, which the filter has as states. Over epochs in
    which the tool turns fast (bends, where the chord leaves the tangent) or without scans it is interpolated where they are
    short, and zero else. What is true of the tilt and what is the tool's shift differs from wave to wave: the filter finds a
    share for each band.
    """
    n = len(epochs.table)
    epoch = np.clip(np.searchsorted(epochs.time, time, side="right") - 1, 0, n - 1)
    good = np.isfinite(slope).all(axis=1) & (time >= epochs.time[0]) & (time <= epochs.time[-1])
    count = np.bincount(epoch[good], minlength=n).astype(float)
    mean = np.column_stack([np.bincount(epoch[good], slope[good, i], n) for i in range(2)])
    mean = mean / np.maximum(count, 1.0)[:, None]
    roll = np.arctan2(-attitudes[:-1, 2, 0], attitudes[:-1, 2, 2])
    sine, cosine = np.sin(roll), np.cos(roll)
    level = np.column_stack([cosine * mean[:, 0] + sine * mean[:, 1], -sine * mean[:, 0] + cosine * mean[:, 1]])
    turn = np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", attitudes[1:, :, 1], attitudes[:-1, :, 1]), -1.0, 1.0)))
    use = (count >= 3) & ~stationary & (turn < 1.0)
    if use.sum() < 50:
        return np.zeros((n, 2 * BANDS))
    level -= np.median(level[use], axis=0)
    use &= np.abs(level).max(axis=1) < LARGEST_RAD
    travel = np.concatenate([[0.0], np.cumsum(np.abs(epochs.travel))])
    middle = 0.5 * (travel[1:] + travel[:-1])
    known = middle[use]
    after = np.clip(np.searchsorted(known, middle), 1, known.size - 1)
    near = (known[after] - known[after - 1] < BRIDGED_M) | use
    level = np.column_stack([np.where(near, np.interp(middle, known, level[use, i]), 0.0) for i in range(2)])
    long = level
    for _ in range(2):
        long = _mean_over(long, travel, 0.5 * LONG_M)
    return np.column_stack([long, level - long])


def _mean_over(values: Floats, travel: Floats, reach: float) -> Floats:
    """Mean of values (epoch, k) over the way from ``reach`` before to ``reach`` behind the middle of each epoch."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values * np.diff(travel)[:, None], axis=0)])
    middle = 0.5 * (travel[1:] + travel[:-1])
    low, high = np.maximum(middle - reach, travel[0]), np.minimum(middle + reach, travel[-1])
    rising = travel + 1e-9 * np.arange(travel.size)  # a tool at rest stays where it is
    sums = [np.interp(high, rising, total[:, i]) - np.interp(low, rising, total[:, i]) for i in range(values.shape[1])]
    return np.column_stack(sums) / np.maximum(high - low, 1e-6)[:, None]
