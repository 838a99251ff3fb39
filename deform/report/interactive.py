"""The content of an output folder in, the data of the page's linked panels, map, ribbon and tables out."""

from __future__ import annotations

from typing import Any

import numpy as np

from deform.options import ReportOptions
from deform.palette import DEPTH, DEPTH_LEAST
from deform.report.content import Content
from deform.report.line_view import on_reference, point_rows
from deform.report.plane import local_metres, turned
from deform.report.series import pack
from deform.report.welds import weld_table

_DETAIL_MARGIN_M = 60.0
_LIMIT_POINTS = 4000
_MAP_POINTS = 6000
_OF_RUN = (
    # variable, title, unit, factor, positive; True where the peaks of bends are cut off at the edge of the panel and marked
    ("height", "Profile, height", "m", 1.0, "+ = up", False),
    ("bending_strain", "Bending strain, total", "µε", 1e6, "root sum of squares", True),
    ("ovality", "Ovality", "%", 1e2, "", True),
)
_CHANGES = (
    ("bending_strain_change_horizontal", "Bending strain change, horizontal", "µε", 1e6, "+ = bend to the right", False),
    ("bending_strain_change_vertical", "Bending strain change, vertical", "µε", 1e6, "+ = sag", False),
    ("displacement_lateral", "Displacement, lateral", "m", 1.0, "+ = to the right looking downstream", False),
    ("displacement_up", "Displacement, vertical", "m", 1.0, "+ = up", False),
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
        "points": point_rows(content),
        "scale": [[round(place, 4), f"rgb({','.join(map(str, colour))})"] for place, colour in DEPTH],
        "scaleLeast": DEPTH_LEAST,
        "map": plan(content, zones, dents),
        "welds": weld_table(content),
    }


def panels(content: Content, options: ReportOptions, windows: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Return the linked panels: profile, strain of every epoch, changes with their limits, joints."""
    curves = len(_OF_RUN) * len(content.ids) + len(_CHANGES) * (len(content.ids) - 1)
    most = min(options.most_points_per_curve, options.most_points_in_page // max(curves, 1))
    limits = {"displacement": options.displacement_attention_m, "bending_strain_change": options.strain_attention}
    found = [
        *[_of_runs(content, most, windows, *entry) | _least(entry[0], options) for entry in _OF_RUN],
        *[_of_comparison(content, most, windows, limits, *entry) for entry in _CHANGES],
        _joint_panel(content),
    ]
    return [panel for panel in found if panel and panel["series"]]


def _least(variable: str, options: ReportOptions) -> dict[str, float]:
    """Return what a panel shows at least, however its peaks are cut: strains up to the attention value."""
    return {"least": 1.2e6 * options.strain_attention} if variable == "bending_strain" else {}


def _of_runs(content, most, windows, variable, title, unit, factor, positive, cut) -> dict[str, Any]:
    series = []
    for i, name in enumerate(content.ids):
        found = on_reference(content, name, variable)
        if found is not None and np.isfinite(found[1]).any():
            series.append({"run": name, "i": i, **_packed(found[0], found[1] * factor, most, windows)})
    return {"key": variable, "title": title, "unit": unit, "positive": positive, "series": series, "cut": cut}


def _of_comparison(content, most, windows, limits, variable, title, unit, factor, positive, cut) -> dict[str, Any] | None:
    ds = content.comparison
    if ds is None or variable not in ds:
        return None
    x, series = ds["chainage"].values, []
    for k, name in enumerate(content.epochs):
        values = ds[variable].isel(epoch=k).values * factor
        if name == content.reference or not np.isfinite(values).any():
            continue
        entry = {"run": name, "i": content.ids.index(name) if name in content.ids else k, **_packed(x, values, most, windows)}
        if f"{variable}_sigma" in ds:
            sigma = ds[f"{variable}_sigma"].isel(epoch=k).values
            entry["limit"] = pack(x, content.k_sigma * factor * sigma, _LIMIT_POINTS)
            entry["sigma"] = [pack(x[a:b], factor * sigma[a:b], b - a) for a, b in _cuts(x, windows)]
        series.append(entry)
    attention = next(limit * factor for name, limit in limits.items() if variable.startswith(name))
    panel = {"key": variable, "title": title, "unit": unit, "positive": positive, "series": series, "cut": cut}
    return panel | {"k": content.k_sigma, "attention": attention}


def _packed(x: np.ndarray, y: np.ndarray, most: int, windows: list[tuple[float, float]]) -> dict[str, Any]:
    """Return a curve, and where it had to be thinned its full rate inside the windows as well."""
    packed: dict[str, Any] = {"base": pack(x, y, most)}
    if y.size > most:
        packed["fine"] = [pack(x[a:b], y[a:b], b - a) for a, b in _cuts(x, windows)]
    return packed


def _cuts(x: np.ndarray, windows: list[tuple[float, float]]) -> list[tuple[int, int]]:
    """Return where the windows begin and end among the places, those with at least two of them."""
    cuts = [tuple(map(int, np.searchsorted(x, window))) for window in windows]
    return [(a, b) for a, b in cuts if b - a > 1]


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
        sigma = f"change_sigma_m:{name}"
        if sigma in rows and rows[sigma].notna().any():
            series[-1]["limit"] = pack(x, content.k_sigma * rows[sigma].to_numpy(float) * 1000, y.size)
    title = {"key": "joints", "title": "Change of joint length", "unit": "mm", "positive": "+ = longer", "k": content.k_sigma}
    return {**title, "series": series, "points": True, "cut": True}


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
