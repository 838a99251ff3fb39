"""Porter's unit (1990): 10 °/h gyros, pulses of 25 arc seconds, 16 Hz; 10 km of a 12-inch line with points every 500 m.

Errors of the position between the points, and how well the curvature of two runs agrees at the same steel.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from benchmarks._path_limit import path_limit
from benchmarks._two_runs import Simulated, errors, places_of, rms, two_runs
from deform.geometry.curvature import curvature
from deform.nav.navigate import Navigation
from deform.nav.trajectory import centreline
from deform.options import RouteOptions
from deform.strain.bending import standardised_percent, stated_turn_sigma
from deform.synthetic import imu

LENGTH_M, POINTS_M, POINT_SIGMA_M = 10_000.0, 500.0, 0.3
GAUGE_M, PLACE_M = 2.0, 0.5
POSITION_BAR_M, CURVATURE_BAR = 5.0, 0.03  # percent, standardised
THEIRS_M, THEIR_CURVATURE = 30.0, 0.1
COMPONENTS = ("horizontal", "vertical")


def position(run: Simulated, found: Navigation, points_m: float) -> str:
    """Errors between the points of one run, with the least that they can be."""
    places = places_of(run)
    off = errors(run, found.trajectory, places)
    level = np.hypot(off.off[:, 0], off.off[:, 1])
    points = np.arange(points_m, run.passage.line.length - 0.5 * points_m, points_m)
    limit = path_limit(run.passage, imu.grade_of(run.passage.tool), points, POINT_SIGMA_M).sigma
    least = np.sqrt(np.mean(limit**2, axis=0))
    inside = ", ".join(f"{x:.2f}" for x in off.inside)
    return (
        f"horizontal rms {rms(level):.2f} m (least {np.hypot(*least[:2]):.2f}), largest {level.max():.2f} m; "
        f"up rms {rms(off.off[:, 2]):.2f} m (least {least[2]:.2f}), largest {np.abs(off.off[:, 2]).max():.2f} m; "
        f"mean square over sigma {off.square[0]:.2f} and {off.square[1]:.2f}; inside 1.96 sigma {inside}"
    )


def bends(run: Simulated, line: xr.Dataset, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standardised curvature (n, 2), horizontal and vertical, where the tool truly was at the places, and its stated sigma."""
    diameter = run.passage.line.outside_diameter
    found = curvature(line["chainage"].values, line["azimuth"].values, line["pitch"].values, GAUGE_M)
    at = run.passage.motion.passage(places)
    here = np.column_stack([np.interp(at, line["time"].values, c) for c in found])
    sigma = np.radians([stated_turn_sigma(line[name], GAUGE_M) for name in ("azimuth", "pitch")]) / GAUGE_M
    return standardised_percent(here, diameter), standardised_percent(sigma, diameter)


def agreement(runs: tuple[Simulated, Simulated], lines: list[xr.Dataset]) -> None:
    """Print how the curvature of both runs differs."""
    places = places_of(runs[0], PLACE_M)[20:-20]
    (one, sigma), (other, other_sigma) = (bends(run, line, places) for run, line in zip(runs, lines, strict=True))
    apart, stated = one - other, np.hypot(sigma, other_sigma)
    for k, name in enumerate(COMPONENTS):
        d = np.abs(apart[:, k])
        size, share = f"{rms(d):.4f} % (bar {CURVATURE_BAR} %, Porter {THEIR_CURVATURE} %)", np.mean(d < CURVATURE_BAR)
        print(f"  curvature, {name}: rms of the difference {size}, both runs state {stated[k]:.4f} %, "
              f"ratio {rms(d) / stated[k]:.2f}; 95 % below {np.quantile(d, 0.95):.4f} %, largest {d.max():.3f} %, "
              f"{share:.4f} of the line within the bar")  # fmt: skip


def main() -> None:
    """Print position and curvature of two runs, with all points and with the two ends alone."""
    route = RouteOptions(length_m=LENGTH_M, marker_spacing_m=POINTS_M, latitude_deg=65.3, longitude_deg=-126.9)
    runs = two_runs("porter", "porter-1990", route, {"stops": 2})
    print(f"two runs over {LENGTH_M / 1000:.0f} km, points every {POINTS_M:.0f} m of sigma {POINT_SIGMA_M} m")
    lines = []
    for k, run in enumerate(runs):
        found = run.navigated(0, POINT_SIGMA_M)
        lines.append(centreline(found, run.raw.header))
        print(f"  run {k + 1}: {position(run, found, POINTS_M)} (bar {POSITION_BAR_M:g} m)")
    agreement(runs, lines)
    for k, run in enumerate(runs):
        ends = run.navigated(0, POINT_SIGMA_M, ("launcher", "receiver"))
        print(f"  run {k + 1}, its ends alone (Porter ±{THEIRS_M:g} m): {position(run, ends, LENGTH_M)}")


if __name__ == "__main__":
    main()
