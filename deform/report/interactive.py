"""The content of an output folder in, the data of the page's linked panels, map, ribbon and tables out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from deform.options import ReportOptions
from deform.report.content import Content
from deform.report.series import pack

_DETAIL_MARGIN_M = 60.0
_LIMIT_POINTS = 4000
_MAP_POINTS = 6000
_EARTH_RADIUS_M = 6_371_008.8
_CHANGES = (
    # variable, title, unit, factor, positive
    ("bending_strain_change_horizontal", "Bending strain change, horizontal", "µε", 1e6, "+ = bend to the right"),
    ("bending_strain_change_vertical", "Bending strain change, vertical", "µε", 1e6, "+ = sag"),
    ("displacement_lateral", "Displacement, lateral", "m", 1.0, "+ = to the right looking downstream"),
    ("displacement_up", "Displacement, vertical", "m", 1.0, "+ = up"),
)


def page_data(content: Content, options: ReportOptions, zones: list[dict], dents: list[dict]) -> dict[str, Any]:
    """Return everything that the page's script draws, as plain lists and base64 text."""
    windows = [(max(z["start"] - _DETAIL_MARGIN_M, 0.0), z["end"] + _DETAIL_MARGIN_M) for z in zones[: options.most_zone_details]]
    return {
        "runs": [{"id": name, "date": content.dates[name]} for name in content.ids],
        "reference": content.reference,
        "panels": panels(content, options, windows),
        "zones": [{k: z[k] for k in ("id", "kind", "start", "end", "severity", "rank")} for z in zones],
        "dents": [{"id": d["id"], "x": d["chainage"], "status": d["status"]} for d in dents],
        "points": _points(content),
        "map": plan(content, zones, dents),
        "welds": weld_table(content),
    }


