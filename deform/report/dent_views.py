"""Dents and the wall maps of the runs in, one dataset per dent on one grid for all epochs out, with its pictures for the page."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import xarray as xr

from deform.report import figures
from deform.report.content import Content, wall_window
from deform.report.svg import themed_svg

_STEP_M = 0.02
_MOST_SCANS = 90
_SURFACE_SHAPE = (70, 72)
_UNMEASURED = ("removed", "unmeasured", "copied")


def dent_views(content: Content, dents: list[dict]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the cards (dent, its picture as SVG or None) and the 3-D surfaces by dent for the page's script.

    A dent of one run without a wall map has no card: the table says all that is known of it.
    """
    cards, surfaces = [], {}
    for dent in dents:
        window = dent_dataset(content, dent)
        picture = None
        if window is not None:
            picture = themed_svg(figures.dent_card(window), f"Dent {dent['id']}: wall, profiles and section of every run")
            surfaces[dent["id"]] = _surface(window)
        if picture is not None or len(dent["epochs"]) > 1:
            cards.append({"dent": dent, "picture": picture})
    return cards, surfaces


def dent_dataset(content: Content, dent: dict) -> xr.Dataset | None:
    """Return ``depth(run, distance, clock)`` (m, positive inward from the undamaged wall) around a dent; None without a wall map.

    ``distance`` (m) is measured downstream from the apex in each run, ``clock`` in degree; all epochs stand on one grid.
    """
    half = _half_length(dent)
    distance = np.linspace(-half, half, min(int(2 * half / _STEP_M) + 1, _MOST_SCANS))
    found, clock = {}, None
    for epoch in dent["epochs"]:
        if epoch["status"] in _UNMEASURED:
            continue
        wall = wall_window(content, epoch["run"], epoch["run_chainage"], half + 0.1)
        if wall is None:
            continue
        clock = wall["clock"].values if clock is None else clock
        found[epoch["run"]] = _on_grid(wall, epoch["run_chainage"] + distance, clock)
    if clock is None:
        return None
    radius = np.nanmedian([r for _, r in found.values()])
    ds = xr.Dataset(
        {"depth": (("run", "distance", "clock"), np.stack([d for d, _ in found.values()]))},
        coords={"run": list(found), "distance": distance, "clock": clock},
        attrs={"dent": dent["id"], "radius_m": float(radius), "clock_deg": dent["clock_deg"], "chainage_m": dent["chainage"]},
    )
    ds["epoch"] = ("run", [content.ids.index(name) for name in found])
    ds["date"] = ("run", [content.dates.get(name, "") for name in found])
    return ds


def _half_length(dent: dict) -> float:
    lengths = [e["length"].value for e in dent["epochs"] if e["length"]]
    return float(np.clip(1.5 * max(lengths, default=0.3), 0.3, 1.2))


def _on_grid(wall: xr.Dataset, at: np.ndarray, clock: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the depth (distance, clock) and the radius of the undamaged pipe (m)."""
    values = np.asarray(wall["radius"].values, float)
    reference = np.full(len(values), np.nanmedian(values))
    if "reference_radius" in wall:
        reference = np.asarray(wall["reference_radius"].values, float)
    depth = reference[:, None] - values
    places, clocks = wall["chainage"].values, wall["clock"].values
    order = np.argsort(clocks)
    wrapped = np.concatenate([clocks[order][-1:] - 360, clocks[order], clocks[order][:1] + 360])
    along = np.stack([np.interp(at, places, column, left=np.nan, right=np.nan) for column in depth.T], axis=1)[:, order]
    around = np.stack([np.interp(clock % 360, wrapped, np.concatenate([row[-1:], row, row[:1]])) for row in along])
    return around, float(np.nanmedian(reference))


def _surface(window: xr.Dataset) -> dict[str, Any]:
    """Return the wall of every epoch, thinned, as micrometres inward, base64 of int16."""
    n = window.sizes["distance"], window.sizes["clock"]
    step = [max(int(np.ceil(have / most)), 1) for have, most in zip(n, _SURFACE_SHAPE, strict=True)]
    thin = window.isel(distance=slice(None, None, step[0]), clock=slice(None, None, step[1]))
    micrometres = np.clip(np.nan_to_num(thin["depth"].values * 1e6, nan=-32768), -32768, 32767).astype("<i2")
    return {
        "runs": [str(r) for r in thin["run"].values],
        "distance": np.round(thin["distance"].values, 4),
        "clock": np.round(thin["clock"].values, 3),
        "radius": window.attrs["radius_m"],
        "at": window.attrs["clock_deg"],
        "depth": [base64.b64encode(m.tobytes()).decode("ascii") for m in micrometres],
    }
