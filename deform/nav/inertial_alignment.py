"""Epochs of a tool at rest or moving in; its first attitude, found in body axes frozen in inertial space, with covariance out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.geometry import earth
from deform.geometry.rotation import matrix_to_rotation_vector, rotation_vector_to_matrix, skew
from deform.nav import _kernels as k
from deform.nav.aiding import WOBBLE_DENSITY, TravelAid
from deform.nav.compensation import STANDARD_GRAVITY
from deform.nav.strapdown import Epochs
from deform.run.raw import RunHeader

Floats = NDArray[np.float64]

FIRST, TURN, SPEED, GYRO, ACCEL, MOUNTING, SCALE, GYRO_SHAPE, ACCEL_SHAPE, STATES = 0, 3, 6, 9, 12, 15, 17, 18, 27, 36

RECORD_S = 5.0  # of one entry of the record; he takes 1 s, a pipe leaves time
REST_SIGMA_M = 2e-4  # displacement of a tool at rest within one epoch, shaking included
WANDER, WANDER_S = 0.2, 1800.0  # share of a bias that wanders within minutes, and over which time
MOUNTED_RAD = math.radians(0.5)
LEVEL_RAD, AZIMUTH_RAD = 0.1, 1.0  # a first attitude that says nothing
GATE = 5.0  # sigma beyond which the variance of a measurement grows with it
MOST_PASSES, STANDS_RAD = 8, 1e-5


@dataclass(frozen=True)
class Record:
    """What is kept of each epoch, in the body axes of the first bound, frozen in inertial space: nothing in it needs an attitude.

    Parameters
    ----------
    duration, gap : (epoch,) s.
    body : (epoch + 1, 3, 3) turn of the body since the first bound.
    force : (epoch, 3) integral of the specific force (m/s).
    shift : (epoch, 3) its second integral (m).
    time : (epoch, 3, 3) integral of the turn over time (s).
    travel : (epoch, 3, 3) integral of the turn over the odometer's distance (m); column 1 is the tool's displacement.
    angle, push : (epoch, 3) turn (radian) and force (m/s) in the body axes of the epoch's beginning.
    variance : (epoch, 3) of the displacement to the right, along, up (m²); 0 = not measured.
    still : (epoch,) the tool stands.
    speed : (epoch + 1,) m/s at the bounds.
    """

    duration: Floats
    gap: Floats
    body: Floats
    force: Floats
    shift: Floats
    time: Floats
    travel: Floats
    angle: Floats
    push: Floats
    variance: Floats
    still: NDArray[np.bool_]
    speed: Floats

    @property
    def displacement(self) -> Floats:
        """Displacement by the odometer along the forward axis (epoch, 3), metre."""
        return self.travel[:, :, 1]


@dataclass(frozen=True)
class First:
    """First attitude found.

    Parameters
    ----------
    attitude : matrix (3, 3), body to east, north, up at the first bound.
    covariance : (3, 3) of the turning error about east, north, up (radian²).
    innovation_square : mean square of the normalised innovations of the last pass.
    worse : (3,) factor by which the variance of the aid had to grow: across and along in motion, at rest.
    passes : how often the record was run through.
    """

    attitude: Floats
    covariance: Floats
    innovation_square: float
    worse: Floats
    passes: int


def record(epochs: Epochs, aid: TravelAid) -> Record:
    """Return the record of the epochs, several of them taken together so that one lasts `RECORD_S` or more.

    Parameters
    ----------
    epochs : the epochs.
    aid : displacements by the odometer and rests of these epochs, and maybe of further ones.
    """
    n = len(epochs.table)
    stationary = aid.stationary[:n]
    table, T = epochs.table, epochs.duration
    turns = table[:, k.TURN : k.TURN + 9].reshape(-1, 3, 3)
    body = np.empty((n + 1, 3, 3))
    body[0] = np.eye(3)
    for i, turn in enumerate(turns):
        body[i + 1] = body[i] @ turn
    force, shift = (np.einsum("nij,nj->ni", body[:-1], table[:, c : c + 3]) for c in (k.VELOCITY, k.POSITION))
    time, travel = (body[:-1] @ table[:, c : c + 9].reshape(-1, 3, 3) for c in (k.ATTITUDE_TIME, k.ATTITUDE_TRAVEL))
    first = _together(T)
    gained = np.cumsum(force, axis=0) - force
    gained -= np.repeat(gained[first], np.diff(np.append(first, n)), axis=0)
    across = WOBBLE_DENSITY * aid.travel[:n] + REST_SIGMA_M**2
    variance = np.column_stack([across, aid.along_shape[:n] + aid.doubt[:n] + REST_SIGMA_M**2, across])
    variance[stationary] = REST_SIGMA_M**2
    lost = np.logical_or.reduceat(epochs.gap > 0, first)
    kept = body[np.append(first, n)]
    T, gap, force, shift, time, travel, variance = (
        np.add.reduceat(v, first, axis=0) for v in (T, epochs.gap, force, shift + gained * T[:, None], time, travel, variance)
    )
    variance[lost] = 0.0
    angle = matrix_to_rotation_vector(kept[:-1].transpose(0, 2, 1) @ kept[1:])
    push = np.einsum("nji,nj->ni", kept[:-1], force)
    still, speed = np.logical_and.reduceat(stationary, first), aid.speeds[np.append(first, n)]
    return Record(T, gap, kept, force, shift, time, travel, angle, push, variance, still, speed)


def _together(duration: Floats) -> NDArray[np.int64]:
    """First epoch of each group that lasts `RECORD_S` or more; a shorter rest at the end joins the last one."""
    group = np.floor((np.cumsum(duration) - 0.5 * duration) / RECORD_S)
    group = np.minimum(group, max(math.floor(float(duration.sum()) / RECORD_S + 0.01) - 1, 0))
    return np.flatnonzero(np.diff(group, prepend=-1.0) > 0)


def coarse(kept: Record, latitude_deg: float, height: float) -> tuple[Floats, Floats]:
    """Return the first attitude from all vectors, and how far each of them stays off (epoch,), in parts of its length.

    Notes
    -----
    With B the gyros' turn since the start and N that of the local level frame (earth and transport rate), the equation of motion
    integrates to C (B v - v0 - ∫ B f + ∫ ω × B v) = ∫ N g: the unknown first attitude C turns one known vector into another
    at every epoch. It is written in the velocity over ground, so that g is plain gravity and the earth's rate ω enters once (9
    to 12 with 15 and 17 hold the centrifugal part twice, in g and in the velocity of the ground). Their rotation by all of
    them is Wahba's problem, solved by singular values; 23, which takes two of them, is singular for equal directions.
    Terms that need C are iterated.

    References
    ----------
    Li et al. (2012), eq. 1 to 23; Markley (1988), J. Astronaut. Sci. 36, 245-258.
    """
    forward = kept.body[:, :, 1] * kept.speed[:, None]
    known = forward[1:] - forward[0] - np.cumsum(kept.force, axis=0)
    enough = np.cumsum(kept.duration) > 1.0
    attitude = np.eye(3)
    for _ in range(4):
        rate = attitude.T @ earth.earth_rate(latitude_deg)
        alpha = known + np.cumsum(np.cross(rate, kept.displacement), axis=0)
        beta = np.cumsum(gravity_pushes(kept, attitude, latitude_deg, height), axis=0)
        attitude = wahba(alpha[enough], beta[enough])
    off = np.linalg.norm(alpha @ attitude.T - beta, axis=1) / np.linalg.norm(beta, axis=1)
    return attitude, off[enough]


def wahba(alpha: Floats, beta: Floats) -> Floats:
    """Return the rotation C that brings the vectors alpha (n, 3) nearest to beta (n, 3), C alpha = beta."""
    u, _, v = np.linalg.svd(beta.T @ alpha)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(v)]) @ v


def gravity_pushes(kept: Record, attitude: Floats, latitude_deg: float, height: float) -> Floats:
    """Return the velocity (epoch, 3) that gravity gives in each epoch, in the first local level frame, frozen.

    Notes
    -----
    That frame is left by the earth's turn and by the way travelled, which takes the displacements of the odometer (44 to 46).
    """
    T = kept.duration
    middle = np.cumsum(T) - 0.5 * T
    turned = rotation_vector_to_matrix(earth.earth_rate(latitude_deg) * middle[:, None])
    steps = np.einsum("nji,nj->ni", turned, kept.displacement @ attitude.T)
    east, north, up = (np.cumsum(steps, axis=0) - 0.5 * steps).T
    meridian, normal = (float(r) + height for r in earth.radii(latitude_deg))
    tilt = np.column_stack([-north / meridian, east / normal, east / normal * math.tan(math.radians(latitude_deg))])
    g = earth.gravity(latitude_deg + np.degrees(north / meridian), height + up)
    down = np.einsum("nij,nj->ni", turned @ rotation_vector_to_matrix(tilt), np.column_stack([0 * g, 0 * g, -g]))
    return down * T[:, None]


def fine(kept: Record, attitude: Floats, header: RunHeader) -> First:
    """Return the first attitude by a Kalman filter that is run over the record again and again.

    Parameters
    ----------
    attitude : from `coarse`; it may be wrong by tens of degrees in azimuth.

    Notes
    -----
    The record does not depend on the attitude, so that the filter goes back to its beginning with the attitude it found, until
    that stands (backtracking). Writing C B = Ĉ (1 + φ×) B̂ for attitude times gyro turn, both with errors, and u for the velocity
    over ground in the axes Ĉ leads to, eq. 24 to 43 become
    φ' = -B (b + E ω), u' = B f + Ĉᵀ N g - ω × u + φ × B f - B (a + A f), with gyro bias b and accelerometer bias a, and E and A
    the scale and misalignment of both triads. (His 31 lets the gyros' error turn the attitude, but not the force in 34: the term
    φ × B f holds both.) The displacement over an epoch is measured by the odometer, or is zero at rest, which is zero
    velocity and position reset at once (Porter, section 3.5). The first attitude is a state of its own (fixed-point
    smoothing). Where the innovations say that the aid is worse than it was said to be, its variance is raised to them.

    References
    ----------
    Li et al. (2012), eq. 24 to 47; Porter (1990), section 3.5.
    """
    worse = np.ones(3)
    for count in range(1, MOST_PASSES + 1):  # noqa: B007  # how many there were is told
        x, P, square, seen = _run(kept, attitude, header, worse)
        attitude = attitude @ rotation_vector_to_matrix(x[FIRST : FIRST + 3])
        grown = np.maximum(worse * np.where(seen > 1.5, seen, 1.0), 1.0)
        stands = float(np.linalg.norm(x[FIRST : FIRST + 3])) < STANDS_RAD and np.all(grown < 1.2 * worse)
        worse = grown
        if stands:
            break
    covariance = attitude @ P[FIRST : FIRST + 3, FIRST : FIRST + 3] @ attitude.T
    return First(attitude, covariance, square, worse, count)


def _run(kept: Record, attitude: Floats, header: RunHeader, worse: Floats) -> tuple[Floats, Floats, float, Floats]:
    """One pass: errors, their covariance, mean square of the innovations, and that of each component of the aid.

    Components: across and along in motion, any at rest.
    """
    launch = header.launch
    pushes = gravity_pushes(kept, attitude, launch.latitude_deg, launch.height_m) @ attitude
    rate = attitude.T @ earth.earth_rate(launch.latitude_deg)
    cross_rate, eye = skew(rate), np.eye(3)
    x, P, walk = np.zeros(STATES), _first_covariance(header, attitude, float(kept.speed[0])), _walks(header)
    velocity = kept.body[0, :, 1] * kept.speed[0]
    squares: list[list[float]] = [[], [], []]
    for i, T in enumerate(kept.duration):
        D, S, force = kept.displacement[i], kept.travel[i], kept.force[i]
        turning, pushing = _by_sensor(kept, i, -1.0), _by_force(kept, i, -1.0)
        H = np.zeros((3, STATES))
        H[:, SPEED : SPEED + 3] = T * eye
        H[:, TURN : TURN + 3] = skew(D) - 0.5 * T * skew(force)
        H[:, ACCEL : ACCEL + 3], H[:, ACCEL_SHAPE:] = -0.5 * T * kept.time[i], 0.5 * T * pushing
        H[:, MOUNTING], H[:, MOUNTING + 1], H[:, SCALE] = -S[:, 0], -S[:, 2], -D
        z = D - (velocity * T + kept.shift[i] + 0.5 * T * pushes[i] - 0.5 * T * np.cross(rate, D))
        axes = 0.5 * (kept.body[i] + kept.body[i + 1])
        for c in range(3):
            if kept.variance[i, c] > 0.0:
                kind = 2 if kept.still[i] else int(c == 1)
                square = _measure(x, P, axes[:, c] @ H, float(axes[:, c] @ z), worse[kind] * kept.variance[i, c])
                squares[kind].append(square)
        velocity = velocity + force + pushes[i] - np.cross(rate, D)
        F = np.eye(STATES)
        F[TURN : TURN + 3, GYRO : GYRO + 3], F[TURN : TURN + 3, GYRO_SHAPE:ACCEL_SHAPE] = -kept.time[i], turning
        F[SPEED : SPEED + 3, SPEED : SPEED + 3] -= T * cross_rate
        F[SPEED : SPEED + 3, TURN : TURN + 3] = -skew(force)
        F[SPEED : SPEED + 3, GYRO : GYRO + 3] = 0.5 * skew(force) @ kept.time[i]
        F[SPEED : SPEED + 3, ACCEL : ACCEL + 3], F[SPEED : SPEED + 3, ACCEL_SHAPE:] = -kept.time[i], pushing
        x, P = F @ x, F @ P @ F.T
        P[range(STATES), range(STATES)] += walk * T
        if kept.gap[i] > 0.0:
            P[range(TURN, SPEED + 3), range(TURN, SPEED + 3)] += np.repeat([math.radians(2.0) ** 2, 0.1**2], 3) * kept.gap[i]
    seen = np.array([np.mean(np.minimum(s, GATE**2)) if len(s) > 20 else 1.0 for s in squares])
    every = np.concatenate([np.asarray(s) for s in squares])
    return x, P, float(np.mean(np.minimum(every, GATE**2))) if every.size else math.nan, seen


def _by_sensor(kept: Record, i: int, sign: float) -> Floats:
    """Derivative (3, 9) of the turn to the elements of the gyros' matrix."""
    return sign * np.einsum("ri,j->rij", kept.body[i], kept.angle[i]).reshape(3, 9)


