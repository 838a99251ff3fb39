"""Control points and the markers of a run in, an offset that all of them share out: the mark of another datum."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.geometry.earth import enu_difference

_LEAST_POINTS = 3
_OFFSET = 20.0  # m: markers are placed to a few metres at worst
_ALIKE = 0.2  # of the offset: spread below which it is one offset and not so many faults


def datum_remark(control: xr.Dataset | None, passages: xr.Dataset | None, run: str) -> str:
    """Return what to say when the control points lie apart from the markers of their names, all alike; empty when they do not.

    Parameters
    ----------
    control : group ``control``. passages : group ``passages`` of the run, with its own coordinates of the markers.
    run : its name.

    Notes
    -----
    The median of the differences (m) must exceed 20 m, and the differences lie within a fifth of it about it: old national datums
    lie one to some hundred metres from WGS84, everywhere the same on one line. The points are used as they are.
    """
    if control is None or passages is None or not control.sizes["point"] or not passages.sizes["marker"]:
        return ""
    row = {str(name): i for i, name in enumerate(control["name"].values)}
    pairs = [(m, row[str(name)]) for m, name in enumerate(passages["name"].values) if str(name) in row]
    if len(pairs) < _LEAST_POINTS:
        return ""
    own, there = (list(part) for part in zip(*pairs, strict=True))
    places = [data[name].values[at] for data, at in ((control, there), (passages, own)) for name in ("latitude", "longitude")]
    flat = np.zeros(len(own))
    east, north, _ = enu_difference(places[0], places[1], flat, places[2], places[3], flat)
    apart = np.column_stack([east, north])[np.isfinite(east) & np.isfinite(north)]
    if len(apart) < _LEAST_POINTS:
        return ""
    offset = np.median(apart, axis=0)
    size = float(np.hypot(*offset))
    spread = float(np.median(np.hypot(*(apart - offset).T)))
    if size < _OFFSET or spread > _ALIKE * size:
        return ""
    return (
        f"{run}: the control points lie {offset[0]:.0f} m east and {offset[1]:.0f} m north of its markers of the same names, all"
        f" alike (spread {spread:.1f} m): they look as if on another datum; state the reference system of the control points"
    )
