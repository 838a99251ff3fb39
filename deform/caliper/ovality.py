"""Scan records in, the section on regular chainage out: ovality by both definitions, least, mean and greatest diameter."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.caliper.cross_section import ScanLog
from deform.caliper.scans import ScanReader
from deform.run import build


def sections(
    reader: ScanReader, logs: list[ScanLog], outside_diameter: float, step: float, window: float, definition: str = "outside"
) -> xr.Dataset:
    """Return group ``sections``: the mean section over ``window`` metres at every ``step`` metres.

    Parameters
    ----------
    reader : gives the chainage of the scans.
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
    grid, mean, sigma, count = _windowed(reader, logs, outside_diameter, step, window)
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


_WINDOWED = ("radius", "oval_cos", "oval_sin")


def _windowed(reader: ScanReader, logs: list[ScanLog], diameter: float, step: float, window: float):
    """Mean, sigma of the mean, and number of scans in windows on a regular grid."""
    centre = {"radius": 0.5 * diameter, "oval_cos": 0.0, "oval_sin": 0.0}  # near the values, so that squares stay small
    first, count, base, sums, squares = _sums(reader, logs, centre, step)
    half = max(0, round(window / step / 2 - 0.5))
    many = _running(count, half)
    use = (count > 0) | (many > 3)
    floor = _running(base, half)
    mean, sigma = {}, {}
    with np.errstate(invalid="ignore", divide="ignore"):
        for name, factor in zip(_WINDOWED, (1.0, 2.0, 2.0), strict=True):
            total, square = _running(sums[name], half), _running(squares[name], half)
            mean[name] = (centre[name] + total / many)[use]
            scatter = np.maximum(square / many - (total / many) ** 2, 0.0) / np.maximum(many - 1.0, 1.0)
            least = factor * floor / many**2
            sigma[name] = np.sqrt(np.where(many > 3, np.maximum(scatter, least), least))[use]
    return ((first + np.arange(count.size)) * step)[use], mean, sigma, np.rint(many[use]).astype(int)


def _sums(reader: ScanReader, logs: list[ScanLog], centre: dict[str, float], step: float):
    """First cell, and per cell the number of scans, the sum of their variances, and sums and squares about a centre."""
    start, stop = reader.span()
    first = int(np.floor(start / step))
    cells = int(np.ceil(stop / step)) - first + 2
    count, base = np.zeros(cells), np.zeros(cells)
    sums, squares = ({name: np.zeros(cells) for name in _WINDOWED} for _ in range(2))
    for log in logs:
        for part, place in log.pieces(reader):
            good = log.good[part]
            if not good.any():
                continue
            cell = np.rint(place[good] / step).astype(np.int64) - first
            own = slice(int(cell.min()), int(cell.max()) + 1)
            cell -= own.start
            count[own] += np.bincount(cell)
            base[own] += np.bincount(cell, log.sigma[part][good].astype(float) ** 2)
            for name in _WINDOWED:
                value = getattr(log, name)[part][good].astype(float) - centre[name]
                sums[name][own] += np.bincount(cell, value)
                squares[name][own] += np.bincount(cell, value**2)
    return first, count, base, sums, squares


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
