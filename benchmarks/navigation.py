"""Navigation of a long run: time, time per sample, peak memory. `python -m benchmarks.navigation 50` for 50 h at 200 Hz."""

from __future__ import annotations

import resource
import sys
import time

import numpy as np
from pydantic import TypeAdapter

from deform.geometry import earth
from deform.geometry.rotation import attitude_to_matrix, matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav.navigate import navigate
from deform.run import build
from deform.run.raw import RawRun, RunHeader

RATE = 200.0
GYRO_PULSE, ACCEL_PULSE, PULSE = 2.424e-7, 2e-5, 2.5e-3
REST_S = 600.0
ORIGIN = (61.0, -121.0, 200.0)


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Attitude matrices and speed."""
    s = np.clip(t - REST_S, 0.0, None)
    ease = np.clip(s / 20.0, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    azimuth, pitch, roll = (
        100.0 + 25.0 * ease * np.sin(s / 90.0),
        4.0 * ease * np.sin(s / 70.0),
        20.0 + ease * 70.0 * np.sin(s / 400.0),
    )
    return attitude_to_matrix(azimuth, pitch, roll), ease * (1.2 + 0.1 * np.sin(s / 60.0))


def long_run(hours: float) -> RawRun:
    """A run of white noise and true motion, made hour by hour."""
    n = int(hours * 3600 * RATE)
    gyro, accel = np.zeros((n, 3), np.int32), np.zeros((n, 3), np.int32)
    distance, place = np.zeros(n), np.array([np.radians(ORIGIN[0]), np.radians(ORIGIN[1]), ORIGIN[2]])
    track, random, step = [], np.random.default_rng(1), int(3600 * RATE)
    for first in range(0, n, step):
        k = np.arange(first, min(first + step, n) + 1)
        C, speed = motion(k / RATE)
        v = C[:, :, 1] * speed[:, None]
        mean = 0.5 * (v[1:] + v[:-1]) / RATE
        meridian, normal = earth.radii(np.degrees(place[0]))
        latitude = place[0] + np.cumsum(mean[:, 1]) / (meridian + place[2])
        longitude = place[1] + np.cumsum(mean[:, 0]) / ((normal + place[2]) * np.cos(latitude))
        height = place[2] + np.cumsum(mean[:, 2])
        rate = earth.earth_rate(np.degrees(latitude)) + earth.transport_rate(np.degrees(latitude), height, v[1:, 0], v[1:, 1])
        angle = matrix_to_rotation_vector(C[:-1].transpose(0, 2, 1) @ (rotation_vector_to_matrix(rate / RATE) @ C[1:]))
        force = np.diff(v, axis=0) + np.cross(rate + earth.earth_rate(np.degrees(latitude)), v[1:]) / RATE
        force[:, 2] += earth.gravity(np.degrees(latitude), height) / RATE
        push = 0.5 * np.einsum("nji,nj->ni", C[1:] + C[:-1], force)
        angle += np.radians(0.002) / 60 / np.sqrt(RATE) * random.standard_normal(angle.shape) + np.radians(0.005) / 3600 / RATE
        push += 1e-4 / np.sqrt(RATE) * random.standard_normal(push.shape)
        here = slice(first, first + len(angle))
        gyro[here] = np.diff(np.rint(np.cumsum(angle, axis=0) / GYRO_PULSE), axis=0, prepend=0.0)
        accel[here] = np.diff(np.rint(np.cumsum(push, axis=0) / ACCEL_PULSE), axis=0, prepend=0.0)
        start = distance[first - 1] if first else 0.0
        distance[here] = start + np.cumsum(0.5 * (speed[1:] + speed[:-1])) / RATE
        place = np.array([latitude[-1], longitude[-1], height[-1]])
        track.append(np.column_stack([latitude, longitude, height])[:: int(RATE)])
    when = np.arange(1, n + 1) / RATE
    return _raw(when, gyro, accel, distance, np.concatenate(track), random)


def _raw(when, gyro, accel, distance, track, random) -> RawRun:
    header = TypeAdapter(RunHeader).validate_python(
        {
            "run": {"id": "long", "line": "long", "date": "2020-01-01"},
            "pipe": {"outside_diameter_m": 0.6096, "nominal_wall_m": 0.009},
            "launch": {"latitude_deg": ORIGIN[0], "longitude_deg": ORIGIN[1], "height_m": ORIGIN[2], "static_s": REST_S},
            "imu": {"rate_hz": RATE},
            "odometer": {"wheels": 3},
        }
    )
    imu = build.dataset("imu", {"time": when, "gyro_count": gyro, "accel_count": accel}).assign_attrs(
        gyro_pulse_rad=GYRO_PULSE, accel_pulse_m_per_s=ACCEL_PULSE
    )
    every = int(RATE / 50)
    wheels = np.floor(distance[::every, None] * np.array([1.001, 0.999, 1.0]) / PULSE).astype(np.int64)
    wheel_set = build.dataset("odometer", {"time": when[::every], "count": wheels}).assign_attrs(pulse_m=PULSE)
    at = np.searchsorted(distance, np.arange(0.0, distance[-1], 2000.0)[1:])
    seconds = np.clip(at // int(RATE), 0, len(track) - 1)
    noise = random.standard_normal((len(at), 3)) * 0.3
    points = track[seconds]
    values = {
        "name": [f"M{i}" for i in range(len(at))],
        "kind": ["agm"] * len(at),
        "time": when[seconds * int(RATE)],
        "latitude": np.degrees(points[:, 0]) + noise[:, 0] / 111e3,
        "longitude": np.degrees(points[:, 1]) + noise[:, 1] / 54e3,
        "height": points[:, 2] + noise[:, 2],
        "sigma_horizontal": np.full(len(at), 0.3),
        "sigma_vertical": np.full(len(at), 0.3),
    }
    return RawRun(header, imu, wheel_set, None, None, build.dataset("passages", values))


def main(hours: float = 2.0) -> None:
    navigate(long_run(0.5))  # compiles
    raw = long_run(hours)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, busy = time.perf_counter(), time.process_time()
    found = navigate(raw)
    seconds, work = time.perf_counter() - start, time.process_time() - busy
    n = raw.imu.sizes["sample"]
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sigma = float(np.hypot(found.trajectory["east_sigma"], found.trajectory["north_sigma"]).mean())
    print(
        f"{hours:g} h, {n / 1e6:.1f} M samples: {seconds:.1f} s, {work:.1f} s of processor, {seconds / n * 1e6:.2f} µs a sample"
    )
    print(f"peak {after / 2**20:.2f} GB ({before / 2**20:.2f} GB before), mean horizontal sigma {sigma:.2f} m")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 2.0)
