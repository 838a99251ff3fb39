"""Attitude and path of the IMU in, the direction of the pipe under it with the sigma of direction and of its turns out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from deform.geometry.earth import radii
from deform.geometry.resample import MAD_TO_SIGMA, box_average, interpolate
from deform.geometry.rotation import attitude_to_matrix
from deform.nav import _kernels_path
from deform.nav.gaps import Unseen
from deform.nav.wobble import Wobble, WobbleModel, gyro_walk, turn_sigma
from deform.nav.wobble_fit import fit_departure
from deform.run.raw import RunHeader

Floats = NDArray[Any]
_log = logging.getLogger(__name__)

_NODE_M = 0.5  # spacing of the nodes at which the wobble is estimated; it is longer than metres
_BLOCK_M = 20.0  # length over which the constant misalignments are averaged before they are adjusted
_RING_SIGMA_M = (
    4e-4  # of the tool's offset at a ring at one node: roundness of the pipe lasts over metres, the arms' noise does not
)
_LEAST_SHIFT_M = 5e-5  # of the path at one node
_NEAR_S, _THROUGHOUT = 1.0, 0.99
_CUPS_OD = 3.0  # usual distance of the tool's supports in outside diameters
_PRIOR_RAD = math.radians(0.5)  # misalignment and sag expected of a tool

TURN_LAGS_M = np.array([0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0])


@dataclass(frozen=True)
class PipeDirection:
    """Direction of the pipe on a grid, looking in the direction of travel (degree).

    Attributes
    ----------
    azimuth, pitch : shape (n,).
    azimuth_sigma, pitch_sigma : of the direction itself.
    unseen : stretches in which the inertial unit recorded nothing.
    turn_sigma : (2, lag) sigma of the turn between two places `TURN_LAGS_M` apart, horizontal (times cos pitch) and vertical.
    mounting : (right, up) of the pipe's direction in the body frame (degree): constant misalignment of the IMU.
    sag : (right, up) in the level frame (degree): how the tool lies in the pipe on the mean.
    """

    azimuth: Floats
    pitch: Floats
    azimuth_sigma: Floats
    pitch_sigma: Floats
    turn_sigma: Floats
    unseen: Unseen
    mounting: tuple[float, float]
    sag: tuple[float, float]


def direction_along(
    trajectory: xr.Dataset, travel: Floats, grid: Floats, header: RunHeader, pose: xr.Dataset | None = None
) -> PipeDirection:
    """Return the direction of the pipe on a grid.

    Parameters
    ----------
    trajectory : group ``trajectory``, only the samples that advance.
    travel : metre along the pipe of these samples, rising strictly.
    grid : metre along the pipe, regular and rising, within ``travel``.
    header : figures of the IMU.
    pose : group ``pose`` of the caliper, or None.

    Notes
    -----
    The attitude is that of the tool: the pipe's direction, a constant misalignment that rolls with the tool, and the wobble of
    the tool in the pipe. The path of the IMU follows the pipe but for the tool's small shift. Attitude minus path, summed
    along the pipe, is therefore the integral of the wobble and of the error of the velocity, measured with the shift as noise.
    In it the pipe cancels: bends leave no trace, and nothing needs to be known about the pipe. A Kalman smoother finds the
    wobble; attitude minus wobble is the pipe. Waves that are shorter than the wobble keep the resolution of the gyros.
    The spectra that tune it are fitted to the run itself (`deform.nav.wobble_fit`), and narrow lines in them get states of their
    own (`deform.nav.tones`).

    A ring of arms at y along the tool sees the tool's shift plus y times the wobble against the pipe there; it halves what the
    path alone leaves in waves of hundreds of metres, where the tilt of the gyros bends the path.

    Two rings see the wobble itself (Porter 1990, section 1), and to a thousandth of a degree: it is taken off, and the path is
    not asked, for the tool's shift would slope it by more.
    """
    azimuth, pitch, roll = (np.radians(trajectory[a].values) for a in ("azimuth", "pitch", "roll"))
    azimuth, pitch = _turned(azimuth, pitch, roll, (0.0, 0.0))
    unseen = Unseen.of(trajectory["time"].values, travel, azimuth, pitch)
    known = "latitude" in trajectory and travel.size > 10
    mounting, sag = (0.0, 0.0), (0.0, 0.0)
    zero = np.zeros(grid.size)
    wobble = [Wobble.absent(grid.size, TURN_LAGS_M.size)] * 2
    if known:
        apart = unseen.bridged(travel, _apart(trajectory, azimuth, pitch))
        mounting, sag = _constants(travel, apart, roll)
        azimuth, pitch = _turned(azimuth, pitch, roll, mounting)
        apart = (
            unseen.bridged(travel, _apart(trajectory, azimuth, pitch))
            - np.array(sag) * np.diff(travel, prepend=travel[0])[:, None]
        )
    step = float(grid[1] - grid[0])
    tool = azimuth, pitch
    azimuth, pitch = _on_grid(grid, travel, azimuth, step), _on_grid(grid, travel, pitch, step)
    if known and pose is not None and _two_rings_throughout(pose, trajectory["time"].values):
        turned = np.stack([azimuth * np.cos(pitch), pitch])
        seen, sigma = _between_rings(trajectory, travel, grid, turned, pose, header.travel_sign)
        azimuth, pitch = tool[0] - seen[:, 0] / np.maximum(np.cos(tool[1]), 1e-3), tool[1] - seen[:, 1]
        azimuth, pitch = _on_grid(grid, travel, azimuth, step), _on_grid(grid, travel, pitch, step)
        walk = gyro_walk(header.imu, float(np.median(trajectory["speed"].values)))
        turn = np.sqrt(2.0 * sigma**2 + walk * TURN_LAGS_M)
        wobble = [Wobble(zero, zero + sigma, turn)] * 2  # it is taken off already
    elif known:
        turned = np.stack([azimuth * np.cos(pitch), pitch])
        ring = None if pose is None else _ring(trajectory, travel, grid, turned, pose, header.travel_sign)
        wobble = _wobble(trajectory, travel, apart, grid, turned, header, ring)
    level = np.maximum(np.cos(pitch), 1e-3)
    error = [
        interpolate(grid, travel, trajectory[f"{a}_sigma"].values) if f"{a}_sigma" in trajectory else zero
        for a in ("azimuth", "pitch")
    ]
    hidden = np.degrees(np.sqrt(unseen.variances(grid)[0]))
    return PipeDirection(
        np.degrees(azimuth - (wobble[0].value + sag[0]) / level) % 360.0,
        np.degrees(pitch - wobble[1].value - sag[1]),
        np.hypot(np.hypot(error[0], np.degrees(wobble[0].sigma) / level), hidden / level),
        np.hypot(np.hypot(error[1], np.degrees(wobble[1].sigma)), hidden),
        np.degrees(np.stack([w.turn_sigma for w in wobble])),
        unseen,
        (math.degrees(mounting[0]), math.degrees(mounting[1])),
        (math.degrees(sag[0]), math.degrees(sag[1])),
    )


def _turned(azimuth: Floats, pitch: Floats, roll: Floats, mounting: tuple[float, float]) -> tuple[Floats, Floats]:
    """Azimuth (unwrapped) and pitch of the direction that lies ``mounting`` (right, up) beside the body's forward axis."""
    if mounting != (0.0, 0.0):
        axis = np.array([math.tan(mounting[0]), 1.0, math.tan(mounting[1])])
        along = attitude_to_matrix(np.degrees(azimuth), np.degrees(pitch), np.degrees(roll)) @ axis
        azimuth = np.arctan2(along[:, 0], along[:, 1])
        pitch = np.arctan2(along[:, 2], np.hypot(along[:, 0], along[:, 1]))
    return np.unwrap(azimuth), pitch


