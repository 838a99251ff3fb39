"""Weld log, sections, scan records and trajectory in; wall changes, valves, openings, bends and wrinkles out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr
from scipy.ndimage import uniform_filter1d

from deform.caliper.cross_section import ScanLog
from deform.caliper.dent_shape import DentFit
from deform.caliper.dents import OPENING_M
from deform.caliper.scans import ScanReader
from deform.run import build

_WALL_STEP_M = 3e-4  # least change of wall thickness that is reported
_VALVE_M = 2e-3  # a stretch this much wider than the pipe around it is a valve or a chamber
_VALVE_LENGTH_M = (0.1, 6.0)
_SPOOL_M = 3.0  # a heavy spool shorter than this is a valve or a fitting
_OPENING_LENGTH_M = (0.04, 2.0)
_BEND_RADIUS_OD = 300.0  # gentler than this counts as elastic
_BEND_ANGLE_DEG = 2.0
_INDUCTION_OD = 15.0  # tighter bends are made hot
_RIPPLES = 3
_SAME_SIDE_RAD = 0.45

Row = dict[str, object]


def features(
    welds: xr.Dataset,
    section: xr.Dataset,
    reader: ScanReader,
    logs: list[ScanLog],
    fits: list[DentFit],
    trajectory: xr.Dataset,
    outside_diameter: float,
) -> xr.Dataset:
    """Return group ``features`` in order of chainage.

    Parameters
    ----------
    welds : group ``welds`` with ``wall_thickness`` (`joint_walls`).
    section : group ``sections``.
    reader, logs : gives the chainage of the scans, and the scan log of each ring.
    fits : the fitted dents, for trains of ripples.
    trajectory : group ``trajectory``, for bends.
    outside_diameter : m.
    """
    turned = bends(trajectory, outside_diameter)
    rows = [
        *wall_changes(welds),
        *wide_stretches(section),
        *short_spools(welds, turned),
        *openings(reader, logs),
        *turned,
        *wrinkles(fits, outside_diameter),
    ]
    rows.sort(key=lambda r: float(r["chainage"]))  # type: ignore[arg-type]  # the rows hold plain numbers and texts
    names = {"chainage": np.nan, "chainage_end": np.nan, "kind": "", "clock": np.nan, "value": np.nan, "text": "", "label": ""}
    return build.dataset("features", {n: [r.get(n, empty) for r in rows] for n, empty in names.items()})


def joint_walls(welds: xr.Dataset, section: xr.Dataset, outside_diameter: float) -> xr.Dataset:
    """Return the welds with the wall thickness (m) of the joint that begins at each: half of outside minus inner diameter."""
    place, at = welds["chainage"].values, section["chainage"].values
    wall = np.full(place.size, np.nan)
    sure = np.flatnonzero(welds["probability"].values >= 0.5)
    for first, last in zip(sure, np.append(sure, -1)[1:], strict=True):
        end = place[last] if last >= 0 else at[-1] if at.size else place[first]
        inside = (at > place[first] + 0.3) & (at < end - 0.3)
        if inside.sum() >= 3:
            wall[first] = 0.5 * (outside_diameter - float(np.median(section["diameter_mean"].values[inside])))
    return build.add(welds, "welds", {"wall_thickness": np.where((wall > 0) & (wall < 0.2), wall, np.nan)})


def wall_changes(welds: xr.Dataset) -> list[Row]:
    """Welds at which the wall thickness of the joints changes; ``value`` is the wall behind (m)."""
    wall, place = welds["wall_thickness"].values, welds["chainage"].values
    known = np.flatnonzero(np.isfinite(wall))
    usual = 1.4826 * float(np.median(np.abs(np.diff(wall[known])))) if known.size > 3 else 0.0
    limit = max(_WALL_STEP_M, 5.0 * usual)
    rows: list[Row] = []
    for before, here in pairwise(known):
        if abs(wall[here] - wall[before]) > limit:
            text = f"wall {wall[before] * 1e3:.2f} to {wall[here] * 1e3:.2f} mm"
            rows.append({"chainage": float(place[here]), "kind": "wall_change", "value": float(wall[here]), "text": text})
    return rows


def wide_stretches(section: xr.Dataset) -> list[Row]:
    """Valves and chambers: stretches whose diameter stands above that of the pipe on both sides."""
    at, diameter = section["chainage"].values, section["diameter_mean"].values
    if at.size < 50:
        return []
    step = float(np.median(np.diff(at)))
    around = _running_median(diameter, max(3, round(25.0 / step)))
    return [
        {
            "chainage": start,
            "chainage_end": end,
            "kind": "valve",
            "value": height,
            "text": f"bore {height * 1e3:.1f} mm wider than the pipe",
        }
        for start, end, height in _stretches(at, diameter - around, 2 * _VALVE_M, _VALVE_LENGTH_M)
    ]


def short_spools(welds: xr.Dataset, turned: list[Row]) -> list[Row]:
    """Short straight spools that are heavier than both neighbours: valves and fittings."""
    wall, place = welds["wall_thickness"].values, welds["chainage"].values
    rows: list[Row] = []
    known = np.flatnonzero(np.isfinite(wall))
    for before, here, behind in zip(known[:-2], known[1:-1], known[2:], strict=True):
        start, end = float(place[here]), float(place[behind])
        heavier = wall[here] > 1.2 * max(wall[before], wall[behind])
        bent = any(float(r["chainage"]) < end and float(r["chainage_end"]) > start for r in turned)  # type: ignore[arg-type]  # plain numbers
        if heavier and end - start < _SPOOL_M and not bent:
            text = f"spool of {end - start:.2f} m, wall {wall[here] * 1e3:.2f} mm: valve or fitting"
            rows.append({"chainage": start, "chainage_end": end, "kind": "valve", "value": float(wall[here]), "text": text})
    return rows


def openings(reader: ScanReader, logs: list[ScanLog]) -> list[Row]:
    """Tees, taps and other openings: some arms reach outside the section over a short stretch."""
    rows: list[Row] = []
    for log in logs:
        place = reader.chainage(reader.time[log.bulges.index], log.ring)
        order = np.argsort(place, kind="stable")
        place, size, clocks = place[order], log.bulges.size[order].astype(float), log.bulges.clock[order].astype(float)
        for start, end, reach in _stretches(place, size, OPENING_M, _OPENING_LENGTH_M):
            inside = (place >= start) & (place <= end)
            clock = np.degrees(np.angle(np.mean(np.exp(1j * clocks[inside])))) % 360.0
            if not any(abs(float(r["chainage"]) - start) < 0.2 for r in rows):  # type: ignore[arg-type]  # plain number
                text = f"an opening of {end - start:.2f} m, {reach * 1e3:.0f} mm beyond the wall"
                rows.append({"chainage": start, "chainage_end": end, "kind": "tee", "clock": clock, "value": reach, "text": text})
    return rows


def bends(trajectory: xr.Dataset, outside_diameter: float, step: float = 0.1) -> list[Row]:
    """Bends from the attitude of the tool: start, end, angle (degree, ``value``), radius, direction, cold or induction."""
    order = np.argsort(trajectory["chainage"].values, kind="stable")
    place, first = np.unique(trajectory["chainage"].values[order], return_index=True)
    if place.size < 10:
        return []
    pick, sign = order[first], np.sign(trajectory["chainage"].values[-1] - trajectory["chainage"].values[0])
    grid = np.arange(place[0], place[-1], step)
    azimuth, pitch = (
        np.interp(grid, place, np.unwrap(np.radians(trajectory[n].values))[pick] * f)
        for n, f in (("azimuth", 1.0), ("pitch", sign))
    )
    width = max(3, round(2 * outside_diameter / step))
    level = uniform_filter1d(pitch, width)
    right = uniform_filter1d(np.gradient(uniform_filter1d(azimuth, width), step) * np.cos(level), width)
    up = uniform_filter1d(np.gradient(level, step), width)
    rows: list[Row] = []
    for start, end, _ in _stretches(grid, np.hypot(right, up), 1.0 / (_BEND_RADIUS_OD * outside_diameter), (0.3, 60.0)):
        inside = (grid >= start) & (grid <= end)
        sideways, upwards = np.degrees(right[inside].sum() * step), np.degrees(up[inside].sum() * step)
        angle = float(np.hypot(sideways, upwards))
        if angle < _BEND_ANGLE_DEG:
            continue
        clock = float(np.degrees(np.arctan2(sideways, upwards)) % 360.0)
        radius = 1.0 / float(np.hypot(right[inside], up[inside]).max()) / outside_diameter  # tightest over two diameters
        words = _direction(sideways, upwards)
        text = f"{radius:.1f} D, {angle:.1f} degree {words}, {'induction' if radius < _INDUCTION_OD else 'cold'}"
        rows.append({"chainage": start, "chainage_end": end, "kind": "bend", "clock": clock, "value": angle, "text": text})
    return rows


def wrinkles(fits: list[DentFit], outside_diameter: float) -> list[Row]:
    """Trains of at least three inward ripples on one side of the pipe, each within a diameter of the next."""
    trains: list[list[DentFit]] = []
    for fit in sorted(fits, key=lambda f: f.centre):
        last = trains[-1][-1] if trains else None
        near = last is not None and fit.centre - last.centre < outside_diameter
        if near and last is not None and abs((fit.clock - last.clock + np.pi) % (2 * np.pi) - np.pi) < _SAME_SIDE_RAD:
            trains[-1].append(fit)
        else:
            trains.append([fit])
    return [_train(t) for t in trains if len(t) >= _RIPPLES]


def _train(ripples: list[DentFit]) -> Row:
    height = float(np.mean([f.depth for f in ripples]))
    spacing = float(np.mean(np.diff([f.centre for f in ripples])))
    return {
        "chainage": ripples[0].centre,
        "chainage_end": ripples[-1].centre,
        "kind": "wrinkle",
        "clock": float(np.degrees(ripples[0].clock)),
        "value": height,
        "text": f"{len(ripples)} ripples, height {height * 1e3:.1f} mm, spacing {spacing:.2f} m",
    }


def _direction(right: float, up: float) -> str:
    words = []
    if abs(right) > 0.3 * abs(up):
        words.append("to the right" if right > 0 else "to the left")
    if abs(up) > 0.3 * abs(right):
        words.append("up" if up > 0 else "down")
    return " and ".join(words)


def _stretches(
    place: np.ndarray, value: np.ndarray, limit: float, length: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Start, end and median value of the runs above a limit whose length (m) is in the range."""
    above = np.flatnonzero(np.nan_to_num(value) > limit)
    if not above.size:
        return []
    groups = np.split(above, np.flatnonzero((np.diff(above) > 2) & (np.diff(place[above]) > 0.05)) + 1)
    found = [(float(place[g[0]]), float(place[g[-1]]), float(np.median(value[g]))) for g in groups]
    return [f for f in found if length[0] <= f[1] - f[0] <= length[1]]


def _running_median(values: np.ndarray, size: int) -> np.ndarray:
    """Median over about ``size`` cells, formed on a thinned grid."""
    thin = max(1, size // 25)
    coarse = values[::thin]
    half = max(1, size // thin // 2)
    padded = np.pad(coarse, half, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return np.interp(np.arange(values.size), np.arange(0, values.size, thin), middle)
