"""The line that test output folders show: its shape, its welds and how it moves, in closed form."""

from __future__ import annotations

import numpy as np

OD, WALL = 0.3239, 0.00635
LATITUDE, LONGITUDE = 61.04, -121.28
SLIDE = (2655.0, 2785.0)
SETTLEMENT = (857.0, 903.0)
CUTOUT = (3150.0, 3215.0)
DENTS = (  # id, chainage, clock (degree), depth in each epoch, length, width (metre)
    ("D01", 455.3, 172.0, (0.0071, 0.0071, 0.0071), 0.22, 0.16),
    ("D02", 1391.8, 35.0, (0.0078, 0.0110, 0.0146), 0.34, 0.22),
    ("D03", 1955.1, 205.0, (0.0100, 0.0101, 0.0100), 0.28, 0.20),
    ("D05", 3400.2, 90.0, (None, None, 0.0062), 0.25, 0.18),
)


def _bump(s: np.ndarray, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return w = (1 - cos 2 pi x / L) / 2 and its second derivative."""
    span = end - start
    phase = 2 * np.pi * (s - start) / span
    inside = (s > start) & (s < end)
    return np.where(inside, (1 - np.cos(phase)) / 2, 0.0), np.where(inside, 0.5 * (2 * np.pi / span) ** 2 * np.cos(phase), 0.0)


def movement(s: np.ndarray, k: int, n: int) -> np.ndarray:
    """Return lateral and up displacement of epoch k (2, chainage)."""
    slide = 0.8 * k / max(n - 1, 1) * _bump(s, *SLIDE)[0]
    sink = -0.25 * (k == n - 1 and k > 0) * _bump(s, *SETTLEMENT)[0]
    return np.stack([slide, sink])


def strain_change(s: np.ndarray, k: int, n: int) -> np.ndarray:
    slide = 0.8 * k / max(n - 1, 1) * _bump(s, *SLIDE)[1]
    sink = -0.25 * (k == n - 1 and k > 0) * _bump(s, *SETTLEMENT)[1]
    return np.stack([slide, sink]) * OD / 2


def headings(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuth and pitch (degree) of a wavy line with a few bends."""
    azimuth = 135 + 25 * np.sin(2 * np.pi * s / 2700)
    for place, angle in ((600, 8), (1490, -15), (2210, 90), (3050, -88), (3700, 12)):
        azimuth = azimuth + angle * np.clip((s - place) / 4.0, 0, 1)
    pitch = (
        3 * np.sin(2 * np.pi * s / 800)
        + 6 * np.sin(2 * np.pi * s / 3000)
        + 9 * (np.clip((s - 1700) / 4, 0, 1) - np.clip((s - 1760) / 4, 0, 1))
    )
    return azimuth, pitch


def weld_places(length_m: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    places = np.cumsum(
        rng.choice([12.2, 12.21, 11.6, 3.4], size=int(length_m / 10), p=[0.5, 0.3, 0.17, 0.03])
        + rng.normal(0, 0.05, int(length_m / 10))
    )
    return places[places < length_m - 5]
