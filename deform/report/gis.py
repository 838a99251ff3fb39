"""The content of an output folder in, a GeoPackage for the office and a KML for the field out."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pandas as pd

from deform.errors import Fault, InputError, MissingExtraError, OptionError
from deform.options import ReportOptions
from deform.report.content import Content, records
from deform.report.context import build_context
from deform.run import store
from deform.units import clock_text

_LINE_STEP_M = 2.0
_WGS84 = 4979  # geographic, with ellipsoidal height
_COLOURS = {
    "high": "ff261eb3",
    "medium": "ff005b9a",
    "low": "ff3a6d2f",
    "construction": "ff6b625b",
}  # KML: alpha, blue, green, red


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``gis/<line>.gpkg`` and ``gis/<line>.kml``; return the path of the first.

    Layers: a centreline per run, zones (along the reference run), dents, welds, markers. Coordinates are geographic WGS84 with
    height above the ellipsoid, or those of ``options.crs`` (any name that PROJ knows, or ``utm`` for the zone of the line).

    Raises
    ------
    InputError
        When no run has coordinates.
    MissingExtraError
        When geopandas or pyogrio is not installed.
    OptionError
        When PROJ does not know ``options.crs``.
    """
    geopandas = _library("geopandas")
    layers = build_layers(content, options)
    if not any(name.startswith("centreline") for name in layers):
        raise InputError(Fault(str(content.folder), "runs", "no run has coordinates", "a map cannot be drawn"))
    stem = content.folder / "gis" / file_name(content.line)
    crs = _crs(options.crs, layers)
    path = stem.with_name(f"{stem.name}.gpkg")
    with store.atomic(path) as place:
        for i, (name, frame) in enumerate(layers.items()):
            shapes = geopandas.GeoDataFrame(frame, geometry="geometry", crs=_WGS84)
            shapes = shapes.to_crs(crs) if crs is not None else shapes
            shapes.to_file(place, layer=name, driver="GPKG", engine="pyogrio", mode="a" if i else "w")
    with store.atomic(stem.with_name(f"{stem.name}.kml")) as place:
        place.write_text(kml(content, layers), encoding="utf-8")
    return path


def file_name(line: str) -> str:
    """Return the name of a line as a file name: letters of any script, digits, dot, dash, underscore."""
    return re.sub(r"[^\w.\-]+", "_", line).strip("._") or "line"


def build_layers(content: Content, options: ReportOptions) -> dict[str, pd.DataFrame]:
    """Return the layers as tables with a column ``geometry`` (WGS84)."""
    shapely = _library("shapely")
    numbers = build_context(content, options)
    place = {run: _Place(content, run) for run in content.ids}
    layers: dict[str, pd.DataFrame] = {}
    for run in content.ids:
        if place[run].known:
            row = {"run": run, "date": content.dates[run], "length_m": place[run].length, "geometry": place[run].line(shapely)}
            layers[f"centreline_{file_name(run)}"] = pd.DataFrame([row])
    reference = place[content.reference]
    if reference.known:
        zones = [{**_zone(z), "geometry": reference.line(shapely, z["start"], z["end"])} for z in numbers["zones"]]
        layers["zones"] = pd.DataFrame([z for z in zones if z["geometry"] is not None])
        layers["dents"] = _dents(content, place, shapely)
        layers["welds"] = _welds(content, reference, shapely)
    layers["markers"] = _markers(content, shapely)
    return {name: frame for name, frame in layers.items() if len(frame)}


class _Place:
    """Where the chainage of one run lies on the earth."""

    def __init__(self, content: Content, run: str):
        ds = content.group(run, "centreline")
        self.known = ds is not None and "latitude" in ds and bool(np.isfinite(ds["latitude"].values).any())
        if ds is None or not self.known:
            return
        good = np.isfinite(ds["latitude"].values) & np.isfinite(ds["longitude"].values)
        self.s = ds["chainage"].values[good]
        height = ds["height"].values[good] if "height" in ds else np.zeros(self.s.size)
        self.xyz = np.stack([ds["longitude"].values[good], ds["latitude"].values[good], np.nan_to_num(height)])
        self.length = float(self.s[-1] - self.s[0])

    def at(self, chainage: Any) -> np.ndarray:
        """Return longitude, latitude, height (3, n) at chainages; NaN outside."""
        return np.stack([np.interp(chainage, self.s, row, left=np.nan, right=np.nan) for row in self.xyz])

    def line(self, shapely: Any, start: float = -np.inf, end: float = np.inf) -> Any:
        """Return a line string of the pipe between two chainages, None when it is too short or not there."""
        start, end = max(start, self.s[0]), min(end, self.s[-1])
        if not end > start:
            return None
        points = self.at(np.linspace(start, end, max(int((end - start) / _LINE_STEP_M) + 1, 2)))
        return shapely.LineString(points.T)


