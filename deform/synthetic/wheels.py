"""A motion and the wheels of a tool in, cumulative odometer pulses out, with every slip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.options import ToolOptions
from deform.synthetic._kernels import AZIMUTH, PITCH, ROLL
from deform.synthetic.motion import Motion
from deform.synthetic.route import stream

Floats = NDArray[Any]


def roll_wheels(
    motion: Motion, tool: ToolOptions, seed: int, name: str
) -> tuple[Floats, NDArray[np.int64], Floats, pd.DataFrame]:
    """Return time (n,), counts (n, wheel), scale error of each wheel, and the slips.

    Notes
    -----
    A wheel at the clock c on a wall of radius r travels 1 - κh r sin c - κv r cos c per metre of centreline: less on the
    inside of a bend. Opposite wheels cancel it. Scale and wear (a share of the way gone) come on top, slips take away.
    """
    rng = stream(seed, name, "wheels")
    time = np.arange(int(motion.duration * tool.wheel_rate_hz + 1e-6) + 1) / tool.wheel_rate_hz
    distance, _ = motion.distance(time)
    scale = rng.normal(0.0, tool.wheel_scale, tool.wheels)
    wear = np.abs(rng.normal(0.0, tool.wheel_wear_per_km, tool.wheels)) / 1000.0
    slips = _slips(motion, tool, rng)
    steps = np.diff(distance)
    middle = distance[:-1] + 0.5 * steps
    turned = motion.line.at(middle, ROLL)[:, 0]
    behind = np.clip(middle + tool.wheel_lever_m, 0.0, motion.line.length)
    pitch = motion.line.at(behind, PITCH)
    horizontal = motion.line.at(behind, AZIMUTH)[:, 1] * np.cos(pitch[:, 0])
    radius = 0.5 * motion.line.outside_diameter - float(np.median(motion.line.joints.wall_m))
    count = np.empty((time.size, tool.wheels), np.int64)
    for w in range(tool.wheels):
        clock = 2 * np.pi * w / tool.wheels + turned
        way = steps * (1.0 - radius * (horizontal * np.sin(clock) + pitch[:, 1] * np.cos(clock)))
        way *= 1.0 + scale[w] - wear[w] * (middle - distance[0])
        own = slips[slips.wheel == w][["time_s", "duration_s", "fraction_lost"]].to_numpy()
        for at, lasts, lost in own:
            way[(time[1:] > at) & (time[1:] <= at + lasts)] *= 1.0 - lost
        count[:, w] = np.floor(np.append(0.0, np.cumsum(way)) / tool.wheel_pulse_m)
    return time, count, scale, slips


def _slips(motion: Motion, tool: ToolOptions, rng: np.random.Generator) -> pd.DataFrame:
    """Slips of single wheels; a third of them are stalls."""
    number = int(rng.poisson(tool.slips_per_km * motion.line.length / 1000.0))
    frame = pd.DataFrame(
        {
            "wheel": rng.integers(0, tool.wheels, number),
            "time_s": rng.uniform(motion.begin, motion.end, number),
            "duration_s": rng.uniform(1.0, 6.0, number),
            "fraction_lost": np.where(rng.random(number) < 0.33, 1.0, rng.uniform(0.15, 0.9, number)),
        }
    )
    return frame.sort_values("time_s").reset_index(drop=True)
