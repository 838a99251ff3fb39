"""Counts of redundant wheels in; profile of distance, speed and stops out, with slips found and repaired."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from deform.errors import Fault, InputError
from deform.geometry.resample import robust_sigma
from deform.nav import _kernels_path, wheel_scale
from deform.nav.error_model import SCALE_WALK
from deform.nav.profile import Profile
from deform.options import NavigationOptions
from deform.run.raw import RawRun
from deform.run.stamps import usual_step

Floats = NDArray[Any]
_log = logging.getLogger(__name__)

_LEAST_STEP_S = 0.1  # spacing of the knots: CN103727938A smooths the odometer over 0.1 s
_SLIP_TOLERANCE = 0.01  # share of the travel by which a wheel may fall behind for reasons other than slip
_SLIP_ALARM_PULSES = 6.0  # lost pulses at which a slip is believed: counts are floors, a pair differs by up to two
_GROSS_TOLERANCE = 0.05  # the same before scales and arms are known
_BEND_MODEL_SIGMA = 0.3  # share of turning rate × radius that arms may leave: the bend at the wheels is that of the IMU, delayed
_BEND_SLACK = 0.2  # share of turning rate × radius by which a wheel may fall behind in a bend once the arms are known
_LONE_WHEEL_SIGMA = 0.02  # share of the speed that a slip may take unseen when only one wheel is left
_SPEED_MODEL_SIGMA = 5e-4  # share of the speed: ride over wall roughness, seen as spread of wheels of one set
_MOST_BLOCKS = 20_000  # seconds that scales and arms are adjusted to: more of them tell nothing new
_BEND_S = 1.0  # over which the turn of a bend is told from the wobble of the tool
_QUIET_S = 0.5  # no pulse for this long before and after, and a quiet IMU, is a stop


@dataclass(frozen=True)
class Slip:
    """One stretch in which a wheel lost distance (seconds on the tool's clock, metre)."""

    wheel: int
    start: float
    end: float
    lost_distance: float


@dataclass(frozen=True)
class OdometerSolution:
    """Travel along the pipe, and what was found out about the wheels.

    Attributes
    ----------
    profile : distance along the pipe at the wheel set, zero at the start, speed with sigma, and rest. The sigma grows where
        wheels disagree, are alone or stall. The scale that all wheels share is not in it: that is `OdometerHeader.scale_error`
        and is estimated by the filter.
    time : (sample,) of the inertial unit (s).
    wheel_scale : scale of each wheel relative to the mean of the wheels (1), shape (wheels,), NaN for a wheel that is dead.
    wheel_scale_sigma : its standard deviation.
    wander : random walk of the scale that all wheels share, as sigma per root metre of travel.
    wheel_arm : arms (right, up) of the wheels in the tool's cross-section found from the bends (metre), shape (wheels, 2).
    slips : slips found, in the order of time.
    stalls : (start, end) in seconds where no wheel turned though the tool was not at rest.
    remarks : what a person should know, in words.
    """

    profile: Profile
    time: Floats
    wheel_scale: Floats
    wheel_scale_sigma: Floats
    wander: float
    wheel_arm: Floats
    slips: tuple[Slip, ...]
    stalls: tuple[tuple[float, float], ...]
    remarks: tuple[str, ...]

    def on_samples(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return distance (m), speed (m/s), its sigma and rest at the begin of the first sample and at the end of each."""
        return self.profile.at(np.concatenate([[self.profile.start], self.time]))


@dataclass
class _Knots:
    """What is known at regular times: the work sheet of this module."""

    start: float
    step: float
    travel: Floats  # (knot, wheel), metre
    turn: Floats  # (knot, 2), radian about body x and z
    shake: Floats  # (knot,), m/s2


def combine(raw: RawRun, options: NavigationOptions | None = None) -> OdometerSolution:
    """Return distance, speed and stops from all wheels of a run.

    Parameters
    ----------
    raw : the raw run; its odometer and IMU are used.
    options : options of the navigation; nothing of them concerns the wheels so far.

    Raises
    ------
    InputError
        When the odometer has fewer than two samples or no wheel turns at all.

    Notes
    -----
    A wheel can only lose distance by slipping. For each pair the lead of one over the other, free of relative scale and of
    the arm of each wheel in a bend (turning rate × arm), is summed; where the sum passes a few pulses the wheel behind has
    slipped from the last zero of the sum to its peak, and its travel there is left out of the mean. The scales and the arms are
    adjusted together by iteratively reweighted least squares; wear is followed block by block. The mean over the wheels
    is the centreline's travel (opposite wheels cancel the bend).

    References
    ----------
    Porter (1990), section 2.3; CN103727938A, step 2.
    """
    knots = _on_knots(raw)
    doubts: list[str] = []  # what a person should look at; the other remarks tell of ordinary repairs
    remarks: list[str] = []
    alive = _alive(knots, doubts)
    knots.travel = np.ascontiguousarray(knots.travel[:, alive])
    scale, scale_sigma, arm, good, step, wander = _adjust(knots, raw, remarks)
    mean, n_good, spread = _fused(step, good)
    stalls, lag = _stalls(knots, mean, good, doubts)
    still = _still(knots, stalls)
    distance, slope, sigma = _profile(knots, mean, n_good, spread, float(raw.odometer.attrs["pulse_m"]))
    guess = np.where(lag > 0.0, np.sqrt(slope**2 + (0.05 * lag) ** 2 + 0.1**2), 0.0)
    open_speed = np.hypot(guess, _bend_doubt(knots, raw, distance)) if alive.size == 1 else guess
    slips = _slips(knots, step, good, mean, alive, stalls)
    wheels = raw.odometer.sizes["wheel"]
    if slips:
        remarks.append(f"{len(slips)} slips repaired, {sum(s.lost_distance for s in slips):.2f} m of wheel travel lost in them")
    for doubt in doubts:
        _log.warning("odometer of %s: %s", raw.id, doubt)
    for remark in remarks:
        _log.info("odometer of %s: %s", raw.id, remark)
    return OdometerSolution(
        Profile(knots.start, knots.step, distance, slope, sigma, still, open_speed, alive.size == 1),
        raw.imu["time"].values,
        wheel_scale=_spread_out(scale, alive, wheels),
        wheel_scale_sigma=_spread_out(scale_sigma, alive, wheels),
        wander=wander,
        wheel_arm=_spread_out(np.stack([arm[:, 1], -arm[:, 0]], axis=1), alive, wheels),  # (ω × r) along y = ω_z x - ω_x z
        slips=slips,
        stalls=stalls,
        remarks=(*doubts, *remarks),
    )


def start_of_run(raw: RawRun) -> float:
    """Start of the first IMU sample's interval, in seconds on the tool's clock."""
    time = raw.imu["time"].values
    return float(time[0] - (usual_step(time) if time.size > 1 else 1.0 / raw.header.imu.rate_hz))


def _on_knots(raw: RawRun) -> _Knots:
    time, count = raw.odometer["time"].values.astype(float), raw.odometer["count"].values
    if time.size < 2:
        raise InputError(Fault(f"{raw.id}/odometer.nc", "time", f"has {time.size} samples; two are needed for a distance"))
    imu_time = raw.imu["time"].values
    step = max(_LEAST_STEP_S, usual_step(time))
    start = start_of_run(raw)
    n = max(int(np.ceil((imu_time[-1] - start) / step)) + 1, 3)
    travel = _kernels_path.counts_on_knots(time, count, float(raw.odometer.attrs["pulse_m"]), start, step, n)
    gyro, accel = raw.imu["gyro_count"].values, raw.imu["accel_count"].values
    pulses = float(raw.imu.attrs["gyro_pulse_rad"]), float(raw.imu.attrs["accel_pulse_m_per_s"])
    turn, shake = _kernels_path.imu_on_knots(imu_time, gyro, accel, raw.header.imu.mounting, *pulses, start, step, n)
    return _Knots(start, step, travel, turn, shake)


def _alive(knots: _Knots, remarks: list[str]) -> Floats:
    """Indices of the wheels that turned over at least a twentieth of the longest travel."""
    total = knots.travel[-1] - knots.travel[0]
    if total.max() <= 0.0:
        raise InputError(
            Fault("odometer.nc", "count", "no wheel turned in the whole run", "without odometer there is no chainage")
        )
    alive = np.flatnonzero(total > 0.05 * total.max())
    dead = np.flatnonzero(total <= 0.05 * total.max())
    remarks += [f"wheel {i} is dead: {total[i]:.1f} m against {total.max():.1f} m of the others; it is left out" for i in dead]
    if alive.size == 1:
        remarks.append(f"only wheel {alive[0]} works: only the inertial unit sees its slips")
    return alive


def _adjust(knots: _Knots, raw: RawRun, remarks: list[str]) -> tuple[Floats, Floats, Floats, Floats, Floats, float]:
    """Relative scale, its sigma, arms, good flags (knot, wheel), travel per knot free of scale and arm, wander of the scale."""
    raw_step = np.diff(knots.travel, axis=0, prepend=knots.travel[:1])
    wheels = raw_step.shape[1]
    good = np.ones(raw_step.shape, bool)
    if wheels == 1:
        return np.zeros(1), np.full(1, np.nan), np.zeros((1, 2)), good, raw_step, SCALE_WALK
    rough = np.median(knots.travel, axis=1) - np.median(knots.travel[0])
    turn = _kernels_path.turn_at_wheels(knots.turn, rough, float(raw.header.odometer.lever_arm_m[1]))
    turning = np.diff(turn, axis=0, prepend=turn[:1])
    alarm = _SLIP_ALARM_PULSES * float(raw.odometer.attrs["pulse_m"])
    reach = 0.5 * raw.header.pipe.outside_diameter_m
    step = raw_step
    _kernels_path.mark_slips(step, _GROSS_TOLERANCE, np.zeros(step.shape[0]), 1.0 + 4.0 * reach, good)
    slack = _BEND_SLACK * reach * np.hypot(turning[:, 0], turning[:, 1])
    for _ in range(3):
        scale, scale_sigma, arm = _scales_and_arms(raw_step, turning, good, reach, knots.step)
        ratio, centre = wheel_scale.ratios(raw_step - turning @ arm.T, good, scale)
        local = wheel_scale.along(ratio, centre, scale, raw_step.shape[0])
        step = (raw_step - turning @ arm.T) / (1.0 + local)
        good[:] = True
        _kernels_path.mark_slips(step, _SLIP_TOLERANCE, slack, alarm, good)
    drift = np.ptp(local, axis=0)
    worn = np.flatnonzero(drift > 1e-3)
    remarks += [f"wheel {i}: relative scale drifts by {1e6 * drift[i]:.0f} ppm over the run (wear)" for i in worn]
    return scale, scale_sigma, arm, good, step, wheel_scale.wander(ratio)


def _scales_and_arms(step: Floats, turning: Floats, good: Floats, reach: float, knot_s: float) -> tuple[Floats, Floats, Floats]:
    """Scales and arms of the wheels relative to their mean, robustly, from blocks of a second; both sum to zero."""
    every = max(round(1.0 / knot_s), 1)
    edges = np.arange(0, step.shape[0], every)
    blocks = np.add.reduceat(step, edges)
    whole = np.logical_and.reduceat(good, edges).all(axis=1)
    turns = np.add.reduceat(turning, edges)
    mean = blocks.mean(axis=1)
    use = whole & (mean > 0.05 * every * knot_s)
    wheels = step.shape[1]
    if use.sum() < 3:
        return np.zeros(wheels), np.full(wheels, np.nan), np.zeros((wheels, 2))
    use = np.flatnonzero(use)[:: -(-int(use.sum()) // _MOST_BLOCKS)]
    A = np.column_stack([mean, turns])[use]
    scale, sigma, arm = np.zeros(wheels), np.zeros(wheels), np.zeros((wheels, 2))
    for i in range(wheels):
        x, covariance = _robust_fit(A, (blocks[:, i] - mean)[use], reach)
        scale[i], sigma[i], arm[i] = x[0], np.sqrt(covariance[0, 0]), x[1:]
    return scale - scale.mean(), sigma, arm - arm.mean(axis=0)


def _robust_fit(A: Floats, y: Floats, reach: float) -> tuple[Floats, Floats]:
    """Tukey-weighted least squares of y = A x; the arms (columns 1, 2) are held near zero with sigma ``reach``."""
    prior = np.diag([0.0, 1.0 / reach**2, 1.0 / reach**2])
    x = np.array([np.median(y / A[:, 0]), 0.0, 0.0])
    covariance = np.eye(3)
    for _ in range(20):
        residual = y - A @ x
        sigma = np.hypot(max(float(robust_sigma(residual)), 1e-6), _BEND_MODEL_SIGMA * reach * np.hypot(A[:, 1], A[:, 2]))
        weight = np.clip(1.0 - (residual / (4.685 * sigma)) ** 2, 0.0, None) ** 2 / sigma**2
        covariance = np.linalg.inv(A.T @ (weight[:, None] * A) + prior)
        update = covariance @ (A.T @ (weight * y))
        if np.abs(update - x).max() < 1e-9:
            return update, covariance
        x = update
    return x, covariance


def _fused(step: Floats, good: Floats) -> tuple[Floats, Floats, Floats]:
    n = step.shape[0]
    mean, n_good, spread = np.empty(n), np.empty(n, np.int64), np.empty(n)
    _kernels_path.fuse(step, good, mean, n_good, spread)
    return mean, n_good, spread


def _still_wheels(knots: _Knots) -> Floats:
    """True at knots with no pulse of any wheel for the quiet time before and after."""
    moving = (np.diff(knots.travel, axis=0, prepend=knots.travel[:1]) > 0.0).any(axis=1)
    reach = max(round(_QUIET_S / knots.step), 1)
    near = np.convolve(moving, np.ones(2 * reach + 1), mode="same") > 0.5
    return ~near


def _quiet_limit(knots: _Knots, still: Floats) -> float:
    """Shaking (m/s2) that separates rest from motion; infinite when the IMU does not tell them apart."""
    if still.sum() < 10 or (~still).sum() < 10:
        return np.inf
    rest, motion = np.quantile(knots.shake[still], 0.25), np.quantile(knots.shake[~still], 0.25)
    return float(np.sqrt(rest * motion)) if motion > 2.0 * rest else np.inf


def _shake_smoothed(knots: _Knots) -> Floats:
    width = max(round(1.0 / knots.step), 1) | 1
    return np.sqrt(np.convolve(knots.shake**2, np.full(width, 1.0 / width), mode="same"))


def _stalls(knots: _Knots, mean: Floats, good: Floats, remarks: list[str]) -> tuple[tuple[tuple[float, float], ...], Floats]:
    """Stretches where no wheel turns and the IMU shakes as in motion, filled in ``mean`` with the speed on either side.

    The second return is the seconds since the stall began, zero elsewhere: the uncertainty grows with it.
    """
    still = _still_wheels(knots)
    limit = _quiet_limit(knots, still)
    stalled = still & (_shake_smoothed(knots) > limit)
    lag = np.zeros(mean.size)
    found, rocked = [], 0
    for first, last in _stretches(stalled):
        if (last - first) * knots.step < 2.0:
            continue
        reach = max(round(_QUIET_S / knots.step), 1)
        first, last = max(first - reach, 1), min(last + reach, mean.size - 1)
        before = mean[max(first - 2 * reach, 0) : first].mean() if first > 1 else 0.0
        after = mean[last : last + 2 * reach].mean() if last < mean.size - 1 else 0.0
        if before <= 0.0 and after <= 0.0:  # no wheel turns on either side: the tool rests and is rocked, nothing is stalled
            lag[first:last] = knots.step
            rocked += last - first
            continue
        mean[first:last] = np.linspace(before, after, last - first)
        lag[first:last] = knots.step * (1 + np.arange(last - first))
        good[first:last] = True
        found.append((knots.start + first * knots.step, knots.start + last * knots.step))
        remarks.append(f"all wheels stalled from t={found[-1][0]:.1f} s to {found[-1][1]:.1f} s; the speed there is guessed")
    if rocked:
        remarks.append(f"shaken while at rest for {rocked * knots.step:.0f} s in all; no zero velocity is taken there")
    return tuple(found), lag


def _still(knots: _Knots, stalls: tuple[tuple[float, float], ...]) -> Floats:
    still = _still_wheels(knots)
    still &= _shake_smoothed(knots) <= _quiet_limit(knots, still)
    times = knots.start + knots.step * np.arange(still.size)
    for start, end in stalls:
        still &= (times < start) | (times > end)
    reach = max(round(_QUIET_S / knots.step), 1)
    for first, last in _stretches(still):
        if last - first <= 2 * reach:
            still[first:last] = False
    return still


def _stretches(flags: Floats) -> list[tuple[int, int]]:
    """First and past-the-last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _bend_doubt(knots: _Knots, raw: RawRun, distance: Floats) -> Floats:
    """Sigma of the speed (m/s) of a lone wheel in bends: turning rate × radius, at whatever clock it runs.

    The turn is that of the inertial unit when it was where the wheel is, over `_BEND_S` before and after; wobble is slower.
    """
    turn = _kernels_path.turn_at_wheels(knots.turn, distance, float(raw.header.odometer.lever_arm_m[1]))
    reach = max(round(_BEND_S / knots.step), 1)
    at = np.arange(distance.size)
    turned = turn[np.minimum(at + reach, at[-1])] - turn[np.maximum(at - reach, 0)]
    rate = np.hypot(turned[:, 0], turned[:, 1]) / (2.0 * reach * knots.step)
    radius = 0.5 * raw.header.pipe.outside_diameter_m
    return radius / np.sqrt(2.0) * maximum_filter1d(rate, 2 * reach + 1)


def _profile(knots: _Knots, mean: Floats, n_good: Floats, spread: Floats, pulse: float) -> tuple[Floats, Floats, Floats]:
    """Distance, speed and its sigma at the knots; the steps of the counts are smoothed over three knots."""
    distance = np.cumsum(mean)
    inner = 0.25 * distance[:-2] + 0.5 * distance[1:-1] + 0.25 * distance[2:]
    distance = np.concatenate([distance[:1], np.maximum.accumulate(inner), distance[-1:]])
    distance = np.maximum.accumulate(distance) - distance[0]
    slope = _kernels_path.limited_slopes(distance, knots.step)
    wheels = np.maximum(n_good, 1)
    width = max(round(1.0 / knots.step), 1) | 1
    disagreement = np.sqrt(np.convolve(spread**2, np.full(width, 1.0 / width), mode="same")) / knots.step
    quantum = pulse / np.sqrt(12.0) * np.sqrt(2.0) / (2.0 * knots.step)
    variance = (quantum**2 + disagreement**2 / 8.0) / wheels + (_SPEED_MODEL_SIGMA * slope) ** 2
    variance += np.where(n_good <= 1, (_LONE_WHEEL_SIGMA * slope) ** 2, 0.0)
    return distance, slope, np.sqrt(variance)


def _slips(knots, step, good, mean, alive, stalls) -> tuple[Slip, ...]:
    found = []
    for column, wheel in enumerate(alive):
        for first, last in _stretches(~good[:, column]):
            start, end = knots.start + (first - 1) * knots.step, knots.start + (last - 1) * knots.step
            lost = float((mean[first:last] - step[first:last, column]).sum())
            found.append(Slip(int(wheel), start, end, lost))
    return tuple(sorted(found, key=lambda s: (s.start, s.wheel)))


def _spread_out(values: Floats, alive: Floats, wheels: int) -> Floats:
    """Put values of the working wheels into an array of all wheels; NaN for the dead ones."""
    out = np.full((wheels, *values.shape[1:]), np.nan)
    out[alive] = values
    return out