def _zone(zone: dict) -> dict[str, Any]:
    keys = (
        "id",
        "kind",
        "rank",
        "severity",
        "start",
        "end",
        "displacement",
        "strain",
        "direction",
        "first_epoch",
        "trend",
        "reasons",
    )
    return {key: zone[key] for key in keys}


def _dents(content: Content, place: dict[str, _Place], shapely: Any) -> pd.DataFrame:
    table = content.tables["dents"]
    table = table[table.run.isin([run for run, p in place.items() if p.known]) & table.run_chainage_m.notna()].copy()
    points = [place[row.run].at([row.run_chainage_m])[:, 0] for row in records(table)]
    table["clock"] = [clock_text(c) if np.isfinite(c) else "" for c in table.clock_deg.astype(float)]
    table["geometry"] = [shapely.Point(*p) if np.isfinite(p).all() else None for p in points]
    return table[table.geometry.notna()]


def _welds(content: Content, reference: _Place, shapely: Any) -> pd.DataFrame:
    table = content.tables["welds"]
    if table.empty:
        ds = content.group(content.reference, "welds")
        at = ds["chainage"].values if ds is not None else np.array([])
        frame = pd.DataFrame({"weld_id": [f"{i + 1}" for i in range(at.size)], "reference_chainage_m": at, "statuses": ""})
    else:
        table = table.assign(said=table.run + " " + table.status)
        frame = (
            table.groupby("weld_id")
            .agg(reference_chainage_m=("reference_chainage_m", "mean"), statuses=("said", ", ".join))
            .reset_index()
        )
    points = reference.at(frame.reference_chainage_m.to_numpy(float))
    good = np.isfinite(points).all(0)
    return frame[good].assign(geometry=shapely.points(points[:, good].T))


def _markers(content: Content, shapely: Any) -> pd.DataFrame:
    rows = []
    for run in content.ids:
        ds = content.group(run, "markers")
        if ds is None or "latitude" not in ds:
            continue
        frame = ds.to_dataframe().reset_index(drop=True)
        frame = frame[frame.latitude.notna() & frame.longitude.notna()]
        height = frame.height.fillna(0.0) if "height" in frame else pd.Series(0.0, index=frame.index)
        points = shapely.points(np.stack([frame.longitude, frame.latitude, height], axis=1).astype(float))
        rows.append(frame.assign(run=run, geometry=points))
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def kml(content: Content, layers: dict[str, pd.DataFrame]) -> str:
    """Return a KML document: centreline of the reference run, zones, dents, markers (longitude, latitude, height)."""
    reference = f"centreline_{file_name(content.reference)}"
    marks: list[str] = []
    for name in (reference, "zones", "dents", "markers"):
        marks += [_placemark(name, row) for row in layers.get(name, pd.DataFrame()).to_dict("records")]
    styles = "".join(
        f'<Style id="{word}"><LineStyle><color>{colour}</color><width>6</width></LineStyle></Style>'
        for word, colour in _COLOURS.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<name>{escape(content.line)}</name>{styles}\n" + "\n".join(marks) + "\n</Document></kml>\n"
    )


def _placemark(layer: str, row: dict[Any, Any]) -> str:
    title = str(row.get("id") or row.get("dent_id") or row.get("name") or row.get("run"))
    title += f" {row['run']}" if layer == "dents" else ""
    said = "\n".join(f"{k}: {v}" for k, v in row.items() if k != "geometry" and not _nothing(v))
    style = f"<styleUrl>#{row['severity']}</styleUrl>" if layer == "zones" else ""
    points = " ".join(f"{x:.8f},{y:.8f},{z:.2f}" for x, y, z in row["geometry"].coords)
    kind = "LineString" if row["geometry"].geom_type == "LineString" else "Point"
    clamp = "<tessellate>1</tessellate>" if kind == "LineString" else ""
    return (
        f"<Placemark><name>{escape(title)}</name><description>{escape(said)}</description>{style}"
        f"<{kind}>{clamp}<coordinates>{points}</coordinates></{kind}></Placemark>"
    )


def _nothing(value: Any) -> bool:
    return value is None or value == "" or (isinstance(value, float) and not np.isfinite(value))


def _crs(name: str, layers: dict[str, pd.DataFrame]) -> Any:
    """Return the CRS asked for; None keeps WGS84."""
    if not name:
        return None
    pyproj = _library("pyproj")
    if name == "utm":
        x, y = next(frame for key, frame in layers.items() if key.startswith("centreline")).geometry.iloc[0].coords[0][:2]
        return pyproj.CRS.from_epsg((32600 if y >= 0 else 32700) + int((x + 180) // 6) % 60 + 1)
    try:
        return pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.CRSError as fault:
        raise OptionError(
            Fault("options", "report.crs", f"{name!r} is not a coordinate system ({fault})", "such as EPSG:32610, or utm")
        ) from None


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingExtraError("the GeoPackage", "gis") from None
