"""Scan records in, dents out: candidates from inward departures, then a smooth shape fitted to all arms around each."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import xarray as xr

from deform.caliper.cross_section import ScanLog
from deform.caliper.dent_shape import DentFit, DentSamples, fit_dent, gather
from deform.caliper.scans import ScanReader
from deform.run import build

logger = logging.getLogger(__name__)

_CANDIDATE_SHARE = 0.2  # of the least depth asked for: an apex between two arms shows less than its depth
_CANDIDATE_SIGMA = 2.2  # of one reading, after the running mean; the largest of all arms rarely exceeds it by chance
_GAP_M = 0.08  # a candidate may be interrupted this long
_LEAST_SCANS = 3
_FLANK_M = 0.6  # sound wall on either side from which the undamaged section is taken
_SAME_M, _SAME_RAD = 0.05, 0.35  # fits nearer to each other than this are one dent


@dataclass(frozen=True)
class Candidate:
    """A stretch of inward departure: start, end and centre (m), clock (rad) and depth as seen by one arm (m)."""

    start: float
    end: float
    centre: float
    clock: float
    depth: float


def candidates(logs: list[ScanLog], sigma: float, least_depth: float) -> list[Candidate]:
    """Stretches in which some arm stands inward of the robust section by more than noise allows."""
    found: list[Candidate] = []
    for log in logs:
        limit = max(_CANDIDATE_SHARE * least_depth, _CANDIDATE_SIGMA * sigma)
        above = np.flatnonzero(log.good & (np.nan_to_num(log.dip) > limit))
        if not above.size:
            continue
        order = above[np.argsort(log.chainage[above], kind="stable")]
        place = log.chainage[order]
        for group in np.split(order, np.flatnonzero(np.diff(place) > _GAP_M) + 1):
            for part in _by_clock(log, group):
                if part.size >= _LEAST_SCANS:
                    best = part[np.argmax(log.dip[part])]
                    at = log.chainage[part]
                    weight = log.dip[part].astype(float) - limit
                    centre = float(np.sum(weight * at) / np.sum(weight))
                    found.append(
                        Candidate(float(at.min()), float(at.max()), centre, float(log.dip_clock[best]), float(log.dip[best]))
                    )
    return _merged(found)


def _by_clock(log: ScanLog, group: np.ndarray) -> list[np.ndarray]:
    """Split scans of one stretch when their deepest arms lie on different sides of the pipe."""
    parts, left = [], group
    while left.size:
        best = left[np.argmax(log.dip[left])]
        near = np.abs(_wrap(log.dip_clock[left].astype(float) - float(log.dip_clock[best]))) < 0.8
        parts.append(left[near])
        left = left[~near]
    return parts


def _merged(found: list[Candidate]) -> list[Candidate]:
    """One candidate where several rings, or interrupted stretches, show the same."""
    kept: list[Candidate] = []
    for c in sorted(found, key=lambda c: -c.depth):
        near = [k for k in kept if c.start < k.end + 0.1 and c.end > k.start - 0.1 and abs(_wrap(c.clock - k.clock)) < 0.8]
        if not near:
            kept.append(c)
    return sorted(kept, key=lambda c: c.centre)


def measure_dents(
    reader: ScanReader, logs: list[ScanLog], found: list[Candidate], sigma: float, outside_diameter: float, least_depth: float
) -> tuple[xr.Dataset, list[DentFit]]:
    """Fit each candidate and return group ``dents`` with those that are at least half as deep as asked for.

    Parameters
    ----------
    sigma : standard deviation of one reading (m).
    least_depth : depth (m) that must not be missed; shallower ones down to half of it are listed as well.
    """
    fits: list[DentFit] = []
    for candidate in found:
        samples = gather(reader, logs, candidate.start, candidate.end, _FLANK_M)
        fit = fit_dent(samples, candidate.centre, candidate.clock, candidate.depth, sigma) if samples is not None else None
        if fit is None or fit.depth < 0.5 * least_depth or not _real(fit, samples):
            continue
        if not any(abs(f.centre - fit.centre) < _SAME_M and abs(_wrap(f.clock - fit.clock)) < _SAME_RAD for f in fits):
            fits.append(fit)
    return dataset(fits, least_depth), fits


def _real(fit: DentFit, samples: DentSamples | None) -> bool:
    """A dent is a few scans long at least and does not fill the window in which it was fitted."""
    if samples is None:
        return False
    pitch = float(np.median(np.abs(np.diff(samples.place))))
    return fit.length > 2.5 * pitch and fit.length < 0.9 * float(np.ptp(samples.place))


def dataset(fits: list[DentFit], least_depth: float) -> xr.Dataset:
    """Group ``dents`` of fitted dents."""
    column = {name: np.array([getattr(f, name) for f in fits], float) for name in DentFit.NUMBERS}
    depth, sigma = column["depth"], column["depth_sigma"]
    values = {
        "chainage": column["centre"],
        "clock": np.degrees(column["clock"]) % 360.0,
        "clock_sigma": np.degrees(column["clock_sigma"]),
        "depth": depth,
        "depth_sigma": sigma,
        "length": column["length"],
        "length_sigma": column["length_sigma"],
        "width": column["width"],
        "width_sigma": column["width_sigma"],
        "probability": np.clip(1.0 - np.exp(-0.5 * (depth / np.maximum(sigma, 1e-6) - 3.0)), 0.0, 1.0),
        "shape": np.array([f.shape for f in fits], dtype=object),
        "sizing": np.array(["measured"] * len(fits), dtype=object),
    }
    return build.dataset("dents", values, least_depth_m=least_depth, reference="robust section of the wall on both sides")


def beside_welds(dents: xr.Dataset, welds: xr.Dataset) -> xr.Dataset:
    """Return the dents with the distance from the next weld upstream (m), and their class: plain, at weld, multi-apex."""
    place, joints = dents["chainage"].values, welds["chainage"].values[welds["probability"].values >= 0.5]
    reach = 0.5 * dents["length"].values + 0.02
    shape = np.array(["plain"] * place.size, dtype=object)
    distance = np.full(place.size, np.nan)
    for k, centre in enumerate(place):
        before = joints[joints <= centre]
        if before.size:
            distance[k] = centre - before[-1]
        others = np.abs(place - centre) < reach[k] + reach
        turned = np.abs((dents["clock"].values - dents["clock"].values[k] + 180) % 360 - 180) < 40
        if (others & turned).sum() > 1:
            shape[k] = "multi-apex"
        if joints.size and np.abs(joints - centre).min() < reach[k]:
            shape[k] = "at weld"
    return build.add(dents, "dents", {"weld_distance": distance, "shape": shape})


def _wrap(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


__all__ = ["Candidate", "DentSamples", "candidates", "dataset", "measure_dents"]
