"""Two simulated runs of one line that differ in nothing but errors: each against truth, and one against the other."""

from __future__ import annotations

import datetime
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from deform.geometry.earth import enu_difference
from deform.nav.navigate import Navigation, navigate
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.run.raw import RawRun
from deform.synthetic._kernels import AZIMUTH
from deform.synthetic.in_memory import passages_of, raw_run
from deform.synthetic.motion import TRAP_M
from deform.synthetic.simulate import Passage, built_line, passage_of

PLACE_M = 10.0  # spacing of the places at which runs are compared
NEVER_M = 1e9  # spacing of valves, whose places would count as further markers


@dataclass(frozen=True)
class Simulated:
    """One run as it was and as the tool recorded it."""

    options: SimulateOptions
    passage: Passage
    raw: RawRun

    def navigated(self, draw: int, marker_sigma: float, kinds: tuple[str, ...] = ("launcher", "agm", "receiver")) -> Navigation:
        """Navigate with markers of these kinds, whose errors are of another draw and of this sigma (m)."""
        tool = replace(self.passage.tool, marker_noise_m=marker_sigma)
        drawn = replace(self.options, seed=self.options.seed + 1000 * draw)
        heard = passages_of(replace(self.passage, tool=tool), drawn)
        heard = heard.isel(marker=np.isin(heard["kind"].values.astype(str), kinds))
        return navigate(replace(self.raw, passages=heard))


@dataclass(frozen=True)
class Errors:
    """Of one run at the places: along, to the right, up (n, 3) in m, and the sigma stated of east, north, up (n, 3)."""

    off: np.ndarray
    enu: np.ndarray
    sigma: np.ndarray

    @property
    def square(self) -> tuple[float, float]:
        """Mean square of the errors over the sigma stated, horizontal and up; 1 when the sigma is honest."""
        normal = (self.enu / self.sigma) ** 2
        return float(normal[:, :2].mean()), float(normal[:, 2].mean())

    @property
    def inside(self) -> np.ndarray:
        """Share of the places inside 1.96 sigma, east, north, up."""
        return np.mean(np.abs(self.enu) < 1.96 * self.sigma, axis=0)


def two_runs(name: str, grade: str, route: RouteOptions, tool: dict, seed: int = 7) -> tuple[Simulated, Simulated]:
    """Simulate two runs of one line a month apart, with wheels and markers, without arms; all markers are heard."""
    own = ToolOptions(imu=grade, caliper=False, unheard=0.0, **tool)
    runs = tuple(RunOptions(id=f"{name}-{k}", date=datetime.date(2014, k, 1)) for k in (1, 2))
    options = SimulateOptions(line=name, seed=seed, route=replace(route, valve_spacing_m=NEVER_M), tool=own, runs=runs)
    line = built_line(options)
    passages = [passage_of(options, line, k) for k in range(2)]
    first, second = (Simulated(options, p, raw_run(p, options)) for p in passages)
    return first, second


def places_of(run: Simulated, step: float = PLACE_M) -> np.ndarray:
    """Chainages of the line at which runs are compared: from the first to the last place of the tool."""
    return np.arange(TRAP_M + 1.0, run.passage.line.length - TRAP_M - 1.0, step)


def errors(run: Simulated, path: xr.Dataset, places: np.ndarray) -> Errors:
    """Errors of a path (``trajectory`` or ``centreline``) where the tool truly was at these chainages.

    Two runs are so compared at the same steel, as a matching weld by weld does it.
    """
    line, time = run.passage.line, path["time"].values
    at = run.passage.motion.passage(places)
    found = (np.interp(at, time, path[name].values) for name in ("latitude", "longitude", "height"))
    enu = np.column_stack(enu_difference(*found, *line.position(places)))
    sigma = np.column_stack([np.interp(at, time, path[f"{axis}_sigma"].values) for axis in ("east", "north", "up")])
    azimuth = line.at(places, AZIMUTH)[:, 0]
    along = enu[:, 0] * np.sin(azimuth) + enu[:, 1] * np.cos(azimuth)
    right = enu[:, 0] * np.cos(azimuth) - enu[:, 1] * np.sin(azimuth)
    return Errors(np.column_stack([along, right, enu[:, 2]]), enu, sigma)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
