"""A solution on epochs and the counts in; trajectory, markers and diagnostics as datasets out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.nav import _kernels_expand, _kernels_state
from deform.nav.alignment import Alignment
from deform.nav.odometer import OdometerSolution
from deform.nav.reverse import Agreement
from deform.nav.second_path import SecondPath
from deform.nav.slips import SlipsSeen
from deform.nav.solution import NO_WEIGHT, Solution
from deform.nav.strapdown import Counts
from deform.nav.trajectory import decimation, trajectory
from deform.options import NavigationOptions
from deform.run import build
from deform.run.raw import RawRun

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Checks:
    """Independent looks at the same run."""

    second: SecondPath
    backward: Agreement
    slips: SlipsSeen
    gaps: Sequence[str] = ()

    @property
    def remarks(self) -> list[str]:
        """What contradicts the trajectory, or is hidden from it, in words."""
        return [text for text in (self.slips.remark(), self.second.remark(), self.backward.remark(), *self.gaps) if text]


MOST_EPOCHS = 20_000  # rows of the diagnostics


def trajectory_dataset(
    raw: RawRun, counts: Counts, solution: Solution, wheels: OdometerSolution, options: NavigationOptions
) -> xr.Dataset:
    """Return the group ``trajectory``: the counts integrated once more inside each epoch, from and to its smoothed states."""
    epochs, states = solution.problem.epochs, solution.smoothed.states
    step = decimation(raw.header.imu.rate_hz, options)
    wanted = np.arange(0, counts.time.size, step)
    if wanted[-1] != counts.time.size - 1:
        wanted = np.append(wanted, counts.time.size - 1)
    spread = sigmas(solution)
    out = np.empty((10 + len(spread), wanted.size))
    offsets = np.searchsorted(wanted, epochs.bounds[:-1])
    spreads = np.column_stack(list(spread.values()))
    arguments = (*counts.arguments, epochs.bounds, counts.step, epochs.table, states, spreads, wanted, offsets, out)
    _kernels_expand.expand(*arguments)
    for row in (0, 1, 6, 7, 8):
        np.degrees(out[row], out=out[row])
    out[6] %= 360.0
    time = counts.time[wanted]
    distance, _, _, stationary = wheels.profile.at(time)
    out[9][stationary] = 0.0
    names = ("latitude", "longitude", "height", "velocity_east", "velocity_north", "velocity_up", "azimuth", "pitch", "roll",
             "speed", *spread)  # fmt: skip
    values: dict[str, Any] = {"time": time, "log_distance": distance, "stationary": stationary}
    values |= dict(zip(names, out, strict=True))
    return trajectory(values, raw.header, raw.passages, raw.weld_events)


def sigmas(solution: Solution) -> dict[str, Floats]:
    """Standard deviations at the epochs: position (m), chainage (m), azimuth and pitch (degree)."""
    sigma, matrix = solution.smoothed.sigma, solution.smoothed.states[:, 6:15].reshape(-1, 3, 3)
    forward = matrix[:, :, 1]
    level = np.maximum(np.hypot(forward[:, 0], forward[:, 1]), 1e-3)
    along = np.sqrt(np.sum((forward * sigma[:, :3]) ** 2, axis=1))
    east, north = forward[:, 0] / level, forward[:, 1] / level  # horizontal part of the forward axis
    return {
        "east_sigma": sigma[:, 0],
        "north_sigma": sigma[:, 1],
        "up_sigma": sigma[:, 2],
        "chainage_sigma": along,
        "azimuth_sigma": np.degrees(
            np.hypot(sigma[:, 8], np.hypot(sigma[:, 6] * east, sigma[:, 7] * north) * forward[:, 2] / level)
        ),
        "pitch_sigma": np.degrees(np.hypot(sigma[:, 6] * north, sigma[:, 7] * east)),
    }


def marker_dataset(
    raw: RawRun, passages: xr.Dataset, solution: Solution, line: xr.Dataset, remarks: dict[int, str]
) -> xr.Dataset:
    """Return the group ``markers``: misclosures before (without the mark itself) and after, and what is wrong with it."""
    marks, n = solution.problem.marks, passages.sizes["marker"]
    own = marks.index < n
    before, after, used = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.zeros(n, bool)
    before[marks.index[own]], after[marks.index[own]] = solution.left_out[own], solution.closed[own]
    used[marks.index[own]] = marks.weight[own] > NO_WEIGHT
    time = passages["time"].values
    values: dict[str, Any] = {str(name): passages[name].values for name in passages.variables}
    values["chainage"] = np.interp(time, line["time"].values, line["chainage"].values, left=np.nan, right=np.nan)
    for i, axis in enumerate(("east", "north", "up")):
        values[f"misclosure_{axis}_before"], values[f"misclosure_{axis}_after"] = before[:, i], after[:, i]
    remark = [remarks.get(i, "passage not heard" if np.isnan(time[i]) else "") for i in range(n)]
    return build.dataset("markers", {**values, "used": used, "remark": remark})


def diagnostics_dataset(solution: Solution, aligned: Alignment, checks: Checks) -> xr.Dataset:
    """Return the group ``navigation``."""
    problem, smoothed = solution.problem, solution.smoothed
    keep = slice(None, None, max(1, -(-problem.epochs.time.size // MOST_EPOCHS)))
    model, k = problem.model, _kernels_state
    values: dict[str, Any] = {"time": problem.epochs.time[keep]}
    per_hour = np.degrees(1.0) * 3600.0
    values |= _with_sigma("gyro_bias", smoothed.states[keep, k.GYRO_BIAS : k.GYRO_BIAS + 3] * per_hour,
                          smoothed.sigma[keep, model.index("gyro_bias")] * per_hour)  # fmt: skip
    values |= _with_sigma("accel_bias", smoothed.states[keep, k.ACCEL_BIAS : k.ACCEL_BIAS + 3],
                          smoothed.sigma[keep, model.index("accel_bias")])  # fmt: skip
    if model.at[k.B_SCALE] >= 0:
        values |= _with_sigma("odometer_scale", smoothed.states[keep, k.SCALE], smoothed.sigma[keep, model.index("scale")][:, 0])
    if model.at[k.B_MOUNTING] >= 0:
        mounting, sigma = (
            np.degrees(smoothed.states[-1, k.MOUNTING :][:2]),
            np.degrees(smoothed.sigma[-1, model.index("mounting")]),
        )
        values |= _with_sigma("mounting_azimuth", mounting[0], sigma[0]) | _with_sigma("mounting_pitch", mounting[1], sigma[1])
    if model.at[k.B_DELAY] >= 0:
        values |= _with_sigma("delay", smoothed.states[-1, k.DELAY], smoothed.sigma[-1, model.index("delay")][0])
    if model.at[k.B_LEVER] >= 0:
        last, sigma = smoothed.states[-1], smoothed.sigma[-1]
        lean, spread = np.degrees(last[k.LEAN : k.LEAN + 2]), np.degrees(sigma[model.index("lean")])
        values |= _with_sigma("lever", last[k.LEVER], sigma[model.index("lever")][0])
        values |= _with_sigma("lean_right", lean[0], spread[0]) | _with_sigma("lean_up", lean[1], spread[1])
    for name, *angle in zip(("azimuth", "pitch", "roll"), aligned.angles, aligned.angle_sigma, strict=True):
        values |= _with_sigma(f"alignment_{name}", *angle)
    values |= _innovations(solution)
    news = np.concatenate([np.full((1, 3), np.nan), solution.filtered.news])  # of the epoch that ends at each time
    values |= {f"innovation_{axis}": news[keep, i] for i, axis in enumerate(("along", "right", "up"))}
    second, backward = checks.second, checks.backward
    for i, axis in enumerate(("east", "north", "up")):
        values |= _with_sigma(f"reckoning_{axis}", second.difference[keep, i], second.sigma[keep, i])
        values |= _with_sigma(f"backward_{axis}", backward.difference[:, i], backward.sigma[:, i])
    values |= _with_sigma("backward_azimuth", *np.degrees([backward.difference[:, 3], backward.sigma[:, 3]]))
    values["backward_time"] = backward.time
    words = "\n".join(checks.remarks)
    return build.dataset("navigation", values, error_model=model.name, alignment_method=aligned.method, remarks=words)


def _with_sigma(name: str, value: Any, sigma: Any) -> dict[str, Any]:
    return {name: value, f"{name}_sigma": sigma}


def _innovations(solution: Solution) -> dict[str, Any]:
    news, still = solution.filtered.news, solution.problem.travel.stationary
    kinds: dict[str, Floats] = {}
    for i, axis in enumerate(("along", "right", "up")):
        kinds[f"travel {axis}"] = news[~still, i]
    kinds["rest"] = news[still].ravel()
    m = solution.filtered.mark_news
    for i, axis in enumerate(("along", "across", "up")):
        kinds[f"mark {axis}"] = m[:, i] / np.sqrt(m[:, 3 + i])
    kinds = {name: v[np.isfinite(v)] for name, v in kinds.items()}
    return {
        "kind": list(kinds),
        "innovation_count": [v.size for v in kinds.values()],
        "innovation_square": [float(np.mean(v**2)) if v.size else np.nan for v in kinds.values()],
        "innovation_outliers": [int((np.abs(v) > 4.0).sum()) for v in kinds.values()],
    }
