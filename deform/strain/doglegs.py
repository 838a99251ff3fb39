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
_LEAST_VALUES = 5  # on either side
_BLOCK = 1024  # places looked at together, which bounds the memory
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
    rows = bends + _deflections(centreline, points, outside_diameter, options)
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


def _deflections(
    line: xr.Dataset, points: list[tuple[float, str]], diameter: float, options: StrainOptions
) -> list[dict[str, Any]]:
    """Rows of the points at which the pipe turns."""
    # two lines led on to the weld: four times the variance of a mean over the side, the errors of both sides being half common
    sigma = 2.0 * max(stated_turn_sigma(line[name], 0.5 * _SIDE_M) for name in ("azimuth", "pitch"))
    gauge = float(line["curvature_horizontal"].attrs["gauge_length_m"])
    chainage, azimuth, pitch = (line[name].values for name in ("chainage", "azimuth", "pitch"))
    right, up = jumps(chainage, azimuth, pitch, np.array([place for place, _ in points]))
    angle = np.hypot(right, up)
    return [
        {
            "kind": points[k][1],
            "start_m": points[k][0],
            "end_m": points[k][0],
            "angle_horizontal_deg": right[k],
            "angle_vertical_deg": up[k],
            "angle_deg": angle[k],
            "angle_sigma_deg": sigma,
            "clock_deg": float(tension_clock(right[k], up[k])),
            "radius_m": np.nan,
            "standardised_percent": float(standardised_percent(np.radians(angle[k]) / gauge, diameter)),
        }
        for k in np.flatnonzero(angle > options.dogleg_sigmas * sigma)
    ]


def jumps(chainage: Floats, azimuth: Floats, pitch: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return the turn to the right (times cos pitch) and up at places of a line, each (m,), degree.

    Parameters
    ----------
    chainage, azimuth, pitch : (n,) of the line (m, degree).
    places : (m,) where it may turn (m). NaN is returned where either side holds fewer than five values, or an unknown one.

    Notes
    -----
    The straight lines through the values of 3 m on either side, without 0.3 m about the place itself, led on to it.
    """
    right, up = np.full(places.size, np.nan), np.full(places.size, np.nan)
    for start in range(0, places.size, _BLOCK):
        some = slice(start, start + _BLOCK)
        first, last = np.searchsorted(chainage, [places[some] - _SIDE_M, places[some] + _SIDE_M])
        at = first[:, None] + np.arange(max(int((last - first).max()), 1))
        held, at = at < last[:, None], np.minimum(at, chainage.size - 1)
        s = chainage[at] - places[some, None]
        sides = held & (s >= _GAP_M), held & (s <= -_GAP_M)
        level = np.cos(np.radians(np.where(held, pitch[at], 0.0).sum(axis=1) / np.maximum(held.sum(axis=1), 1)))
        for out, values in ((right, np.unwrap(azimuth[at], period=360.0, axis=1)), (up, pitch[at])):
            behind, before = (_at_zero(s, values, use) for use in sides)
            out[some] = behind - before
        right[some] *= level
    return right, up


def _at_zero(s: Floats, values: Floats, use: Floats) -> Floats:
    """Values at zero of the lines through the used values of each row, NaN where there are fewer than five."""
    count = use.sum(axis=1)
    few = count < _LEAST_VALUES
    count = np.where(few, 1, count)
    x, y = np.where(use, s, 0.0), np.where(use, values, 0.0)
    x_mean, y_mean = x.sum(axis=1) / count, y.sum(axis=1) / count
    x = np.where(use, s - x_mean[:, None], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (x * np.where(use, values - y_mean[:, None], 0.0)).sum(axis=1) / (x**2).sum(axis=1)
        return np.where(few, np.nan, y_mean - slope * x_mean)
