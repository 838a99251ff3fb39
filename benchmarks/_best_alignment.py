"""The best linear estimate of a first attitude in motion, by one who knows truth and statistics: the limit of `alignment`."""

from __future__ import annotations

import numpy as np

from deform.geometry import earth
from deform.geometry.rotation import attitude_to_matrix, matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav.inertial_alignment import Record, gravity_pushes
from deform.options import ToolOptions
from deform.synthetic import imu
from deform.synthetic.simulate import Passage

STEP_S = 1.0  # of the truth's grid
TRAVEL_SIGMA_M, OFFSET_SIGMA_M = 1e-3, 1.4e-3  # of the wheels' travel at one instant, of the tool's place in the pipe


def true_attitudes(passage: Passage, times: np.ndarray) -> np.ndarray:
    """Attitudes of the inertial unit (n, 3, 3), body to east, north, up."""
    return attitude_to_matrix(*np.degrees(passage.motion.states(times)[:, 10:13].T))


def best_estimate(
    passage: Passage, kept: Record, start: float, grade: imu.Grade, tool: ToolOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Error and sigma (degree, east, north, up) of generalised least squares over the displacements, linearised at the truth.

    Unknown are attitude, velocity, both biases, both triads' matrices, mounting and odometer scale, with their true spread;
    noise are both random walks, the biases' wander, the wheels' pulses, and the wobble as the sideways displacement it makes.
    """
    truth = Truth(passage, kept, start)
    z = truth.misfits(kept)
    J, prior = truth.design(grade, tool)
    R = truth.sensor_noise(grade) + truth.aid_noise(tool)
    weighed = np.linalg.solve(R, J)
    covariance = np.linalg.inv(J.T @ weighed + np.diag(1.0 / prior))
    estimate = covariance @ (weighed.T @ z)
    return np.degrees(estimate[:3]), np.degrees(np.sqrt(np.diag(covariance)[:3]))


class Truth:
    """True motion on a grid, in the local level frame of the first bound frozen in inertial space, and what errors do to it."""

    def __init__(self, passage: Passage, kept: Record, start: float):
        n = round(float(kept.duration.sum()) / STEP_S)
        self.t = start + STEP_S * np.arange(n + 1)
        state = passage.motion.states(self.t)
        latitude, longitude, height = state[:, :3].T
        self.latitude, self.height = float(np.degrees(latitude[0])), float(height[0])
        north, about = latitude - latitude[0], longitude - longitude[0]
        tilt = np.column_stack([-north, np.cos(latitude[0]) * about, np.sin(latitude[0]) * about])
        rate = earth.earth_rate(self.latitude)
        level = rotation_vector_to_matrix(rate * (self.t - self.t[0])[:, None]) @ rotation_vector_to_matrix(tilt)
        self.C0 = true_attitudes(passage, self.t[:1])[0]
        self.Q = level @ true_attitudes(passage, self.t)
        self.v = np.einsum("nij,nj->ni", level, state[:, 3:6])
        pull = -level[:, :, 2] * earth.gravity(np.degrees(latitude), height)[:, None]
        self.f = np.gradient(self.v, STEP_S, axis=0) - pull + np.cross(rate, self.v)
        turn = matrix_to_rotation_vector(self.Q[:-1].transpose(0, 2, 1) @ self.Q[1:]) / STEP_S
        self.w = np.concatenate([turn, turn[-1:]])
        self.distance, self.speed = state[:, 6] - state[0, 6], state[:, 7]
        self.forward = self.v / np.maximum(self.speed, 1e-3)[:, None]
        self.up = level[:, :, 2]
        self.right = np.cross(self.forward, self.up)
        self.ends = np.searchsorted(self.t, start + np.cumsum(kept.duration) - 1e-6)
        self.begins = np.concatenate([[0], self.ends[:-1]])

    def misfits(self, kept: Record) -> np.ndarray:
        """Odometer's minus inertial displacement of each entry with the true first attitude and velocity (3 K,)."""
        rate = earth.earth_rate(self.latitude)
        D, force, shift = (a @ self.C0.T for a in (kept.displacement, kept.force, kept.shift))
        pushes = gravity_pushes(kept, self.C0, self.latitude, self.height)
        gained = force + pushes - np.cross(rate, D)
        u = self.v[0] + np.cumsum(gained, axis=0) - gained
        T = kept.duration[:, None]
        return (D - (u * T + shift + 0.5 * T * pushes - 0.5 * T * np.cross(rate, D))).ravel()

    def response(self, turn: np.ndarray, gyro: np.ndarray, accel: np.ndarray, kick: np.ndarray) -> np.ndarray:
        """Misfits (3 K, m) by m errors: first turn (m, 3), body gyro and force errors (m, n + 1, 3), first velocity (m, 3)."""
        Q, gain = self.Q, _integral
        eps = turn[:, None, :] + gain(np.einsum("nij,mnj->mni", Q, gyro))
        du = kick[:, None, :] + gain(np.cross(eps, self.f) + np.einsum("nij,mnj->mni", Q, accel))
        way = gain(np.cross(eps, self.v)) - gain(du)
        return (way[:, self.ends] - way[:, self.begins]).reshape(len(turn), -1).T

    def design(self, grade: imu.Grade, tool: ToolOptions) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives (3 K, parameter) and true variances of the parameters."""
        n, eye, o = self.t.size, np.eye(3), np.zeros
        scale = np.where(eye > 0, grade.gyro_scale_ppm * 1e-6, grade.misalignment_rad).ravel()
        accel_scale = np.where(eye > 0, grade.accel_scale_ppm * 1e-6, grade.misalignment_rad).ravel()
        body_force = np.einsum("nji,nj->ni", self.Q, self.f)
        pairs = [(i, j) for i in range(3) for j in range(3)]
        shape = np.stack([np.outer(self.w[:, j], eye[i]) for i, j in pairs])
        push = np.stack([np.outer(body_force[:, j], eye[i]) for i, j in pairs])
        constant = np.broadcast_to(eye[:, None, :], (3, n, 3))
        parts = [
            self.response(eye, o((3, n, 3)), o((3, n, 3)), o((3, 3))),
            self.response(o((3, 3)), o((3, n, 3)), o((3, n, 3)), eye),
            self.response(o((3, 3)), constant, o((3, n, 3)), o((3, 3))),
            self.response(o((3, 3)), o((3, n, 3)), constant, o((3, 3))),
            self.response(o((9, 3)), shape, o((9, n, 3)), o((9, 3))),
            self.response(o((9, 3)), o((9, n, 3)), push, o((9, 3))),
        ]
        ways = np.stack([-self.Q[:, :, 0], -self.Q[:, :, 2], self.forward])
        askew = _integral(ways * self.speed[:, None])
        parts.append((askew[:, self.ends] - askew[:, self.begins]).reshape(3, -1).T)
        drift, bias = grade.gyro_bias_deg_per_h * imu.DEG_PER_H, grade.accel_bias_ug * imu.MICRO_G
        mounted, stretch = np.radians(tool.mounting_deg), tool.wheel_scale / np.sqrt(tool.wheels)
        sigma = [[1.0] * 6, [drift] * 3, [bias] * 3, scale, accel_scale, [mounted] * 2, [stretch]]
        variance = np.concatenate(sigma) ** 2
        return np.hstack(parts), variance

    def sensor_noise(self, grade: imu.Grade) -> np.ndarray:
        """Covariance of the misfits by random walks and wander: sum over impulses at every step of the grid."""
        n = self.t.size
        after = np.tril(np.ones((n, n))).T  # impulse at row i acts from column i on
        decay = np.exp(-np.abs(self.t - self.t[:, None]) / grade.wander_s) * after
        drive = imu.wander_sigma(grade) * np.sqrt(2.0 * STEP_S / grade.wander_s)
        drive_first = imu.wander_sigma(grade)
        walk_g, walk_a = (
            grade.gyro_random_walk_deg_per_sqrt_h * imu.DEG_PER_SQRT_H,
            grade.accel_random_walk_ug_per_sqrt_hz * imu.MICRO_G,
        )
        walks = np.repeat([walk_g, walk_a], 3)
        R = np.zeros((3 * self.ends.size, 3 * self.ends.size))
        nothing, zero = np.zeros((n, n, 3)), np.zeros((n, 3))
        for axis in range(6):
            e = np.eye(3)[axis % 3]
            white, slow = (np.eye(n) / STEP_S)[:, :, None] * e, decay[:, :, None] * e
            for shape, size in ((white, np.full(n, walks[axis] * np.sqrt(STEP_S))),
                                (slow, np.concatenate([drive_first[[axis]], np.full(n - 1, drive[axis])]))):  # fmt: skip
                errors = (shape, nothing) if axis < 3 else (nothing, shape)
                A = self.response(zero, *errors, zero) * size
                R += A @ A.T
        return R

    def aid_noise(self, tool: ToolOptions) -> np.ndarray:
        """Covariance of the misfits by wobble (sideways displacement), the tool's place in the pipe and the wheels' pulses."""
        K, n = self.ends.size, self.t.size
        apart = np.abs(self.distance - self.distance[:, None])
        like = _correlation(apart, tool.wobble_length_m) * np.radians(tool.wobble_deg) ** 2
        R = np.zeros((3 * K, 3 * K))
        for across in (self.right, self.up):
            M = np.zeros((K, 3, n))
            for i, (a, b) in enumerate(zip(self.begins, self.ends, strict=True)):
                weight = np.full(b - a + 1, STEP_S)
                weight[[0, -1]] *= 0.5
                M[i, :, a : b + 1] = (across[a : b + 1] * (self.speed[a : b + 1] * weight)[:, None]).T
            M = M.reshape(3 * K, n)
            R += M @ like @ M.T
        for axis, sigma in ((self.forward, TRAVEL_SIGMA_M), (self.right, OFFSET_SIGMA_M), (self.up, OFFSET_SIGMA_M)):
            M = np.zeros((K, 3, K + 1))
            for i, (a, b) in enumerate(zip(self.begins, self.ends, strict=True)):
                M[i, :, i], M[i, :, i + 1] = -axis[a], axis[b]
            M = M.reshape(3 * K, K + 1)
            R += sigma**2 * M @ M.T
        return R


def _integral(values: np.ndarray) -> np.ndarray:
    """Trapezoidal integral along the axis before the last."""
    steps = 0.5 * STEP_S * (values[..., 1:, :] + values[..., :-1, :])
    return np.concatenate([np.zeros_like(values[..., :1, :]), np.cumsum(steps, axis=-2)], axis=-2)


def _correlation(apart: np.ndarray, lengths: tuple[float, float]) -> np.ndarray:
    """Correlation of the simulator's waves: wavelengths drawn evenly in the logarithm, power in proportion to the length."""
    wave = np.exp(np.linspace(*np.log(lengths), 200))
    grid = np.linspace(0.0, float(apart.max()), 4000)
    values = np.mean(wave * np.cos(2.0 * np.pi * grid[:, None] / wave), axis=1) / wave.mean()
    return np.interp(apart, grid, values)
