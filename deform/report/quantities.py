"""A value in SI units in, its number for people out: unit, decimals and sign of every quantity stand here and nowhere else."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from deform.errors import Fault, OptionError
from deform.report.words import NOTHING, number


@dataclass(frozen=True)
class Quantity:
    """How a quantity is shown: its unit, the factor from SI, the decimals, and whether a positive value carries its sign."""

    unit: str
    factor: float = 1.0
    decimals: int = 2
    sign: bool = False

    @property
    def excel(self) -> str:
        """Return the number format of a workbook's cell, the same decimals as in the text."""
        return "#,##0" + ("." + "0" * self.decimals if self.decimals else "")


QUANTITIES = {
    "place": Quantity("m", decimals=1),  # ends of zones and detection on the axis of the comparison, half a metre
    "chainage": Quantity("m"),
    "extent": Quantity("m", decimals=1),
    "line length": Quantity("km", 1e-3, 3),
    "height": Quantity("m", decimals=1),
    "displacement": Quantity("m"),
    "strain": Quantity("µε", 1e6, 0),
    "dent depth": Quantity("mm", 1e3, 1),
    "dent depth change": Quantity("mm", 1e3, 1, sign=True),
    "dent depth share": Quantity("% OD", 1e2, 1),
    "dent size": Quantity("mm", 1e3, 0),
    "dent strain": Quantity("%", 1e2, 2),
    "joint length": Quantity("m", decimals=3),
    "joint length change": Quantity("mm", 1e3, 1, sign=True),
    "diameter": Quantity("mm", 1e3, 1),
    "wall": Quantity("mm", 1e3, 2),
    "ovality": Quantity("%", 1e2, 2),
    "displacement rate": Quantity("mm/a", 1e3, 0, sign=True),
    "strain rate": Quantity("µε/a", 1e6, 0, sign=True),
    "dent depth rate": Quantity("mm/a", 1e3, 1, sign=True),
    "misclosure": Quantity("m", sign=True),
    "position sigma": Quantity("m"),
    "turn": Quantity("°", decimals=2),
    "signed turn": Quantity("°", decimals=2, sign=True),
    "direction": Quantity("°", decimals=0),
    "bend radius": Quantity("m", decimals=1),
    "standardised curvature": Quantity("%", decimals=3),
    "noise": Quantity("mm", 1e3, 1),
    "strain noise": Quantity("µε", 1e6, 1),
    "ovality noise": Quantity("%", 1e2, 3),
    "wavelength": Quantity("m", decimals=0),
    "axial strain": Quantity("µε", 1e6, 2),
    "speed": Quantity("m/s", decimals=2),
    "attitude": Quantity("°", decimals=4, sign=True),
    "gyro drift": Quantity("°/h", decimals=4, sign=True),
    "accelerometer bias": Quantity("µg", 1e6 / 9.80665, 1, sign=True),
    "odometer scale": Quantity("ppm", 1e6, 0, sign=True),
    "delay": Quantity("ms", 1e3, 1, sign=True),
    "probability": Quantity("1", decimals=3),
    "seconds": Quantity("s", decimals=1),
    "memory": Quantity("MB", decimals=0),
}

# What a trend speaks of (`kind` of tables/trends.csv) and the quantity that shows it.
OF_TREND = {"displacement": "displacement", "bending strain": "strain", "dent depth": "dent depth"}


@dataclass(frozen=True)
class Measure:
    """A value with its sigma, both SI, and how to show them; prints as ``value ± sigma unit``, a dash when unknown."""

    quantity: Quantity
    value: float
    sigma: float = np.nan

    def __str__(self) -> str:
        if not self:
            return NOTHING
        spread = f" {self.spread}" if self.spread else ""
        return f"{self.number}{spread}\u00a0{self.quantity.unit}"

    def __bool__(self) -> bool:
        return bool(np.isfinite(self.value))

    @property
    def number(self) -> str:
        """The value without its unit."""
        return number(self.value * self.quantity.factor, self.quantity.decimals, sign=self.quantity.sign)

    @property
    def spread(self) -> str:
        """The sigma as ``± 0.05``; nothing when it is not known."""
        known = bool(self) and np.isfinite(self.sigma)
        return f"± {number(self.sigma * self.quantity.factor, self.quantity.decimals)}" if known else ""

    @property
    def unit(self) -> str:
        """The unit in which it is shown."""
        return self.quantity.unit


def quantity(name: str) -> Quantity:
    """Return a quantity by its name.

    Raises
    ------
    OptionError
        When it is not in the table above.
    """
    if name not in QUANTITIES:
        raise OptionError(Fault("report", "quantity", f"{name!r} is not known; known are {', '.join(QUANTITIES)}"))
    return QUANTITIES[name]


def measure(name: str, value: Any, sigma: Any = None) -> Measure:
    r"""Return a value (SI) with its sigma as it is shown to people; None and NaN are unknown.

    Examples
    --------
    >>> str(measure("dent depth", 0.01436, 0.0002))
    '14.4 ± 0.2\xa0mm'
    """
    known = [np.nan if v is None or v is pd.NA or pd.isna(v) else float(v) for v in (value, sigma)]
    return Measure(quantity(name), *known)


def column(name: str, values: Iterable[Any]) -> np.ndarray:
    """Return values (SI) in the unit and with the decimals that people are shown: for tables that hold numbers, not text."""
    of = quantity(name)
    return np.round(np.asarray(pd.to_numeric(pd.Series(list(values), dtype=object)), float) * of.factor, of.decimals) + 0.0


def heading(title: str, name: str) -> str:
    """Return the head of a column, ``title [unit]``."""
    return f"{title} [{quantity(name).unit}]"
