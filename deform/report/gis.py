"""The content of an output folder in, a GeoPackage for the office and a KML for the field out."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pandas as pd

from deform.errors import Fault, InputError, MissingExtraError, OptionError
from deform.options import ReportOptions
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.quantities import column
from deform.run import store

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
            length = round(place[run].length, 1)
            row = {"run": run, "date": content.dates[run], "length_m": length, "geometry": place[run].line(shapely)}
            layers[f"centreline_{file_name(run)}"] = pd.DataFrame([row])
    reference = place[content.reference]
    if reference.known:
        layers["zones"] = _zones(numbers["zones"], reference, shapely)
        layers["dents"] = _dents(numbers["dents"], place, shapely)
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


def _zones(zones: list[dict], reference: _Place, shapely: Any) -> pd.DataFrame:
    """Return the zones along the reference run, with the numbers of the report."""
    frame = _frame(
        zones,
        text=("id", "kind", "severity", "direction", "first_epoch", "confidence", "headline"),
        numbers={
            "from_m": ("place", lambda z: z["start"]),
            "to_m": ("place", lambda z: z["end"]),
            "displacement_m": ("displacement", lambda z: z["displacement"].value),
            "displacement_sigma_m": ("displacement", lambda z: z["displacement"].sigma),
            "strain_change_microstrain": ("strain", lambda z: z["strain"].value),
            "strain_change_sigma_microstrain": ("strain", lambda z: z["strain"].sigma),
        },
    )
    frame["rank"] = [z["rank"] for z in zones]
    frame["reasons"] = ["; ".join(z["reasons"]) for z in zones]
    frame["geometry"] = [reference.line(shapely, z["start"], z["end"]) for z in zones]
    return frame[frame.geometry.notna()]


def _dents(dents: list[dict], place: dict[str, _Place], shapely: Any) -> pd.DataFrame:
    """Return one point per dent and run, at the coordinates of that run, with the numbers of the report."""
    rows = [
        dent | epoch | {"id": dent["id"]}
        for dent in dents
        for epoch in dent["epochs"]
        if epoch["run"] in place and place[epoch["run"]].known
    ]
    frame = _frame(
        rows,
        text=("id", "run", "status", "joint", "clock", "reason"),
        numbers={
            "reference_chainage_m": ("chainage", lambda d: d["chainage"]),
            "chainage_m": ("chainage", lambda d: d["run_chainage"]),
            "depth_mm": ("dent depth", lambda d: d["depth"].value),
            "depth_sigma_mm": ("dent depth", lambda d: d["depth"].sigma),
            "depth_percent_of_od": ("dent depth share", lambda d: d["depth_share"].value),
            "depth_change_mm": ("dent depth change", lambda d: d["change"].value),
            "length_mm": ("dent size", lambda d: d["length"].value),
            "width_mm": ("dent size", lambda d: d["width"].value),
            "strain_percent": ("dent strain", lambda d: d["strain"].value),
        },
    )
    points = [place[row["run"]].at([row["run_chainage"]])[:, 0] for row in rows]
    frame["geometry"] = [shapely.Point(*p) if np.isfinite(p).all() else None for p in points]
    return frame[frame.geometry.notna()]


def _frame(rows: list[dict], text: tuple[str, ...], numbers: dict[str, tuple[str, Callable[[dict], float]]]) -> pd.DataFrame:
    """Return a layer's table: columns of text, and numbers in the unit that their name ends in, rounded as in the report."""
    frame = pd.DataFrame({name: [str(row[name]) for row in rows] for name in text}, dtype=object)
    for name, (quantity, value) in numbers.items():
        frame[name] = column(quantity, [value(row) for row in rows])
    return frame


def _welds(content: Content, reference: _Place, shapely: Any) -> pd.DataFrame:
    table = content.tables["welds"]
    if table.empty:
        ds = content.group(content.reference, "welds")
        at = ds["chainage"].values if ds is not None else np.array([])
        frame = pd.DataFrame({"id": [f"{i + 1}" for i in range(at.size)], "reference_chainage_m": at, "statuses": ""})
    else:
        table = table.assign(said=table.run + " " + table.status)
        frame = (
            table.groupby("weld_id")
            .agg(reference_chainage_m=("reference_chainage_m", "mean"), statuses=("said", ", ".join))
            .reset_index(names="id")
        )
    points = reference.at(frame.reference_chainage_m.to_numpy(float))
    good = np.isfinite(points).all(0)
    frame["reference_chainage_m"] = column("chainage", frame.reference_chainage_m)
    return frame[good].assign(geometry=shapely.points(points[:, good].T))


