"""Weld log, sections, scan records and trajectory in; wall changes, valves, openings, bends and wrinkles out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr

from deform.caliper.bends import bends
from deform.caliper.cross_section import ScanLog
from deform.caliper.dents import OPENING_M
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


def features(
    welds: xr.Dataset,
    section: xr.Dataset,
    reader: ScanReader,
    logs: list[ScanLog],
    ripples: list[Row],
    trajectory: xr.Dataset,
    outside_diameter: float,
) -> xr.Dataset:
    """Return group ``features`` in order of chainage.

    Parameters
    ----------
    welds : group ``welds`` with ``wall_thickness`` (`deform.caliper.joints.joint_walls`).
    section : group ``sections``.
    reader, logs : gives the chainage of the scans, and the scan log of each ring.
    ripples : wrinkles (`deform.caliper.wrinkles`).
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
        *ripples,
    ]
    rows.sort(key=lambda r: float(r["chainage"]))  # type: ignore[arg-type]  # the rows hold plain numbers and texts
    numbers = ("chainage", "chainage_end", "clock", "value", "value_sigma", "radius", "radius_sigma", "spacing", "spacing_sigma")
    empty: dict[str, object] = {**dict.fromkeys(numbers, np.nan), **dict.fromkeys(("kind", "direction", "text", "label"), "")}
    return build.dataset("features", {n: [r.get(n, none) for r in rows] for n, none in empty.items()})


def wall_changes(welds: xr.Dataset) -> list[Row]:
    """Welds at which the wall thickness of the joints changes; ``value`` is the wall behind (m)."""
    wall, sigma, place = (welds[n].values for n in ("wall_thickness", "wall_thickness_sigma", "chainage"))
    known = np.flatnonzero(np.isfinite(wall))
    usual = 1.4826 * float(np.median(np.abs(np.diff(wall[known])))) if known.size > 3 else 0.0
    rows: list[Row] = []
    for before, here in pairwise(known):
        limit = max(_WALL_STEP_M, _WALL_SIGMA * usual, _WALL_SIGMA * float(np.hypot(sigma[here], sigma[before])))
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
    for start, end, height in stretches(at, diameter - around, 2 * _VALVE_M, _VALVE_LENGTH_M):
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


def openings(reader: ScanReader, logs: list[ScanLog]) -> list[Row]:
    """Tees, taps and other openings: some arms reach outside the section over a short stretch; ``value`` is how far (m)."""
    rows: list[Row] = []
    for log in logs:
        place = reader.chainage(reader.time[log.bulges.index], log.ring)
        order = np.argsort(place, kind="stable")
        place, size, clocks = place[order], log.bulges.size[order].astype(float), log.bulges.clock[order].astype(float)
        for start, end, _ in stretches(place, size, OPENING_M, _OPENING_LENGTH_M):
            inside = (place >= start) & (place <= end)
            reach = float(np.quantile(size[inside], 0.9))  # at its rims the running mean sees half of it
            clock = np.degrees(np.angle(np.mean(np.exp(1j * clocks[inside])))) % 360.0
            if not any(abs(float(r["chainage"]) - start) < 0.2 for r in rows):  # type: ignore[arg-type]  # plain number
                text = f"an opening of {end - start:.2f} m, {reach * 1e3:.0f} mm beyond the wall"
                row: Row = {"chainage": start, "chainage_end": end, "kind": "tee", "clock": clock, "value": reach, "text": text}
                rows.append({**row, "value_sigma": float(np.std(size[inside]) / np.sqrt(inside.sum()))})
    return rows
