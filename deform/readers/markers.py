"""The file ``markers.csv`` of a raw run in, the passages of surveyed markers out; gross ones named, impossible ones left out."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from deform.readers.events import parse_number, read_rows
from deform.readers.findings import Findings
from deform.run import build
from deform.run.raw import RunHeader

FILE = "markers.csv"
KINDS = ("launcher", "receiver", "agm", "valve")
_NUMBERS = ("time_s", "latitude_deg", "longitude_deg", "height_m")
_SIGMAS = ("sigma_horizontal_m", "sigma_vertical_m")
_LIMITS = {"latitude_deg": (-90.0, 90.0), "longitude_deg": (-180.0, 360.0), "height_m": (-1000.0, 9000.0)}
_UNKNOWN_SIGMA_M = 1.0
_LEAST_SIGMA_M = 0.001
_EARTH_RADIUS_M = 6_371_000.0
_IMPOSSIBLE_M = 100_000.0  # beyond the length of the run: no gross error of a survey, another place
_FAR_M = 1_000.0

Table = dict[str, np.ndarray]


def read_passages(
    path: Path, header: RunHeader | None, span: tuple[float, float] | None, length: float, findings: Findings
) -> xr.Dataset | None:
    """Return group ``passages``; None when there is no file or no marker in it.

    Parameters
    ----------
    path : the file.
    header : header of the run; its launch is held against the markers.
    span : first and last time of the recording (second).
    length : length of the run by its odometer (metre).
    findings : takes the faults and the repairs.
    """
    if not path.exists():
        return None
    rows = read_rows(path, ("name", "kind", *_NUMBERS), _SIGMAS, findings)
    if rows is None:
        return None
    known = len(findings.faults)
    table = _table(rows, findings)
    if len(findings.faults) > known:
        return None
    _times(table, span, findings)
    table = _places(table, header, length, findings)
    if len(findings.faults) > known:
        return None
    if not table["name"].size:
        findings.repair(FILE, "", "holds no marker")
        return None
    sigmas = {s.removesuffix("_m"): table[s] for s in _SIGMAS}
    numbers = {
        "time": table["time_s"],
        "latitude": table["latitude_deg"],
        "longitude": table["longitude_deg"],
        "height": table["height_m"],
    }
    return build.dataset("passages", {"name": table["name"], "kind": table["kind"], **numbers, **sigmas})


def _table(rows: list[tuple[int, dict[str, str]]], findings: Findings) -> Table:
    columns: dict[str, list] = {name: [] for name in ("name", "kind", *_NUMBERS, *_SIGMAS)}
    for line, row in rows:
        columns["name"].append(_name(row.get("name", ""), columns["name"], line, findings))
        columns["kind"].append(_kind(row.get("kind", ""), line, findings))
        for name in _NUMBERS:
            value = parse_number(row.get(name, ""), FILE, f"{name}, line {line}", findings)
            columns[name].append(value)
            low, high = _LIMITS.get(name, (-np.inf, np.inf))
            if not (low <= value <= high or (name == "time_s" and np.isnan(value))):
                rule = "is empty" if np.isnan(value) else f"is {value:g}; it must lie in {low:g} .. {high:g}"
                findings.fault(
                    FILE, f"{name}, line {line}", rule, "latitude and longitude may be swapped" if name == "latitude_deg" else ""
                )
        for name in _SIGMAS:
            columns[name].append(_sigma(row.get(name, ""), name, line, findings))
    text = {"name", "kind"}
    return {name: np.array(column, dtype=object if name in text else float) for name, column in columns.items()}


def _name(text: str, before: list[str], line: int, findings: Findings) -> str:
    if not text:
        text = f"marker {len(before) + 1}"
        findings.repair(FILE, f"name, line {line}", f"is empty; called {text!r}")
    if text in before:
        n = 2
        while f"{text} ({n})" in before:
            n += 1
        findings.repair(FILE, f"name, line {line}", f"{text!r} stands there before; called '{text} ({n})'")
        text = f"{text} ({n})"
    return text


def _kind(text: str, line: int, findings: Findings) -> str:
    kind = text.lower()
    if kind not in KINDS:
        findings.fault(FILE, f"kind, line {line}", f"is {text!r}, none of {', '.join(KINDS)}")
    return kind


def _sigma(text: str, name: str, line: int, findings: Findings) -> float:
    value = parse_number(text, FILE, f"{name}, line {line}", findings)
    if np.isnan(value):
        findings.repair(FILE, f"{name}, line {line}", f"is empty; {_UNKNOWN_SIGMA_M:g} m is taken")
        return _UNKNOWN_SIGMA_M
    if not 0 <= value <= 1000:
        findings.fault(FILE, f"{name}, line {line}", f"is {value:g} m; a standard deviation lies in 0 .. 1000 m")
    if value < _LEAST_SIGMA_M:
        findings.repair(FILE, f"{name}, line {line}", f"is {value:g} m; {_LEAST_SIGMA_M:g} m is taken")
        return _LEAST_SIGMA_M
    return value


def _times(table: Table, span: tuple[float, float] | None, findings: Findings) -> None:
    time, name = table["time_s"], table["name"]
    if span is not None:
        outside = np.isfinite(time) & ((time < span[0]) | (time > span[1]))
        for i in np.flatnonzero(outside):
            findings.repair(
                FILE,
                f"time_s of {name[i]}",
                f"{time[i]:g} s is outside the recording ({span[0]:.1f} to {span[1]:.1f} s); taken as not heard",
            )
        time[outside] = np.nan
    heard = np.flatnonzero(np.isfinite(time))
    for i, k in pairwise(heard):
        if time[k] <= time[i]:
            findings.repair(
                FILE, f"time_s of {name[k]}", f"{time[k]:.3f} s is not after {name[i]} ({time[i]:.3f} s), the row before; kept"
            )


def _places(table: Table, header: RunHeader | None, length: float, findings: Findings) -> Table:
    """Leave out markers that cannot be on this line; a fault when most of them are far from the launch."""
    if header is None or not table["name"].size:
        return table
    launch = header.launch
    away = distance(launch.latitude_deg, launch.longitude_deg, table["latitude_deg"], table["longitude_deg"])
    beyond = away - 1.05 * length
    impossible = beyond > _IMPOSSIBLE_M
    ran = f"the tool ran {length / 1000:.1f} km"
    if impossible.any() and impossible.mean() > 0.5:
        i = int(np.argmax(away))
        farthest = f"{table['name'][i]} {away[i] / 1000:.0f} km"
        rule = f"{impossible.sum()} of {impossible.size} markers lie far from the launch, {farthest}; {ran}"
        advice = "check signs and order in markers.csv and in [launch] of run.toml"
        findings.fault(FILE, "latitude_deg, longitude_deg", rule, advice)
        return table
    for name, metres, gone in zip(table["name"], away, impossible, strict=True):
        if metres - 1.05 * length > _FAR_M:
            what = "left out" if gone else "kept"
            findings.repair(FILE, f"place of {name}", f"{metres / 1000:.1f} km from the launch, {ran}; {what}")
    return {name: column[~impossible] for name, column in table.items()}


def distance(latitude: float, longitude: float, latitudes: np.ndarray, longitudes: np.ndarray) -> np.ndarray:
    """Distance on the sphere (metre), good to half a percent: enough to tell another place."""
    p1, p2 = np.radians(latitude), np.radians(latitudes)
    half = np.sin((p2 - p1) / 2) ** 2 + np.cos(p1) * np.cos(p2) * np.sin(np.radians(longitudes - longitude) / 2) ** 2
    return 2 * _EARTH_RADIUS_M * np.arcsin(np.sqrt(np.clip(half, 0, 1)))