def _apart(trajectory: xr.Dataset, azimuth: Floats, pitch: Floats) -> Floats:
    """What the path falls short of the attitude between successive samples, to the right and up (metre); shape (n, 2)."""
    latitude, height = trajectory["latitude"].values, trajectory["height"].values
    meridian, normal = radii(latitude)
    north = np.radians(np.diff(latitude)) * (meridian + height)[1:]
    east = np.radians(np.diff(trajectory["longitude"].values)) * ((normal + height) * np.cos(np.radians(latitude)))[1:]
    a, p = 0.5 * (azimuth[1:] + azimuth[:-1]), 0.5 * (pitch[1:] + pitch[:-1])
    right = east * np.cos(a) - north * np.sin(a)
    up = np.diff(height) * np.cos(p) - (east * np.sin(a) + north * np.cos(a)) * np.sin(p)
    return np.concatenate([np.zeros((1, 2)), -np.stack([right, up], axis=1)])


def _constants(travel: Floats, apart: Floats, roll: Floats) -> tuple[tuple[float, float], tuple[float, float]]:
    """Mounting (right, up in the body) and sag (right, up, level) by a robust adjustment of block means (radian)."""
    block = ((travel - travel[0]) / _BLOCK_M).astype(np.int64)
    length = np.maximum(np.bincount(block, np.diff(travel, prepend=travel[0])), 1e-6)
    use = length > 0.5 * _BLOCK_M
    if use.sum() < 3:
        use = length > 0
    means = [(np.bincount(block, apart[:, i]) / length)[use] for i in range(2)]
    weight = np.diff(travel, prepend=travel[0])
    c, s = ((np.bincount(block, weight * f(roll)) / length)[use] for f in (np.cos, np.sin))
    zero, one = np.zeros(c.size), np.ones(c.size)
    A = np.vstack([np.stack([-c, -s, one, zero], axis=1), np.stack([s, -c, zero, one], axis=1)])
    y = np.concatenate(means)
    x = np.zeros(4)
    prior = np.eye(4) / _PRIOR_RAD**2
    for _ in range(10):
        residual = y - A @ x
        sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-7)
        w = np.minimum(1.0, 1.5 * sigma / np.maximum(np.abs(residual), 1e-12)) / sigma**2
        x = np.linalg.solve(A.T @ (w[:, None] * A) + prior, A.T @ (w * y))
    return (float(x[0]), float(x[1])), (float(x[2]), float(x[3]))


