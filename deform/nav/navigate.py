"""A raw run in; trajectory, markers with their misclosures and diagnostics of the navigation out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.geometry import earth
from deform.nav import _kernels, marks, odometer
from deform.nav.alignment import Alignment, static_alignment
from deform.nav.compensation import compensation_table
from deform.nav.dead_reckoning import Reckoning, dead_reckon
from deform.nav.strapdown import Counts, Epochs, epoch_bounds, preintegrate
from deform.options import NavigationOptions
from deform.run import build
from deform.run.raw import RawRun

Floats = NDArray[np.float64]
Progress = Callable[[float], None] | None
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Navigation:
    """What the navigation of one run gives.

    Parameters
    ----------
    trajectory : group ``trajectory`` of the vocabulary (dim ``time``), about the IMU in the pipe, in the direction of travel.
    markers : group ``markers``: each marker with its misclosure before and after, and a remark where it was not believed.
    diagnostics : group ``navigation``: alignment, biases, mounting, scale with sigmas, innovations, second trajectory.
    """

    trajectory: xr.Dataset
    markers: xr.Dataset
    diagnostics: xr.Dataset


def navigate(
    raw: RawRun, options: NavigationOptions | None = None, control: xr.Dataset | None = None, progress: Progress = None
) -> Navigation:
    """Return the trajectory of a raw run.

    Parameters
    ----------
    raw : the raw run.
    options : options of the navigation.
    control : group ``control`` of the vocabulary: surveyed points with chainage, used beside the run's own markers.
    progress : called with the fraction done.

    Raises
    ------
    InputError
        With every fault that keeps the run from being navigated.
    """
    options = options or NavigationOptions()
    tell = progress or (lambda fraction: None)
    counts = _counts(raw)
    wheels = odometer.combine(raw, options)
    distance, stationary = wheels.distance[1:], wheels.stationary[1:]
    tell(0.2)
    launch = raw.header.launch
    end = first_rest(counts.time, stationary, launch.static_s)
    aligned = static_alignment(counts, 0, end, launch.latitude_deg, launch.height_m, raw.header.imu)
    passages = _passages(raw)
    bounds = epoch_bounds(counts.time, 1.0, passages["time"].values)
    epochs = preintegrate(counts, distance, bounds)
    tell(0.4)
    place = np.array([np.radians(launch.latitude_deg), np.radians(launch.longitude_deg), launch.height_m])
    reckoning = dead_reckon(epochs, place, aligned.attitude)
    corrected, heard = _through_marks(epochs, reckoning, passages, place)
    tell(0.6)
    states = _states(epochs, reckoning, corrected.path, place)
    trajectory = _trajectory(
        raw, counts, epochs, states, distance, wheels.speed[1:], stationary, corrected, heard, aligned, options
    )
    tell(1.0)
    return Navigation(trajectory, _markers(passages, heard, corrected, trajectory), _diagnostics(epochs, aligned, corrected))


def first_rest(time: Floats, stationary: NDArray[np.bool_], static_s: float) -> int:
    """Index of the last sample of the rest at the beginning, by the odometer and not beyond what the header says; 0 when none."""
    moving = np.flatnonzero(~stationary)
    end = int(moving[0]) - 1 if moving.size else len(time) - 1
    if static_s > 0:
        end = min(end, int(np.searchsorted(time, time[0] + static_s)) - 1)
    return max(end, 0)


def _counts(raw: RawRun) -> Counts:
    imu = raw.imu
    time = np.ascontiguousarray(imu["time"].values, float)
    usual = float(np.median(np.diff(time[:10001])))
    return Counts(
        time,
        np.ascontiguousarray(imu["gyro_count"].values, np.int32),
        np.ascontiguousarray(imu["accel_count"].values, np.int32),
        float(imu.attrs["gyro_pulse_rad"]),
        float(imu.attrs["accel_pulse_m_per_s"]),
        compensation_table(raw.header.imu),
        2.5 * usual,
    )


def _passages(raw: RawRun) -> xr.Dataset:
    if raw.passages is not None:
        return raw.passages
    names = ("name", "kind", "time", "latitude", "longitude", "height", "sigma_horizontal", "sigma_vertical")
    return build.dataset("passages", {name: [] for name in names})


def _through_marks(epochs: Epochs, reckoning: Reckoning, passages: xr.Dataset, place: Floats):
    time = passages["time"].values
    heard = np.flatnonzero(np.isfinite(time) & (time >= epochs.time[0]) & (time <= epochs.time[-1]))
    heard = heard[np.argsort(time[heard], kind="stable")]
    first = np.degrees(place[0]), np.degrees(place[1]), place[2]
    enu = np.column_stack(earth.enu_difference(*(passages[n].values[heard] for n in ("latitude", "longitude", "height")), *first))
    sigma = np.column_stack([passages[n].values[heard] for n in ("sigma_horizontal", "sigma_horizontal", "sigma_vertical")])
    epoch = np.abs(epochs.time[:, None] - time[heard]).argmin(axis=0) if heard.size else np.empty(0, int)
    return marks.correct_between_marks(reckoning.steps, epoch, enu, np.nan_to_num(sigma, nan=1.0)), heard


def _states(epochs: Epochs, reckoning: Reckoning, path: Floats, place: Floats) -> Floats:
    n = len(path)
    states = np.zeros((n, 27))
    latitude, longitude, height = earth.enu_shift(
        *(np.full(n, v) for v in (np.degrees(place[0]), np.degrees(place[1]), place[2])), *path.T
    )
    states[:, 0], states[:, 1], states[:, 2] = np.radians(latitude), np.radians(longitude), height
    states[:, 3:6] = np.gradient(path, epochs.time, axis=0)
    states[:, 6:15] = reckoning.attitudes.reshape(n, 9)
    return states


def _trajectory(raw, counts, epochs, states, distance, speed, stationary, corrected, heard, aligned, options) -> xr.Dataset:
    step = max(1, round(raw.header.imu.rate_hz / options.output_rate_hz))
    wanted = np.unique(np.concatenate([np.arange(0, counts.time.size, step), [counts.time.size - 1]]))
    offsets = np.searchsorted(wanted, epochs.bounds[:-1])
    out = np.empty((wanted.size, 12))
    _kernels.expand(*counts.arguments, epochs.bounds, counts.longest_gap, epochs.table, states, wanted, offsets, out)
    time = counts.time[wanted]
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corrected.path, axis=0), axis=1))])
    along = np.interp(distance[wanted], *_rising(distance[epochs.bounds], travel))
    markers = _passages(raw)["time"].values[heard][corrected.used] if heard.size else np.array([time[0]])
    away = np.abs(distance[wanted][:, None] - np.interp(markers, counts.time, distance)).min(axis=1)
    sigma = np.hypot(0.3, 2e-3 * away)
    azimuth_sigma = np.degrees(aligned.sigma[2])
    return build.dataset(
        "trajectory",
        {
            "time": time,
            "log_distance": distance[wanted],
            "chainage": raw.header.travel_sign * (along - along[0]),
            "chainage_sigma": sigma,
            "latitude": np.degrees(out[:, 0]),
            "longitude": np.degrees(out[:, 1]),
            "height": out[:, 2],
            "east_sigma": sigma,
            "north_sigma": sigma,
            "up_sigma": sigma,
            "azimuth": np.degrees(out[:, 6]) % 360.0,
            "azimuth_sigma": np.full(time.size, azimuth_sigma),
            "pitch": np.degrees(out[:, 7]),
            "pitch_sigma": np.full(time.size, np.degrees(aligned.sigma[0])),
            "roll": np.degrees(out[:, 8]),
            "speed": speed[wanted],
            "velocity_east": out[:, 3],
            "velocity_north": out[:, 4],
            "velocity_up": out[:, 5],
            "stationary": stationary[wanted],
        },
    )


def _rising(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    keep = np.concatenate([[True], np.diff(x) > 0])
    return x[keep], y[keep]


def _markers(passages: xr.Dataset, heard: NDArray, corrected: marks.MarkCorrection, trajectory: xr.Dataset) -> xr.Dataset:
    n = passages.sizes["marker"]
    before, used = np.full((n, 3), np.nan), np.zeros(n, bool)
    before[heard], used[heard] = corrected.misfit, corrected.used
    time, at = passages["time"].values, trajectory["time"].values
    place = [np.interp(time, at, trajectory[v].values, left=np.nan, right=np.nan) for v in ("latitude", "longitude", "height")]
    after = np.column_stack(earth.enu_difference(*place, *(passages[v].values for v in ("latitude", "longitude", "height"))))
    remark = np.where(np.isnan(time), "passage not heard", np.where(used, "", "contradicts its neighbours: left out"))
    values = {name: passages[name].values for name in passages.variables}
    values["chainage"] = np.interp(time, at, trajectory["chainage"].values, left=np.nan, right=np.nan)
    for i, axis in enumerate(("east", "north", "up")):
        values[f"misclosure_{axis}_before"], values[f"misclosure_{axis}_after"] = before[:, i], after[:, i]
    return build.dataset("markers", {**values, "used": used, "remark": remark})


def _diagnostics(epochs: Epochs, aligned: Alignment, corrected: marks.MarkCorrection) -> xr.Dataset:
    azimuth, pitch, roll = aligned.angles
    sigma = np.degrees(aligned.sigma)
    values = {
        "time": epochs.time,
        "alignment_azimuth": azimuth,
        "alignment_azimuth_sigma": sigma[2],
        "alignment_pitch": pitch,
        "alignment_pitch_sigma": sigma[0],
        "alignment_roll": roll,
        "alignment_roll_sigma": sigma[1],
    }
    if len(corrected.turns):
        values |= {
            "mounting_azimuth": np.degrees(corrected.turns[:, 0]).mean(),
            "mounting_pitch": np.degrees(corrected.turns[:, 1]).mean(),
        }
    return build.dataset("navigation", values, alignment_method=aligned.method)
