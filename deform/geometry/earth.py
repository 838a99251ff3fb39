"""Geodetic places (degree, metre, WGS84) in, radii, gravity, rates and local coordinates out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deform.geometry import _kernels_earth as kernels
from deform.geometry._kernels_earth import EARTH_RATE, FLATTENING, SEMI_MAJOR, SEMI_MINOR

__all__ = [
    "EARTH_RATE",
    "FLATTENING",
    "SEMI_MAJOR",
    "SEMI_MINOR",
    "earth_rate",
    "enu_difference",
    "enu_shift",
    "geodetic_to_local",
    "gravity",
    "local_to_geodetic",
    "radii",
    "transport_rate",
]

Floats = NDArray[Any]


def radii(latitude_deg: ArrayLike) -> tuple[Floats, Floats]:
    """Return the meridian and the prime-vertical radius of curvature (metre).

    Notes
    -----
    M = a (1 - e²) / (1 - e² sin² φ)^(3/2), N = a / (1 - e² sin² φ)^(1/2).

    References
    ----------
    Porter (1990), eq. 3-22; Torge (2001), eq. 4.13.

    Examples
    --------
    >>> meridian, normal = radii(90.0)
    >>> bool(abs(meridian - normal) < 1e-6)
    True
    """
    s2 = np.sin(np.radians(latitude_deg)) ** 2
    w2 = 1.0 - kernels.ECCENTRICITY2 * s2
    normal = SEMI_MAJOR / np.sqrt(w2)
    return normal * (1.0 - kernels.ECCENTRICITY2) / w2, normal


def gravity(latitude_deg: ArrayLike, height: ArrayLike = 0.0) -> Floats:
    """Return normal gravity (m/s², positive down) at a height above the ellipsoid (metre).

    Notes
    -----
    Somigliana's closed form on the ellipsoid, continued upward by the second-order series in h / a; within 1e-6 m/s² of the
    closed form up to 9000 m (see the tests).

    References
    ----------
    Porter (1990), eq. 3-24; NIMA TR8350.2 (2000), eq. 4-1 and 4-3.

    Examples
    --------
    >>> round(float(gravity(45.0)), 5)
    9.8062
    """
    s2 = np.sin(np.radians(latitude_deg)) ** 2
    surface = kernels.GRAVITY_EQUATOR * (1.0 + kernels.SOMIGLIANA * s2) / np.sqrt(1.0 - kernels.ECCENTRICITY2 * s2)
    h = np.asarray(height, float) / SEMI_MAJOR
    return surface * (1.0 - 2.0 * (1.0 + FLATTENING + kernels.CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2) * h + 3.0 * h**2)


def earth_rate(latitude_deg: ArrayLike) -> Floats:
    """Return the rate of the earth in east, north, up (rad/s), shape (..., 3)."""
    latitude = np.radians(latitude_deg)
    return EARTH_RATE * np.stack([np.zeros_like(latitude), np.cos(latitude), np.sin(latitude)], axis=-1)


def transport_rate(latitude_deg: ArrayLike, height: ArrayLike, east_velocity: ArrayLike, north_velocity: ArrayLike) -> Floats:
    """Return the rate of the local level frame over the earth in east, north, up (rad/s), shape (..., 3).

    References
    ----------
    Porter (1990), eq. 3-21.
    """
    meridian, normal = radii(latitude_deg)
    around = np.asarray(east_velocity, float) / (normal + np.asarray(height, float))
    ahead = -np.asarray(north_velocity, float) / (meridian + np.asarray(height, float))
    return np.stack(np.broadcast_arrays(ahead, around, around * np.tan(np.radians(latitude_deg))), axis=-1)


def geodetic_to_local(
    latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike, latitude_0: float, longitude_0: float, height_0: float
) -> tuple[Floats, Floats, Floats]:
    """Return east, north, up (metre) in the frame that is tangent at a place, rigorously through earth-centred coordinates.

    Parameters
    ----------
    latitude, longitude, height : points, any shapes that broadcast (degree, degree, metre).
    latitude_0, longitude_0, height_0 : origin of the frame.

    Notes
    -----
    The frame is a plane one: over a distance d the ellipsoid falls away below it by d² / 2R (8 cm at 1 km).

    Examples
    --------
    >>> east, north, up = geodetic_to_local(61.0, -121.0, 250.0, 61.0, -121.0, 200.0)
    >>> bool(abs(up - 50.0) < 1e-8)
    True
    """
    return _local(kernels.fill_local, (latitude, longitude, height), (True, True, False), (latitude_0, longitude_0, height_0))


def local_to_geodetic(
    east: ArrayLike, north: ArrayLike, up: ArrayLike, latitude_0: float, longitude_0: float, height_0: float
) -> tuple[Floats, Floats, Floats]:
    """Return latitude, longitude (degree) and height (metre) of points in a tangent frame; undoes `geodetic_to_local`."""
    latitude, longitude, height = _local(
        kernels.fill_geodetic, (east, north, up), (False, False, False), (latitude_0, longitude_0, height_0)
    )
    return np.degrees(latitude), np.degrees(longitude), height


def enu_difference(
    latitude: ArrayLike,
    longitude: ArrayLike,
    height: ArrayLike,
    latitude_0: ArrayLike,
    longitude_0: ArrayLike,
    height_0: ArrayLike,
) -> tuple[Floats, Floats, Floats]:
    """Return the small differences point minus point 0 as east, north, up (metre), along the curved earth.

    Notes
    -----
    Radii and cosine are taken at the mean latitude and height, so that swapping the points turns the sign and nothing else.
    Unlike `geodetic_to_local` each pair has its own frame, and up is the difference of heights: what a misclosure wants.
    """
    latitude, latitude_0 = np.asarray(latitude, float), np.asarray(latitude_0, float)
    height, height_0 = np.asarray(height, float), np.asarray(height_0, float)
    middle = 0.5 * (latitude + latitude_0)
    meridian, normal = radii(middle)
    level = 0.5 * (height + height_0)
    turn = (np.asarray(longitude, float) - np.asarray(longitude_0, float) + 180.0) % 360.0 - 180.0
    east = np.radians(turn) * (normal + level) * np.cos(np.radians(middle))
    return east, np.radians(latitude - latitude_0) * (meridian + level), height - height_0


def enu_path(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Floats:
    """Return the way from the first of many near points to each, (n, 3) east, north, up (metre), as the sum of its small steps.

    Notes
    -----
    Each step has the east and north of its own place, so that a path of steps led by an inertial unit can be laid beside it over
    any length. `enu_difference` from the first point cannot: at 61° and 200 km further north its metre east is 3 % short.
    """
    places = [np.asarray(v, float) for v in (latitude, longitude, height)]
    steps = np.column_stack(enu_difference(*(v[1:] for v in places), *(v[:-1] for v in places)))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def enu_shift(
    latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike, east: ArrayLike, north: ArrayLike, up: ArrayLike
) -> tuple[Floats, Floats, Floats]:
    """Return latitude, longitude, height of points shifted by small east, north, up (metre); undoes `enu_difference`."""
    latitude, height = np.asarray(latitude, float), np.asarray(height, float)
    level = height + 0.5 * np.asarray(up, float)
    moved = latitude + np.degrees(np.asarray(north, float) / (radii(latitude)[0] + level))
    middle = 0.5 * (latitude + moved)
    meridian, normal = radii(middle)
    moved = latitude + np.degrees(np.asarray(north, float) / (meridian + level))
    turn = np.degrees(np.asarray(east, float) / ((normal + level) * np.cos(np.radians(middle))))
    return moved, np.asarray(longitude, float) + turn, height + np.asarray(up, float)


def _local(kernel, points, angles, origin) -> tuple[Floats, Floats, Floats]:
    arrays = np.broadcast_arrays(*(np.asarray(p, float) for p in points))
    flat = [np.ascontiguousarray(np.radians(a) if angle else a).ravel() for a, angle in zip(arrays, angles, strict=True)]
    out = np.empty((flat[0].size, 3))
    kernel(*flat, np.radians(float(origin[0])), np.radians(float(origin[1])), float(origin[2]), out)
    shape = arrays[0].shape
    return out[:, 0].reshape(shape), out[:, 1].reshape(shape), out[:, 2].reshape(shape)
