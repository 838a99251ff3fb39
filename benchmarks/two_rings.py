"""Tool-to-pipe angles of two rings against truth, and the noise of the pipe's curvature with and without their correction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.ndimage import maximum_filter1d

from benchmarks._caliper_line import CaliperLine, caliper_line
from deform.caliper.measure import measure
from deform.geometry.curvature import curvature
from deform.nav.trajectory import centreline
from deform.strain.bending import stated_turn_sigma
from deform.synthetic import truth

GAUGE_M, STRAIGHT = 2.0, 1e-3
AWAY_M = 4.0  # from bends: a gauge and a filter's reach
ANGLE_BAR_DEG, NOISE_BAR = 0.03, 0.5
RINGS = {"0.7, -0.7 m": (0.7, -0.7), "-0.9, -2.3 m": (-0.9, -2.3)}


@dataclass(frozen=True)
class Navigated:
    """A trajectory as navigation hands it on."""

    trajectory: xr.Dataset


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + 180.0) % 360.0 - 180.0


def angle_errors(line: CaliperLine, pose: xr.Dataset) -> dict[str, tuple[float, float, float]]:
    """Rms error, rms of the angle itself, and share within 1.96 sigma, of yaw and pitch while the tool moves on straight pipe."""
    t = truth.trajectory(line.passage)
    bend = np.hypot(*line.passage.line.curvature(pose.chainage.values))
    use = (np.interp(pose.time, t["time"], t["speed"]) > 0.1) & (bend < STRAIGHT)
    found = {}
    for name, tool, pipe in (("yaw", "tool_azimuth", "pipe_azimuth"), ("pitch", "tool_pitch", "pipe_pitch")):
        true = np.interp(pose.time, t["time"], wrapped(t[tool] - t[pipe]))[use]
        error = pose[name].values[use] - true
        within = np.abs(error) < 1.96 * pose[f"{name}_sigma"].values[use]
        found[name] = (float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(true**2))), float(within.mean()))
    return found


def curvature_noise(line: CaliperLine, pose: xr.Dataset) -> tuple[dict[str, float], dict[str, float]]:
    """Rms error of the horizontal and vertical curvature (1/m): of the tool, of the tool less the angles, of the centreline.

    The second result is the sigma that the two centrelines state.
    """
    t = truth.trajectory(line.passage)
    order = np.flatnonzero(np.diff(np.maximum.accumulate(t["chainage"]), prepend=-1.0) > 0)
    grid = np.arange(np.ceil(t["chainage"][order[0]]) + 1.0, t["chainage"][order[-1]] - 1.0, 0.1)
    time = np.interp(grid, t["chainage"][order], t["time"][order])
    bend = np.hypot(*line.passage.line.curvature(grid))
    straight = maximum_filter1d(bend, round(2 * AWAY_M / 0.1) + 1) < STRAIGHT

    def of(values: np.ndarray) -> np.ndarray:
        return np.interp(time, t["time"], np.unwrap(values, period=360.0))

    azimuth, pitch = of(t["tool_azimuth"]), of(t["tool_pitch"])
    true = curvature(grid, of(t["pipe_azimuth"]), of(t["pipe_pitch"]), GAUGE_M)

    def noise(azimuth: np.ndarray, pitch: np.ndarray) -> float:
        found = curvature(grid, azimuth, pitch, GAUGE_M)
        error = np.concatenate([(a - b)[straight] for a, b in zip(found, true, strict=True)])
        return float(np.sqrt(np.nanmean(error**2)))

    yaw, climb = (np.interp(time, pose.time.values, pose[n].values) for n in ("yaw", "pitch"))
    stated, result = {}, {"attitude of the tool": noise(azimuth, pitch)}
    result["less the angles of the rings"] = noise(azimuth - yaw, pitch - climb)
    for name, given in (("centreline without rings", None), ("centreline with rings", pose)):
        made = centreline(Navigated(line.trajectory), line.raw.header, None, given)
        along = (np.interp(grid, made.chainage, v) for v in (np.unwrap(made.azimuth, period=360.0), made.pitch.values))
        result[name] = noise(*along)
        stated[name] = np.radians(stated_turn_sigma(made.azimuth, GAUGE_M)) / GAUGE_M
    return result, stated


def main() -> None:
    """Print errors of the angles and of the curvature for two places of the rings."""
    for name, rings in RINGS.items():
        line = caliper_line(5, 1500.0, tool={"ring_offset_m": rings, "arms": 64})
        pose = measure(line.raw, line.trajectory).pose
        print(f"rings at {name} along the tool, 64 arms of {line.raw.header.caliper.noise_m * 1e3:.1f} mm, 1.5 km")
        for angle, (error, size, within) in angle_errors(line, pose).items():
            share = f"in 1.96 sigma {within:.1%}"
            print(f"  {angle:6s} rms error {error:.4f} degree (bar {ANGLE_BAR_DEG}), the angle {size:.3f}, {share}")
        noises, stated = curvature_noise(line, pose)
        tool = noises["attitude of the tool"]
        for what, noise in noises.items():
            print(f"  curvature, {what:29s} rms {noise:.2e} per metre, {noise / tool:.3f} of the tool's")
        for what, sigma in stated.items():
            print(f"  stated sigma, {what:26s} {sigma:.2e} per metre")
        ratio = noises["centreline with rings"] / noises["centreline without rings"]
        print(f"  centreline with rings, noise over that without: {ratio:.3f} (bar {NOISE_BAR})")


if __name__ == "__main__":
    main()
