"""Weld log, sections, scan records and trajectory in; wall changes, valves, openings, bends and wrinkles out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr

from deform.caliper.bends import bends
from deform.caliper.cross_section import MEAN_HALF, ScanLog
from deform.caliper.dent_shape import wrap
from deform.caliper.scans import ScanReader
from deform.caliper.stretches import Row, running_median, stretches
from deform.run import build

_WALL_STEP_M = 3e-4  # least change of wall thickness that is reported
_WALL_SIGMA = 5.0
_VALVE_M = 2e-3  # a stretch this much wider than the pipe around it is a valve or a chamber
_VALVE_LENGTH_M = (0.1, 6.0)
_SPOOL_M = 3.0  # a heavy spool shorter than this is a valve or a fitting
_SPOOL_HEAVIER = 1.2
_OPENING_LENGTH_M = (0.04, 2.0)
_OPENING_GAP_M, _OPENING_GAP_SCANS = 0.05, 2  # sound wall longer than both parts two openings
_OPENING_SIDE_RAD = 0.8  # likewise around the pipe; more than the arms' spacing
_OPENING_SCANS = 3
_SAME_OPENING_M = 0.1  # openings of two rings nearer than this, on one side of the pipe, are one


def features(
    welds: xr.Dataset,
    wall_sigma: np.ndarray,
    section: xr.Dataset,
    reader: ScanReader,
    logs: list[ScanLog],
    ripples: list[Row],
    trajectory: xr.Dataset,
    outside_diameter: float,
    sigma: float,
) -> xr.Dataset:
    """Return group ``features`` in order of chainage.

    Parameters
    ----------
    welds, wall_sigma : group ``welds`` with ``wall_thickness``, and the sigma by which walls are compared
        (`deform.caliper.joints.joint_walls`).
    section : group ``sections``.
    reader, logs : gives the chainage of the scans, and the scan log of each ring.
    ripples : wrinkles (`deform.caliper.wrinkles`).
    trajectory : group ``trajectory``, for bends.
    outside_diameter : m.
    sigma : standard deviation of one reading (m).
    """
    turned = bends(trajectory, outside_diameter)
    rows = [
        *wall_changes(welds, wall_sigma),
        *wide_stretches(section),
        *short_spools(welds, turned),
        *(row for row in openings(reader, logs, sigma) if not _rippled(row, ripples)),
        *turned,
        *ripples,
    ]
    rows.sort(key=lambda r: float(r["chainage"]))  # type: ignore[arg-type]  # the rows hold plain numbers and texts
    numbers = ("chainage", "chainage_end", "clock", "value", "value_sigma", "radius", "radius_sigma", "spacing", "spacing_sigma")
    empty: dict[str, object] = {**dict.fromkeys(numbers, np.nan), **dict.fromkeys(("kind", "direction", "text", "label"), "")}
    return build.dataset("features", {n: [r.get(n, none) for r in rows] for n, none in empty.items()})


def wall_changes(welds: xr.Dataset, alike: np.ndarray) -> list[Row]:
    """Welds at which the wall changes; ``value`` is the wall behind (m), ``alike`` the sigma of walls against each other (m)."""
    wall, sigma, place = (welds[n].values for n in ("wall_thickness", "wall_thickness_sigma", "chainage"))
    known = np.flatnonzero(np.isfinite(wall))
    usual = 1.4826 * float(np.median(np.abs(np.diff(wall[known])))) if known.size > 3 else 0.0
    rows: list[Row] = []
    for before, here in pairwise(known):
        limit = max(_WALL_STEP_M, _WALL_SIGMA * usual, _WALL_SIGMA * float(np.hypot(alike[here], alike[before])))
        if abs(wall[here] - wall[before]) > limit:
            text = f"wall {wall[before] * 1e3:.2f} to {wall[here] * 1e3:.2f} mm"
            row: Row = {"chainage": float(place[here]), "kind": "wall_change", "value": float(wall[here]), "text": text}
            rows.append({**row, "value_sigma": float(sigma[here])})
    return rows


def wide_stretches(section: xr.Dataset) -> list[Row]:
    """Valves and chambers: stretches whose diameter stands above that of the pipe on both sides; ``value`` by how much (m)."""
    at, diameter, sigma = (section[n].values for n in ("chainage", "diameter_mean", "diameter_mean_sigma"))
    if at.size < 50:
        return []
    step = float(np.median(np.diff(at)))
    around = running_median(diameter, max(3, round(25.0 / step)))
    rows: list[Row] = []
    for start, end, height in stretches(at, diameter - around, 2 * _VALVE_M, _VALVE_LENGTH_M, max(0.05, 2.5 * step)):
        inside = (at >= start) & (at <= end)
        text = f"bore {height * 1e3:.1f} mm wider than the pipe"
        row: Row = {"chainage": start, "chainage_end": end, "kind": "valve", "value": height, "text": text}
        rows.append({**row, "value_sigma": float(1.2533 * np.median(sigma[inside]))})
    return rows


def short_spools(welds: xr.Dataset, turned: list[Row]) -> list[Row]:
    """Short straight spools that are heavier than both neighbours: valves and fittings; ``value`` is their wall (m)."""
    wall, sigma, place = (welds[n].values for n in ("wall_thickness", "wall_thickness_sigma", "chainage"))
    rows: list[Row] = []
    known = np.flatnonzero(np.isfinite(wall))
    for before, here, behind in zip(known[:-2], known[1:-1], known[2:], strict=True):
        start, end = float(place[here]), float(place[behind])
        heavier = wall[here] > _SPOOL_HEAVIER * max(wall[before], wall[behind])
        bent = any(float(r["chainage"]) < end and float(r["chainage_end"]) > start for r in turned)  # type: ignore[arg-type]  # plain numbers
        if heavier and end - start < _SPOOL_M and not bent:
            text = f"spool of {end - start:.2f} m, wall {wall[here] * 1e3:.2f} mm: valve or fitting"
            row: Row = {"chainage": start, "chainage_end": end, "kind": "valve", "value": float(wall[here]), "text": text}
            rows.append({**row, "value_sigma": float(sigma[here])})
    return rows


def openings(reader: ScanReader, logs: list[ScanLog], sigma: float) -> list[Row]:
    """Tees, taps and other openings: some arms reach outside the section over a short stretch; ``value`` is how far (m).

    Notes
    -----
    A scan keeps its greatest departure only: of two openings at one place the smaller is seen in scans in which it reaches
    further than the other.
    """
    rows: list[Row] = []
    for log in logs:
        index = log.bulges.index
        place = reader.chainage(reader.time[index], log.ring)
        order = np.argsort(place, kind="stable")
        index, place = index[order], place[order]
        size, clock = log.bulges.size[order].astype(float), log.bulges.clock[order].astype(float)
        apart = (np.diff(place) > _OPENING_GAP_M) & (np.abs(np.diff(index)) > _OPENING_GAP_SCANS)
        earlier = list(rows)
        for group in np.split(np.arange(place.size), np.flatnonzero(apart) + 1):
            for side in _sides(clock[group]):
                own = group[side]
                row = _opening(index[own], place[own], size[own], clock[own], sigma)
                if row is not None and not any(_same_opening(row, r) for r in earlier):
                    rows.append(row)
    return rows


def _sides(clock: np.ndarray) -> list[np.ndarray]:
    """Indices of the clocks (rad, 0 to 2 pi) in groups between which the pipe is sound."""
    order = np.argsort(clock)
    if not order.size:
        return []
    ahead = np.diff(clock[order], append=clock[order[0]] + 2 * np.pi)
    ends = np.flatnonzero(ahead > _OPENING_SIDE_RAD) + 1
    first = ends[-1] if ends.size else 0
    return np.split(np.roll(order, -first), ends[:-1] - first + order.size)


def _opening(index: np.ndarray, place: np.ndarray, size: np.ndarray, clock: np.ndarray, sigma: float) -> Row | None:
    """One opening; None where the scans are too few or reach too far along the pipe, or where one stray scan made them all."""
    start, end = float(place.min()), float(place.max())
    if place.size < _OPENING_SCANS or np.ptp(index) <= 2 * MEAN_HALF:
        return None
    if not _OPENING_LENGTH_M[0] <= end - start <= _OPENING_LENGTH_M[1]:
        return None
    low, reach, most = np.quantile(size, [0.8, 0.9, 1.0])  # at its rims the running mean sees half of it
    return {
        "chainage": start,
        "chainage_end": end,
        "kind": "tee",
        "clock": float(np.degrees(np.angle(np.mean(np.exp(1j * clock)))) % 360.0),
        "value": float(reach),
        "value_sigma": float(np.hypot(sigma / np.sqrt(2 * MEAN_HALF + 1), 0.5 * (most - low))),
        "text": f"an opening of {end - start:.2f} m, {reach * 1e3:.0f} mm beyond the wall",
    }


def _rippled(opening: Row, ripples: list[Row]) -> bool:
    """True where an opening is the outward half of a wrinkle."""
    return any(_same_opening(opening, r) for r in ripples)


def _same_opening(first: Row, second: Row) -> bool:
    """True where two rows stand at one place on one side of the pipe."""
    one, two = ([float(r[n]) for n in ("chainage", "chainage_end", "clock")] for r in (first, second))  # type: ignore[arg-type]  # plain numbers
    near = one[0] < two[1] + _SAME_OPENING_M and two[0] < one[1] + _SAME_OPENING_M
    return near and bool(abs(wrap(np.radians(one[2] - two[2]))) < _OPENING_SIDE_RAD)
