"""The centreline of a zone and its displacement in, the pipe as a closed surface out, in one frame for all runs."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.geometry.earth import geodetic_to_local
from deform.mesh.colours import legend
from deform.mesh.surface import Surface, steel
from deform.options import MeshOptions

_STEP_M = 0.5
_AROUND = 36
_MARGIN_M = 20.0


def zone_shell(
    reference: xr.DataTree, comparison: xr.Dataset, run: str, start_m: float, end_m: float, options: MeshOptions
) -> Surface | None:
    """Return the pipe of a zone in one run, moved by its displacement times the exaggeration.

    Parameters
    ----------
    reference : the reference run (attributes and group ``/centreline``).
    comparison : content of ``comparison.nc``.
    run : epoch whose displacement is drawn.
    start_m, end_m : of the zone on the reference chainage, metre; 20 m are added on both sides.
    options : ``shell_exaggeration`` multiplies the displacement.

    Returns
    -------
    Surface or None
        x east, y north, z up from the middle of the zone, metre; the value is the size of the displacement (m), NaN where that is
        not known: grey and not moved. None when the reference run has no coordinates there, or does not state its pipe's size.
    """
    centreline = reference["centreline"].to_dataset() if "centreline" in reference.children else None
    radii = wall_radii(reference)
    if radii is None or centreline is None or "latitude" not in centreline:
        return None
    s = np.arange(start_m - _MARGIN_M, end_m + _MARGIN_M + _STEP_M, _STEP_M)
    own = centreline["chainage"].values
    latitude, longitude, height = (
        np.interp(s, own, centreline[n].values, left=np.nan, right=np.nan) for n in ("latitude", "longitude", "height")
    )
    good = np.isfinite(latitude + longitude + height)
    if good.sum() < 5:
        return None
    s, latitude, longitude, height = s[good], latitude[good], longitude[good], height[good]
    origin = tuple(float(v[s.size // 2]) for v in (latitude, longitude, height))
    moved = displacement(comparison, run, s)
    known = np.isfinite(moved).all(axis=1)
    path = np.stack(geodetic_to_local(latitude, longitude, height, *origin), axis=1)
    path = path + options.shell_exaggeration * np.nan_to_num(moved)
    size = np.where(known, np.linalg.norm(moved, axis=1), np.nan)
    meaning = {
        "unit": "m",
        "frame": "x east, y north, z up, tangent at the middle of the zone on the reference run; the same in every run",
        "origin": dict(zip(("latitude_deg", "longitude_deg", "height_m"), origin, strict=True)),
        "run": run,
        "date": _date(comparison, run),
        "reference": str(comparison.attrs.get("reference", "")),
        "start_m": float(s[0]),
        "end_m": float(s[-1]),
        "displacement_exaggeration": float(options.shell_exaggeration),
        "displacement_unknown_m": float((~known).sum() * _STEP_M),
        "colour": legend(size, "displacement", "m"),
    }
    walls = [_tube(path, radius) for radius in radii]
    value = np.repeat(size[:, None], _AROUND, axis=1)
    return steel(walls[0], walls[1], value, meaning, {"displacement_m": value})


def wall_radii(reference: xr.DataTree) -> tuple[float, float] | None:
    """Return inner and outer radius (m) of the pipe as a run states it; None when it does not."""
    diameter, wall = (float(reference.attrs.get(name, np.nan)) for name in ("outside_diameter_m", "nominal_wall_m"))
    return (diameter / 2 - wall, diameter / 2) if 0 < wall < diameter / 2 else None


def displacement(comparison: xr.Dataset, run: str, s: np.ndarray) -> np.ndarray:
    """Return the displacement (n, 3) east, north, up (m) of a run at reference chainages (n,); NaN where it is not known."""
    k = [str(name) for name in comparison["epoch"].values].index(run)
    at, parts = comparison["chainage"].values, []
    for name in ("east", "north", "up"):
        held = comparison.get(f"displacement_{name}")
        parts.append(np.full(s.size, np.nan) if held is None else np.interp(s, at, held.values[k], left=np.nan, right=np.nan))
    return np.stack(parts, axis=1)


def _date(comparison: xr.Dataset, run: str) -> str:
    names = [str(name) for name in comparison["epoch"].values]
    return str(comparison["date"].values[names.index(run)]) if "date" in comparison else ""


def _tube(path: np.ndarray, radius: float) -> np.ndarray:
    """Return points (n, around, 3) on circles across a path: clockwise looking along it, the first one on top."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    right = np.cross(along, [0.0, 0.0, 1.0])
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-9)
    up = np.cross(right, along)
    angle = np.arange(_AROUND) * 2 * np.pi / _AROUND
    return path[:, None, :] + radius * (
        right[:, None, :] * np.sin(angle)[None, :, None] + up[:, None, :] * np.cos(angle)[None, :, None]
    )
