"""A table of surveyed points in (any spelling of its headers, any reference system), group ``control`` in WGS84 out."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import xarray as xr

from deform.readers import cells, datum, delimited
from deform.readers.columns import FileOptions
from deform.readers.delimited import Sheet
from deform.readers.findings import Findings
from deform.run import build

# Spellings of each column, unit and brackets taken off; the first that is there is used.
SPELLINGS: dict[str, tuple[str, ...]] = {
    "name": ("name", "point", "point name", "point id", "id", "pt", "station", "marker", "label", "no", "number", "description"),
    "latitude": ("latitude", "lat", "latitude deg", "lat deg", "latitude wgs84", "y lat", "breite"),
    "longitude": (
        "longitude",
        "long",
        "lon",
        "lng",
        "longitude deg",
        "lon deg",
        "long deg",
        "longtitude",
        "longitude wgs84",
        "länge",
    ),
    "easting": ("easting", "east", "e", "x", "utm e", "utm easting", "rechtswert"),
    "northing": ("northing", "north", "n", "y", "utm n", "utm northing", "hochwert"),
    "height": ("height", "ellipsoidal height", "h", "elevation", "elev", "altitude", "alt", "z", "up", "höhe"),
    "sigma_horizontal": (
        "sigma horizontal",
        "horizontal sigma",
        "sigma h",
        "sigma hor",
        "sigma_h",
        "hrms",
        "horizontal accuracy",
        "sigma xy",
    ),
    "sigma_vertical": ("sigma vertical", "vertical sigma", "sigma v", "sigma ver", "vrms", "vertical accuracy", "sigma z"),
    "chainage": ("chainage", "kp", "reference chainage", "distance", "stationing"),
}
_PLACES = (("latitude", "longitude"), ("northing", "easting"))
_UNIT = re.compile(r"[\[(]\s*([^\])]*)\s*[\])]|[_ ](deg|degree|degrees|m|ft|km|mm)$")
_CRS_LINE = re.compile(r"^\s*#?\s*crs\s*[:=]\s*\"?([^\"\r\n]+?)\"?[,;\s]*$", re.IGNORECASE)
_METRES_PER_DEGREE = 111_200.0
_DEFAULT_UNITS = {"chainage": "m", "height": "m", "easting": "m", "northing": "m", "sigma_horizontal": "m", "sigma_vertical": "m"}


def read_control(
    path: Path | str, crs: str | None = None, *, decimal: str = ".", delimiter: str = "", sheet: str | int = 0
) -> xr.Dataset:
    """Read surveyed control points.

    Parameters
    ----------
    path : CSV, Excel or Parquet table. Columns may be spelled in any of the ways of `SPELLINGS`, with a unit in brackets or
        behind an underscore (``height_m``, ``Easting [ft]``, ``KP (km)``); latitude and longitude may be decimal degrees or
        degrees, minutes, seconds.
    crs : reference system of the coordinates as PROJ reads it (``EPSG:32610``, ``EPSG:4269``); None takes a line
        ``# crs = EPSG:...`` at the top of the file, else WGS84. Eastings and northings need one.
    decimal, delimiter, sheet : how the table is written; the delimiter is found when empty.

    Returns
    -------
    Group ``control`` (``point``): ``name``, ``latitude``, ``longitude`` (degree), ``height`` (metre above the ellipsoid),
    ``sigma_horizontal``, ``sigma_vertical`` (metre) and ``chainage`` (metre) where the table has them; attribute ``repairs``.

    Raises
    ------
    InputError
        With every fault: missing columns, cells that are no numbers, coordinates that cannot be, an unknown reference system.

    Examples
    --------
    >>> read_control("control.csv", crs="EPSG:32610")  # doctest: +SKIP
    """
    path = Path(path)
    findings = Findings(path.name)
    if not path.is_file():
        findings.fault("", "", "no such file")
        findings.raise_if()
    wanted = [tuple(s) for s in SPELLINGS.values()]
    options = FileOptions(decimal="," if decimal == "," else ".", delimiter=delimiter, sheet=sheet)
    table = delimited.read_sheet(path, options, _as_written(path, options, wanted), findings)
    places = _places(table)
    pair = next((p for p in _PLACES if all(name in places for name in p)), None)
    if pair is None:
        held = ", ".join(h for h in table.header if h) or "nothing"
        findings.fault("", "", f"no columns latitude and longitude, nor easting and northing; the file holds {held}")
    if "height" not in places:
        findings.fault(
            "",
            "height",
            f"no column {', '.join(SPELLINGS['height'][:4])}, ...",
            "a control point needs its height above the ellipsoid",
        )
    findings.raise_if()
    values = {
        name: _values(name, place, unit, table, decimal, findings) for name, (place, unit) in places.items() if name != "name"
    }
    names = _names(table, places, findings)
    crs = crs or _stated_crs(path)
    if pair == _PLACES[1] and not crs:
        findings.fault(
            "", "easting, northing", "have no reference system", "give crs = 'EPSG:...', or a first line '# crs = EPSG:...'"
        )
    findings.raise_if()
    if pair == _PLACES[1] or crs:
        y, x = (values.pop(n) for n in pair or ())
        values["latitude"], values["longitude"], values["height"] = datum.to_wgs84(x, y, values["height"], str(crs), findings)
    keep = _checked(values, table, findings)
    findings.raise_if()
    wanted_columns = ("latitude", "longitude", "height", "sigma_horizontal", "sigma_vertical", "chainage")
    chosen: dict[str, np.ndarray] = {n: values[n][keep] for n in wanted_columns if n in values}
    chosen["name"] = names[keep]
    return build.dataset("control", chosen, repairs="\n".join(findings.repairs), crs=str(crs or "EPSG:4979"))


def _as_written(path: Path, options: FileOptions, wanted: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the file's own headers in place of the spellings they stand for, so that the header row is found."""
    first = delimited.read_sheet(path, options, wanted)
    cells_of_file = [*first.header, *(c for row in first.rows[:20] for c in row)]
    return [tuple(c for c in cells_of_file if _bare(c)[0] in spellings) or spellings for spellings in wanted]


