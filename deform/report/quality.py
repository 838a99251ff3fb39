"""The content of an output folder in, the numbers of the data-quality page out: marks, noise, warnings, options, hashes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import Content
from deform.report.words import NOTHING, number, with_sigma

_CONTRACT = ("zones", "dents", "trends", "joints", "welds")
_TITLES = {
    "floors": (
        "Noise floors",
        "On the stable pipe of each pair of runs; a change below k times this is not distinguished from none.",
    ),
    "limits": (
        "Detection limits",
        "Least amplitude of a movement of the given length that these runs could show; smaller ones stay unseen.",
    ),
}
_NAVIGATION = (
    # variable, title, unit, decimals, factor
    ("alignment_azimuth", "first azimuth", "°", 4, 1.0),
    ("alignment_pitch", "first pitch", "°", 4, 1.0),
    ("alignment_roll", "first roll", "°", 4, 1.0),
    ("gyro_bias", "gyro drift", "°/h", 4, 1.0),
    ("accel_bias", "accelerometer bias", "µg", 1, 1e6 / 9.80665),
    ("mounting_azimuth", "mounting, azimuth", "°", 4, 1.0),
    ("mounting_pitch", "mounting, pitch", "°", 4, 1.0),
    ("odometer_scale", "odometer scale", "ppm", 0, 1e6),
    ("delay", "odometer delay", "ms", 1, 1e3),
)
_COMPONENTS = ("east", "north", "up")
_INNER = {"Conventions", "history", "schema_version", "id", "date", "line", "source", "direction", "input_sha256", "repairs"}
_STATUSES = ("matched", "shifted", "missed", "false", "added", "removed")


def quality(content: Content) -> dict[str, Any]:
    """Return marks, weld statistics, further tables, stages, warnings, what is missing, options, inputs and history."""
    survey = content.survey
    return {
        "markers": marker_rows(content),
        "welds": weld_counts(content),
        "navigation": navigation_rows(content),
        "innovations": innovation_rows(content),
        "tables": further_tables(content),
        "runs": [run_details(content, run) for run in content.ids],
        "stages": [
            {
                "name": str(stage.get("name", "")),
                "seconds": number(stage.get("seconds"), 1, "s"),
                "memory": number(stage.get("peak_memory_mb"), 0, "MB"),
                "status": str(stage.get("status", "")),
            }
            for stage in survey.get("stages", [])
        ],
        "warnings": [{key: str(w.get(key, "")) for key in ("stage", "message")} for w in survey.get("warnings", [])],
        "missing": [(m.get("output", ""), m.get("reason", "")) for m in survey.get("missing", [])] + list(content.absent),
        "options": flat(survey.get("options", {})),
        "inputs": inputs(content),
    }


def marker_rows(content: Content) -> list[dict[str, str]]:
    """Return the misclosure of every marker of every run before and after its use."""
    rows = []
    for name in content.ids:
        ds = content.group(name, "markers")
        if ds is None:
            continue
        for i in range(int(ds.sizes.get("marker", 0))):
            row = {key: ds[key].values[i] if key in ds else None for key in ("name", "kind", "chainage", "used", "remark")}
            before, after = (_misclosure(ds, i, word) for word in ("before", "after"))
            used = NOTHING if row["used"] is None else "yes" if bool(row["used"]) else "no"
            text = {"run": name, "chainage": number(row["chainage"], 1, "m"), "before": before, "after": after, "used": used}
            rows.append(text | {key: str(row[key] or "") for key in ("name", "kind", "remark")})
    return rows


def _misclosure(ds: xr.Dataset, i: int, word: str) -> str:
    names = [f"misclosure_{component}_{word}" for component in _COMPONENTS]
    parts = [float(ds[name].values[i]) if name in ds else np.nan for name in names]
    return NOTHING if not np.isfinite(parts).any() else " / ".join(number(p, 2, sign=True) for p in parts)


def weld_counts(content: Content) -> list[dict[str, Any]]:
    """Return for each run how many welds have which status."""
    rows = []
    for run, statuses in content.tables["welds"].groupby("run", sort=False).status:
        counts = statuses.value_counts()
        rows.append({"run": run, "counts": [(word, int(counts.get(word, 0))) for word in _STATUSES]})
    return rows


def frame_rows(name: str, frame: pd.DataFrame, most: int = 400) -> dict[str, Any]:
    """Return any table for people: its title, a note, columns, rows of text, and how many rows were cut."""
    shown = frame.dropna(axis=1, how="all").head(most)
    rows = [[_cell(value) for value in row] for row in shown.itertuples(index=False)]
    title, note = _TITLES.get(name, (name.capitalize(), f"tables/{name}.csv"))
    columns = [str(column).replace("_", " ") for column in shown.columns]
    return {"name": name, "title": title, "note": note, "columns": columns, "rows": rows, "cut": len(frame) - len(shown)}


def limit_tables(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the noise floors and the detection limits of ``tables/limits.csv`` apart, in units for people."""
    if not {"wavelength_m", "noise_sigma", "run_from", "run_to"} <= set(frame.columns):
        return [frame_rows("limits", frame)]
    pair = frame.run_from.astype(str) + " to " + frame.run_to.astype(str)
    frame = frame.assign(pair=pair)
    tables = []
    for name, part, columns in (
        ("floors", frame[frame.wavelength_m.isna()], _FLOOR_COLUMNS),
        ("limits", frame[frame.wavelength_m.notna()], _LIMIT_COLUMNS),
    ):
        shown = {title: column(part) for title, column in columns.items()}
        if len(part):
            tables.append(frame_rows(name, pd.DataFrame(shown)))
    return tables