def _ring(
    trajectory: xr.Dataset, travel: Floats, grid: Floats, direction: Floats, pose: xr.Dataset, sign: int
) -> tuple[float, Floats]:
    """Place of the ring along the tool, and what it sees at the samples: shift plus place times wobble (metre), shape (n, 2).

    The pipe's own bend between ring and IMU is taken out by the share of it that the run shows (a rigid tool shows all of it,
    one that is hinged or flexible less), and so is what is constant in the body and in the level frame: the calibration of the
    arms, and how the tool hangs.
    """
    lever = float(pose.attrs.get("ring_offset_m", 0.0))
    time, at = pose["time"].values, trajectory["time"].values
    seen = np.stack(
        [interpolate(at, time, sign * pose["offset_right"].values), interpolate(at, time, pose["offset_up"].values)], axis=1
    )
    for i in range(2):
        bend = _bend(lever, travel, grid, direction[i])
        seen[:, i] -= _share(seen[:, i], bend) * bend
    return lever, _without_constants(seen, travel, np.radians(trajectory["roll"].values))


def _two_rings_throughout(pose: xr.Dataset, at: Floats) -> bool:
    """Whether two rings tell the angle within a second of nearly every sample; a wobble bridged over gaps is a guess."""
    if "yaw" not in pose or pose.sizes["time"] < 100:
        return False
    time = pose["time"].values
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    apart = np.minimum(np.abs(at - time[after - 1]), np.abs(time[after] - at))
    return bool(np.mean(apart < _NEAR_S) > _THROUGHOUT)


def _between_rings(
    trajectory: xr.Dataset, travel: Floats, grid: Floats, direction: Floats, pose: xr.Dataset, sign: int
) -> tuple[Floats, float]:
    """Wobble as two rings see it at the samples, to the right and up, shape (n, 2), and its sigma (radian).

    The angle is against the chord of the pipe between the rings. The chord's share is taken out as for one ring; waves shorter
    than the rings are apart are none of a stiff tool, and are left to the gyros.
    """
    lever, base = (float(pose.attrs[name]) for name in ("ring_offset_m", "ring_base_m"))
    time, at = pose["time"].values, trajectory["time"].values
    inside = np.clip(at, time[0], time[-1])
    seen = np.stack([np.interp(inside, time, np.radians(pose["yaw"].values)),
                     np.interp(inside, time, sign * np.radians(pose["pitch"].values))], axis=1)  # fmt: skip
    against_chord, pipe = seen, direction
    for _ in range(2):  # at first the pipe's direction is known but for the wobble
        seen = against_chord.copy()
        for i in range(2):
            chord = (_bend(lever, travel, grid, pipe[i]) - _bend(lever - base, travel, grid, pipe[i])) / base
            seen[:, i] -= _share(seen[:, i], chord) * chord
        pipe = direction - np.stack([np.interp(grid, travel, seen[:, i]) for i in range(2)])
    seen = _without_constants(seen, travel, np.radians(trajectory["roll"].values))
    cells = max(1.0, base * time.size / float(travel[-1] - travel[0]))
    smooth = _parabolic_mean(travel, seen, base)
    noise = math.radians(float(pose["yaw_sigma"].median())) * math.sqrt(25.0 / 18.0 / cells)
    lost = MAD_TO_SIGMA * float(np.median(np.abs(smooth - _parabolic_mean(travel, smooth, base))))  # of the wobble itself
    return smooth, math.hypot(noise, lost)


