"""Units of listings and reports: factors to SI, clock positions, fractions; no physics."""

from __future__ import annotations

import numpy as np

from deform.errors import OptionError

TO_METRE = {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254, "mi": 1609.344, "yd": 0.9144}
TO_FRACTION = {"1": 1.0, "%": 0.01, "percent": 0.01, "microstrain": 1e-6}
TO_DEGREE = {"degree": 1.0, "deg": 1.0, "rad": 180.0 / np.pi, "clock": 30.0}
TO_METRE_PER_SECOND = {"m/s": 1.0, "ft/s": 0.3048, "km/h": 1 / 3.6, "mph": 0.44704}

DIMENSIONS = {"length": TO_METRE, "fraction": TO_FRACTION, "angle": TO_DEGREE, "speed": TO_METRE_PER_SECOND}


def factor(unit: str, dimension: str) -> float:
    """Return the factor from ``unit`` to the SI unit (metre, 1, degree, m/s) of ``dimension``.

    Raises
    ------
    OptionError
        When the unit is not one of the dimension.

    Examples
    --------
    >>> factor("ft", "length")
    0.3048
    """
    table = DIMENSIONS[dimension]
    if unit not in table:
        raise OptionError(f"unit {unit!r} is no {dimension}; known are {', '.join(table)}")
    return table[unit]


def clock_text(angle_deg: float) -> str:
    """Return a clock angle (degree, 0 at the top, clockwise looking downstream) as industry's ``h:mm``.

    Examples
    --------
    >>> clock_text(95.0)
    '3:10'
    """
    minutes = round((angle_deg % 360.0) * 2.0) % 720
    hours, rest = divmod(minutes, 60)
    return f"{hours or 12}:{rest:02d}"


def wrap_degree(angle):
    """Return angles in -180 (included) .. 180 degree (excluded)."""
    return (np.asarray(angle, float) + 180.0) % 360.0 - 180.0
