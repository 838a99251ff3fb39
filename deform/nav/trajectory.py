"""What navigation found on time in; the `trajectory` on time with chainage, and the `centreline` on regular chainage out."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.errors import Fault, InputError
from deform.geometry.earth import enu_shift
from deform.geometry.resample import interpolate, interpolate_angle, regular_grid
from deform.nav.pipe_direction import TURN_LAGS_M, direction_along
from deform.options import NavigationOptions
from deform.run import build
from deform.run.raw import RunHeader

Floats = NDArray[Any]
_log = logging.getLogger(__name__)

_LEAST_ADVANCE_M = 1e-4  # advance along the pipe by which a sample counts as a new place


class HasTrajectory(Protocol):
    """What `centreline` needs of a `Navigation`."""

    @property
    def trajectory(self) -> xr.Dataset:
        """Group ``trajectory``."""


def decimation(rate_hz: float, options: NavigationOptions) -> int:
    """Return the number of IMU samples per sample of the trajectory.

    Examples
    --------
    >>> decimation(100.0, NavigationOptions(output_rate_hz=20.0))
    5
    """
    return max(int(rate_hz / options.output_rate_hz + 1e-9), 1)


def trajectory(
    values: Mapping[str, Floats],
    header: RunHeader,
    passages: xr.Dataset | None = None,
    weld_events: xr.Dataset | None = None,
) -> xr.Dataset:
    """Return the group ``trajectory`` with chainage, speed and the variables given.

    Parameters
    ----------
    values : arrays by the names of the vocabulary (degree, metre, m/s) at the output rate, without ``chainage``: ``time``,
        ``log_distance``, ``latitude`` ... ``up_sigma``, ``azimuth``, ``pitch``, ``roll``, ``velocity_east``, ``velocity_north``,
        ``velocity_up``, ``stationary``; optional ``speed`` (smoothed, along the pipe), ``chainage_sigma`` and attitude sigmas.
        Without velocities and ``speed`` the log distance is the chainage.
    header : content of ``run.toml``.
    passages, weld_events : of the raw run; they place the zero of the chainage.

    Notes
    -----
    Chainage is the integral of the smoothed speed, zero while the tool stands, so that it agrees with the positions; its zero is
    the trap marker at the upstream end of the line, else the first weld, else the upstream end of the record.
    """
    values = dict(values)
    time = np.asarray(values["time"], float)
    if "speed" not in values:
        values["speed"] = _speed(values)
    travelled = _travelled(values)
    along = header.travel_sign * travelled
    values["chainage"] = along - _zero(time, along, header, passages, weld_events)
    return build.dataset("trajectory", values)


def _speed(values: Mapping[str, Floats]) -> Floats:
    if "velocity_east" in values:
        return np.sqrt(sum(np.asarray(values[f"velocity_{c}"], float) ** 2 for c in ("east", "north", "up")))
    return np.gradient(np.asarray(values["log_distance"], float), np.asarray(values["time"], float))


def _travelled(values: Mapping[str, Floats]) -> Floats:
    """Metres since the first sample: the integral of the speed where the tool is not at rest."""
    speed = np.asarray(values["speed"], float)
    if "velocity_east" not in values:
        return np.asarray(values["log_distance"], float) - values["log_distance"][0]
    moving = np.where(values["stationary"], 0.0, speed) if "stationary" in values else speed
    step = 0.5 * (moving[1:] + moving[:-1]) * np.diff(values["time"])
    return np.concatenate([[0.0], np.cumsum(step)])


def _zero(time: Floats, along: Floats, header: RunHeader, passages: xr.Dataset | None, weld_events: xr.Dataset | None) -> float:
    """Place on the unshifted axis at which chainage is zero."""
    wanted = "launcher" if header.travel_sign > 0 else "receiver"
    if passages is not None:
        heard = np.isfinite(passages["time"].values) & (passages["kind"].values.astype(str) == wanted)
        inside = heard & (passages["time"].values >= time[0]) & (passages["time"].values <= time[-1])
        if inside.any():
            return float(np.interp(passages["time"].values[inside][0], time, along))
    if weld_events is not None and weld_events.sizes["event"]:
        return float(np.interp(weld_events["time"].values, time, along).min())
    return float(along.min())


def centreline(
    navigation: HasTrajectory, header: RunHeader, options: NavigationOptions | None = None, pose: xr.Dataset | None = None
) -> xr.Dataset:
    """Return the group ``centreline`` on regular chainage, rising downstream, without curvature.

    Parameters
    ----------
    navigation : result of `deform.nav.navigate.navigate`, or anything with its ``trajectory``.
    header : content of ``run.toml``.
    options : step of the chainage.
    pose : group ``pose`` of the caliper on ``time``: place of the tool's axis in the pipe, ``offset_right`` (looking
        downstream) and ``offset_up`` (metre); it is taken off the position.

    Raises
    ------
    InputError
        When the tool did not advance by two steps.

    Notes
    -----
    Azimuth and pitch are the pipe's looking downstream: for an upstream run the azimuth is turned by 180 degree and the pitch
    changes sign. Samples at standstill, or behind a place already reached, carry no new place and are left out, so that time
    is monotone along the chainage. Attributes ``turn_lag_m`` and ``turn_sigma_deg`` of azimuth and pitch say how sure a turn
    between two places that far apart is (for the azimuth: times the cosine of the pitch); where the inertial unit recorded
    nothing ``unseen_m`` holds begin and end (m) of the stretch, ``unseen_turn_deg`` the sigma of a turn of the pipe there over a
    metre.
    """
    options = options or NavigationOptions()
    source = navigation.trajectory
    keep = _advancing(source["chainage"].values * header.travel_sign)
    if keep.size < 2 or np.ptp(source["chainage"].values[keep]) < 2 * options.chainage_step_m:
        advance = np.ptp(source["chainage"].values)
        rule = f"the tool advanced by {advance:.3f} m; too short for a chainage in steps of {options.chainage_step_m} m"
        raise InputError(Fault(f"{header.id}/trajectory", "chainage", rule))
    source = source.isel(time=keep)
    axis = source["chainage"].values
    grid = regular_grid(axis.min(), axis.max(), options.chainage_step_m)
    values = {"chainage": grid, "time": interpolate(grid, axis, source["time"].values)}
    names = (
        "log_distance",
        "latitude",
        "longitude",
        "height",
        "east_sigma",
        "north_sigma",
        "up_sigma",
        "chainage_sigma",
        "speed",
    )
    values |= {name: interpolate(grid, axis, source[name].values) for name in names if name in source}
    ahead = slice(None, None, header.travel_sign)
    found = direction_along(source, axis * header.travel_sign, (grid * header.travel_sign)[ahead], header, pose)
    turned = 0.0 if header.travel_sign > 0 else 180.0
    values["azimuth"] = (found.azimuth[ahead] + turned) % 360.0
    values["pitch"] = header.travel_sign * found.pitch[ahead]
    values["azimuth_sigma"], values["pitch_sigma"] = found.azimuth_sigma[ahead], found.pitch_sigma[ahead]
    values["tool_roll"] = (interpolate_angle(grid, axis, source["roll"].values) + 180.0) % 360.0 - 180.0
    if pose is not None:
        _take_off_offset(values, pose)
    for name in ("east_sigma", "north_sigma", "up_sigma"):
        values[name] = np.hypot(values[name], np.sqrt(found.unseen.variances((grid * header.travel_sign)[ahead])[1])[ahead])
    line = build.dataset("centreline", values)
    for name, sigma in zip(("azimuth", "pitch"), found.turn_sigma, strict=True):
        line[name].attrs |= {"turn_lag_m": TURN_LAGS_M.tolist(), "turn_sigma_deg": sigma.tolist()}
        if found.unseen.turn.size:
            places = np.sort(found.unseen.ends * header.travel_sign, axis=1)
            line[name].attrs |= {"unseen_m": places.ravel().tolist(), "unseen_turn_deg": _per_metre(found.unseen.turn)}
    return line


def _per_metre(turn: Floats) -> list[float]:
    return np.degrees(np.sqrt(turn)).tolist()


def _advancing(along: Floats) -> Floats:
    """Indices of the samples that lie further along than everything before them."""
    reached = np.maximum.accumulate(along)
    steps = np.floor((reached - reached[0]) / _LEAST_ADVANCE_M)
    new = np.flatnonzero(np.diff(steps, prepend=-1.0) > 0)
    keep = new[along[new] >= reached[new]]
    if keep.size > 1:
        keep[0] = keep[1] - 1  # the tool leaves its first place when it first moves, however long it stood there
    return keep


def _take_off_offset(values: dict[str, Floats], pose: xr.Dataset) -> None:
    """Move the positions from the tool's axis to the pipe's centreline, where the caliper tells both apart."""
    right = np.nan_to_num(interpolate(values["time"], pose["time"].values, pose["offset_right"].values))
    up = np.nan_to_num(interpolate(values["time"], pose["time"].values, pose["offset_up"].values))
    azimuth, pitch = np.radians(values["azimuth"]), np.radians(values["pitch"])
    east = -(right * np.cos(azimuth) - up * np.sin(pitch) * np.sin(azimuth))
    north = -(-right * np.sin(azimuth) - up * np.sin(pitch) * np.cos(azimuth))
    moved = enu_shift(values["latitude"], values["longitude"], values["height"], east, north, -up * np.cos(pitch))
    values["latitude"], values["longitude"], values["height"] = moved
