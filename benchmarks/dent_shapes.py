"""Dents unlike those of the simulator, measured by the caliper room: errors of the depth, and how often its sigma holds.

Run with ``python -m benchmarks.dent_shapes [tool ...]``. The readings are made here, by shapes that the fit does not have: the
simulator and the fit share a family of shapes, and the fit's prior has its middle at the simulator's usual dent. In brackets:
how deep the arms read in the dents that were missed (least and most).
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks._caliper_line import FILL, arms_of, even_trajectory, header, still
from deform.caliper.dent_shape import wrap
from deform.caliper.measure import measure
from deform.options import RouteOptions, ToolOptions
from deform.run.raw import RawRun
from deform.synthetic import arms

LN10, SPACING, SPEED = np.log(10.0), 12.0, 1.2  # dents and welds stand so many metres apart; m/s
NEAR_M, NEAR_DEG = 0.3, 20.0  # a dent found within these is the true one
COUNT = 6  # dents of each kind and tool

Shape = Callable[[np.ndarray, np.ndarray], np.ndarray]
Pipe = tuple[float, float, int]  # outside diameter, wall (m), arms


@dataclass(frozen=True)
class Kind:
    """A kind of dent: shape of unit size, with ranges of length and width (m; of the diameter) and of depth (of the diameter)."""

    shape: Shape
    length: tuple[float, float]
    width: tuple[float, float]
    depth: tuple[float, float]


def bell(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.exp(-LN10 * (x**2 + y**2))


def cosine(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A bell of bounded support, full extents at a tenth of the depth."""
    return 0.5 * (1.0 + np.cos(np.pi * np.minimum(np.hypot(x, y) * 0.7952, 1.0)))


