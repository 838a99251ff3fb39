"""Cells of a table as text in; numbers, clock positions, angles and clean words out, in SI and degree."""

from __future__ import annotations

import re
import unicodedata

import numpy as np

import deform.units as units
from deform.errors import OptionError

CLOCK_FORMATS = ("h:mm", "h.mm", "hours", "degree")
_EMPTY = {"", "-", "--", "n/a", "na", "nan", "none", "null", "#n/a"}
_SCALED = re.compile(r"(?P<scale>\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s+(?P<unit>\S.*)", re.IGNORECASE)
_GROUPED = {".": re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?"), ",": re.compile(r"[-+]?\d{1,3}([. '\u00a0\u202f]\d{3})+(,\d*)?")}
_STATION = re.compile(r"(?P<sign>[-+]?)(?P<hundreds>\d+)\s*\+\s*(?P<rest>\d+(?:[.,]\d*)?)")
_CLOCK = re.compile(r"(?P<hours>\d{1,2})\s*[:h.,]\s*(?P<minutes>\d{1,2})(?:\s*[:m.,]\s*(?P<seconds>\d{1,2})(?:\.\d*)?)?")
_DMS = re.compile(r"(?P<deg>\d{1,3})\s*[°d:\s]\s*(?P<min>\d{1,2})\s*['’′m:\s]\s*(?P<sec>\d{1,2}(?:[.,]\d*)?)?\s*(?:[\"”″s]|'')?")


def words(text: object) -> str:
    """Return text with one form of each letter and single spaces (header cells hold line breaks and hard spaces)."""
    return " ".join(unicodedata.normalize("NFKC", str(text)).split())


def key(text: object) -> str:
    """Return text for comparison: `words`, in one case."""
    return words(text).casefold()


def is_empty(text: str) -> bool:
    """Return whether a cell says nothing."""
    return text.strip().casefold() in _EMPTY


def number(text: str, decimal: str = ".") -> float:
    """Return a number, thousands marks and the other decimal mark understood; NaN for an empty cell.

    Raises
    ------
    ValueError
        When the cell holds something else.

    Examples
    --------
    >>> number("14,949.71"), number("10,48", decimal=","), number(" 0,0 ", decimal=",")
    (14949.71, 10.48, 0.0)
    """
    text = text.strip().replace("−", "-")
    if is_empty(text):
        return float("nan")
    if decimal == "." and "," in text:
        if not _GROUPED["."].fullmatch(text):
            raise ValueError(f"{text!r} is no number with a decimal point")
        text = text.replace(",", "")
    elif decimal == ",":
        if _GROUPED[","].fullmatch(text):
            text = re.sub(r"[. '\u00a0\u202f]", "", text)
        text = text.replace(",", ".")
    value = float(text)
    if value in (float("inf"), float("-inf")) or "_" in text:
        raise ValueError(f"{text!r} is no finite number")
    return value


def station(text: str, decimal: str = ".") -> float:
    """Return a distance written as a station: ``123+45.6`` is 12345.6; a plain number passes.

    Examples
    --------
    >>> station("123+45.6")
    12345.6
    """
    match = _STATION.fullmatch(text.strip())
    if match is None:
        return number(text, decimal)
    value = float(match["hundreds"]) * 100 + float(match["rest"].replace(",", "."))
    return -value if match["sign"] == "-" else value


def clock(text: str, form: str, decimal: str = ".") -> float:
    """Return a clock position as an angle (degree, 0 at the top, clockwise looking downstream); NaN for an empty cell.

    Parameters
    ----------
    text : the cell.
    form : ``h:mm`` (also hh:mm:ss, and the fraction of a day that a spreadsheet stores), ``h.mm`` (the two digits behind the
        point or comma are minutes), ``hours`` (decimal hours), ``degree``.
    decimal : decimal mark.

    Raises
    ------
    ValueError
        When the cell is no such clock position.

    Examples
    --------
    >>> clock("09:04:00", "h:mm"), clock("10,48", "h.mm"), clock("10,5", "hours", ",")
    (272.0, 324.0, 315.0)
    """
    text = text.strip()
    if is_empty(text):
        return float("nan")
    if form == "degree":
        angle = number(text, decimal)
        if not -360.0 <= angle <= 360.0:
            raise ValueError(f"{text!r} is no angle in degree")
        return angle % 360.0
    hours = number(text, decimal) if form == "hours" else _hours(text, form)
    if not 0.0 <= hours < 13.0:
        raise ValueError(f"{text!r} is no clock position")
    return (hours * units.TO_DEGREE["clock"]) % 360.0


def angle(text: str, decimal: str = ".") -> float:
    r"""Return an angle in degree from decimal degrees or degrees, minutes, seconds, with a sign or one of N S E W.

    Examples
    --------
    >>> angle("61°02'30.0''N"), angle("121 17 00 W"), angle("-121.5")
    (61.041666666666664, -121.28333333333333, -121.5)
    """
    text = words(text).replace("º", "°")
    if is_empty(text):
        return float("nan")
    sign = -1.0 if re.search(r"[SsWw]", text) or text.startswith("-") else 1.0
    bare = (
        re.sub(r"[NSEWnsew+\-]", " ", text).strip().rstrip("°").strip()
        if not re.search(r"\de[-+]?\d", text, re.IGNORECASE)
        else text
    )
    match = _DMS.fullmatch(bare)
    if match is None:
        return sign * abs(number(bare, decimal))
    seconds = float((match["sec"] or "0").replace(",", "."))
    if int(match["min"]) >= 60 or seconds >= 60:
        raise ValueError(f"{text!r} has 60 minutes or seconds or more")
    return sign * (int(match["deg"]) + int(match["min"]) / 60 + seconds / 3600)


def factor(unit: str, dimension: str) -> float:
    """Return the factor to SI of ``m``, ``ft``, ... or of a multiple such as ``0.1 mm``; `OptionError` for an unknown unit."""
    match = _SCALED.fullmatch(unit.strip())
    if match is None:
        return units.factor(unit.strip(), dimension)
    return float(match["scale"]) * units.factor(match["unit"], dimension)


def convert(column: np.ndarray, one, *, least: float = -np.inf, most: float = np.inf) -> tuple[np.ndarray, list[int]]:
    """Return the values of a column of text by the function ``one``, NaN where it refuses, and the places of those."""
    values, refused = np.full(len(column), np.nan), []
    for i, text in enumerate(column):
        if not text:
            continue
        try:
            value = one(text)
        except ValueError:
            refused.append(i)
            continue
        if value < least or value > most:
            refused.append(i)
        else:
            values[i] = value
    return values, refused


def _hours(text: str, form: str) -> float:
    match = _CLOCK.fullmatch(text)
    if form == "h:mm" and (match is None or (":" not in text and "h" not in text)):
        value = number(text.replace(",", "."))
        if value != int(value) and value >= 1.0:
            raise ValueError(f"{text!r} is no clock position h:mm")
        return value * 24.0 % 12.0 if 0.0 < value < 1.0 else value
    if match is None:
        return float(int(text))
    minutes = int(match["minutes"]) if len(match["minutes"]) == 2 or ":" in text else int(match["minutes"]) * 10
    seconds = int(match["seconds"] or 0)
    if minutes >= 60 or seconds >= 60:
        raise ValueError(f"{text!r} has 60 minutes or more")
    return int(match["hours"]) + minutes / 60 + seconds / 3600


def check_unit(unit: str, dimension: str) -> str:
    """Return an empty text when a unit is of a dimension, else what is wrong."""
    try:
        factor(unit, dimension)
    except OptionError as fault:
        return str(fault)
    return ""
