"""What faultless sensors deliver, integrated by plain code of the test's own, is the route again."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from deform.geometry.rotation import attitude_to_matrix, matrix_to_rotation_vector
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.synthetic import imu
from deform.synthetic.simulate import ride

A, F, OMEGA = 6378137.0, 1 / 298.257223563, 7.292115e-5
E2 = F * (2 - F)


@njit(cache=True)
def _gravity(latitude, height):
    """WGS84 normal gravity; the constants are written out again on purpose."""
    s2 = np.sin(latitude) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(1 - E2 * s2)
    m = 0.00344978650684
    return surface * (1 - 2 * (1 + F + m - 2 * F * s2) * height / A + 3 * (height / A) ** 2)


@njit(cache=True)
def _cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _exponential(vector):
    angle = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    K = np.array([[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]])
    if angle < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * (K @ K)


@njit(cache=True)
def integrate(increments, dt, C, v, place):
    """Plain strapdown integration: two-sample coning and sculling, rates of the middle, trapezoid positions."""
    latitude, longitude, height = place
    before_angle, before_velocity = increments[0, :3], increments[0, 3:]
    path = np.empty((len(increments), 6))
    for k in range(len(increments)):
        angle, velocity = increments[k, :3], increments[k, 3:]
        turn = angle + _cross(before_angle, angle) / 12
        push = velocity + 0.5 * _cross(angle, velocity)
        push = push + (_cross(before_angle, velocity) + _cross(before_velocity, angle)) / 12
        before_angle, before_velocity = angle, velocity
        w2 = 1 - E2 * np.sin(latitude) ** 2
        N, M = A / np.sqrt(w2), A * (1 - E2) / w2**1.5
        earth = OMEGA * np.array([0, np.cos(latitude), np.sin(latitude)])
        over = np.array([-v[1] / (M + height), v[0] / (N + height), v[0] * np.tan(latitude) / (N + height)])
        middle = _exponential(-0.5 * dt * (earth + over)) @ C
        new = v + middle @ push - dt * _cross(2 * earth + over, v)
        new[2] -= dt * _gravity(latitude, height)
        mean = 0.5 * (v + new)
        latitude, height = latitude + dt * mean[1] / (M + height), height + dt * mean[2]
        longitude += dt * mean[0] / ((N + height) * np.cos(latitude))
        C = _exponential(-dt * (earth + over)) @ C @ _exponential(turn)
        v = new
        path[k, 0], path[k, 1], path[k, 2] = latitude, longitude, height
        path[k, 3:] = v
    return path, C


def _passage(direction="downstream", vibration=1.0, rate=100.0, **tool):
    options = SimulateOptions(
        seed=3,
        route=RouteOptions(length_m=800.0, induction_bends_deg=(45.0,), crossings=1),
        runs=(RunOptions(id="run", date="2020-01-01", direction=direction),),
        tool=ToolOptions(imu="perfect", imu_rate_hz=rate, static_start_s=20.0, vibration=vibration, stops=1, **tool),
    )
    return ride(options)


def _errors(passage, rate, seconds=600.0):
    """Position errors (east, north, up; metre) and velocity errors over the ride, and the last attitude's error (rad)."""
    start = passage.motion.states([0.0])[0]
    C = attitude_to_matrix(*np.degrees(start[10:13]))
    count = int(min(seconds, passage.motion.duration) * rate)
    path, C = integrate(imu.increments(passage.motion, rate, 0.0, count), 1 / rate, C, start[3:6].copy(), start[:3].copy())
    true = passage.motion.states((1 + np.arange(count)) / rate)
    d = path - true[:, :6]
    errors = np.column_stack([d[:, 1] * A * np.cos(start[0]), d[:, 0] * A, d[:, 2]])
    turned = matrix_to_rotation_vector(C.T @ attitude_to_matrix(*np.degrees(true[-1, 10:13])))
    return errors, d[:, 3:], turned


@pytest.mark.parametrize("direction", ["downstream", "upstream"])
def test_increments_of_faultless_sensors_return_the_route(direction):
    errors, velocity, turned = _errors(_passage(direction), 100.0)
    assert np.abs(errors).max() < 0.01
    assert np.abs(velocity).max() < 1e-4
    assert np.abs(turned).max() < 1e-7


def test_the_loop_closes_better_at_a_higher_rate_and_without_vibration():
    coarse, fine = (np.abs(_errors(_passage(vibration=0.0), rate)[0]).max() for rate in (50.0, 200.0))
    assert fine < 0.002
    assert fine < 0.5 * coarse


def test_counts_of_the_perfect_grade_are_the_increments():
    passage = _passage()
    exact = imu.increments(passage.motion, 100.0, 0.0, 5000)
    time, gyro, accel = next(
        imu.counts(passage.motion, passage.tool, imu.draw_errors(imu.GRADES["perfect"], np.random.default_rng(1)), 3, "run")
    )
    assert time[:2] == pytest.approx([0.01, 0.02])
    assert np.abs(gyro[:5000] * 1e-11 - exact[:, :3]).max() < 1.1e-11
    assert np.abs(accel[:5000] * 1e-9 - exact[:, 3:]).max() < 1.1e-9
    assert np.abs((accel[:5000] * 1e-9 - exact[:, 3:]).cumsum(axis=0)).max() < 1.1e-9


def test_blocks_of_counts_follow_each_other_without_a_seam(monkeypatch):
    passage = _passage(static_end_s=10.0)
    perfect = imu.draw_errors(imu.GRADES["perfect"], np.random.default_rng(1))
    whole = np.concatenate([b[1] for b in imu.counts(passage.motion, passage.tool, perfect, 3, "run")])
    monkeypatch.setattr(imu, "BLOCK", 1234)
    pieces = np.concatenate([b[1] for b in imu.counts(passage.motion, passage.tool, perfect, 3, "run")])
    assert np.abs(whole - pieces).max() <= 1


def test_standing_tool_feels_earth_rate_and_gravity_and_nothing_else():
    passage = _passage()
    still = imu.increments(passage.motion, 100.0, 2.0, 500)
    angle = np.linalg.norm(still[:, :3].sum(axis=0)) / 5.0
    assert angle == pytest.approx(OMEGA, rel=1e-7)
    start = passage.motion.states([3.0])[0]
    assert np.linalg.norm(still[:, 3:].sum(axis=0)) / 5.0 == pytest.approx(_gravity(start[0], start[2]), abs=1e-8)
