"""Curvature over a gauge length: one fused pass against numpy with a Savitzky-Golay derivative, in the same run."""

from __future__ import annotations

import time

import numpy as np
from scipy.signal import savgol_filter

from deform.geometry.curvature import curvature

GAUGE_M, STEP_M = 2.0, 0.1


def with_savgol(azimuth, pitch):
    """The usual way: unwrap, differentiate a quadratic over the gauge, multiply by the cosine."""
    window = round(GAUGE_M / STEP_M) | 1
    turn = savgol_filter(np.unwrap(np.radians(azimuth)), window, 2, deriv=1, delta=STEP_M)
    return np.cos(np.radians(pitch)) * turn, savgol_filter(np.radians(pitch), window, 2, deriv=1, delta=STEP_M)


def best_of(call, times=3):
    took = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        took.append(time.perf_counter() - start)
    return min(took)


def main(samples: int = 5_000_000) -> None:
    """Print samples per second of both and their ratio, and that a circle comes out the same."""
    rng = np.random.default_rng(0)
    chainage = STEP_M * np.arange(samples)
    azimuth = (90.0 + np.degrees(chainage / 500.0) + np.cumsum(rng.normal(0.0, 0.01, samples))) % 360.0
    pitch = 5.0 * np.sin(chainage / 300.0)
    curvature(chainage[:1000], azimuth[:1000], pitch[:1000], GAUGE_M)
    ours, theirs = best_of(lambda: curvature(chainage, azimuth, pitch, GAUGE_M)), best_of(lambda: with_savgol(azimuth, pitch), 1)
    rates = samples / ours / 1e6, samples / theirs / 1e6
    print(f"one pass {rates[0]:.1f} M samples/s, numpy + savgol {rates[1]:.2f} M: {theirs / ours:.0f} times as fast")
    circle = 90.0 + np.degrees(chainage[:1000] / 500.0)
    apart = curvature(chainage[:1000], circle, np.zeros(1000), GAUGE_M)[0] - with_savgol(circle, np.zeros(1000))[0]
    print(f"on a circle of 500 m they differ by {np.nanmax(np.abs(apart[20:-20])):.1e} per metre")


if __name__ == "__main__":
    main()
