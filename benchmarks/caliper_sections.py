"""Time of section fits: a million sections of 40 arms by the direct fit and by the full adjustment, against scikit-image.

Run with ``NUMBA_NUM_THREADS=1 python benchmarks/caliper_sections.py`` for one core; processor time is printed.
"""

from __future__ import annotations

import time

import numpy as np

from deform.geometry.circle import adjust_ellipse, fit_ellipse_direct


def points(n: int, arms: int = 40) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    angle = np.arange(arms) * 2 * np.pi / arms
    size = 0.25 + 0.0025 * np.cos(2 * (angle - rng.uniform(0, np.pi, (n, 1)))) + rng.normal(0, 2e-4, (n, arms))
    return size * np.sin(angle) + 0.001, size * np.cos(angle) - 0.002


def timed(function, *data) -> float:
    function(*(d[:100] for d in data))
    start = time.process_time()
    function(*data)
    return time.process_time() - start


def main() -> None:
    x, z = points(1_000_000)
    direct, full = timed(fit_ellipse_direct, x, z), timed(adjust_ellipse, x, z)
    print(f"direct fit           {direct:8.3f} s for 1e6 sections (bar 0.5)")
    print(f"full, covariance     {full:8.3f} s for 1e6 sections (bar 5)")
    try:
        from skimage.measure import EllipseModel
    except ImportError:
        print("scikit-image is not installed: no comparison")
        return
    some = 300
    start = time.process_time()
    for i in range(some):
        EllipseModel().estimate(np.stack([x[i], z[i]], axis=1))
    other = (time.process_time() - start) / some * 1e6
    print(f"scikit-image         {other:8.3f} s for 1e6 sections")
    print(f"that is {other / direct:.0f} times the direct fit, {other / full:.0f} times the full adjustment")


if __name__ == "__main__":
    main()
