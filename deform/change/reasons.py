"""What is known of a zone in, why it was flagged out, in words that fit a cell of a table: size, evidence, caveat."""

from __future__ import annotations

from typing import Any

import numpy as np

from deform.options import ChangeOptions

_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def zone_words(row: dict, shown: list[str], epochs: list[str], options: ChangeOptions) -> str:
    """Return the reasons of a zone of kind movement or bending.

    Parameters
    ----------
    row : the row of table ``zones``. shown : what shows the change alone, of position and curvature.
    epochs : runs that show it, in their order.
    options : the stated rate of false alarms.

    Notes
    -----
    Three sentences of at most 25 words: how far and where to; what shows it, and how sure that is; what must be kept in mind.
    """
    return ". ".join(part for part in (_size(row), _evidence(row, shown, epochs, options), _caveat(row, shown)) if part)


def axial_words(zone: Any) -> str:
    """Return the reasons of a zone that only its joint lengths show."""
    longer = "longer" if zone.change > 0 else "shorter"
    size = f"{1e3 * abs(zone.change):.0f} mm (sigma {1e3 * zone.sigma:.0f} mm)"
    first = f"{zone.joints} joints are {longer} by {size} in all from {zone.since} to {zone.run}"
    sure = f"(likelihood ratio {zone.statistic:.0f}, threshold {zone.limit:.0f})"
    second = f"Only the joint lengths show it {sure}: a strain along the pipe, neither sideways movement nor bending"
    return f"{first}. {second}. Check the odometers: a slip over several joints looks the same"


def edit_words(edit: Any) -> str:
    """Return the reasons of a reconfiguration."""
    name = "Cut-out" if edit.kind == "cutout" else "Re-route"
    reason = str(getattr(edit, "reason", "") or "") or f"{edit.n_old} joints out, {edit.n_new} in"
    return f"{name} before {edit.run}: {reason}. The steel is another: no movement is derived"


def _size(row: dict) -> str:
    bent = ""
    if np.isfinite(row["peak_strain_change"]):
        bent = f"{1e6 * row['peak_strain_change']:.0f} microstrain (sigma {1e6 * row['peak_strain_change_sigma']:.0f})"
    if row["kind"] == "movement":
        moved = f"{row['peak_displacement_m']:.2f} m {_way(row)} (sigma {row['peak_displacement_sigma_m']:.2f} m)"
        words = f"Moved {moved} at {row['peak_m']:.0f} m from {row['since']} to {row['peak_epoch']}"
        return f"{words}; bending changed by {bent}" if bent else words
    return f"Bending changed by {bent} from {row['since']} to {row['peak_epoch']}, tension {_side(row['peak_strain_clock_deg'])}"


def _evidence(row: dict, shown: list[str], epochs: list[str], options: ChangeOptions) -> str:
    how = {2: "Position and curvature each show it alone", 1: f"{' '.join(shown).capitalize()} shows it alone"}
    words = how.get(len(shown), "Position and curvature show it only together")
    rate = f"at {options.false_alarms_per_100_km:g} false alarms per 100 km"
    sure = f"(likelihood ratio {row['statistic']:.0f}, threshold {row['threshold']:.0f} {rate})"
    return f"{words} {sure}; seen in {', '.join(epochs)}"


def _caveat(row: dict, shown: list[str]) -> str:
    if row["kind"] == "bending" and np.isfinite(row["peak_displacement_sigma_m"]):
        known = f"a movement below {3.0 * row['peak_displacement_sigma_m']:.2f} m would not show in the position here"
        return known[0].upper() + known[1:]
    longer, sigma = row["elongation_m"], row["elongation_sigma_m"]
    if not np.isfinite(longer):
        return ""
    size = f"{1e3 * abs(longer):.0f} mm (sigma {1e3 * sigma:.0f} mm)"
    if abs(longer) > 3.0 * sigma:
        return f"Its joints are {'longer' if longer > 0 else 'shorter'} by {size} in all: the pipe is strained along its axis too"
    return f"Its joints changed in length by {size} in all, which is not significant"


def _way(row: dict) -> str:
    level = float(np.hypot(row["peak_east_m"], row["peak_north_m"]))
    up = "down" if row["peak_up_m"] < 0 else "up"
    if not np.isfinite(row["direction_deg"]):
        return up
    point = _POINTS[round(row["direction_deg"] / 45.0) % 8]
    return f"towards {point} and {up}" if abs(row["peak_up_m"]) > 0.25 * level else f"towards {point}"


def _side(clock: float) -> str:
    names = {0: "at the top", 90: "on the right", 180: "at the bottom", 270: "on the left"}
    return names[min(names, key=lambda c: abs((clock - c + 180.0) % 360.0 - 180.0))]
