"""Attitude of the tool along the pipe in, bends out: start, end, angle, radius and direction, each with its sigma."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr
from scipy.ndimage import uniform_filter1d

from deform.caliper.stretches import Row, stretches

_STEP_M = 0.05
_RADIUS_OD = 500.0  # gentler than this, a tenth of a percent of strain, counts as elastic
_ANGLE_DEG = 2.0  # a bend turns by more
_INDUCTION_OD = 15.0  # tighter bends are made hot
_FINE_M = 0.3  # length over which the curvature inside a bend is formed
_BESIDE_M = 0.5  # pipe on both sides that still turns with the bend, by the smoothing
_EDGE_SIGMA_M = 0.1
_LENGTH_M = (0.3, 60.0)


def bends(trajectory: xr.Dataset, outside_diameter: float) -> list[Row]:
    """Return the bends in order of chainage.

    Notes
    -----
    A bend is found where the curvature over two diameters exceeds that of elastic pipe. Where the curvature changes sides (an
    S) one bend ends and the next begins. A bend begins and ends where the curvature over 0.3 m is half of that in its middle,
    its radius is length over angle. The sigma of the angle is what the tool turns by itself over such a length where the pipe
    is straight.
    """
    along = _turning(trajectory)
    if along is None:
        return []
    place, right, up = along
    width = max(3, round(2 * outside_diameter / _STEP_M))
    wide = [uniform_filter1d(uniform_filter1d(c, width), width) for c in (right, up)]
    fine = [uniform_filter1d(c, max(3, round(_FINE_M / _STEP_M))) for c in (right, up)]
    limit = 1.0 / (_RADIUS_OD * outside_diameter)
    straight = np.hypot(*wide) < limit
    parts: list[slice] = []
    for start, end, _ in stretches(place, np.hypot(*wide), limit, (_LENGTH_M[0], np.inf), 2.5 * _STEP_M):
        first, last = np.searchsorted(place, [start - _BESIDE_M, end + _BESIDE_M])
        parts += _one_sided(slice(int(first), int(last)), wide, fine, limit)
    most = (_LENGTH_M[1] + 2 * _BESIDE_M) / _STEP_M
    rows = [_bend(place, fine, straight, p, outside_diameter) for p in parts if p.stop - p.start <= most]
    return [r for r in rows if r is not None]


def _one_sided(stretch: slice, wide: list[np.ndarray], fine: list[np.ndarray], limit: float) -> list[slice]:
    """Parts of a stretch between which the curvature changes sides, each of which turns by as much as a bend."""
    turned = np.stack([c[stretch] for c in wide])
    axis = np.linalg.eigh(turned @ turned.T)[1][:, -1]
    side, turn = axis @ turned, axis @ np.stack([c[stretch] for c in fine]) * _STEP_M
    strong = np.flatnonzero(np.abs(side) > limit)
    lobes = np.split(strong, np.flatnonzero(np.diff(np.sign(side[strong]))) + 1)
    lobes = [b for b in lobes if b.size and np.degrees(abs(turn[b[0] : b[-1] + 1].sum())) > _ANGLE_DEG]
    cuts = []
    for before, behind in pairwise(lobes):
        if side[before[0]] * side[behind[0]] < 0:
            between = slice(before[-1], behind[0] + 1)
            cuts.append(stretch.start + int(before[-1] + np.argmin(np.abs(side[between]))))
    edges = [stretch.start, *cuts, stretch.stop]
    return [slice(a, b) for a, b in pairwise(edges)]


def _turning(trajectory: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Regular chainage (m), and the curvature to the right and upward (1/m) looking downstream."""
    chainage = trajectory["chainage"].values
    order = np.argsort(chainage, kind="stable")
    at, first = np.unique(chainage[order], return_index=True)
    if at.size < 10 or np.ptp(at) < 1.0:
        return None
    pick, sign = order[first], np.sign(chainage[-1] - chainage[0])
    place = np.arange(at[0], at[-1], _STEP_M)
    azimuth, pitch = (
        np.interp(place, at, np.unwrap(np.radians(trajectory[n].values))[pick] * f)
        for n, f in (("azimuth", 1.0), ("pitch", sign))
    )
    return place, np.gradient(azimuth, _STEP_M) * np.cos(pitch), np.gradient(pitch, _STEP_M)


def _bend(place: np.ndarray, fine: list[np.ndarray], straight: np.ndarray, part: slice, outside_diameter: float) -> Row | None:
    turn = np.array([c[part].sum() * _STEP_M for c in fine])
    angle = float(np.hypot(*turn))
    if np.degrees(angle) < _ANGLE_DEG:
        return None
    plane = turn / angle
    curve = plane[0] * fine[0][part] + plane[1] * fine[1][part]
    inner = np.flatnonzero(curve > 0.5 * np.quantile(curve, 0.85))
    start, end = (float(place[part][inner[k]]) + s * 0.5 * _STEP_M for k, s in ((0, -1), (-1, 1)))
    length = end - start
    sigma = _turn_sigma(fine, straight, part.stop - part.start)
    radius = length / angle
    radius_sigma = radius * float(np.hypot(sigma / angle, np.sqrt(2.0) * _EDGE_SIGMA_M / length))
    sideways, upwards = np.degrees(turn)
    kind = "induction" if radius < _INDUCTION_OD * outside_diameter else "cold"
    text = f"{radius / outside_diameter:.1f} D, {np.degrees(angle):.1f} degree {_direction(sideways, upwards)}, {kind}"
    return {
        "chainage": start,
        "chainage_end": end,
        "kind": "bend",
        "clock": float(np.degrees(np.arctan2(sideways, upwards)) % 360.0),
        "value": float(np.degrees(angle)),
        "value_sigma": float(np.degrees(sigma)),
        "radius": radius,
        "radius_sigma": radius_sigma,
        "direction": _listed(sideways, upwards),
        "text": text,
    }


def _turn_sigma(fine: list[np.ndarray], straight: np.ndarray, size: int) -> float:
    """What the tool turns by itself over so many steps of straight pipe (rad, one component, robust)."""
    inside = np.concatenate([[0], np.cumsum(~straight)])
    free = np.flatnonzero(inside[size:] - inside[: inside.size - size] == 0)
    if free.size < 20:
        return float(np.radians(0.3))
    turned = []
    for c in fine:
        total = np.concatenate([[0.0], np.cumsum(c)]) * _STEP_M
        change = (total[size:] - total[: total.size - size])[free]
        turned.append(1.4826 * float(np.median(np.abs(change - np.median(change)))))
    return float(np.hypot(turned[0], turned[1])) / np.sqrt(2.0)


def _direction(right: float, up: float) -> str:
    words = []
    if abs(right) > 0.3 * abs(up):
        words.append("to the right" if right > 0 else "to the left")
    if abs(up) > 0.3 * abs(right):
        words.append("up" if up > 0 else "down")
    return " and ".join(words)


def _listed(right: float, up: float) -> str:
    """The direction in the words of listings: right, left, sag (turns up), over (turns down)."""
    if abs(right) >= abs(up):
        return "right" if right > 0 else "left"
    return "sag" if up > 0 else "over"
