"""Scan records in, dents out: candidates from inward departures, then a smooth shape fitted to all arms around each."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import xarray as xr

from deform.caliper.cross_section import Limits, ScanLog
from deform.caliper.dent_fit import fit_dent
from deform.caliper.dent_samples import DentSamples, gather
from deform.caliper.dent_shape import DentFit, wrap
from deform.caliper.scans import ScanReader
from deform.caliper.stretches import Row
from deform.run import build

OPENING_M = 3e-3  # some arms reach this far outside the section: a tee, a tap or another opening
logger = logging.getLogger(__name__)

_CANDIDATE_SHARE = 0.2  # of the least depth asked for: an apex between two arms shows less than its depth
_BROAD_SHARE = 0.45  # likewise, from the usual section around: many arms see a broad dent
_LONGEST_M = 4.0  # longer stretches are no dent
_CANDIDATE_SIGMA = 2.2  # of one reading, after the running mean; the largest of all arms rarely exceeds it by chance
_GAP_M = 0.08  # a candidate may be interrupted this long
_LEAST_SCANS = 3
_FLANK_M = 0.6  # sound wall on either side from which the undamaged section is taken
_APEXES_DEG = 40.0  # apexes of one dent, and ripples of one wrinkle, lie this near to each other around the pipe
_SAME_M, _SAME_RAD = 0.05, 0.35  # fits nearer to each other than this are one dent


@dataclass(frozen=True)
class Candidate:
    """A stretch of inward departure: start, end and centre (m), clock (rad) and depth as seen by one arm (m)."""

    start: float
    end: float
    centre: float
    clock: float
    depth: float


def limits(sigma: float, least_depth: float) -> Limits:
    """Departures from which on a scan may belong to a dent or an opening; ``sigma`` of one reading, both in metre."""
    dip = max(_CANDIDATE_SHARE * least_depth, _CANDIDATE_SIGMA * sigma)
    return Limits(dip=dip, broad=max(_BROAD_SHARE * least_depth, 1.5 * dip), bulge=OPENING_M)


def candidates(reader: ScanReader, logs: list[ScanLog], limit: float) -> list[Candidate]:
    """Stretches in which some arm stands inward of the section by more than ``limit`` (m)."""
    found: list[Candidate] = []
    for log in logs:
        place = reader.chainage(reader.time[log.dips.index], log.ring)
        order = np.argsort(place, kind="stable")
        stretch = _Stretch(place[order], log.dips.size[order].astype(float), log.dips.clock[order].astype(float))
        found += _in_stretch(stretch, limit, reader.raw.id)
    return _merged(found)


@dataclass(frozen=True)
class _Stretch:
    """Departures in order of chainage: place (m), size (m), clock (rad)."""

    place: np.ndarray
    size: np.ndarray
    clock: np.ndarray

    def part(self, pick: np.ndarray) -> _Stretch:
        return _Stretch(self.place[pick], self.size[pick], self.clock[pick])


def _in_stretch(all_of_it: _Stretch, limit: float, run_id: str) -> list[Candidate]:
    found: list[Candidate] = []
    every = np.flatnonzero(all_of_it.size > limit)
    if not every.size:
        return found
    for group in np.split(every, np.flatnonzero(np.diff(all_of_it.place[every]) > _GAP_M) + 1):
        for part in _by_clock(all_of_it.part(group)):
            if part.place.size < _LEAST_SCANS:
                continue
            if np.ptp(part.place) > _LONGEST_M:  # an arm that reads inward, or a long low swell: look for what stands out of it
                deeper = _in_stretch(part, 2.0 * limit, run_id)
                if not deeper:
                    ends = f"{part.place[0]:.1f} to {part.place[-1]:.1f} m"
                    logger.warning("%s: some arm stands %.1f mm inward from %s: no dent", run_id, part.size.max() * 1e3, ends)
                found += deeper
                continue
            best = int(np.argmax(part.size))
            weight = part.size - 0.999 * limit
            centre = float(np.sum(weight * part.place) / np.sum(weight))
            first, last = float(part.place.min()), float(part.place.max())
            found.append(Candidate(first, last, centre, float(part.clock[best]), float(part.size[best])))
    return found


def _by_clock(group: _Stretch) -> list[_Stretch]:
    """Split scans of one stretch when their deepest arms lie on different sides of the pipe."""
    parts, left = [], group
    while left.place.size:
        near = np.abs(wrap(left.clock - left.clock[np.argmax(left.size)])) < 0.8
        parts.append(left.part(near))
        left = left.part(~near)
    return parts


def _merged(found: list[Candidate]) -> list[Candidate]:
    """One candidate where several rings, or interrupted stretches, show the same."""
    kept: list[Candidate] = []
    for c in sorted(found, key=lambda c: -c.depth):
        near = [k for k in kept if c.start < k.end + 0.1 and c.end > k.start - 0.1 and abs(wrap(c.clock - k.clock)) < 0.8]
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

    Notes
    -----
    Dents that lie within each other's windows are fitted in turns, each with the others taken off the readings.
    """
    fits: list[DentFit] = []
    for group in _neighbours(found):
        fits += _fitted_together(reader, logs, group, sigma, 0.5 * outside_diameter, 0.5 * least_depth)
    fits.sort(key=lambda f: f.centre)
    for fit in (f for f in fits if not f.settled):
        words = "%s: the fit of the dent at %.2f m, %.0f degree has not settled; its sigmas hold the last step"
        logger.warning(words, reader.raw.id, fit.centre, np.degrees(fit.clock))
    return dataset(fits, least_depth), fits