def tip(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A cone with a slightly rounded tip."""
    return np.clip(1.0 - 0.9 * (np.sqrt(x**2 + y**2 + 0.01) - 0.1), 0.0, None)


def flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A flat floor with steep, round walls."""
    return np.exp(-LN10 * np.hypot(x, y) ** 6)


def two(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Two apexes along the pipe, the second of three quarters of the depth."""
    return np.maximum(bell(2.2 * (x + 0.5), 1.3 * y), 0.75 * bell(2.2 * (x - 0.5), 1.3 * (y - 0.3)))


def beside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Two apexes around the pipe, the second of three quarters of the depth."""
    return np.maximum(bell(1.3 * x, 2.2 * (y + 0.5)), 0.75 * bell(1.3 * (x - 0.3), 2.2 * (y - 0.5)))


def rimmed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A bell that raised a rim of a tenth of its depth, and leans upstream."""
    lean = np.where(x > 0.0, 0.75 * x, 1.45 * x)
    return bell(lean, y) - 0.1 * np.exp(-LN10 * ((np.hypot(lean, y) - 1.3) / 0.5) ** 2)


KINDS = {
    "long, shallow": Kind(cosine, (0.9, 2.2), (0.35, 0.8), (0.01, 0.02)),
    "short, wide": Kind(cosine, (0.08, 0.16), (0.45, 0.9), (0.01, 0.03)),
    "sharp, narrow": Kind(tip, (0.06, 0.15), (0.18, 0.4), (0.012, 0.04)),
    "flat floor": Kind(flat, (0.15, 0.6), (0.2, 0.6), (0.01, 0.06)),
    "two apexes along": Kind(two, (0.4, 1.0), (0.25, 0.6), (0.012, 0.05)),
    "two apexes around": Kind(beside, (0.2, 0.6), (0.6, 1.2), (0.012, 0.05)),
    "leaning, with a rim": Kind(rimmed, (0.2, 0.6), (0.25, 0.7), (0.012, 0.05)),
    "the simulator's bell": Kind(bell, (0.15, 0.6), (0.25, 0.7), (0.01, 0.05)),
}
TOOLS = {
    "16 arms, 8 inch": (0.2191, 0.00635, 16),
    "40 arms, 20 inch": (0.508, 0.0127, 40),
    "64 arms, 36 inch": (0.9144, 0.0127, 64),
}


def drawn(kind: Kind, diameter: float, rng: np.random.Generator) -> pd.DataFrame:
    """Dents, one per joint, sizes even in the logarithm; none steeper than pipe can be pressed."""
    between = lambda low, high: np.exp(rng.uniform(np.log(low), np.log(high), COUNT))  # noqa: E731  # said once, used thrice
    length, width, depth = between(*kind.length), diameter * between(*kind.width), diameter * between(*kind.depth)
    place = SPACING * (1.5 + np.arange(COUNT)) + rng.uniform(-2.5, 2.5, COUNT)
    table = {"place": place, "clock": rng.uniform(0, 2 * np.pi, COUNT), "length": length, "width": width}
    return pd.DataFrame({**table, "depth": np.maximum(np.minimum(depth, 0.25 * np.minimum(length, width)), 0.01 * diameter)})


def passage(dents: pd.DataFrame, shape: Shape, pipe: Pipe, seed: int) -> tuple[RawRun, xr.Dataset, np.ndarray]:
    """A raw run over an oval pipe with a weld per joint: the tool wanders and rolls, arms have noise and drop out.

    Returned with its trajectory, and with the depth (m) of each dent where the luckiest arm crossed it.
    """
    diameter, wall, count = pipe
    rng = np.random.default_rng(seed)
    tool = ToolOptions(arms=count, ring_offset_m=(0.0,), speed_m_per_s=SPEED)
    time = np.arange(0.0, SPACING * (len(dents) + 2) / SPEED, 1.0 / tool.caliper_rate_hz)
    place, turn = SPEED * time, 0.7  # degree per second
    radius = np.full((time.size, count), 0.5 * diameter - wall)
    radius -= 1e-3 * (np.abs((place + SPACING / 2) % SPACING - SPACING / 2) < 0.012)[:, None]
    ray = arms.arm_angles(tool) + np.radians(turn) * time[:, None]
    right, up = (
        2e-3 * np.sin(place / s + rng.uniform(0, 6))[:, None] + 1e-4 * rng.normal(size=(time.size, 1)) for s in (3.1, 4.3)
    )
    oval = 0.25 * 0.003 * diameter
    found, crossed = radius.copy(), np.zeros(len(dents))
    for _ in range(4):  # where the ray from the tool's axis meets the wall
        clock = np.arctan2(right + found * np.sin(ray), up + found * np.cos(ray))
        rho = radius + oval * np.cos(2 * clock - 0.1 * place[:, None])
        for k, d in enumerate(dents.itertuples()):
            rows = np.abs(place - d.place) < 2.5 * d.length
            x, y = 2 * (place[rows, None] - d.place) / d.length, wrap(clock[rows] - d.clock) * diameter / d.width
            inward = d.depth * shape(x, y)
            rho[rows] -= inward
            crossed[k] = inward.max()
        along = right * np.sin(ray) + up * np.cos(ray)
        found = np.sqrt(rho**2 - (right**2 + up**2 - along**2)) - along
    found += rng.normal(0.0, tool.arm_noise_m, found.shape)
    packed = np.round(found / arms.PACKING_M).astype(np.uint16)
    packed[rng.random(found.shape) < 0.001] = FILL
    route = RouteOptions(outside_diameter_m=diameter, wall_m=wall, joint_m=SPACING)
    raw = RawRun(header(route, tool), still(), xr.Dataset(), arms_of(time, packed[:, None], tool))
    return raw, even_trajectory(time[-1], SPEED, turn), crossed


def peak(shape: Shape) -> float:
    """Greatest value of a shape: its depth, in the depth that was drawn."""
    x, y = np.meshgrid(*[np.linspace(-2, 2, 801)] * 2, indexing="ij")
    return float(shape(x, y).max())


def errors(kind: Kind, pipe: Pipe, seed: int) -> tuple[pd.DataFrame, int]:
    """True depth, what an arm crossed of it, error and sigma (m) of each dent, NaN where missed; how many were invented."""
    dents = drawn(kind, pipe[0], np.random.default_rng(seed))
    raw, trajectory, crossed = passage(dents, kind.shape, pipe, seed)
    found = measure(raw, trajectory).dents
    at, clock, depth, sigma = (found[n].values for n in ("chainage", "clock", "depth", "depth_sigma"))
    rows, free = [], np.ones(at.size, bool)
    for d, seen in zip(dents.itertuples(), crossed, strict=True):
        reach = np.abs(at - d.place) < max(NEAR_M, 0.6 * d.length)
        side = np.degrees(np.abs(wrap(np.radians(clock) - d.clock))) < max(NEAR_DEG, np.degrees(1.2 * d.width / pipe[0]))
        near = np.flatnonzero(reach & side)
        free[near] = False
        truth = d.depth * peak(kind.shape)
        best = near[np.argmax(depth[near])] if near.size else None
        rows.append((truth, seen, np.nan, np.nan) if best is None else (truth, seen, depth[best] - truth, sigma[best]))
    return pd.DataFrame(rows, columns=["depth", "crossed", "error", "sigma"]), int(free.sum())


def row(table: pd.DataFrame, invented: int) -> str:
    """One line of the printed table (mm)."""
    there = table.error.notna()
    e, s, part = 1e3 * table.error, 1e3 * table.sigma, table.error / table.depth
    z2, lost = (e / s)[there] ** 2, 1e3 * table.crossed[~there]
    missed = f"({lost.min():.1f}-{lost.max():.1f})" if lost.size else ""
    rms, rms_part = np.sqrt((e**2).mean()), 100 * np.sqrt((part**2).mean())
    sizes = f"{e.mean():8.2f} {rms:7.2f} {rms_part:6.1f} {e.abs().max():9.2f} {s.mean():11.2f}"
    return f"{there.sum():3d}/{len(table):<3d} {missed:10s} {invented:8d} {sizes} {(z2 < 1.96**2).mean():12.2f} {z2.mean():18.2f}"


def main() -> None:
    logging.disable(logging.WARNING)
    heading = "found (read mm)  invented  bias mm  rms mm  rms %  worst mm  mean sigma  within 1.96  normalised square"
    print(f"{'':40s}{heading}")
    for tool in sys.argv[1:] or TOOLS:
        found = []
        for seed, (name, kind) in enumerate(KINDS.items()):
            found.append(errors(kind, TOOLS[tool], seed + 1))
            print(f"{tool:18s}{name:22s}{row(*found[-1])}", flush=True)
        whole = row(pd.concat([table for table, _ in found]), sum(invented for _, invented in found))
        print(f"{tool:18s}{'all':22s}{whole}", flush=True)


if __name__ == "__main__":
    main()
