"""Stretches of chainage in, which places lie in them out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]
Stretch = tuple[float, float]


def inside(place: Floats, stretches: Iterable[Stretch], margin: float = 0.0) -> NDArray[np.bool_]:
    """Return true where a place of a rising axis lies in one of the stretches or within a margin of it (m)."""
    out = np.zeros(place.size, bool)
    for start, end in stretches:
        out[np.searchsorted(place, start - margin) : np.searchsorted(place, end + margin, side="right")] = True
    return out


def merged(stretches: Iterable[Stretch]) -> list[Stretch]:
    """Return stretches that do not touch each other, in their order, which cover what those given cover."""
    out: list[Stretch] = []
    for start, end in sorted(stretches):
        if out and start <= out[-1][1]:
            out[-1] = out[-1][0], max(end, out[-1][1])
        else:
            out.append((start, end))
    return out


def between(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return true from the first to the last known place."""
    out = np.zeros(known.size, bool)
    at = np.flatnonzero(known)
    if at.size:
        out[at[0] : at[-1] + 1] = True
    return out


def clear_of(zone: Any, margin: float) -> Stretch:
    """Return the stretch about a zone that carries no datum: to two sigma beyond its ends, and a margin at least (m)."""
    return zone.start - max(margin, 2.0 * zone.start_sigma), zone.end + max(margin, 2.0 * zone.end_sigma)
