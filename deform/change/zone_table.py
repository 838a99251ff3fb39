"""Candidates of every pair of runs and the edits of the line in, the zones of the line with extent, peak and first epoch out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.change.axial_zones import AxialZone
from deform.change.first_epoch import first_epoch
from deform.change.pair import PairChange
from deform.change.reasons import axial_words, edit_words, zone_words
from deform.change.running_mean import running_mean
from deform.change.significance import confidence_of
from deform.change.zones import TESTS_PER_WAVELENGTH, Candidate
from deform.options import ChangeOptions
from deform.run import build
from deform.strain.bending import tension_clock

Floats = NDArray[Any]
EDITS = ("cutout", "reroute")
_PEAK_STRAIN_LENGTH = 5.0  # m over which the change of strain is averaged before its peak is taken
_PEAK_DISPLACEMENT_LENGTH = 3.0
_COMMON = 0.3  # of the shorter of two candidates that must lie in the other for them to be one zone


@dataclass
class _Group:
    """Candidates of several pairs at one place."""

    start: float
    end: float
    members: list[tuple[PairChange, Candidate]]

    @property
    def best(self) -> tuple[PairChange, Candidate]:
        return max(self.members, key=lambda m: m[1].statistic)


def zone_table(
    pairs: list[PairChange],
    steps: list[PairChange],
    grown: list[AxialZone],
    axis: Floats,
    edits: pd.DataFrame,
    outside_diameter: float,
    options: ChangeOptions,
) -> pd.DataFrame:
    """Return the table ``zones``.

    Parameters
    ----------
    pairs : changes of each run since the reference run, in the order of the runs.
    steps : changes of runs since the run before, where that is not the reference run.
    grown : stretches whose joints grew or shrank. axis : reference chainage (m).
    edits : edits of the line, as `Matching.edits`.
    outside_diameter : of the pipe (m).
    options : least sizes and thresholds.

    Notes
    -----
    A zone is told from the pair that shows it best; it moved from the earlier run of that pair to the later one, whichever of
    them is the reference.
    """
    rows = []
    for group in _groups(pairs, steps):
        row = _row(group, pairs, axis, outside_diameter, options)
        if row is not None and not _in_edit(row, edits):
            rows.append(row)
    rows += [row for zone in grown if not _known(row := _axial_row(zone), rows) and not _in_edit(row, edits)]
    rows += _reconfigurations(edits)
    rows.sort(key=lambda row: (row["start_m"], row["end_m"]))
    for number, row in enumerate(rows):
        row["zone_id"] = f"Z{number + 1:03d}"
    return build.table("zones", pd.DataFrame(rows))


def _groups(pairs: list[PairChange], steps: list[PairChange]) -> list[_Group]:
    """Candidates that share a good part of the shorter belong together; the strongest says where the zone lies."""
    members = [(pair, c) for pair in (*pairs, *steps) for c in pair.candidates]
    members.sort(key=lambda m: -m[1].statistic)
    groups: list[_Group] = []
    for pair, c in members:
        for group in groups:
            common = min(c.end, group.end) - max(c.start, group.start)
            if common > _COMMON * min(c.end - c.start, group.end - group.start):
                group.members.append((pair, c))
                break
        else:
            groups.append(_Group(c.start, c.end, [(pair, c)]))
    return groups


def _row(group: _Group, pairs, axis, outside_diameter, options: ChangeOptions) -> dict | None:
    inside = (axis >= group.start) & (axis <= group.end)
    if not inside.any():
        return None
    step = float(axis[1] - axis[0])
    flagged = _flagged(group, pairs)
    peaks = [_peak_displacement(pair, inside, step) for pair in flagged]
    strains = [_peak_strain(pair, inside, step, outside_diameter) for pair in flagged]
    at = int(np.argmax([np.nan_to_num(peak["size"]) for peak in peaks]))
    bent = int(np.argmax([np.nan_to_num(strain["size"]) for strain in strains]))
    peak, strain = peaks[at], strains[bent]
    moved = peak["size"] >= max(options.least_displacement_m, options.k_sigma * peak["sigma"])
    curved = strain["size"] >= max(options.least_strain_change, options.k_sigma * strain["sigma"])
    if not (moved or curved):
        return None
    pair, best = group.best
    looks = TESTS_PER_WAVELENGTH * (axis[-1] - axis[0]) * sum(1.0 / w.length for w in pair.waves)
    told = flagged[at if moved else bent]
    first = first_epoch(told, pairs, inside, peak, strain, options) or min(flagged, key=lambda p: max(p.order)).later
    longer, longer_sigma = told.elongation(group.start, group.end) if told.elongation else (np.nan, np.nan)
    row = {
        "kind": "movement" if moved else "bending",
        "start_m": float(np.clip(group.start, axis[0], axis[-1])),
        "end_m": float(np.clip(group.end, axis[0], axis[-1])),
        "start_sigma_m": best.start_sigma,
        "end_sigma_m": best.end_sigma,
        "first_epoch": first,
        "peak_strain_change": strain["size"],
        "peak_strain_change_sigma": strain["sigma"],
        "peak_strain_clock_deg": strain["clock"],
        "peak_displacement_m": peak["size"],
        "peak_displacement_sigma_m": peak["sigma"],
        "direction_deg": peak["direction"],
        "confidence": confidence_of(best.statistic, looks, 2),
        "peak_m": float(axis[inside][peak["index"]]) if peak["index"] is not None else best.centre,
        "peak_epoch": told.later,
        "since": told.earlier,
        "peak_east_m": peak["vector"][0],
        "peak_north_m": peak["vector"][1],
        "peak_up_m": peak["vector"][2],
        "elongation_m": told.sign * longer,
        "elongation_sigma_m": longer_sigma,
        "wavelength_m": best.length,
        "statistic": best.statistic,
        "threshold": pair.limit,
    }
    shown = [name for name in ("position", "curvature") if getattr(best, f"{name}_score") > pair.limit]
    epochs = {max(p.order): p.later for p, _ in group.members}
    row["reasons"] = zone_words(row, shown, [epochs[k] for k in sorted(epochs)], options)
    return row


def _flagged(group: _Group, pairs: list[PairChange]) -> list[PairChange]:
    """Pairs that show a zone: those with the reference run where there are any, else the one that shows it best."""
    found = {id(pair): pair for pair, _ in group.members}
    with_reference = [found[id(pair)] for pair in pairs if id(pair) in found]
    return with_reference or [group.best[0]]


def _peak_displacement(pair: PairChange, inside: Floats, step: float) -> dict:
    """The largest displacement of a stretch, forward in time."""
    nothing = {"size": np.nan, "sigma": np.nan, "direction": np.nan, "index": None, "vector": (np.nan,) * 3}
    if pair.displacement is None or pair.displacement_sigma is None:
        return nothing
    smooth = _smooth(pair.displacement[inside, :4].T, _PEAK_DISPLACEMENT_LENGTH / step)
    size = np.hypot(smooth[3], smooth[2])
    if not np.isfinite(size).any():
        return nothing
    i = int(np.nanargmax(size))
    v, s = pair.sign * smooth[:3, i], pair.displacement_sigma[inside, :3][i]
    full = float(np.linalg.norm(v))
    level, level_sigma = np.hypot(v[0], v[1]), np.hypot(*s[:2]) / np.sqrt(2.0)
    level_known = level > 3.0 * level_sigma and level > 0.25 * abs(v[2])
    return {
        "size": full,
        "sigma": float(np.sqrt(np.sum((v * s) ** 2)) / max(full, 1e-9)),
        "direction": float(np.degrees(np.arctan2(v[0], v[1])) % 360.0) if level_known else np.nan,
        "index": i,
        "vector": tuple(v),
    }


def _peak_strain(pair: PairChange, inside: Floats, step: float, outside_diameter: float) -> dict:
    """The largest change of bending strain of a stretch, forward in time, with its tension side."""
    nothing = {"size": np.nan, "sigma": np.nan, "clock": np.nan}
    parts = [pair.curvature.get(name) for name in ("horizontal", "vertical")]
    if not any(parts):
        return nothing
    zero = np.zeros(int(inside.sum()))
    bent = pair.sign * _smooth(np.stack([part.change[inside] if part else zero for part in parts]), _PEAK_STRAIN_LENGTH / step)
    size = np.sqrt(np.nansum(bent**2, axis=0))
    if not np.isfinite(bent).any():
        return nothing
    i = int(np.nanargmax(size))
    sigma = np.array([part.sigma[inside][i] if part else 0.0 for part in parts])
    half = outside_diameter / 2.0
    spread = float(np.sqrt(np.nansum((bent[:, i] * sigma) ** 2)) / max(size[i], 1e-18))
    return {"size": float(size[i] * half), "sigma": spread * half, "clock": float(tension_clock(*bent[:, i]))}


def _smooth(values: Floats, width: float) -> Floats:
    """Running means where a value itself is known: elsewhere it has no sigma, and is no peak."""
    return np.where(np.isfinite(values), running_mean(values, round(width)), np.nan)


def _axial_row(zone: AxialZone) -> dict:
    return {
        "kind": "movement",
        "start_m": zone.start,
        "end_m": zone.end,
        "first_epoch": zone.run,
        "peak_displacement_m": abs(zone.change),
        "peak_displacement_sigma_m": zone.sigma,
        "confidence": zone.confidence,
        "peak_m": 0.5 * (zone.start + zone.end),
        "peak_epoch": zone.run,
        "since": zone.since,
        "elongation_m": zone.change,
        "elongation_sigma_m": zone.sigma,
        "statistic": zone.statistic,
        "threshold": zone.limit,
        "reasons": axial_words(zone),
    }


def _known(row: dict, rows: list[dict]) -> bool:
    """True when another zone lies there already: its own words tell the change of its joints."""
    return any(min(row["end_m"], r["end_m"]) > max(row["start_m"], r["start_m"]) for r in rows)


def _in_edit(row: dict, edits: pd.DataFrame) -> bool:
    """True for a zone that lies mostly in replaced pipe: that is no movement."""
    if edits is None or not len(edits):
        return False
    length = max(row["end_m"] - row["start_m"], 1e-9)
    return any(
        min(row["end_m"], e.end_m) - max(row["start_m"], e.start_m) > 0.5 * length
        for e in edits[edits["kind"].isin(EDITS)].itertuples()
    )


def _reconfigurations(edits: pd.DataFrame) -> list[dict]:
    """Rows of replaced pipe, without a confidence: the matching states none for an edit."""
    if edits is None or not len(edits):
        return []
    return [
        {
            "kind": "reconfiguration",
            "start_m": edit.start_m,
            "end_m": edit.end_m,
            "first_epoch": str(edit.run),
            "reasons": edit_words(edit),
        }
        for edit in edits[edits["kind"].isin(EDITS)].itertuples(index=False)
    ]
