"""The content of an output folder in, datasets of the line out: what its figures are drawn from, whole or a stretch of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.options import ReportOptions
from deform.report.content import Content
from deform.report.dents import dent_rows
from deform.report.plane import local_metres, turned
from deform.report.zones import zone_rows

_OF_RUN = ("height", "bending_strain", "curvature_horizontal", "curvature_vertical", "azimuth", "pitch", "tool_roll", "ovality")
_OF_CHANGE = tuple(
    f"{name}{end}"
    for name in (
        "displacement_up",
        "displacement_lateral",
        "bending_strain_change_horizontal",
        "bending_strain_change_vertical",
        "curvature_change_horizontal",
        "curvature_change_vertical",
    )
    for end in ("", "_sigma")
)
_SIZES = {  # the size of a change, of two components
    "displacement": ("displacement_lateral", "displacement_up"),
    "bending_strain_change": ("bending_strain_change_horizontal", "bending_strain_change_vertical"),
}
OVERVIEW_COLUMNS = 1200


def line_dataset(
    content: Content,
    zones: Sequence[dict] | None = None,
    dents: Sequence[dict] | None = None,
    *,
    window: tuple[float, float] | None = None,
    columns: int = OVERVIEW_COLUMNS,
    margin: float = 0.0,
) -> xr.Dataset:
    """Return profile, strain, curvature and changes with sigma (run, chainage), with zones, dents, points and joints beside them.

    Parameters
    ----------
    content : of an output folder.
    zones, dents : as `zone_rows` and `dent_rows` give them, which is the default.
    window : stretch of reference chainage (m), by default the whole line; attributes ``start_m`` and ``end_m`` keep it.
    columns : a longer axis is cut into this many pieces, each drawn by its least and its greatest value: no peak is lost.
    margin : added to the window on both sides (m).

    Returns
    -------
    xarray.Dataset
        Variables absent from the folder are absent here. ``along`` and ``across`` (m) are the plan, turned so that the line runs
        to the right; attribute ``turn_deg`` is the azimuth of the right.
    """
    s = _axis(content)
    low, high = (s[0], s[-1]) if window is None else (window[0] - margin, window[1] + margin)
    pick = slice(int(np.searchsorted(s, low)), int(np.searchsorted(s, high, side="right")))
    pieces = _pieces(s[pick], columns)
    ds = xr.Dataset(coords={"run": content.ids, "chainage": _reduced(s[pick], None, pieces, "stride")})
    ds.attrs = {"reference": content.reference, "line": content.line, "k_sigma": content.k_sigma}
    ds.attrs |= {} if window is None else {"start_m": float(window[0]), "end_m": float(window[1])}
    ds["date"] = ("run", [content.dates[name] for name in content.ids])
    _add_runs(ds, content, s, pick, pieces)
    _add_changes(ds, content, s, pick, pieces)
    _add_plan(ds, content, s, pick, pieces)
    given = zone_rows(content, ReportOptions()) if zones is None else zones
    return _with_events(ds, content, given, dent_rows(content) if dents is None else dents)


def run_dataset(content: Content, run: str, columns: int = OVERVIEW_COLUMNS) -> xr.Dataset | None:
    """Return the navigation of one run on its own chainage: plan, height, pitch, tool roll, azimuth, speed; None without one."""
    line = content.group(run, "centreline")
    if line is None or "pitch" not in line:
        return None
    s = line["chainage"].values
    pieces = _pieces(s, columns)
    ds = xr.Dataset(coords={"chainage": _reduced(s, None, pieces, "stride")}, attrs={"run": run, "date": content.dates[run]})
    for name in ("height", "pitch", "tool_roll", "azimuth", "speed"):
        if name in line:
            ds[name] = ("chainage", _reduced(s, line[name].values, pieces, "extremes"))
    _plan_of(ds, line, slice(None), pieces)
    return ds


def on_reference(content: Content, run: str, variable: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (reference chainage, values) of a centreline variable of a run; None when the run does not hold it.

    Values are taken at `run_chainage` of the comparison; without one, at the run's own chainage.
    """
    centreline = content.group(run, "centreline")
    if centreline is None or variable not in centreline:
        return None
    own, values = centreline["chainage"].values, np.asarray(centreline[variable].values, float)
    if run == content.reference or content.comparison is None or run not in content.epochs:
        return own, values
    at = content.comparison["run_chainage"].isel(epoch=content.epochs.index(run)).values
    return content.comparison["chainage"].values, np.interp(at, own, values, left=np.nan, right=np.nan)


def _axis(content: Content) -> np.ndarray:
    """Return the chainage of the reference run, of the comparison, or of its welds: the first that is there."""
    line = content.group(content.reference, "centreline")
    if line is not None:
        return line["chainage"].values
    if content.comparison is not None:
        return content.comparison["chainage"].values
    welds = content.group(content.reference, "welds")
    return np.array([0.0, 1.0]) if welds is None or not welds.sizes["weld"] else welds["chainage"].values[[0, -1]]


def _pieces(s: np.ndarray, columns: int) -> np.ndarray | None:
    """Return where the pieces of an axis begin; None when it is short enough to be drawn as it is."""
    return None if s.size <= 4 * columns else np.linspace(0, s.size, columns, endpoint=False).astype(int)


