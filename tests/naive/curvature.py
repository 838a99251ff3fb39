"""Curvature over a gauge length, written down as it is defined, place by place."""

from __future__ import annotations

import numpy as np


def curvature(chainage, azimuth, pitch, gauge_length):
    turned = np.zeros(chainage.size)
    for i in range(1, chainage.size):
        turn = np.radians((azimuth[i] - azimuth[i - 1] + 180.0) % 360.0 - 180.0)
        cosine = 0.5 * (np.cos(np.radians(pitch[i])) + np.cos(np.radians(pitch[i - 1])))
        turned[i] = turned[i - 1] + cosine * turn
    horizontal, vertical = np.full(chainage.size, np.nan), np.full(chainage.size, np.nan)
    for i, s in enumerate(chainage):
        a, b = s - gauge_length / 2, s + gauge_length / 2
        if a < chainage[0] - 1e-9 or b > chainage[-1] + 1e-9:
            continue
        horizontal[i] = (np.interp(b, chainage, turned) - np.interp(a, chainage, turned)) / gauge_length
        vertical[i] = np.radians(np.interp(b, chainage, pitch) - np.interp(a, chainage, pitch)) / gauge_length
    return horizontal, vertical