def _bare(header: str) -> tuple[str, str]:
    """Return a header without its unit, and the unit."""
    text = cells.key(header).replace("σ", "sigma")
    match = _UNIT.search(text)
    unit = (match[1] or match[2] or "").strip() if match else ""
    text = (text[: match.start()] + text[match.end() :]) if match else text
    return " ".join(text.replace("_", " ").replace(".", " ").split()), unit


def _places(table: Sheet) -> dict[str, tuple[int, str]]:
    bare = [_bare(h) for h in table.header]
    found: dict[str, tuple[int, str]] = {}
    for name, spellings in SPELLINGS.items():
        for spelling in spellings:
            place = next(
                (i for i, (text, _) in enumerate(bare) if text == spelling and i not in [p for p, _ in found.values()]), None
            )
            if place is not None:
                found[name] = (place, bare[place][1])
                break
    return found


def _values(name: str, place: int, unit: str, table: Sheet, decimal: str, findings: Findings) -> np.ndarray:
    text = table.column(place)
    if name in ("latitude", "longitude"):
        values, refused = cells.convert(text, lambda t: cells.angle(t, decimal))
        factor = 1.0
    else:
        wrong = cells.check_unit(unit or _DEFAULT_UNITS[name], "length")
        if wrong:
            findings.fault("", table.header[place], wrong)
            return np.full(len(text), np.nan)
        factor = cells.factor(unit or _DEFAULT_UNITS[name], "length")
        values, refused = cells.convert(text, lambda t: cells.station(t, decimal))
    for i in refused:
        findings.fault("", f"{table.header[place]}, line {table.lines[i]}", f"is {text[i]!r}, wanted a number")
    return values * factor


def _names(table: Sheet, places: dict[str, tuple[int, str]], findings: Findings) -> np.ndarray:
    given = table.column(places["name"][0]) if "name" in places else [""] * len(table.rows)
    names: list[str] = []
    for i, text in enumerate(given, 1):
        name = cells.words(text) or f"point {i}"
        if name in names:
            n = 2
            while f"{name} ({n})" in names:
                n += 1
            findings.repair("", "name", f"{name!r} stands there twice; called '{name} ({n})'")
            name = f"{name} ({n})"
        names.append(name)
    return np.array(names, dtype=object)


def _checked(values: dict[str, np.ndarray], table: Sheet, findings: Findings) -> np.ndarray:
    """Hold the points against what can be; rows without coordinates are left out."""
    latitude, longitude, height = values["latitude"], values["longitude"], values["height"]
    empty = ~(np.isfinite(latitude) & np.isfinite(longitude) & np.isfinite(height))
    if empty.any():
        first = table.lines[int(np.argmax(empty))]
        findings.repair("", "", f"{empty.sum()} of {empty.size} rows have no full coordinates, first line {first}; left out")
    if empty.all():
        findings.fault("", "", "holds no point with coordinates")
        return ~empty
    for name, value, low, high in (
        ("latitude", latitude, -90, 90),
        ("longitude", longitude, -180, 360),
        ("height", height, -1000, 9000),
    ):
        for i in np.flatnonzero(~empty & ((value < low) | (value > high)))[:5]:
            findings.fault(
                "",
                f"{name}, line {table.lines[i]}",
                f"is {value[i]:g}; it must lie in {low} .. {high}",
                "is the order of the columns or the crs right?",
            )
    for name in ("sigma_horizontal", "sigma_vertical"):
        bad = ~empty & (values[name] <= 0) if name in values else np.zeros(empty.shape, bool)
        for i in np.flatnonzero(bad)[:5]:
            findings.fault("", f"{name}, line {table.lines[i]}", f"is {values[name][i]:g} m; a standard deviation is positive")
    _together(latitude[~empty], longitude[~empty], findings)
    return ~empty


def _together(latitude: np.ndarray, longitude: np.ndarray, findings: Findings) -> None:
    spread = np.hypot(latitude - np.median(latitude), (longitude - np.median(longitude) + 180) % 360 - 180) * _METRES_PER_DEGREE
    if spread.max() > 3e6:
        findings.fault(
            "",
            "latitude, longitude",
            f"points lie {spread.max() / 1000:.0f} km apart; they are of one pipeline",
            "check signs and order",
        )


def _stated_crs(path: Path) -> str | None:
    """Return the reference system that a line ``# crs = ...`` at the top of a text file states."""
    if path.suffix.lower() not in (".csv", ".txt", ".tsv", ".dat"):
        return None
    for line in path.read_bytes()[:4096].decode("utf-8", errors="replace").splitlines()[:20]:
        match = _CRS_LINE.match(line)
        if match:
            return match[1].strip()
    return None
