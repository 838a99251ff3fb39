"""Places in radian and metre in; radii, gravity, rates and places in other frames out: the jitted floor of `earth`."""

from __future__ import annotations

import math

from numba import njit

# WGS84 (NIMA TR8350.2, 2000, tables 3.1 and 3.4)
SEMI_MAJOR = 6378137.0
FLATTENING = 1.0 / 298.257223563
EARTH_RATE = 7.292115e-5
GRAVITATION = 3.986004418e14
GRAVITY_EQUATOR = 9.7803253359
GRAVITY_POLE = 9.8321849379

SEMI_MINOR = SEMI_MAJOR * (1.0 - FLATTENING)
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
SECOND_ECCENTRICITY2 = ECCENTRICITY2 / (1.0 - ECCENTRICITY2)
SOMIGLIANA = SEMI_MINOR * GRAVITY_POLE / (SEMI_MAJOR * GRAVITY_EQUATOR) - 1.0
CENTRIFUGAL_RATIO = EARTH_RATE**2 * SEMI_MAJOR**2 * SEMI_MINOR / GRAVITATION


@njit(cache=True, error_model="numpy")
def radii(latitude):
    """Meridian and prime-vertical radius of curvature (metre)."""
    s = math.sin(latitude)
    w2 = 1.0 - ECCENTRICITY2 * s * s
    normal = SEMI_MAJOR / math.sqrt(w2)
    return normal * (1.0 - ECCENTRICITY2) / w2, normal


@njit(cache=True, error_model="numpy")
def gravity(latitude, height):
    """Normal gravity along the ellipsoid's normal (m/s², positive down)."""
    s2 = math.sin(latitude) ** 2
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / math.sqrt(1.0 - ECCENTRICITY2 * s2)
    h = height / SEMI_MAJOR
    return surface * (1.0 - 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2) * h + 3.0 * h * h)


@njit(cache=True, error_model="numpy")
def earth_rate(latitude):
    """Rate of the earth in east, north, up (rad/s)."""
    return 0.0, EARTH_RATE * math.cos(latitude), EARTH_RATE * math.sin(latitude)


@njit(cache=True, error_model="numpy")
def transport_rate(latitude, height, east_velocity, north_velocity):
    """Rate of the local level frame over the earth in east, north, up (rad/s)."""
    meridian, normal = radii(latitude)
    around = east_velocity / (normal + height)
    return -north_velocity / (meridian + height), around, around * math.tan(latitude)


@njit(cache=True, error_model="numpy")
def geodetic_to_ecef(latitude, longitude, height):
    """Earth-centred coordinates (metre)."""
    normal = radii(latitude)[1]
    across = (normal + height) * math.cos(latitude)
    up = (normal * (1.0 - ECCENTRICITY2) + height) * math.sin(latitude)
    return across * math.cos(longitude), across * math.sin(longitude), up


@njit(cache=True, error_model="numpy")
def ecef_to_geodetic(x, y, z):
    """Latitude, longitude, height; Bowring's start, iterated until it stands still."""
    p = math.hypot(x, y)
    longitude = math.atan2(y, x)
    tangent = math.atan2(z * SEMI_MAJOR, p * SEMI_MINOR)
    latitude = 0.0
    for _ in range(6):
        s, c = math.sin(tangent), math.cos(tangent)
        latitude = math.atan2(z + SECOND_ECCENTRICITY2 * SEMI_MINOR * s**3, p - ECCENTRICITY2 * SEMI_MAJOR * c**3)
        following = math.atan2((1.0 - FLATTENING) * math.sin(latitude), math.cos(latitude))
        if abs(following - tangent) < 1e-16:
            break
        tangent = following
    s, c = math.sin(latitude), math.cos(latitude)
    height = p * c + z * s - SEMI_MAJOR * math.sqrt(1.0 - ECCENTRICITY2 * s * s)
    return latitude, longitude, height


@njit(cache=True, error_model="numpy")
def fill_local(latitude, longitude, height, latitude_0, longitude_0, height_0, out):
    """East, north, up (n, 3) of points in the tangent frame at a place."""
    x0, y0, z0 = geodetic_to_ecef(latitude_0, longitude_0, height_0)
    sp, cp = math.sin(latitude_0), math.cos(latitude_0)
    sl, cl = math.sin(longitude_0), math.cos(longitude_0)
    for i in range(latitude.size):
        x, y, z = geodetic_to_ecef(latitude[i], longitude[i], height[i])
        x, y, z = x - x0, y - y0, z - z0
        outward = cl * x + sl * y
        out[i, 0] = -sl * x + cl * y
        out[i, 1] = -sp * outward + cp * z
        out[i, 2] = cp * outward + sp * z


@njit(cache=True, error_model="numpy")
def fill_geodetic(east, north, up, latitude_0, longitude_0, height_0, out):
    """Latitude, longitude, height (n, 3) of points given in the tangent frame at a place."""
    x0, y0, z0 = geodetic_to_ecef(latitude_0, longitude_0, height_0)
    sp, cp = math.sin(latitude_0), math.cos(latitude_0)
    sl, cl = math.sin(longitude_0), math.cos(longitude_0)
    for i in range(east.size):
        outward = cp * up[i] - sp * north[i]
        x = x0 + cl * outward - sl * east[i]
        y = y0 + sl * outward + cl * east[i]
        z = z0 + sp * up[i] + cp * north[i]
        out[i, 0], out[i, 1], out[i, 2] = ecef_to_geodetic(x, y, z)
