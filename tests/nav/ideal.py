"""Perfect counts of a tool on an analytic path, with what is true at every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deform.geometry import earth
from deform.geometry.rotation import attitude_to_matrix, matrix_to_rotation_vector
from deform.nav.compensation import compensation_table
from deform.nav.strapdown import Counts
from deform.run.raw import ImuHeader

GYRO_PULSE, ACCEL_PULSE = 1e-12, 1e-10
WOBBLE_WAVES_M = (14.0, 23.0, 38.0, 61.0, 100.0, 165.0)


@dataclass(frozen=True)
class Ideal:
    """Counts and truth at the samples."""

    counts: Counts
    distance: np.ndarray
    places: np.ndarray
    velocities: np.ndarray
    attitudes: np.ndarray


def ideal_run(duration: float, rate: float = 100.0, latitude: float = 61.0, rest: float = 0.0, substeps: int = 4, gyro_bias=0.0,
              accel_bias=0.0, seed: int = 0, gyro_walk: float = 0.0, accel_walk: float = 0.0, turn_deg: float = 30.0,
              wobble_deg: float = 0.0) -> Ideal:  # fmt: skip
    """Return a run that rolls, climbs and turns along body y after a rest; biases (rad/s, m/s²) are those of all axes.

    ``wobble_deg``: how far the tool's axis sways against the path, right and up, as root mean square over `WOBBLE_WAVES_M`.
    """
    h = 1.0 / (rate * substeps)
    t = np.arange(round(duration / h) + 1) * h
    s = np.clip(t - rest, 0.0, None)
    start = np.clip(s / 20.0, 0.0, 1.0)
    ease = start**3 * (10 - 15 * start + 6 * start**2)
    speed = ease * (1.3 + 0.2 * np.sin(s / 40.0))
    azimuth = 100.0 + ease * turn_deg * np.sin(s / 60.0)
    pitch = ease * 5.0 * np.sin(s / 35.0)
    roll = 20.0 + ease * 80.0 * np.sin(s / 150.0)
    v = attitude_to_matrix(azimuth, pitch, roll)[:, :, 1] * speed[:, None]
    place = _places(v, h, latitude)
    if wobble_deg:
        along = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * h)])
        size = wobble_deg * np.sqrt(2.0 / len(WOBBLE_WAVES_M))
        azimuth = azimuth + sum(size * np.sin(2.0 * np.pi * along / w) for w in WOBBLE_WAVES_M)
        pitch = pitch + sum(size * (np.cos(2.0 * np.pi * along / w) - 1.0) for w in WOBBLE_WAVES_M)
    C = attitude_to_matrix(azimuth, pitch, roll)
    lat_deg, height = np.degrees(place[:, 0]), place[:, 2]
    ie = earth.earth_rate(lat_deg)
    en = earth.transport_rate(lat_deg, height, v[:, 0], v[:, 1])
    force_n = np.gradient(v, h, axis=0, edge_order=2) + np.cross(2 * ie + en, v)
    force_n[:, 2] += earth.gravity(lat_deg, height)
    force = np.einsum("nji,nj->ni", C, force_n)
    # exact turn of each substep against inertial space: n-frame turn composed with the attitude's
    middle = 0.5 * (ie + en)[1:] + 0.5 * (ie + en)[:-1]
    turned = C[:-1].transpose(0, 2, 1) @ (_small(middle * h) @ C[1:])
    angle = matrix_to_rotation_vector(turned)
    k = np.arange(0, t.size, substeps)
    # counts are integrals of the rate; over a substep the rotation vector is that to second order
    gyro = np.add.reduceat(angle, k[:-1], axis=0)
    weights = 0.5 * (force[1:] + force[:-1]) * h
    accel = np.add.reduceat(weights, k[:-1], axis=0)
    noise = np.random.default_rng(seed)
    gyro = gyro + gyro_bias / rate + gyro_walk / np.sqrt(rate) * noise.standard_normal(gyro.shape)
    accel = accel + accel_bias / rate + accel_walk / np.sqrt(rate) * noise.standard_normal(accel.shape)
    time = t[k]
    counts = Counts(
        time,
        np.vstack([np.zeros(3), np.diff(np.rint(np.cumsum(gyro, axis=0) / GYRO_PULSE), axis=0, prepend=0)]).astype(np.int32),
        np.vstack([np.zeros(3), np.diff(np.rint(np.cumsum(accel, axis=0) / ACCEL_PULSE), axis=0, prepend=0)]).astype(np.int32),
        GYRO_PULSE,
        ACCEL_PULSE,
        compensation_table(ImuHeader(rate_hz=rate)),
        1.0 / rate,
    )
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * h)])[k]
    return Ideal(counts, distance, place[k], v[k], C[k])


def _small(angle):
    """Matrices of rotation vectors."""
    from deform.geometry.rotation import rotation_vector_to_matrix

    return rotation_vector_to_matrix(angle)


def _places(v, h, latitude):
    """Latitude, longitude (radian), height by the trapezoidal rule, twice for the radii."""
    place = np.zeros((len(v), 3))
    place[:, 2] = 200.0 + np.concatenate([[0.0], np.cumsum(0.5 * (v[1:, 2] + v[:-1, 2]) * h)])
    lat = np.full(len(v), np.radians(latitude))
    for _ in range(3):
        meridian = earth.radii(np.degrees(lat))[0]
        north = v[:, 1] / (meridian + place[:, 2])
        lat = np.radians(latitude) + np.concatenate([[0.0], np.cumsum(0.5 * (north[1:] + north[:-1]) * h)])
    east = v[:, 0] / ((earth.radii(np.degrees(lat))[1] + place[:, 2]) * np.cos(lat))
    place[:, 0] = lat
    place[:, 1] = np.radians(-121.0) + np.concatenate([[0.0], np.cumsum(0.5 * (east[1:] + east[:-1]) * h)])
    return place
