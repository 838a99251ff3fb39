"""The colours of surfaces and maps, one set for pictures and meshes alike: legible to the colour-blind, and in greyscale."""

from __future__ import annotations

import numpy as np

# place between 0 and 1, then red, green, blue of 255. The depth of a dent runs from DEPTH_LEAST to 1 of the deepest: outward
# bulges are amber, the undamaged wall is white, and the deeper the darker.
DEPTH_LEAST = -0.2
_DEPTH_ZERO = -DEPTH_LEAST / (1 - DEPTH_LEAST)
Scale = tuple[tuple[float, tuple[int, int, int]], ...]
DEPTH: Scale = (
    (0.0, (236, 170, 74)),
    (_DEPTH_ZERO, (245, 246, 247)),
    (0.38, (166, 203, 227)),
    (0.60, (79, 147, 196)),
    (0.80, (28, 84, 149)),
    (1.0, (8, 29, 78)),
)
# A change is white at zero; blue = less, red = more (ColorBrewer RdBu).
CHANGE: Scale = (
    (0.0, (33, 102, 172)),
    (0.25, (146, 197, 222)),
    (0.5, (247, 247, 247)),
    (0.75, (244, 165, 130)),
    (1.0, (178, 24, 43)),
)
UNKNOWN = (178, 178, 178)


def paint(place: np.ndarray, scale: Scale = DEPTH) -> np.ndarray:
    """Return colours (n, 3) between 0 and 1 at places (n,) between 0 and 1 of a scale; NaN is grey.

    Examples
    --------
    >>> paint(np.array([0.5]), CHANGE).round(2).tolist()
    [[0.97, 0.97, 0.97]]
    """
    place = np.asarray(place, float)
    known = np.isfinite(place)
    steps = [step for step, _ in scale]
    colours = np.array([colour for _, colour in scale]) / 255
    shown = np.stack([np.interp(np.where(known, place, 0.0), steps, colours[:, k]) for k in range(3)], axis=-1)
    return np.where(known[:, None], shown, np.array(UNKNOWN) / 255)