def _parabolic_mean(travel: Floats, values: Floats, length: float) -> Floats:
    """Running mean over some two lengths that leaves parabolas as they are; it has 25 / 18 of the variance of a mean of one."""
    narrow, wide = (box_average(travel, travel, values, size) for size in (length, 2.0 * length))
    mean = (4.0 * narrow - wide) / 3.0
    return np.where(np.isfinite(mean), mean, values)


def _bend(lever: float, travel: Floats, grid: Floats, direction: Floats) -> Floats:
    """How far the pipe at ``lever`` along the tool lies beside its tangent at the IMU (metre), at the samples."""
    mean = box_average(grid + 0.5 * lever, grid, direction, max(abs(lever), 1e-3))
    return lever * np.nan_to_num(np.interp(travel, grid, mean - direction))


def _without_constants(seen: Floats, travel: Floats, roll: Floats) -> Floats:
    """Take off what is constant in the body and in the level frame."""
    known = np.isfinite(seen).all(axis=1, keepdims=True)
    step = np.diff(travel, prepend=travel[0])
    body, level = _constants(travel, np.where(known, seen, 0.0) * step[:, None], roll)
    right = level[0] - body[0] * np.cos(roll) - body[1] * np.sin(roll)
    up = level[1] + body[0] * np.sin(roll) - body[1] * np.cos(roll)
    return seen - np.stack([right, up], axis=1)


def _share(seen: Floats, bend: Floats) -> float:
    """Share of the bend that is in what is seen, robustly; zero when the line has too few bends to tell."""
    use = np.isfinite(seen) & (np.abs(bend) > 1e-3)
    if use.sum() < 50:
        return 0.0
    share = 0.0
    for _ in range(10):
        residual = seen[use] - share * bend[use]
        sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-4)
        weight = np.minimum(1.0, 1.5 * sigma / np.maximum(np.abs(residual), 1e-12))
        share = float(np.sum(weight * seen[use] * bend[use]) / np.sum(weight * bend[use] ** 2))
    return share


def _wobble(
    trajectory: xr.Dataset,
    travel: Floats,
    apart: Floats,
    grid: Floats,
    direction: Floats,
    header: RunHeader,
    ring: tuple[float, Floats] | None,
) -> list[Wobble]:
    """Wobble to the right and up on the grid, with its sigma and that of its turns (radian)."""
    cell = np.round((travel - travel[0]) / _NODE_M).astype(np.int64)
    n = int(cell[-1]) + 1
    count = np.bincount(cell, minlength=n)

    def averaged(values):
        with np.errstate(invalid="ignore"):
            return np.where(count > 0, np.bincount(cell, values, minlength=n) / count, np.nan)

    speed = averaged(trajectory["speed"].values)
    usual = float(np.nanmedian(speed))
    speed = np.where(np.isfinite(speed), speed, usual).clip(0.1 * usual)
    nodes = travel[0] + _NODE_M * np.arange(n)
    return [
        _smoothed(
            averaged(np.cumsum(apart[:, i])),
            None if ring is None else (ring[0], averaged(ring[1][:, i])),
            speed,
            nodes,
            grid,
            direction[i],
            header,
        )
        for i in range(2)
    ]


