"""Candidates and the readings around them in, wrinkles out: trains of ripples that stand in and out by turns on one side."""

from __future__ import annotations

import numpy as np

from deform.caliper.cross_section import ScanLog
from deform.caliper.dent_samples import DentSamples, gather
from deform.caliper.dent_shape import wrap
from deform.caliper.dents import Candidate
from deform.caliper.scans import ScanReader
from deform.caliper.stretches import Row

_SIDE_RAD = 0.35  # arms this near to the apex show the ripples
_WIDEST_RAD = 1.2  # how far to both sides a crest may reach
_LEAST_TURNS = 3  # ripples stand in, out and in again, or the other way round
_SHARE = 0.2  # of the highest ripple: lower ones do not count
_SURE = 5.0  # sigma of the profile
_AROUND_OD = 1.5  # pipe on both sides in which ripples are looked for
_SMOOTH = 3  # scans


def wrinkles(reader: ScanReader, logs: list[ScanLog], found: list[Candidate], sigma: float, outside_diameter: float) -> list[Row]:
    """Return the wrinkles in order of chainage.

    Parameters
    ----------
    found : candidates of dents; a wrinkle is one or several of them, each shorter than the diameter.
    sigma : standard deviation of one reading (m).
    outside_diameter : m.

    Notes
    -----
    ``value`` is the height from the lowest trough to the highest crest, ``spacing`` that from crest to crest.
    """
    rows: list[Row] = []
    for candidate in found:
        if candidate.end - candidate.start > outside_diameter:
            continue
        if any(float(r["chainage"]) - 0.1 < candidate.centre < float(r["chainage_end"]) + 0.1 for r in rows):  # type: ignore[arg-type]  # plain numbers
            continue
        samples = gather(reader, logs, candidate.centre, candidate.centre, _AROUND_OD * outside_diameter)
        row = None if samples is None else _wrinkle(samples, candidate.clock, sigma)
        if row is not None:
            rows.append(row)
    return sorted(rows, key=lambda r: float(r["chainage"]))  # type: ignore[arg-type]  # plain number


def _wrinkle(samples: DentSamples, clock: float, sigma: float) -> Row | None:
    place, profile, noise = _profile(samples, clock, sigma)
    if place.size < 15:
        return None
    limit = max(_SURE * noise, _SHARE * float(np.abs(profile).max()))
    turns: list[int] = []
    for i in np.flatnonzero(np.abs(profile) > limit):
        if turns and np.sign(profile[i]) == np.sign(profile[turns[-1]]):
            if abs(profile[i]) > abs(profile[turns[-1]]):
                turns[-1] = int(i)
        else:
            turns.append(int(i))
    if len(turns) < _LEAST_TURNS:
        return None
    height = float(profile[turns].max() - profile[turns].min())
    spacing = 2.0 * float(np.mean(np.diff(place[turns])))
    pitch = float(np.median(np.diff(place)))
    return {
        "chainage": float(place[turns[0]]) - 0.25 * spacing,
        "chainage_end": float(place[turns[-1]]) + 0.25 * spacing,
        "kind": "wrinkle",
        "clock": float(np.degrees(_middle(samples, clock, float(place[turns[int(np.argmax(profile[turns]))]]))) % 360.0),
        "value": height,
        "value_sigma": float(np.hypot(np.sqrt(2.0) * noise, 0.05 * height)),  # a crest may lie between two scans or arms
        "spacing": spacing,
        "spacing_sigma": float(2.0 * pitch / np.sqrt(6.0) / (len(turns) - 1)),
        "text": f"{len(turns)} ripples in and out, height {height * 1e3:.1f} mm, spacing {spacing:.2f} m",
    }


def _middle(samples: DentSamples, clock: float, crest: float) -> float:
    """Clock (rad) of the middle of the highest crest, which stands at a place (m)."""
    inward, clocks = _inward(samples)
    rows = np.abs(samples.place - crest) < 0.02
    near = rows[:, None] & (np.abs(wrap(clocks - clock)) < _WIDEST_RAD) & np.isfinite(inward)
    if not near.any():
        return clock
    weight = np.clip(inward[near] - 0.5 * float(inward[near].max()), 0.0, None)
    return clock + float(np.sum(weight * wrap(clocks[near] - clock)) / max(weight.sum(), 1e-12))


def _inward(samples: DentSamples) -> tuple[np.ndarray, np.ndarray]:
    """How far each arm stands inward of its own median (m), and its clock (rad) about the centre."""
    still = np.ones(len(samples.place))  # ripples draw the centre of their own scans: take the usual one
    radius, clocks = samples.centred(np.median(samples.right) * still, np.median(samples.up) * still)
    there = np.isfinite(radius).any(axis=0)
    usual = np.full(radius.shape[1], np.nan)
    usual[there] = np.nanmedian(radius[:, there], axis=0)
    return usual[None, :] - radius, clocks


def _profile(samples: DentSamples, clock: float, sigma: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean inward departure (m) of the arms near the apex from their own median, along the pipe, and its noise."""
    inward, clocks = _inward(samples)
    near = (np.abs(wrap(clocks - clock)) < _SIDE_RAD) & np.isfinite(inward)
    count = near.sum(axis=1)
    use = count > 0
    inward = np.where(near, np.nan_to_num(inward), 0.0).sum(axis=1)
    order = np.argsort(samples.place[use], kind="stable")
    value = (inward[use] / count[use])[order]
    smooth = np.convolve(np.pad(value, _SMOOTH // 2, mode="edge"), np.ones(_SMOOTH) / _SMOOTH, mode="valid")
    scans = np.median(samples.count[use])
    return samples.place[use][order], smooth, float(sigma / np.sqrt(np.median(count[use]) * _SMOOTH * scans))
