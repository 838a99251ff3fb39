"""An output folder and one of its runs in, the windows of the wall that tell the most out: most oval place, deepest dent."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.report.caliper_figures import profile_dataset
from deform.report.content import Content, wall_window

_SECTION_HALF_M = 0.6  # the wall is stored every tenth of a metre away from dents
_WALL_HALF_M = 8.0
_DENT_HALF_M = 3.0


def most_oval_wall(content: Content, run: str) -> xr.Dataset | None:
    """Return the wall about the most oval place of a run, ``chainage_m`` among its attributes; None without a caliper."""
    line = content.group(run, "centreline")
    if line is None or "ovality" not in line or not np.isfinite(line["ovality"].values).any():
        return None
    place = float(line["chainage"].values[int(np.nanargmax(line["ovality"].values))])
    wall = wall_window(content, run, place, _SECTION_HALF_M)
    return None if wall is None else wall.assign_attrs(chainage_m=place)


def wall_of_deepest_dent(content: Content, run: str) -> xr.Dataset | None:
    """Return the wall about the deepest dent of a run, with ``ends_m`` and the ``welds`` (m) among its attributes."""
    index = _deepest(content, run)
    if index is None:
        return None
    dents, welds = content.group(run, "dents"), content.group(run, "welds")
    assert dents is not None
    place = float(dents["chainage"].values[index])
    wall = wall_window(content, run, place, _WALL_HALF_M)
    if wall is None or "reference_radius" not in wall:
        return None
    seen = wall["chainage"].values
    return wall.assign_attrs(
        ends_m=(float(seen[0]), float(seen[-1])), welds=np.empty(0) if welds is None else welds["chainage"].values
    )


def profiles_of_deepest_dent(content: Content, run: str) -> xr.Dataset | None:
    """Return the profiles of the deepest dent of a run with their sigma, from `caliper_figures.profile_dataset`."""
    index = _deepest(content, run)
    if index is None:
        return None
    dents = content.group(run, "dents")
    assert dents is not None
    wall = wall_window(content, run, float(dents["chainage"].values[index]), _DENT_HALF_M)
    if wall is None or any(name not in dents for name in ("depth_sigma", "length", "width", "clock")):
        return None
    window = profile_dataset(wall, dents, index, content.outside_diameter)
    return window if window.sizes["distance"] > 4 and window.sizes["arc"] > 2 else None


def _deepest(content: Content, run: str) -> int | None:
    """Return the index of the deepest dent of a run; None without one."""
    dents = content.group(run, "dents")
    if dents is None or "depth" not in dents or not np.isfinite(dents["depth"].values).any():
        return None
    return int(np.nanargmax(dents["depth"].values))
