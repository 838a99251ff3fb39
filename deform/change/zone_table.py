"""Candidates of every run and the edits of the line in, the zones of the line with extent, peak, first epoch and reasons out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import chi2

from deform.change.joint_change import elongation
from deform.change.pair import PairChange
from deform.change.zones import TESTS_PER_WAVELENGTH, Candidate
from deform.options import ChangeOptions
from deform.run import build

Floats = NDArray[Any]
EDITS = ("cutout", "reroute")
_PEAK_STRAIN_LENGTH = 5.0  # m over which the change of strain is averaged before its peak is taken
_PEAK_DISPLACEMENT_LENGTH = 3.0


@dataclass
class _Group:
    """Candidates of several runs at one place."""

    start: float
    end: float
    members: list[tuple[int, Candidate]]

    @property
    def best(self) -> tuple[int, Candidate]:
        return max(self.members, key=lambda m: m[1].statistic)


def zone_table(
    pairs: list[PairChange],
    axis: Floats,
    edits: pd.DataFrame,
    joints: pd.DataFrame,
    outside_diameter: float,
    options: ChangeOptions,
) -> pd.DataFrame:
    """Return the table ``zones``.

    Parameters
    ----------
    pairs : changes of each run since the reference run, in the order of dates.
    axis : reference chainage (m).
    edits : edits of the line, as `Matching.edits`.
    joints : joint table.
    outside_diameter : of the pipe (m).
    options : least sizes and thresholds.
    """
    rows = []
    for group in _groups(pairs):
        row = _row(group, pairs, axis, joints, outside_diameter, options)
        if row is not None and not _in_edit(row, edits, pairs):
            rows.append(row)
    rows += _reconfigurations(edits)
    rows.sort(key=lambda row: (row["start_m"], row["end_m"]))
    for number, row in enumerate(rows):
        row["zone_id"] = f"Z{number + 1:03d}"
    return build.table("zones", pd.DataFrame(rows))


def _groups(pairs: list[PairChange]) -> list[_Group]:
    """Candidates that overlap by half the shorter belong together."""
    members = [(k, c) for k, pair in enumerate(pairs) for c in pair.candidates]
    members.sort(key=lambda m: -m[1].statistic)
    groups: list[_Group] = []
    for k, c in members:
        for group in groups:
            common = min(c.end, group.end) - max(c.start, group.start)
            if common > 0.3 * min(c.end - c.start, group.end - group.start):
                group.members.append((k, c))
                break
        else:
            groups.append(_Group(c.start, c.end, [(k, c)]))
    return groups


def _row(group: _Group, pairs, axis, joints, outside_diameter, options) -> dict | None:
    inside = (axis >= group.start) & (axis <= group.end)
    if not inside.any():
        return None
    step = axis[1] - axis[0]
    peaks = [_peak_displacement(pair, inside, step) for pair in pairs]
    strains = [_peak_strain(pair, inside, step, outside_diameter) for pair in pairs]
    flagged = sorted({k for k, _ in group.members})
    at = max(flagged, key=lambda k: np.nan_to_num(peaks[k]["size"]))
    bent = max(flagged, key=lambda k: np.nan_to_num(strains[k][0]))
    peak, (strain, strain_sigma) = peaks[at], strains[bent]
    moved = peak["size"] >= max(options.least_displacement_m, options.k_sigma * peak["sigma"])
    curved = strain >= max(options.least_strain_change, options.k_sigma * strain_sigma)
    if not (moved or curved):
        return None
    looks = TESTS_PER_WAVELENGTH * (axis[-1] - axis[0]) * sum(1.0 / w.length for w in pairs[at].waves)
    best_pair, best = group.best
    row = {
        "kind": "movement" if moved else "bending",
        "start_m": float(np.clip(group.start, axis[0], axis[-1])),
        "end_m": float(np.clip(group.end, axis[0], axis[-1])),
        "first_epoch": pairs[_first(best, best_pair, flagged, pairs, options)].run,
        "peak_strain_change": strain,
        "peak_strain_change_sigma": strain_sigma,
        "peak_displacement_m": peak["size"],
        "peak_displacement_sigma_m": peak["sigma"],
        "direction_deg": peak["direction"],
        "confidence": float(np.clip(1.0 - looks * np.exp(-0.5 * best.statistic), 0.0, 1.0)),
        "peak_m": float(axis[inside][peak["index"]]) if peak["index"] is not None else best.centre,
        "peak_epoch": pairs[at].run,
        "peak_east_m": peak["vector"][0],
        "peak_north_m": peak["vector"][1],
        "peak_up_m": peak["vector"][2],
        "wavelength_m": best.length,
        "statistic": best.statistic,
        "threshold": pairs[at].limit,
    }
    row["reasons"] = _reasons(row, best, pairs, group, joints, options)
    return row


def _first(best: Candidate, best_pair: int, flagged: list[int], pairs, options: ChangeOptions) -> int:
    """Return the first run in which the change is significant, its place and length being known from the run that shows it best.

    With the place given there is one look, not one for every wavelength of pipe: an earlier run counts when its amplitude
    there is significant at one in a thousand, of half the least size at least, and in the same direction.
    """
    limit = chi2.isf(1e-3 / len(pairs), 2)
    for k in range(flagged[0]):
        if not pairs[k].waves:
            continue
        wave = min(pairs[k].waves, key=lambda w: abs(w.length - best.length))
        i = int(np.argmin(np.abs(wave.place - best.centre)))
        amplitude = np.nan_to_num(wave.amplitude[i])
        size = float(np.linalg.norm(amplitude))
        along = float(amplitude @ best.amplitude) / max(size * float(np.linalg.norm(best.amplitude)), 1e-12)
        if wave.statistic[i] > limit and along > 0.8 and size > 0.5 * options.least_displacement_m:
            return k
    return flagged[0]


def _peak_displacement(pair: PairChange, inside: Floats, step: float) -> dict:
    nothing = {"size": np.nan, "sigma": np.nan, "direction": np.nan, "index": None, "vector": (np.nan,) * 3}
    if pair.displacement is None or pair.displacement_sigma is None:
        return nothing
    width = max(round(_PEAK_DISPLACEMENT_LENGTH / step), 1)
    vector = np.column_stack([_mean(pair.displacement[inside, m], width) for m in range(3)])
    sigma = pair.displacement_sigma[inside, :3]
    across = np.column_stack([_mean(pair.displacement[inside, m], width) for m in (3, 2)])
    size = np.hypot(across[:, 0], across[:, 1])
    if not np.isfinite(size).any():
        return nothing
    i = int(np.nanargmax(size))
    v, s = vector[i], sigma[i]
    full = float(np.linalg.norm(v))
    level, level_sigma = np.hypot(v[0], v[1]), np.hypot(*s[:2]) / np.sqrt(2.0)
    level_known = level > 3.0 * level_sigma and level > 0.25 * abs(v[2])
    direction = float(np.degrees(np.arctan2(v[0], v[1])) % 360.0) if level_known else np.nan
    return {
        "size": full,
        "sigma": float(np.sqrt(np.sum((v * s) ** 2)) / max(full, 1e-9)),
        "direction": direction,
        "index": i,
        "vector": tuple(v),
    }


def _peak_strain(pair: PairChange, inside: Floats, step: float, outside_diameter: float) -> tuple[float, float]:
    if not pair.curvature:
        return float("nan"), float("nan")
    width = max(round(_PEAK_STRAIN_LENGTH / step), 1)
    parts = [_mean(c.change[inside], width) for c in pair.curvature.values()]
    size = np.sqrt(np.nansum(np.square(parts), axis=0))
    if not np.isfinite(size).any():
        return float("nan"), float("nan")
    i = int(np.nanargmax(size))
    sigma = np.hypot(*[c.sigma[inside][i] for c in pair.curvature.values()]) / np.sqrt(2.0)
    return float(size[i] * outside_diameter / 2.0), float(sigma * outside_diameter / 2.0)


def _mean(values: Floats, width: int) -> Floats:
    kernel = np.ones(min(width, values.size) | 1)
    if kernel.size > values.size:
        return values
    known = np.isfinite(values)
    total = np.convolve(np.where(known, values, 0.0), kernel, mode="same")
    count = np.convolve(known.astype(float), kernel, mode="same")
    return np.where(count > 0.5 * kernel.size, total / np.maximum(count, 1.0), np.where(known, values, np.nan))


def _reasons(row: dict, best: Candidate, pairs, group: _Group, joints, options) -> str:
    words = []
    if row["kind"] == "movement":
        word = _way(row)
        words.append(
            f"moved {row['peak_displacement_m']:.2f} m {word} at {row['peak_m']:.0f} m by {row['peak_epoch']}"
            f" (sigma {row['peak_displacement_sigma_m']:.2f} m)"
        )
    if np.isfinite(row["peak_strain_change"]):
        words.append(
            f"bending strain changed by {1e6 * row['peak_strain_change']:.0f} microstrain"
            f" (sigma {1e6 * row['peak_strain_change_sigma']:.0f})"
        )
    alone = [
        name
        for name, score in (("position", best.position_score), ("curvature", best.curvature_score))
        if score > row["threshold"]
    ]
    agree = (
        " and ".join(alone) + (" each show it alone" if len(alone) > 1 else " shows it alone")
        if alone
        else "position and curvature show it only together"
    )
    words.append(
        f"{agree} (likelihood ratio {best.statistic:.0f}, threshold {row['threshold']:.0f}"
        f" for {options.false_alarms_per_100_km:g} false alarms in 100 km)"
    )
    longer, sigma = elongation(joints, row["peak_epoch"], row["start_m"], row["end_m"])
    if np.isfinite(longer):
        verdict = "significant" if abs(longer) > options.k_sigma * sigma else "not significant"
        words.append(
            f"joints in it {'longer' if longer >= 0 else 'shorter'} by {1e3 * abs(longer):.0f} mm in all"
            f" (sigma {1e3 * sigma:.0f} mm, {verdict})"
        )
    epochs = sorted({k for k, _ in group.members})
    words.append("seen in " + ", ".join(pairs[k].run for k in epochs))
    return "; ".join(words)


def _way(row: dict) -> str:
    if np.isfinite(row["direction_deg"]):
        names = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
        return f"towards {names[round(row['direction_deg'] / 45.0) % 8]}"
    return "down" if row["peak_up_m"] < 0 else "up"


def _in_edit(row: dict, edits: pd.DataFrame, pairs) -> bool:
    """True for a zone that lies mostly in replaced pipe: that is no movement."""
    if edits is None or not len(edits):
        return False
    length = max(row["end_m"] - row["start_m"], 1e-9)
    return any(
        min(row["end_m"], e.end_m) - max(row["start_m"], e.start_m) > 0.5 * length
        for e in edits[edits["kind"].isin(EDITS)].itertuples()
    )


def _reconfigurations(edits: pd.DataFrame) -> list[dict]:
    if edits is None or not len(edits):
        return []
    rows = []
    for edit in edits[edits["kind"].isin(EDITS)].itertuples(index=False):
        name = "cut-out" if edit.kind == "cutout" else "re-route"
        reason = str(getattr(edit, "reason", "") or "")
        counts = f"{edit.n_old} joints out, {edit.n_new} in"
        rows.append(
            {
                "kind": "reconfiguration",
                "start_m": edit.start_m,
                "end_m": edit.end_m,
                "first_epoch": str(edit.run),
                "confidence": 1.0,
                "reasons": f"{name} before {edit.run}: {reason or counts}; the steel is another, no movement is derived",
            }
        )
    return rows
