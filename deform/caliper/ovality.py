"""Scan records in, the section on regular chainage out: ovality by both definitions, least, mean and greatest diameter."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.caliper.cross_section import ScanLog
from deform.run import build


def sections(logs: list[ScanLog], outside_diameter: float, step: float, window: float, definition: str = "outside") -> xr.Dataset:
    """Return group ``sections``: the mean section over ``window`` metres at every ``step`` metres.

    Parameters
    ----------
    logs : one scan log per ring.
    outside_diameter : m.
    definition : ``outside`` for (greatest - least diameter) / outside diameter, ``mean`` for / mean inner diameter.

    Notes
    -----
    The oval is averaged as a vector (its two components in the pipe's clock), so noise averages out instead of adding up;
    four times its length is the difference of the greatest and least diameter. Sigma comes from the scatter of the scans,
    or of the arms where a window holds fewer than four scans. Near a round pipe the length of a vector is biased upwards
    by half its variance over its length; ``ovality_sigma`` covers this.
    """
    grid, mean, sigma, count = _windowed(logs, step, window)
    length = np.hypot(mean["oval_cos"], mean["oval_sin"])
    oval_sigma = np.sqrt(0.5 * (sigma["oval_cos"] ** 2 + sigma["oval_sin"] ** 2))
    diameter, diameter_sigma = 2 * mean["radius"], 2 * sigma["radius"]
    end_sigma = 2 * np.sqrt(sigma["radius"] ** 2 + oval_sigma**2)
    by_outside, by_mean = 4 * length / outside_diameter, 4 * length / diameter
    values = {
        "chainage": grid,
        "ovality": by_outside if definition == "outside" else by_mean,
        "ovality_sigma": 4 * oval_sigma / (outside_diameter if definition == "outside" else diameter),
        "ovality_mean": by_mean,
        "ovality_mean_sigma": 4 * oval_sigma / diameter,
        "ovality_clock": np.degrees(0.5 * np.arctan2(mean["oval_sin"], mean["oval_cos"])) % 180.0,
        "diameter_min": diameter - 2 * length,
        "diameter_max": diameter + 2 * length,
        "diameter_mean": diameter,
        "diameter_min_sigma": end_sigma,
        "diameter_max_sigma": end_sigma,
        "diameter_mean_sigma": diameter_sigma,
        "scans": count,
    }
    words = (
        "(greatest - least diameter) / outside diameter"
        if definition == "outside"
        else "(greatest - least) / mean inner diameter"
    )
    return build.dataset("sections", values, definition=words, window_m=window)


def _windowed(logs: list[ScanLog], step: float, window: float):
    """Mean, sigma of the mean, and number of scans in windows on a regular grid."""
    places = np.concatenate([log.chainage[log.good] for log in logs])
    if not places.size:
        empty = np.empty(0)
        names = ("radius", "oval_cos", "oval_sin")
        return empty, dict.fromkeys(names, empty), dict.fromkeys(names, empty), empty.astype(int)
    first = np.floor(places.min() / step)
    cell = (np.rint(places / step) - first).astype(np.int64)
    cells = int(cell.max()) + 1
    half = max(0, round(window / step / 2 - 0.5))
    count = np.bincount(cell, minlength=cells)
    many = _running(count.astype(float), half)
    use = (count > 0) | (many > 3)
    floor = np.concatenate([log.reading_sigma[log.good] for log in logs])
    base = _running(np.bincount(cell, floor.astype(float) ** 2, cells), half)
    mean, sigma = {}, {}
    with np.errstate(invalid="ignore", divide="ignore"):
        for name, factor in (("radius", 1.0), ("oval_cos", 2.0), ("oval_sin", 2.0)):
            value = np.concatenate([getattr(log, name)[log.good] for log in logs]).astype(float)
            centre = np.median(value)
            total = _running(np.bincount(cell, value - centre, cells), half)
            squares = _running(np.bincount(cell, (value - centre) ** 2, cells), half)
            mean[name] = (centre + total / many)[use]
            scatter = np.maximum(squares / many - (total / many) ** 2, 0.0) / np.maximum(many - 1.0, 1.0)
            least = factor * base / many**2
            sigma[name] = np.sqrt(np.where(many > 3, np.maximum(scatter, least), least))[use]
    return ((first + np.arange(cells)) * step)[use], mean, sigma, np.rint(many[use]).astype(int)


def _running(values: np.ndarray, half: int) -> np.ndarray:
    """Sum over 2 half + 1 cells, shorter at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(values.size)
    return sums[np.minimum(index + half + 1, values.size)] - sums[np.maximum(index - half, 0)]


def on_chainage(section: xr.Dataset, chainage: np.ndarray, reach: float = 1.0) -> xr.Dataset:
    """Interpolate ovality and diameters to places (m); NaN further than ``reach`` metres from a measured section."""
    names = ("ovality", "diameter_min", "diameter_max", "diameter_mean")
    place, at = np.asarray(chainage, float), section["chainage"].values
    values: dict[str, np.ndarray] = {"chainage": place}
    if at.size:
        right = np.clip(np.searchsorted(at, place), 0, at.size - 1)
        left = np.maximum(right - 1, 0)
        near = np.minimum(np.abs(at[right] - place), np.abs(at[left] - place)) <= reach
        for name in (n for base in names for n in (base, f"{base}_sigma")):
            values[name] = np.where(near, np.interp(place, at, section[name].values), np.nan)
    result = build.dataset("centreline", values)
    return result.assign_attrs(section.attrs)
