"""Repeatability of the centreline, Li et al. (2014): two runs over 30 km, sensors of his table 1, markers every 2 km.

The errors of the markers are independent between the runs and drawn several times over. Places are compared at the same steel.
Printed beside the differences is what both runs state of themselves, and the least that any method can reach.
"""

from __future__ import annotations

import numpy as np

from benchmarks._path_limit import path_limit
from benchmarks._two_runs import Errors, Simulated, errors, places_of, rms, two_runs
from deform.options import RouteOptions
from deform.synthetic import imu

LENGTH_M, MARKERS_M, SPEED = 30_000.0, 2000.0, 1.16
SIGMAS_M = (0.3, 1.0)  # of the markers
DRAWS = 3
BAR_M, THEIRS_M = 0.20, (0.35, 0.74)
AXES = ("along", "right", "up")


def least(runs: tuple[Simulated, Simulated], sigma: float, places: np.ndarray) -> np.ndarray:
    """Least rms (along, right, up) of the difference of both runs with markers of this sigma."""
    squares = np.zeros(3)
    for run in runs:
        length = run.passage.line.length
        markers = np.arange(MARKERS_M, length - 0.5 * MARKERS_M, MARKERS_M)
        limit = path_limit(run.passage, imu.grade_of(run.passage.tool), markers, sigma)
        squares += [np.mean(np.interp(places, limit.places, limit.sigma[:, k]) ** 2) for k in range(3)]
    return np.sqrt(squares)


def report(sigma: float, found: list[tuple[Errors, Errors]], limit: np.ndarray) -> None:
    """Print the differences of all draws together."""
    apart = np.concatenate([a.off - b.off for a, b in found])
    stated = np.sqrt(np.mean(np.concatenate([a.sigma**2 + b.sigma**2 for a, b in found]), axis=0))
    level, up = rms(np.hypot(apart[:, 0], apart[:, 1])), rms(apart[:, 2])
    level_stated, level_limit = np.hypot(*stated[:2]), np.hypot(*limit[:2])
    print(f"\nmarkers of sigma {sigma:g} m, {len(found)} draws of their errors, both runs: rms of the difference (1 sigma)")
    for axis, size, least_size in zip(AXES, (rms(a) for a in apart.T), limit, strict=True):
        print(f"  {axis:22s} {size:.3f} m   least {least_size:.3f} m, ratio {size / least_size:.2f}")
    bar = f" (bar {BAR_M:g} m; Li {{:g}} m)" if sigma == SIGMAS_M[0] else ""
    for name, size, said, lowest, theirs in (("horizontal, both axes", level, level_stated, level_limit, THEIRS_M[0]),
                                            ("vertical", up, stated[2], limit[2], THEIRS_M[1])):  # fmt: skip
        print(f"  {name:22s} {size:.3f} m   least {lowest:.3f} m, ratio {size / lowest:.2f}; "
              f"both runs state {said:.3f} m, ratio {size / said:.2f}{bar.format(theirs)}")  # fmt: skip
    for k, one in enumerate(zip(*found, strict=True)):
        square = np.mean([e.square for e in one], axis=0)
        inside = np.mean([e.inside for e in one], axis=0)
        print(f"  run {k + 1} against truth: mean square over sigma {square[0]:.2f} horizontal, {square[1]:.2f} up; "
              f"inside 1.96 sigma {', '.join(f'{x:.2f}' for x in inside)} (east, north, up)")  # fmt: skip


def main(draws: int = DRAWS) -> None:
    """Simulate two runs and print how far they lie apart, for each sigma of the markers."""
    route = RouteOptions(length_m=LENGTH_M, marker_spacing_m=MARKERS_M)
    runs = two_runs("li", "li-2014", route, {"speed_m_per_s": SPEED, "stops": 3})
    places = places_of(runs[0])
    print(f"two runs over {places[-1] / 1000:.1f} km, {runs[0].passage.motion.duration / 3600:.1f} h at 200 Hz")
    for sigma in SIGMAS_M:
        found = []
        for draw in range(draws):
            one, other = (errors(run, run.navigated(draw, sigma).trajectory, places) for run in runs)
            found.append((one, other))
        report(sigma, found, least(runs, sigma, places))


if __name__ == "__main__":
    main()
