"""A centreline with curvature, its welds and features in; a signed table of everything that turns at a place out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from deform.options import StrainOptions
from deform.run import build
from deform.strain.bending import standardised_percent, stated_turn_sigma, tension_clock

Floats = NDArray[Any]

_SIDE_M = 3.0  # length on either side of a weld from which its two directions are taken
_GAP_M = 0.3  # of the weld itself, where the tool is shaken
_POINT_KINDS = ("tee", "valve")  # features that are no bend but may turn


def doglegs(
    centreline: xr.Dataset,
    *,
    outside_diameter: float,
    welds: xr.Dataset | None = None,
    features: xr.Dataset | None = None,
    options: StrainOptions | None = None,
) -> pd.DataFrame:
    """Return the table ``doglegs``: bends, and deflections at welds, tees and valves, each with sign and sigma.

    Parameters
    ----------
    centreline : group ``centreline`` with azimuth, pitch and curvature (`bending.add_bending`).
    outside_diameter : of the pipe (metre).
    welds, features : groups of the run, or None.
    options : strain from which a stretch is a bend, and sigmas from which a deflection is listed.

    Notes
    -----
    A bend is a stretch whose bending strain over the gauge exceeds the option; its angle is the whole turn between half a gauge
    before and behind it. A deflection at a point is the jump between two straight lines fitted to the direction on either side,
    the bend of the joints themselves taken along: elastic bending makes no dogleg. Points inside bends are not listed twice.
    """
    options = options or StrainOptions()
    if "curvature_horizontal" not in centreline:
        return build.table("doglegs", {})
    centreline = centreline[["azimuth", "pitch", "curvature_horizontal", "curvature_vertical"]]
    bends = _bends(centreline, outside_diameter, options)
    points = _outside(_points(welds, features), bends)
    rows = bends + [row for place, kind in points for row in _deflection(centreline, place, kind, outside_diameter, options)]
    rows.sort(key=lambda r: r["start_m"])
    return build.table("doglegs", pd.DataFrame(rows))


def _outside(points: list[tuple[float, str]], bends: list[dict[str, Any]]) -> list[tuple[float, str]]:
    """The points that lie `_SIDE_M` at least from every bend: so many bends have begun before them as have ended."""
    places = np.array([place for place, _ in points])
    begun = np.searchsorted(np.sort([row["start_m"] for row in bends]), places + _SIDE_M, side="right")
    ended = np.searchsorted(np.sort([row["end_m"] for row in bends]), places - _SIDE_M, side="left")
    return [points[k] for k in np.flatnonzero(begun == ended)]


def _points(welds: xr.Dataset | None, features: xr.Dataset | None) -> list[tuple[float, str]]:
    found = [] if welds is None else [(float(c), "weld") for c in welds["chainage"].values]
    if features is not None:
        kinds = features["kind"].values.astype(str)
        points = [(float(c), str(k)) for c, k in zip(features["chainage"].values, kinds, strict=True) if k in _POINT_KINDS]
        found = [(c, k) for c, k in found if all(abs(c - p) > _SIDE_M for p, _ in points)] + points
    return found


def _bends(line: xr.Dataset, diameter: float, options: StrainOptions) -> list[dict[str, Any]]:
    s = line["chainage"].values
    gauge = float(line["curvature_horizontal"].attrs["gauge_length_m"])
    horizontal, vertical = line["curvature_horizontal"].values, line["curvature_vertical"].values
    total = np.nan_to_num(np.hypot(horizontal, vertical))
    bent = np.concatenate([[False], total * 0.5 * diameter > options.bend_strain, [False]])
    edges = np.flatnonzero(np.diff(bent.astype(np.int8))).reshape(-1, 2)
    rows = []
    azimuth, pitch = line["azimuth"].values, line["pitch"].values
    for first, last in edges:
        a, b = s[first] - 0.5 * gauge, s[last - 1] + 0.5 * gauge
        inside = slice(*np.searchsorted(s, [a - 1e-9, b + 1e-9]))
        right, up = _turn(azimuth[inside], pitch[inside])
        angle = float(np.hypot(right, up))
        peak = total[first:last].max()
        arc = angle / np.degrees(peak)
        rows.append(
            {
                "kind": "bend",
                "start_m": 0.5 * (a + b - arc),
                "end_m": 0.5 * (a + b + arc),
                "angle_horizontal_deg": right,
                "angle_vertical_deg": up,
                "angle_deg": angle,
                "angle_sigma_deg": stated_turn_sigma(line["azimuth"], b - a),
                "clock_deg": float(tension_clock(right, up)),
                "radius_m": 1.0 / peak,
                "standardised_percent": float(standardised_percent(peak, diameter)),
            }
        )
    return rows


def _turn(azimuth: Floats, pitch: Floats) -> tuple[float, float]:
    """Turn to the right (times cos pitch) and up over a stretch (degree)."""
    azimuth = np.unwrap(azimuth, period=360.0)
    level = np.cos(np.radians(0.5 * (pitch[1:] + pitch[:-1])))
    return float(np.sum(level * np.diff(azimuth))), float(pitch[-1] - pitch[0])


def _deflection(line: xr.Dataset, place: float, kind: str, diameter: float, options: StrainOptions) -> list[dict[str, Any]]:
    chainage = line["chainage"].values
    near = slice(*np.searchsorted(chainage, [place - _SIDE_M, place + _SIDE_M]))
    s = chainage[near] - place
    before, behind = s <= -_GAP_M, s >= _GAP_M
    if min(before.sum(), behind.sum()) < 5:
        return []
    azimuth, pitch = np.unwrap(line["azimuth"].values[near], period=360.0), line["pitch"].values[near]
    level = float(np.cos(np.radians(pitch.mean())))
    right = level * (_at_zero(s, azimuth, behind) - _at_zero(s, azimuth, before))
    up = _at_zero(s, pitch, behind) - _at_zero(s, pitch, before)
    # two lines led on to the weld: four times the variance of a mean over the side, the errors of both sides being half common
    sigma = 2.0 * max(stated_turn_sigma(line[name], 0.5 * _SIDE_M) for name in ("azimuth", "pitch"))
    angle = float(np.hypot(right, up))
    if not angle > options.dogleg_sigmas * sigma:
        return []
    gauge = float(line["curvature_horizontal"].attrs["gauge_length_m"])
    return [
        {
            "kind": kind,
            "start_m": place,
            "end_m": place,
            "angle_horizontal_deg": right,
            "angle_vertical_deg": up,
            "angle_deg": angle,
            "angle_sigma_deg": sigma,
            "clock_deg": float(tension_clock(right, up)),
            "radius_m": np.nan,
            "standardised_percent": float(standardised_percent(np.radians(angle) / gauge, diameter)),
        }
    ]


def _at_zero(s: Floats, values: Floats, use: Floats) -> float:
    """Value at the place itself of the line through the values on one side."""
    x, y = s[use], values[use]
    slope = np.sum((x - x.mean()) * (y - y.mean())) / np.sum((x - x.mean()) ** 2)
    return float(y.mean() - slope * x.mean())