def _neighbours(found: list[Candidate]) -> list[list[Candidate]]:
    """Candidates whose windows touch, as groups in the order of the line."""
    groups: list[list[Candidate]] = []
    reach = -np.inf
    for c in sorted(found, key=lambda c: c.start):
        if c.start - _FLANK_M < reach:
            groups[-1].append(c)
        else:
            groups.append([c])
        reach = max(reach, c.end + _FLANK_M)
    return groups


def _fitted_together(
    reader: ScanReader, logs: list[ScanLog], group: list[Candidate], sigma: float, radius: float, least: float
) -> list[DentFit]:
    """The real dents of a group of candidates, the deepest first; with neighbours in two turns."""
    order = sorted(group, key=lambda c: -c.depth)
    windows = [gather(reader, logs, c.start, c.end, _FLANK_M) for c in order]
    fits: list[DentFit | None] = [None] * len(order)
    for turn in range(2 if len(order) > 1 else 1):
        for k, (candidate, samples) in enumerate(zip(order, windows, strict=True)):
            if samples is None or (turn and fits[k] is None):
                continue
            others = [f for j, f in enumerate(fits) if f is not None and j != k]
            start = (candidate.centre, candidate.clock, candidate.depth)
            fit = fit_dent(samples.without(others), *start, sigma, radius, candidate.end - candidate.start)
            real = fit is not None and fit.depth >= least and _real(fit, samples) and not any(_same(fit, f) for f in others)
            fits[k] = fit if real else None
    return [f for f in fits if f is not None]


def _same(first: DentFit, second: DentFit) -> bool:
    return abs(first.centre - second.centre) < _SAME_M and abs(wrap(first.clock - second.clock)) < _SAME_RAD


def _real(fit: DentFit, samples: DentSamples) -> bool:
    """A dent is a few scans long at least and does not fill the window in which it was fitted."""
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
        "area": column["area"],
        "slope_max": column["slope"],
        "probability": np.clip(1.0 - np.exp(-0.5 * (depth / np.maximum(sigma, 1e-6) - 3.0)), 0.0, 1.0),
        "shape": np.array(["plain"] * len(fits), dtype=object),
        "sizing": np.array(["measured"] * len(fits), dtype=object),
    }
    return build.dataset("dents", values, least_depth_m=least_depth, reference="robust section of the wall on both sides")


def beside_welds(dents: xr.Dataset, welds: xr.Dataset, ripples: list[Row]) -> xr.Dataset:
    """Return the dents with the wall (m) of their joint, the distance from the next weld upstream (m), and their class.

    The class is plain, multi-apex, at weld, or wrinkle, the last that holds. Attribute ``wall_thickness_sigma_m`` is the largest
    sigma of these walls.
    """
    place, clock, length = (dents[n].values for n in ("chainage", "clock", "length"))
    sure = welds["probability"].values >= 0.5
    joints, wall, spread = (welds[n].values[sure] for n in ("chainage", "wall_thickness", "wall_thickness_sigma"))
    reach = 0.5 * length + 0.02
    shape = np.array(["plain"] * place.size, dtype=object)
    distance, thickness, sigma = (np.full(place.size, np.nan) for _ in range(3))
    for k, centre in enumerate(place):
        before = int(np.searchsorted(joints, centre, side="right")) - 1
        if before >= 0:
            distance[k], thickness[k], sigma[k] = centre - joints[before], wall[before], spread[before]
        near = (np.abs(place - centre) < reach[k] + reach) & (np.abs((clock - clock[k] + 180) % 360 - 180) < _APEXES_DEG)
        if near.sum() > 1:
            shape[k] = "multi-apex"
        if joints.size and np.abs(joints - centre).min() < reach[k]:
            shape[k] = "at weld"
        for r in ripples:
            turn = abs((float(r["clock"]) - clock[k] + 180) % 360 - 180)  # type: ignore[arg-type]  # plain numbers
            if float(r["chainage"]) < centre < float(r["chainage_end"]) and turn < _APEXES_DEG:  # type: ignore[arg-type]  # plain
                shape[k] = "wrinkle"
    dents = build.add(dents, "dents", {"weld_distance": distance, "wall_thickness": thickness, "shape": shape})
    known = sigma[np.isfinite(sigma)]
    return dents.assign_attrs(wall_thickness_sigma_m=float(known.max())) if known.size else dents


__all__ = ["Candidate", "candidates", "dataset", "limits", "measure_dents"]