def panels(content: Content, options: ReportOptions, windows: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Return the linked panels: profile, strain of every epoch, changes with their limits, joints."""
    curves = 2 * len(content.ids) + len(_CHANGES) * (len(content.ids) - 1)
    most = min(options.most_points_per_curve, options.most_points_in_page // curves)
    found = [
        _of_runs(content, most, windows, "height", "Profile, height", "m", 1.0, "+ = up"),
        _of_runs(content, most, windows, "bending_strain", "Bending strain, total", "µε", 1e6, "root sum of squares"),
        *[_of_comparison(content, most, windows, *change) for change in _CHANGES],
        _joint_panel(content),
    ]
    return [panel for panel in found if panel and panel["series"]]


def on_reference(content: Content, run: str, variable: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (reference chainage, values) of a centreline variable of a run; None when the run does not hold it.

    Values are taken at `run_chainage` of the comparison; without one, at the run's own chainage.
    """
    centreline = content.group(run, "centreline")
    if centreline is None or variable not in centreline:
        return None
    own, values = centreline["chainage"].values, np.asarray(centreline[variable].values, float)
    if run == content.reference or content.comparison is None or run not in _epochs(content.comparison):
        return own, values
    at = content.comparison["run_chainage"].values[_epochs(content.comparison).index(run)]
    return content.comparison["chainage"].values, np.interp(at, own, values, left=np.nan, right=np.nan)


def _of_runs(content, most, windows, variable, title, unit, factor, positive) -> dict[str, Any]:
    series = []
    for i, name in enumerate(content.ids):
        found = on_reference(content, name, variable)
        if found is not None and np.isfinite(found[1]).any():
            series.append({"run": name, "i": i, **_packed(found[0], found[1] * factor, most, windows)})
    return {"key": variable, "title": title, "unit": unit, "positive": positive, "series": series}


def _of_comparison(content, most, windows, variable, title, unit, factor, positive) -> dict[str, Any] | None:
    ds = content.comparison
    if ds is None or variable not in ds:
        return None
    x, series = ds["chainage"].values, []
    for k, name in enumerate(_epochs(ds)):
        values = ds[variable].values[k] * factor
        if name == content.reference or not np.isfinite(values).any():
            continue
        entry = {"run": name, "i": content.ids.index(name) if name in content.ids else k, **_packed(x, values, most, windows)}
        if f"{variable}_sigma" in ds:
            entry["limit"] = pack(x, _k_sigma(content) * factor * ds[f"{variable}_sigma"].values[k], _LIMIT_POINTS)
        series.append(entry)
    return {"key": variable, "title": title, "unit": unit, "positive": positive, "series": series, "k": _k_sigma(content)}


def _packed(x: np.ndarray, y: np.ndarray, most: int, windows: list[tuple[float, float]]) -> dict[str, Any]:
    """Return a curve, and where it had to be thinned its full rate inside the windows as well."""
    packed: dict[str, Any] = {"base": pack(x, y, most)}
    if y.size > most:
        cuts = [np.searchsorted(x, window) for window in windows]
        packed["fine"] = [pack(x[a:b], y[a:b], b - a) for a, b in cuts if b - a > 1]
    return packed


def _joint_panel(content: Content) -> dict[str, Any] | None:
    joints = content.tables["joints"]
    series = []
    for i, name in enumerate(content.ids):
        column = f"change_m:{name}"
        if name == content.reference or column not in joints or not joints[column].notna().any():
            continue
        rows = joints[joints[column].notna() & joints.reference_chainage_m.notna()].sort_values("reference_chainage_m")
        x, y = rows.reference_chainage_m.to_numpy(float), rows[column].to_numpy(float) * 1000
        series.append({"run": name, "i": i, "base": pack(x, y, y.size)})
    title = {"key": "joints", "title": "Change of joint length", "unit": "mm", "positive": "+ = longer"}
    return {**title, "series": series, "points": True}


def plan(content: Content, zones: list[dict], dents: list[dict]) -> dict[str, Any] | None:
    """Return the reference centreline thinned, with its chainage, turned so that the line runs to the right.

    ``along`` and ``across`` are metres from the middle of the line, ``turn`` is the azimuth (degree) of the picture's right.
    """
    centreline = content.group(content.reference, "centreline")
    if centreline is None or "latitude" not in centreline or not np.isfinite(centreline["latitude"].values).any():
        return None
    s = centreline["chainage"].values
    good = np.flatnonzero(np.isfinite(centreline["latitude"].values))
    keep = good[:: max(good.size // _MAP_POINTS, 1)]
    places = [(z["start"], z["end"]) for z in zones] + [(d["chainage"] - 1, d["chainage"] + 1) for d in dents[:500]]
    inside = [good[(s[good] >= start) & (s[good] <= end)][::20] for start, end in places]
    keep = np.unique(np.concatenate([keep, good[-1:], *inside]))
    latitude, longitude = centreline["latitude"].values[keep], centreline["longitude"].values[keep]
    east, north = local_metres(latitude, longitude, (float(np.mean(latitude)), float(np.mean(longitude))))
    along, across, turn = turned(east, north)
    rounded = {name: np.round(values, 2) for name, values in (("s", s[keep]), ("along", along), ("across", across))}
    return rounded | {"turn": turn}


def turned(east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the line in axes along its main direction and to the left of it, and the azimuth (degree) of that direction."""
    span = np.array([east[-1] - east[0], north[-1] - north[0]])
    if np.hypot(*span) < 0.2 * max(np.ptp(east), np.ptp(north)):
        span = np.array([1.0, 0.0])  # a loop has no main direction: north stays up
    unit = span / np.hypot(*span)
    return east * unit[0] + north * unit[1], north * unit[0] - east * unit[1], float(np.degrees(np.arctan2(unit[0], unit[1])))


def local_metres(latitude: np.ndarray, longitude: np.ndarray, origin: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return east and north (m) of an origin (degree), for pictures only: sphere, a few tenths of a percent."""
    scale = np.radians(1.0) * _EARTH_RADIUS_M
    return (longitude - origin[1]) * scale * np.cos(np.radians(origin[0])), (latitude - origin[0]) * scale


def _points(content: Content) -> list[dict[str, Any]]:
    """Return markers and other point features of the reference run."""
    found: list[dict[str, Any]] = []
    for group, text in (("markers", "name"), ("features", "kind")):
        ds = content.group(content.reference, group)
        if ds is None or "chainage" not in ds:
            continue
        kinds = ds["kind"].values if "kind" in ds else np.full(ds["chainage"].size, group)
        rows = zip(ds["chainage"].values, ds[text].values, kinds, strict=True)
        found += [{"x": float(x), "name": str(name), "kind": str(kind)} for x, name, kind in rows if np.isfinite(x)]
    return [point for point in found if point["kind"] not in ("metal_loss", "wall_change")][:5000]


def weld_table(content: Content) -> dict[str, Any]:
    """Return one row per weld: id, reference chainage, (chainage, status) in every run, least probability, reason."""
    welds = content.tables["welds"]
    if welds.empty:
        return {"runs": content.ids, "rows": []}
    wide = welds.drop_duplicates(["weld_id", "run"]).pivot(index="weld_id", columns="run", values=["chainage_m", "status"])
    groups = welds.groupby("weld_id")
    place, probability = groups.reference_chainage_m.mean(), groups.probability.min()
    told = welds[(welds.reason != "") & (welds.status != "matched")]
    reason = told.groupby("weld_id").reason.agg(lambda texts: "; ".join(dict.fromkeys(texts)))
    names = [name for name in content.ids if ("status", name) in wide]
    rows = []
    for weld in place.sort_values().index:
        cells = []
        for name in names:
            chainage, status = wide.at[weld, ("chainage_m", name)], wide.at[weld, ("status", name)]
            cells += [_rounded(chainage), "" if not isinstance(status, str) else status]
        rows.append([weld, _rounded(place[weld]), *cells, _rounded(probability[weld], 4), reason.get(weld, "")])
    return {"runs": names, "rows": rows}


def _rounded(value: Any, decimals: int = 3) -> float | None:
    return round(float(value), decimals) if np.isfinite(float(value)) else None


def _epochs(ds: xr.Dataset) -> list[str]:
    return [str(name) for name in ds["epoch"].values]


def _k_sigma(content: Content) -> float:
    return float(content.survey.get("options", {}).get("change", {}).get("k_sigma", 3.0))