def _markers(content: Content, shapely: Any) -> pd.DataFrame:
    """Return the surveyed markers of every run, with their misclosure after use."""
    rows = []
    for run in content.ids:
        ds = content.group(run, "markers")
        if ds is None or not {"latitude", "longitude"} <= set(ds.data_vars):
            continue
        frame = ds.to_dataframe().reset_index(drop=True)
        frame = frame[frame.latitude.notna() & frame.longitude.notna()]
        height = frame.height.fillna(0.0) if "height" in frame else pd.Series(0.0, index=frame.index)
        points = shapely.points(np.stack([frame.longitude, frame.latitude, height], axis=1).astype(float))
        shown = pd.DataFrame({"name": frame.name.astype(str), "run": run})
        for key in ("kind", "remark"):
            shown[key] = frame[key].astype(str) if key in frame else ""
        shown["used"] = frame.used.map({True: "yes", False: "no"}) if "used" in frame else ""
        if "chainage" in frame:
            shown["chainage_m"] = column("place", frame.chainage)
        for axis in ("east", "north", "up"):
            if f"misclosure_{axis}_after" in frame:
                shown[f"misclosure_{axis}_m"] = column("misclosure", frame[f"misclosure_{axis}_after"])
        rows.append(shown.assign(geometry=points))
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def kml(content: Content, layers: dict[str, pd.DataFrame]) -> str:
    """Return a KML document: centreline of the reference run, zones, dents of the last run, markers; folders switch on and off.

    Coordinates are longitude, latitude, height; lines are drawn on the ground, whose height is not that of the pipe.
    """
    reference = f"centreline_{file_name(content.reference)}"
    folders = []
    for title, name in (("Centreline", reference), ("Zones", "zones"), ("Dents", "dents"), ("Markers", "markers")):
        rows = layers.get(name, pd.DataFrame())
        if name in ("dents", "markers") and len(rows):  # one run is enough in the field: the last that has the point
            rows = rows.drop_duplicates("id" if name == "dents" else "name", keep="last")
        marks = [_placemark(name, row) for row in rows.to_dict("records")]
        if marks:
            folders.append(f"<Folder><name>{title}</name>\n" + "\n".join(marks) + "\n</Folder>")
    styles = "".join(
        f'<Style id="{word}"><LineStyle><color>{colour}</color><width>6</width></LineStyle></Style>'
        for word, colour in _COLOURS.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<name>{_xml(content.line)}</name>{styles}\n" + "\n".join(folders) + "\n</Document></kml>\n"
    )


def _placemark(layer: str, row: dict[Any, Any]) -> str:
    title = str(row.get("id") or row.get("name") or row.get("run"))
    if layer in ("zones", "dents"):
        title += f" {row['severity' if layer == 'zones' else 'status']}"
    said = "\n".join(f"{k.replace('_', ' ')}: {v}" for k, v in row.items() if k != "geometry" and not _nothing(v))
    style = f"<styleUrl>#{row['severity']}</styleUrl>" if layer == "zones" else ""
    points = " ".join(f"{x:.8f},{y:.8f},{z:.2f}" for x, y, z in row["geometry"].coords)
    kind = "LineString" if row["geometry"].geom_type == "LineString" else "Point"
    clamp = "<tessellate>1</tessellate>" if kind == "LineString" else ""
    return (
        f"<Placemark><name>{_xml(title)}</name><description>{_xml(said)}</description>{style}"
        f"<{kind}>{clamp}<coordinates>{points}</coordinates></{kind}></Placemark>"
    )


def _xml(text: str) -> str:
    """Return text that may stand in XML 1.0: escaped, without the control characters that no XML can hold."""
    return escape(re.sub(r"[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "", text))


def _nothing(value: Any) -> bool:
    return value is None or value in ("", "–") or (isinstance(value, float) and not np.isfinite(value))


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
