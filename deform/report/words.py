"""A number in, text for people out: units, signs, sigma, a dash for what is not there."""

from __future__ import annotations

from typing import Any

import pandas as pd

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
NOTHING = "–"


def number(value: Any, decimals: int = 2, unit: str = "", sign: bool = False) -> str:
    """Return a number for people; a dash for what is not there."""
    if value is None or pd.isna(value):
        return NOTHING
    text = f"{float(value):{'+' if sign else ''},.{decimals}f}".replace(",", "\u202f").replace("-", "\u2212")
    return f"{text}\u00a0{unit}" if unit else text


def with_sigma(value: Any, sigma: Any, decimals: int = 2, unit: str = "", sign: bool = False) -> str:
    """Return ``value ± sigma unit``."""
    if value is None or pd.isna(value):
        return NOTHING
    tail = "" if sigma is None or pd.isna(sigma) else f" ± {number(sigma, decimals)}"
    return f"{number(value, decimals, sign=sign)}{tail}" + (f"\u00a0{unit}" if unit else "")


def microstrain(value: Any, sigma: Any = None, sign: bool = False) -> str:
    """Return a strain (1) in microstrain."""
    scaled = [None if v is None or pd.isna(v) else float(v) * 1e6 for v in (value, sigma)]
    return with_sigma(scaled[0], scaled[1], 0, "µε", sign)


def compass(azimuth: Any) -> str:
    """Return an azimuth (degree) with its word."""
    if azimuth is None or pd.isna(azimuth):
        return NOTHING
    return f"{float(azimuth) % 360:.0f}° ({_COMPASS[round(float(azimuth) % 360 / 45) % 8]})"


def percent(probability: float) -> str:
    """Return a probability in percent, never called certain."""
    if probability > 0.999:
        return "> 99.9 %"
    return f"{100 * probability:.0f} %" if probability < 0.99 else f"{100 * probability:.1f} %"