def _text(name: str) -> Callable[[pd.DataFrame], list[str]]:
    return lambda part: ["" if pd.isna(v) else str(v) for v in part[name]] if name in part else [""] * len(part)


def _scaled(name: str, factor: float, decimals: int, unit: str) -> Callable[[pd.DataFrame], list[str]]:
    return lambda part: [number(v * factor, decimals, unit) for v in part[name]] if name in part else [NOTHING] * len(part)


def _floor(part: pd.DataFrame) -> list[str]:
    in_metre = part.quantity.isin(["displacement", "joint length"])
    sizes = zip(part.noise_sigma, in_metre, strict=True)
    return [
        number(v * 1000, 1, "mm") if metre else number(v * 1e6, 1, "µε" if "strain" in q else "ppm")
        for (v, metre), q in zip(sizes, part.quantity, strict=True)
    ]


_FLOOR_COLUMNS = {
    "runs": _text("pair"),
    "quantity": _text("quantity"),
    "component": _text("component"),
    "speeds": _text("speed_class"),
    "one sigma": _floor,
}
_LIMIT_COLUMNS = {
    "runs": _text("pair"),
    "component": _text("component"),
    "length of movement": _scaled("wavelength_m", 1.0, 0, "m"),
    "found in half of all cases": _scaled("limit_displacement_m", 1000, 1, "mm"),
    "found in nine of ten": _scaled("limit_90_displacement_m", 1000, 1, "mm"),
    "its strain change": _scaled("limit_strain_change", 1e6, 1, "µε"),
    "its elongation": _scaled("limit_axial_strain", 1e6, 2, "µε"),
    "decided by": _text("decided_by"),
}


def further_tables(content: Content) -> list[dict[str, Any]]:
    """Return noise floors and limits first, then every other table that lies beside those of the contract."""
    found: list[dict[str, Any]] = []
    for name, frame in sorted(content.tables.items(), key=lambda pair: pair[0] != "limits"):
        if name not in _CONTRACT and len(frame):
            found += limit_tables(frame) if name == "limits" else [frame_rows(name, frame)]
    return found