def _smoothed(
    total: Floats,
    ring: tuple[float, Floats] | None,
    speed: Floats,
    nodes: Floats,
    grid: Floats,
    direction: Floats,
    header: RunHeader,
) -> Wobble:
    usual = float(np.median(speed))
    seen, lever, spread = total[:, None], 0.0, 0.0
    if ring is not None and abs(ring[0]) > 0.05 and np.isfinite(ring[1]).sum() > 100:
        lever, seen = ring[0], np.stack([total, ring[1]], axis=1)
        spread = MAD_TO_SIGMA * float(np.nanmedian(np.abs(ring[1])))

    def riding(model: WobbleModel) -> tuple[float, float]:
        """Sigma of the tool's slow shift, and that of the ring that sees it (m)."""
        if lever:
            return math.sqrt(max(spread**2 - (lever * model.sigma) ** 2, 0.1 * spread**2, 1e-8)), _RING_SIGMA_M
        # two supports a distance B apart that shift by themselves: the mean of both is B / 2 times the angle between them
        return 0.5 * _CUPS_OD * header.pipe.outside_diameter_m * model.sigma, 0.0

    tool = _between(nodes, grid, direction)
    model = fit_departure(total, _NODE_M, usual, header.imu, tool, ring if lever else None, riding)
    shift, ring_sigma = riding(model)
    F, Q, Q_push, P0 = model.discrete(_NODE_M, shift, 1 if lever else model.order)
    rows, wanted = _rows(model, F.shape[0], lever)
    variance = np.array([max(model.shift_variance, _LEAST_SHIFT_M**2), ring_sigma**2])[: seen.shape[1]]
    value, sigma, odd = np.empty((total.size, 2)), np.empty(total.size), np.zeros(1, np.int64)
    push = (usual / speed) ** 3
    _kernels_path.smooth_chain(seen, variance, rows, push, F, Q, Q_push, P0, wanted, value, sigma, odd)
    if odd[0]:
        _log.info("%d of %d measurements of the path lie beyond five sigma and carry less weight", odd[0], seen.size)
    for tone in model.tones:
        _log.info(
            "tone of %.2f m, %.3f degree in the departure of the path, %.2f of it wobble",
            1.0 / tone.frequency,
            math.degrees(math.sqrt(2.0 * tone.variance)),
            abs(tone.share),
        )
        sigma = np.hypot(sigma, tone.share_sigma * math.sqrt(2.0 * tone.variance))
    wobble, tones = np.interp(grid, nodes, value[:, 0] - value[:, 1]), np.zeros(grid.size)
    if model.tones:  # a line from node to node would cut the crests of short ones
        tones = CubicSpline(nodes, value[:, 1])(np.clip(grid, nodes[0], nodes[-1]))
    riders = (shift, ring_sigma, lever)
    calm = direction - tones
    turn = turn_sigma(model, TURN_LAGS_M, total, _NODE_M, calm, float(grid[1] - grid[0]), _between(nodes, grid, calm), riders)
    return Wobble(wobble + tones, np.interp(grid, nodes, sigma), turn)


def _between(nodes: Floats, grid: Floats, direction: Floats) -> Floats:
    """Mean direction from node to node."""
    middle = np.clip(nodes[:-1] + 0.5 * _NODE_M, grid[0], grid[-1])
    mean = box_average(middle, grid, direction, _NODE_M)
    return np.where(np.isfinite(mean), mean, np.interp(middle, grid, direction))


def _rows(model: WobbleModel, states: int, lever: float) -> tuple[Floats, Floats]:
    """What is measured: the summed departure, and a ring; what is wanted: the wobble, and its tones alone."""
    own = model.shift_state
    rows, wanted = np.zeros((2 if lever else 1, states)), np.zeros((2, states))
    rows[0, 0], rows[0, own] = 1.0, -1.0
    wanted[0, 1] = 1.0
    if lever:
        rows[1, own], rows[1, 1] = 1.0, lever
    for i, tone in enumerate(model.tones):
        here = slice(states - 2 * (len(model.tones) - i), states - 2 * (len(model.tones) - i) + 2)
        rows[0, here], wanted[:, here] = -tone.shift, tone.wobble
        if lever:
            rows[1, here] = tone.shift + lever * tone.wobble
    return rows, wanted


def _on_grid(grid: Floats, travel: Floats, values: Floats, step: float) -> Floats:
    """Mean over a step about each place of the grid; at the ends the value itself."""
    mean = box_average(grid, travel, values, step)
    return np.where(np.isfinite(mean), mean, interpolate(grid, travel, values))
