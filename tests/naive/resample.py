"""Obviously right twins of `deform.geometry.resample`."""

from __future__ import annotations

import numpy as np


def interpolate(x, axis, values):
    """Value of the broken line at each x, NaN outside."""
    out = []
    for place in x:
        if place < axis[0] or place > axis[-1]:
            out.append(np.nan)
            continue
        i = min(int(np.searchsorted(axis, place, side="right")) - 1, len(axis) - 2)
        part = (place - axis[i]) / (axis[i + 1] - axis[i])
        out.append(values[i] * (1 - part) + values[i + 1] * part)
    return np.array(out)


def box_average(centre, axis, values, length):
    """Mean of the broken line over the box, by the trapezoid of all corners within it."""
    out = []
    for place in centre:
        begin, end = place - length / 2, place + length / 2
        if begin < axis[0] or end > axis[-1]:
            out.append(np.nan)
            continue
        corners = np.concatenate([[begin], axis[(axis > begin) & (axis < end)], [end]])
        out.append(np.trapezoid(interpolate(corners, axis, values), corners) / length)
    return np.array(out)
