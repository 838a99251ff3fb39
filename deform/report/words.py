"""A number or an angle in, text for people out: signs, thin spaces, a dash for what is not there."""

from __future__ import annotations

import re
from typing import Any

import pandas as pd

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
NOTHING = "–"


def number(value: Any, decimals: int = 2, unit: str = "", sign: bool = False) -> str:
    """Return a number for people; a dash for what is not there; what rounds to zero has no sign."""
    if value is None or pd.isna(value):
        return NOTHING
    value = float(value)
    if round(value, decimals) == 0:
        value, sign = 0.0, False
    text = f"{value:{'+' if sign else ''},.{decimals}f}".replace(",", "\u202f").replace("-", "\u2212")
    return f"{text}\u00a0{unit}" if unit else text


def compass(azimuth: Any) -> str:
    """Return an azimuth (degree) with its word."""
    if azimuth is None or pd.isna(azimuth):
        return NOTHING
    return f"{float(azimuth) % 360:.0f}° ({_COMPASS[round(float(azimuth) % 360 / 45) % 8]})"


def percent(probability: Any) -> str:
    """Return a probability in percent, never called certain and never called impossible."""
    if probability is None or pd.isna(probability):
        return NOTHING
    if probability > 0.999:
        return "> 99.9\u00a0%"
    if 0 <= probability < 0.001:
        return "< 0.1\u00a0%"
    return f"{100 * probability:.0f}\u00a0%" if 0.01 <= probability < 0.99 else f"{100 * probability:.1f}\u00a0%"


def month(date: Any) -> str:
    """Return a date as month and year; a dash for none.

    Examples
    --------
    >>> month("2024-11-17")
    'Nov 2024'
    """
    if date is None or pd.isna(date) or not str(date):
        return NOTHING
    stamp = pd.Timestamp(str(date))
    return f"{_MONTHS[stamp.month - 1]}\u00a0{stamp.year}"


def count(n: int, one: str, many: str = "") -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> count(2, "zone"), count(1, "stretch", "stretches")
    ('2 zones', '1 stretch')
    """
    return f"{number(n, 0)} {one if n == 1 else many or one + 's'}"


def sentence(text: str) -> str:
    """Return a clause as a sentence: the first letter large, no stop at the end, true minus signs, none before a zero.

    Examples
    --------
    >>> sentence("-0.0 mm since 2019-07-02, sigma 0.3 mm")
    '0.0 mm since 2019-07-02, sigma 0.3 mm'
    """
    text = re.sub(r"(?<![\w.)])[-+](?=0\.?0*(?![\d.]))", "", text.strip().rstrip(".;, "))
    text = re.sub(r"(?<![\w.)])-(?=\d)", "\u2212", text)
    return text[:1].upper() + text[1:]
