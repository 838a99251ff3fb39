"""Time of section fits: a million sections of 40 arms by the direct fit and by the full adjustment, on one core.

Run with ``python -m benchmarks.caliper_sections``. Processor time is printed, the median of several turns. What no direct fit
undercuts is measured in the same turns: reading the points and forming the fourteen sums that its equations are made of. So is
scikit-image's ``EllipseModel``. Ratios hold on a loaded machine, seconds do not.
"""

from __future__ import annotations

import time

import numba
import numpy as np
from numba import njit

from deform.geometry._kernels_circle import BLOCK, section_sums
from deform.geometry.circle import adjust_ellipse, fit_ellipse_direct

SECTIONS, ARMS, TURNS, SOME = 1_000_000, 40, 5, 300


def points(n: int, arms: int = ARMS) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    angle = np.arange(arms) * 2 * np.pi / arms
    size = 0.25 + 0.0025 * np.cos(2 * (angle - rng.uniform(0, np.pi, (n, 1)))) + rng.normal(0, 2e-4, (n, arms))
    return size * np.sin(angle) + 0.001, size * np.cos(angle) - 0.002


@njit
def read(x, z):
    """Add all coordinates up: the points read once."""
    total = np.zeros(8)
    flat, other = x.reshape(-1, 8), z.reshape(-1, 8)
    for i in range(len(flat)):
        for k in range(8):
            total[k] += flat[i, k] + other[i, k]
    return total


@njit
def form_sums(x, z):
    """Read the points and form the sums of the direct fit, nothing more."""
    work, sums = np.empty((2, x.shape[1])), np.empty((BLOCK, 14))
    for i in range(len(x)):
        section_sums(x[i], z[i], 4.0, work, sums[i % BLOCK])
    return sums


def ellipse_models(x: np.ndarray, z: np.ndarray) -> None:
    from skimage.measure import EllipseModel

    for i in range(SOME):
        EllipseModel().estimate(np.stack([x[i], z[i]], axis=1))


def timed(function, *data) -> float:
    start = time.process_time()
    function(*data)
    return time.process_time() - start


def main() -> None:
    numba.set_num_threads(1)
    x, z = points(SECTIONS)
    contestants = {"read": read, "sums": form_sums, "direct": fit_ellipse_direct, "full": adjust_ellipse}
    try:
        import skimage  # noqa: F401  # only to see whether it is there

        contestants["scikit-image"] = ellipse_models
    except ImportError:
        print("scikit-image is not installed: no comparison with it")
    for function in contestants.values():
        function(x[:SOME], z[:SOME])
    turns = [{name: timed(f, x, z) for name, f in contestants.items()} for _ in range(TURNS)]
    seconds = {name: float(np.median([t[name] for t in turns])) for name in contestants}
    if "scikit-image" in seconds:
        seconds["scikit-image"] *= SECTIONS / SOME
    print(f"{SECTIONS:.0e} sections of {ARMS} arms, one core, median of {TURNS} turns")
    bars = {"direct": "bar 0.5", "full": "bar 5; with covariance and residuals"}
    for name, value in seconds.items():
        spread = [t[name] * (value / np.median([u[name] for u in turns])) for t in turns]
        print(f"{name:13s} {value:9.3f} s ({min(spread):.3f} to {max(spread):.3f})  {bars.get(name, '')}")
    print(f"the direct fit takes {seconds['direct'] / seconds['sums']:.2f} times its limit, reading and forming the sums")
    if "scikit-image" in seconds:
        ratio = {n: seconds["scikit-image"] / seconds[n] for n in ("direct", "full")}
        print(f"scikit-image takes {ratio['direct']:.0f} times the direct fit, {ratio['full']:.0f} times the full one (bar 100)")


if __name__ == "__main__":
    main()