def _reduced(s: np.ndarray, values: np.ndarray | None, pieces: np.ndarray | None, how: str) -> np.ndarray:
    """Return two numbers for every piece: least and greatest in the order in which the curve rises or falls, or two places."""
    values = s if values is None else values
    if pieces is None:
        return values
    ends = np.append(pieces[1:], s.size)
    if how == "stride":
        second = np.append(((pieces + ends) // 2)[:-1], s.size - 1)  # the line is drawn to its end
        return np.stack([values[pieces], values[second]], 1).ravel()
    least, most = np.fmin.reduceat(values, pieces), np.fmax.reduceat(values, pieces)
    if how == "greatest":
        return np.stack([most, most], 1).ravel()
    rising = ~(values[pieces] > values[ends - 1])
    return np.stack([np.where(rising, least, most), np.where(rising, most, least)], 1).ravel()


def _on_axis(found: tuple[np.ndarray, np.ndarray] | None, s: np.ndarray) -> np.ndarray:
    if found is None:
        return np.full(s.size, np.nan)
    if found[0].size == s.size and np.array_equal(found[0], s):
        return found[1]
    return np.interp(s, found[0], found[1], left=np.nan, right=np.nan)


def _add_runs(ds: xr.Dataset, content: Content, s: np.ndarray, pick: slice, pieces: np.ndarray | None) -> None:
    for name in _OF_RUN:
        rows = [_on_axis(on_reference(content, run, name), s)[pick] for run in content.ids]
        if any(np.isfinite(row).any() for row in rows):
            ds[name] = (("run", "chainage"), np.stack([_reduced(s[pick], row, pieces, "extremes") for row in rows]))


def _add_changes(ds: xr.Dataset, content: Content, s: np.ndarray, pick: slice, pieces: np.ndarray | None) -> None:
    comparison = content.comparison
    if comparison is None or not content.compares_movement:
        return
    at = comparison["chainage"].values

    def rows_of(name: str) -> list[np.ndarray]:
        found = []
        for run in content.ids:
            known = run in content.epochs
            values = comparison[name].isel(epoch=content.epochs.index(run)).values if known else np.full(at.size, np.nan)
            found.append(_on_axis((at, values), s)[pick])
        return found

    for name in _OF_CHANGE:
        if name in comparison:
            how = "greatest" if name.endswith("_sigma") else "extremes"
            ds[name] = (("run", "chainage"), np.stack([_reduced(s[pick], row, pieces, how) for row in rows_of(name)]))
    for name, parts in _SIZES.items():
        if all(part in comparison for part in parts):
            sizes = [np.hypot(a, b) for a, b in zip(*(rows_of(part) for part in parts), strict=True)]
            ds[name] = (("run", "chainage"), np.stack([_reduced(s[pick], row, pieces, "greatest") for row in sizes]))


def _add_plan(ds: xr.Dataset, content: Content, s: np.ndarray, pick: slice, pieces: np.ndarray | None) -> None:
    line = content.group(content.reference, "centreline")
    if line is not None:
        _plan_of(ds, line, pick, pieces)


def _plan_of(ds: xr.Dataset, line: xr.Dataset, pick: slice, pieces: np.ndarray | None) -> None:
    if "latitude" not in line:
        return
    latitude, longitude = line["latitude"].values[pick], line["longitude"].values[pick]
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if good.sum() < 2:
        return
    east, north = local_metres(latitude, longitude, (float(latitude[good].mean()), float(longitude[good].mean())))
    along, across = np.full(good.size, np.nan), np.full(good.size, np.nan)
    along[good], across[good], ds.attrs["turn_deg"] = turned(east[good], north[good])
    for name, values in (("along", along), ("across", across)):
        ds[name] = ("chainage", _reduced(line["chainage"].values[pick], values, pieces, "stride"))


def _with_events(ds: xr.Dataset, content: Content, zones: Sequence[dict], dents: Sequence[dict]) -> xr.Dataset:
    joints, points = content.tables["joints"], point_rows(content)
    events: dict[str, Any] = {
        "zone_id": ("zone", np.array([z["id"] for z in zones], object)),
        "zone_kind": ("zone", np.array([z["kind"] for z in zones], object)),
        "zone_severity": ("zone", np.array([z["severity"] for z in zones], object)),
        "zone_start": ("zone", np.array([z["start"] for z in zones], float)),
        "zone_end": ("zone", np.array([z["end"] for z in zones], float)),
        "dent_id": ("dent", np.array([d["id"] for d in dents], object)),
        "dent_status": ("dent", np.array([d["status"] for d in dents], object)),
        "dent_chainage": ("dent", np.array([d["chainage"] for d in dents], float)),
        "point_name": ("point", np.array([p["name"] for p in points], object)),
        "point_kind": ("point", np.array([p["kind"] for p in points], object)),
        "point_chainage": ("point", np.array([p["x"] for p in points], float)),
        "joint_chainage": ("joint", joints.reference_chainage_m.to_numpy(float)),
    }
    for name, key in (("joint_change", "change_m"), ("joint_change_sigma", "change_sigma_m")):
        rows = [joints.get(f"{key}:{run}", pd.Series(np.nan, joints.index)).to_numpy(float) for run in content.ids]
        events[name] = (("run", "joint"), np.stack(rows))
    return ds.assign(events)


def point_rows(content: Content) -> list[dict[str, Any]]:
    """Return markers and other point features of the reference run: chainage, name, kind."""
    found: list[dict[str, Any]] = []
    for group, text in (("markers", "name"), ("features", "kind")):
        ds = content.group(content.reference, group)
        if ds is None or "chainage" not in ds:
            continue
        kinds = ds["kind"].values if "kind" in ds else np.full(ds["chainage"].size, group)
        rows = zip(ds["chainage"].values, ds[text].values, kinds, strict=True)
        found += [{"x": float(x), "name": str(name), "kind": str(kind)} for x, name, kind in rows if np.isfinite(x)]
    return [point for point in found if point["kind"] not in ("metal_loss", "wall_change")][:5000]