def _by_force(kept: Record, i: int, sign: float) -> Floats:
    """Derivative (3, 9) of the force to the elements of the accelerometers' matrix."""
    return sign * np.einsum("ri,j->rij", kept.body[i], kept.push[i]).reshape(3, 9)


def _measure(x: Floats, P: Floats, h: Floats, z: float, variance: float) -> float:
    """One scalar measurement in Joseph's form, on x and P in place; returns its normalised square."""
    gain = P @ h
    s = float(h @ gain) + variance
    innovation = z - float(h @ x)
    square = innovation**2 / s
    if square > GATE**2:
        s *= square / GATE**2
    x += gain * (innovation / s)
    expected = float(h @ gain) + variance
    P += np.multiply.outer(gain, gain) * (expected / s**2 - 2.0 / s)
    return square


def _first_covariance(header: RunHeader, attitude: Floats, speed: float) -> Floats:
    imu = header.imu
    P = np.zeros((STATES, STATES))
    turn = attitude.T @ np.diag([LEVEL_RAD**2, LEVEL_RAD**2, AZIMUTH_RAD**2]) @ attitude
    for a in (FIRST, TURN):
        for b in (FIRST, TURN):
            P[a : a + 3, b : b + 3] = turn
    drift = math.radians(imu.gyro_bias_deg_per_h) / 3600.0
    bias = imu.accel_bias_ug * 1e-6 * STANDARD_GRAVITY
    askew = max(imu.gyro_scale_ppm, imu.accel_scale_ppm)  # no header says how askew the axes are; about the worse of the scales
    gyro_shape = np.where(np.eye(3) > 0, imu.gyro_scale_ppm, askew).ravel() * 1e-6
    accel_shape = np.where(np.eye(3) > 0, imu.accel_scale_ppm, askew).ravel() * 1e-6
    sigma = np.concatenate([np.full(3, 0.05 + 0.1 * speed), np.full(3, drift), np.full(3, bias), [MOUNTED_RAD] * 2,
                            [header.odometer.scale_error], gyro_shape, accel_shape])  # fmt: skip
    P[range(SPEED, STATES), range(SPEED, STATES)] = sigma**2
    return P


def _walks(header: RunHeader) -> Floats:
    """Variance per second of the random walks."""
    imu = header.imu
    out = np.zeros(STATES)
    out[TURN : TURN + 3] = (math.radians(imu.gyro_random_walk_deg_per_sqrt_h) / 60.0) ** 2
    out[SPEED : SPEED + 3] = (imu.accel_random_walk_ug_per_sqrt_hz * 1e-6 * STANDARD_GRAVITY) ** 2
    wander = 2.0 * WANDER**2 / WANDER_S
    out[GYRO : GYRO + 3] = wander * (math.radians(imu.gyro_bias_deg_per_h) / 3600.0) ** 2
    out[ACCEL : ACCEL + 3] = wander * (imu.accel_bias_ug * 1e-6 * STANDARD_GRAVITY) ** 2
    return out