def navigation_rows(content: Content) -> list[dict[str, Any]]:
    """Return alignment, biases at the end, mounting and odometer scale of each run (Porter 1990, tables 4-1 to 4-5)."""
    rows = []
    for run in content.ids:
        ds = content.group(run, "navigation")
        if ds is not None:
            cells = [cell for entry in _NAVIGATION if entry[0] in ds for cell in _navigation_cells(ds, *entry)]
            method = ", ".join(str(ds.attrs[key]) for key in ("alignment_method", "error_model") if key in ds.attrs)
            rows.append({"run": run, "cells": cells, "method": method})
    return rows


def _navigation_cells(ds: xr.Dataset, name: str, title: str, unit: str, decimals: int, factor: float) -> list[tuple[str, str]]:
    """Return (title, value ± sigma) of the last epoch, one per axis where there are axes."""
    axes = ("right", "forward", "up") if "axis" in ds[name].dims else ("",)
    value = np.asarray(ds[name].values, float).reshape(-1, len(axes))[-1] * factor
    sigma = np.full(len(axes), np.nan)
    if f"{name}_sigma" in ds:
        sigma = np.asarray(ds[f"{name}_sigma"].values, float).reshape(-1, len(axes))[-1] * factor
    titles = [f"{title}, {axis}" if axis else title for axis in axes]
    return [(t, with_sigma(v, s, decimals, unit, sign=True)) for t, v, s in zip(titles, value, sigma, strict=True)]


def innovation_rows(content: Content) -> list[list[str]]:
    """Return for each run and kind of measurement: number, mean square of the scaled innovation, number down-weighted."""
    rows = []
    for run in content.ids:
        ds = content.group(run, "navigation")
        if ds is None or "innovation_count" not in ds or "kind" not in ds.variables:
            continue
        for i, kind in enumerate(ds["kind"].values):
            square = float(ds["innovation_square"].values[i]) if "innovation_square" in ds else np.nan
            outliers = str(int(ds["innovation_outliers"].values[i])) if "innovation_outliers" in ds else NOTHING
            rows.append([run, str(kind), str(int(ds["innovation_count"].values[i])), number(square, 2), outliers])
    return rows


def _cell(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return NOTHING if not np.isfinite(value) else f"{value:.4g}"
    return NOTHING if value is None or value is pd.NA else str(value)


def run_details(content: Content, name: str) -> dict[str, Any]:
    """Return every further attribute of a run, its groups, and its history."""
    run = content.run(name)
    attrs = [
        (str(k).replace("_", " "), ", ".join(_cell(x) for x in np.ravel(v))) for k, v in run.attrs.items() if k not in _INNER
    ]
    given: dict[str, Any] = next((r for r in content.survey.get("runs", []) if r.get("id") == name), {})
    groups = []
    for group, node in run.children.items():
        groups.append(f"{group} ({', '.join(f'{dim} {n}' for dim, n in node.to_dataset().sizes.items())})")
    return {
        "id": name,
        "attrs": attrs,
        "groups": ", ".join(groups),
        "repairs": [str(r) for r in given.get("repairs") or str(run.attrs.get("repairs", "")).splitlines()],
        "history": str(run.attrs.get("history", "")).splitlines(),
    }


def inputs(content: Content) -> list[tuple[str, str, str]]:
    """Return (run, file, SHA-256) of every input, as the survey or else the runs say."""
    given = {str(r.get("id")): r.get("inputs") or {} for r in content.survey.get("runs", [])}
    found = []
    for run in content.ids:
        lines = [line.split(maxsplit=1) for line in str(content.run(run).attrs.get("input_sha256", "")).splitlines()]
        files = given.get(run) or {pair[1]: pair[0] for pair in lines if len(pair) == 2}
        found += [(run, str(name), str(digest)) for name, digest in files.items()]
    return found


def flat(options: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return nested options as (dotted name, value)."""
    if not isinstance(options, dict):
        return [(prefix, str(options))]
    return [pair for key, value in options.items() for pair in flat(value, f"{prefix}.{key}" if prefix else str(key))]
