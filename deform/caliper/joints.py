"""Weld log, scan records and features in, the joint table out: number, length, wall and kind of the joint behind each weld."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.caliper.cross_section import ScanLog, scan_ranges
from deform.caliper.scans import ScanReader
from deform.run import build

_SURE = 0.5  # probability from which on a weld ends a joint
_END_M = 0.3  # wall beside a weld that does not count for the joint
_PUP = 0.5  # of the nominal length; shorter joints are pups
_KINDS = ("valve", "tee", "bend")  # what gives a joint its name, the first that lies in it
_MOST_WALL_M = 0.2
_ALIKE_M = 0.5  # radii of a joint that stand further apart than this are independent
_OUTSIDE_SHARE = 0.0025  # of the diameter, sigma of the outer radius: API 5L allows bodies of pipe 0.5 to 0.75 % of the diameter


def joint_walls(
    welds: xr.Dataset, reader: ScanReader, logs: list[ScanLog], outside_diameter: float
) -> tuple[xr.Dataset, np.ndarray]:
    """Return the welds with the wall thickness (m) of the joint that begins at each, and its sigma.

    The wall is the nominal outer radius of the pipe minus the median of the inner one over the joint. Its sigma holds the
    tolerance of the outside diameter, in which the calibration of the arms is lost. The second result, (weld,) m, is the sigma
    without it: what joints of one diameter, seen by the same arms, are compared by.
    """
    wall, sigma = (np.full(welds.sizes["weld"], np.nan) for _ in range(2))
    for k, start, end in spans(welds, reader.span()[1]):
        inner = _radii(reader, logs, start + _END_M, end - _END_M)
        if inner.size >= 10:
            middle = float(np.median(inner))
            scatter = 1.4826 * float(np.median(np.abs(inner - middle)))
            alone = min(inner.size, max(1.0, (end - start - 2 * _END_M) / _ALIKE_M))
            wall[k], sigma[k] = 0.5 * outside_diameter - middle, 1.2533 * scatter / np.sqrt(alone)
    good = (wall > 0) & (wall < _MOST_WALL_M)
    wall, sigma = np.where(good, wall, np.nan), np.where(good, sigma, np.nan)
    whole = np.hypot(sigma, _OUTSIDE_SHARE * outside_diameter)
    return build.add(welds, "welds", {"wall_thickness": wall, "wall_thickness_sigma": whole}), sigma


def _radii(reader: ScanReader, logs: list[ScanLog], start: float, end: float) -> np.ndarray:
    """Mean radius (m) of every good scan between two places."""
    if end <= start:
        return np.empty(0)
    parts = [log.radius[a:b][log.good[a:b]] for log in logs for a, b in scan_ranges(reader, log, start, end)]
    return np.concatenate(parts) if parts else np.empty(0)


def name_joints(welds: xr.Dataset, features: xr.Dataset | None, nominal_joint: float, end: float) -> xr.Dataset:
    """Return the welds with number and kind of the joint that begins at each.

    Parameters
    ----------
    welds : group ``welds``.
    features : group ``features``, or None without a caliper.
    nominal_joint : m.
    end : chainage (m) at which the last joint ends.
    """
    n = welds.sizes["weld"]
    number, kind = np.zeros(n, np.int64), np.array([""] * n, dtype=object)
    for count, (k, start, stop) in enumerate(spans(welds, end)):
        number[k] = count + 1
        kind[k] = _kind(features, start, stop, nominal_joint)
    return build.add(welds, "welds", {"joint_number": number, "joint_kind": kind})


def spans(welds: xr.Dataset, end: float) -> list[tuple[int, float, float]]:
    """Index of the weld at which each joint begins, and where it begins and ends (m)."""
    place = welds["chainage"].values
    sure = np.flatnonzero(welds["probability"].values >= _SURE)
    stops = np.append(place[sure[1:]], max(end, place[sure[-1]])) if sure.size else np.empty(0)
    return [(int(k), float(place[k]), float(stop)) for k, stop in zip(sure, stops, strict=True)]


def _kind(features: xr.Dataset | None, start: float, stop: float, nominal: float) -> str:
    if features is not None:
        at, behind = features["chainage"].values, features["chainage_end"].values
        middle = np.where(np.isfinite(behind), 0.5 * (at + behind), at)
        inside = (middle >= start) & (middle < stop)
        there = set(features["kind"].values[inside].astype(str))
        for kind in _KINDS:
            if kind in there:
                return kind
    return "pup" if stop - start < _PUP * nominal else "pipe"
