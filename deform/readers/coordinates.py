"""Rows of a listing with coordinates in, group ``centreline`` on a regular chainage out, empty over stretches without points."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.interpolate import Akima1DInterpolator

from deform.readers import datum
from deform.readers.columns import Coordinates
from deform.readers.findings import Findings
from deform.readers.frame import Frame
from deform.run import build

STEP_M = 0.1
_SLACK_M = 5.0
_SLACK = 1.02


def centreline(frame: Frame, options: Coordinates, findings: Findings) -> xr.Dataset | None:
    """Return latitude, longitude and height on a chainage of 0.1 m; None when fewer than two rows have coordinates.

    Notes
    -----
    Akima's interpolation between the points; nothing beyond them, and nothing between points further apart than
    ``longest_gap_m``. Points that stand further apart than the pipe between them allows are left out, and counted.
    """
    points = _points(frame, options, findings)
    points = points[np.isfinite(points[:, :3]).all(axis=1)]
    _, first = np.unique(np.round(points[:, 0], 3), return_index=True)
    points = _possible(points[first], findings)
    if len(points) < 2 or points[-1, 0] - points[0, 0] < STEP_M:
        return None
    start, end = int(np.ceil(points[0, 0] / STEP_M - 1e-6)), int(np.floor(points[-1, 0] / STEP_M + 1e-6))
    chainage = np.arange(start, end + 1) * STEP_M
    values = {
        "chainage": chainage,
        "latitude": _through(points[:, 0], points[:, 1], chainage),
        "longitude": _through(points[:, 0], np.unwrap(points[:, 2], period=360), chainage),
    }
    tall = np.isfinite(points[:, 3])
    if tall.sum() > 1:
        values["height"] = _through(points[tall, 0], points[tall, 3], chainage)
    bridged = np.diff(points[:, 0])[np.clip(np.searchsorted(points[:, 0], chainage, side="right") - 1, 0, len(points) - 2)]
    for name in ("latitude", "longitude", "height"):
        if name in values:
            values[name] = np.where(bridged > options.longest_gap_m, np.nan, values[name])
    wide = np.diff(points[:, 0]) > options.longest_gap_m
    if wide.any():
        findings.repair(
            "", "coordinates", f"{wide.sum()} stretches without coordinates longer than {options.longest_gap_m:g} m stay empty"
        )
    for name, sigma in (
        ("east_sigma", options.sigma_horizontal_m),
        ("north_sigma", options.sigma_horizontal_m),
        ("up_sigma", options.sigma_vertical_m),
    ):
        if sigma is not None:
            values[name] = np.full(chainage.size, sigma)
    return build.dataset("centreline", values)


def _points(frame: Frame, options: Coordinates, findings: Findings) -> np.ndarray:
    """Chainage, latitude, longitude, height of the rows, shape (n, 4)."""
    names = ("easting", "northing") if np.isfinite(frame["easting"]).any() else ("longitude", "latitude")
    x, y, z = (frame[name] for name in (*names, "elevation"))
    if names[0] == "easting" and not options.crs:
        findings.fault(
            "", "easting, northing", "have no reference system", "give crs = 'EPSG:...' in [coordinates] of the column map"
        )
        return np.empty((0, 4))
    latitude, longitude, height = datum.to_wgs84(x, y, z, options.crs, findings) if options.crs else (y, x, z)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    bad = good & ((np.abs(latitude) > 90) | (longitude < -180) | (longitude > 360) | ((latitude == 0) & (longitude == 0)))
    if bad.any():
        findings.repair(
            "",
            "coordinates",
            f"{bad.sum()} rows have coordinates that cannot be, first line {frame['line'][bad][0]}; left out",
        )
    return np.column_stack([frame["chainage"], np.where(bad, np.nan, latitude), longitude, height])


def _possible(points: np.ndarray, findings: Findings) -> np.ndarray:
    """Leave out points to which the pipe is too short from both neighbours."""
    if len(points) < 3:
        return points
    north = np.diff(points[:, 1]) * 111_200.0
    east = (np.diff(points[:, 2]) + 180.0) % 360.0 - 180.0
    east *= 111_300.0 * np.cos(np.radians(points[:-1, 1]))
    far = np.hypot(east, north) > _SLACK * np.diff(points[:, 0]) + _SLACK_M
    gross = np.append(far, True) & np.append(True, far)
    gross[0], gross[-1] = far[0] and not far[1], far[-1] and not far[-2]
    if gross.any():
        rule = f"{gross.sum()} points lie further from their neighbours than the pipe between them is long"
        findings.repair("", "coordinates", f"{rule}, first at chainage {points[gross][0, 0]:.1f} m; left out")
    return points[~gross]


def _through(place: np.ndarray, value: np.ndarray, chainage: np.ndarray) -> np.ndarray:
    if place.size < 3:
        return np.interp(chainage, place, value)
    return Akima1DInterpolator(place, value)(chainage)
