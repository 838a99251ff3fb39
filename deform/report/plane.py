"""Latitude and longitude in, metres of a picture out, turned so that the line runs to the right."""

from __future__ import annotations

import numpy as np

_EARTH_RADIUS_M = 6_371_008.8


def local_metres(latitude: np.ndarray, longitude: np.ndarray, origin: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return east and north (m) of an origin (degree), for pictures only: sphere, a few tenths of a percent."""
    scale = np.radians(1.0) * _EARTH_RADIUS_M
    return (longitude - origin[1]) * scale * np.cos(np.radians(origin[0])), (latitude - origin[0]) * scale


def turned(east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the line in axes along its main direction and to the left of it, and the azimuth (degree) of that direction."""
    span = np.array([east[-1] - east[0], north[-1] - north[0]])
    if np.hypot(*span) < 0.2 * max(np.ptp(east), np.ptp(north)):
        span = np.array([1.0, 0.0])  # a loop has no main direction: north stays up
    unit = span / np.hypot(*span)
    return east * unit[0] + north * unit[1], north * unit[0] - east * unit[1], float(np.degrees(np.arctan2(unit[0], unit[1])))
