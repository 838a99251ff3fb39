"""The content of an output folder in, the data-quality page out: sensors, marks, noise, limits, warnings, options, hashes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import TABLES, Content
from deform.report.limits import detection_rows, floor_rows
from deform.report.quantities import measure
from deform.report.words import NOTHING, number, percent

_COMPONENTS = ("east", "north", "up")
_INNER = {"Conventions", "history", "schema_version", "id", "date", "line", "source", "direction", "input_sha256", "repairs"}
_STATUSES = ("matched", "shifted", "missed", "false", "added", "removed")
_SHOWN_ELSEWHERE = {*TABLES, "limits", "doglegs"}
_STILL_M_S = 0.02
_METRES = re.compile("_m(:|$)")  # also of a column that one run has
_SHORT_M = 10.0


def quality(content: Content) -> dict[str, Any]:
    """Return sensors, marks, weld statistics, noise, limits, stages, warnings, what is missing, options, inputs and history."""
    survey = content.survey
    return {
        "sensors": sensor_rows(content),
        "markers": marker_rows(content),
        "welds": weld_counts(content),
        "innovations": innovation_rows(content),
        "floors": floor_rows(content),
        "limits": detection_rows(content),
        "tables": further_tables(content),
        "runs": [run_details(content, run) for run in content.ids],
        "stages": [
            {
                "name": str(stage.get("name", "")),
                "seconds": measure("seconds", stage.get("seconds")),
                "memory": measure("memory", stage.get("peak_memory_mb")),
                "status": str(stage.get("status", "")),
            }
            for stage in survey.get("stages", [])
        ],
        "warnings": [{key: str(w.get(key, "")) for key in ("stage", "message")} for w in survey.get("warnings", [])],
        "missing": [(m.get("output", ""), m.get("reason", "")) for m in survey.get("missing", [])] + list(content.absent),
        "options": flat(survey.get("options", {})),
        "inputs": inputs(content),
    }


def sensor_rows(content: Content) -> list[dict[str, Any]]:
    """Return for each run what its sensors gave: span of the data, stops, position sigma, caliper share, remarks, repairs."""
    rows = []
    for run in content.ids:
        ds = content.group(run, "centreline")
        entries = _of_centreline(ds) if ds is not None else [("centreline", "none: no position, attitude, curvature or strain")]
        navigation = content.group(run, "navigation")
        said = [] if navigation is None else str(navigation.attrs.get("remarks", "")).splitlines()
        repairs = run_details(content, run)["repairs"]
        entries.append(("slips, gaps and losses", "; ".join([*said, *repairs]) or "none recorded"))
        rows.append({"run": run, "entries": entries})
    return rows


def _of_centreline(ds: xr.Dataset) -> list[tuple[str, str]]:
    entries = []
    if "time" in ds:
        time = ds["time"].values
        entries.append(("time in the pipe", f"{number((np.nanmax(time) - np.nanmin(time)) / 3600, 2)}\u00a0h"))
    if "speed" in ds:
        speed = ds["speed"].values
        speed = speed[np.isfinite(speed)]
        if speed.size:
            low, middle, high = np.percentile(speed, [1, 50, 99])
            entries.append(("speed, 1 / 50 / 99 %", f"{number(low)} / {number(middle)} / {number(high)}\u00a0m/s"))
            entries.append(("pipe passed almost at rest", f"{percent(float((np.abs(speed) < _STILL_M_S).mean()))} of its length"))
    sigmas = [ds[f"{axis}_sigma"].values for axis in _COMPONENTS if f"{axis}_sigma" in ds]
    if sigmas:
        for word, pick in (("median", np.nanmedian), ("largest", np.nanmax)):
            shown = " / ".join(measure("position sigma", pick(values)).number for values in sigmas)
            entries.append((f"sigma of position, {word}", f"{shown}\u00a0m (east / north / up)"))
    if "ovality" in ds:
        entries.append(("pipe with caliper sections", percent(float(np.isfinite(ds["ovality"].values).mean()))))
    else:
        entries.append(("pipe with caliper sections", "no caliper"))
    if "bending_strain_horizontal_sigma" in ds:
        sigma = np.nanmedian(ds["bending_strain_horizontal_sigma"].values)
        gauge = ds["curvature_horizontal"].attrs.get("gauge_length_m") if "curvature_horizontal" in ds else None
        over = f" over a gauge of {gauge:g} m" if gauge else ""
        entries.append(("sigma of the bending strain, median", f"{measure('strain', sigma)}{over}"))
    return entries


def marker_rows(content: Content) -> list[dict[str, Any]]:
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
            text = {"run": name, "chainage": measure("place", row["chainage"]), "before": before, "after": after, "used": used}
            rows.append(text | {key: str(row[key] or "") for key in ("name", "kind", "remark")})
    return rows


def _misclosure(ds: xr.Dataset, i: int, word: str) -> list[Any]:
    names = [f"misclosure_{component}_{word}" for component in _COMPONENTS]
    return [measure("misclosure", ds[name].values[i] if name in ds else None) for name in names]


def weld_counts(content: Content) -> list[dict[str, Any]]:
    """Return for each run how many welds have which status."""
    rows = []
    for run, statuses in content.tables["welds"].groupby("run", sort=False).status:
        counts = statuses.value_counts()
        rows.append({"run": run, "counts": [(word, number(counts.get(word, 0), 0)) for word in _STATUSES]})
    return rows


def further_tables(content: Content) -> list[dict[str, Any]]:
    """Return every table that lies beside those of the contract and has no place of its own."""
    return [frame_rows(name, frame) for name, frame in content.tables.items() if name not in _SHOWN_ELSEWHERE and len(frame)]


def frame_rows(name: str, frame: pd.DataFrame, most: int = 400) -> dict[str, Any]:
    """Return any table for people: its title, columns, rows of text, and how many rows were cut."""
    shown = frame.dropna(axis=1, how="all").head(most)
    places = [_holds_places(str(column), shown[column]) for column in shown.columns]
    rows = [[_cell(*pair) for pair in zip(row, places, strict=True)] for row in shown.itertuples(index=False)]
    columns = [str(column).replace("_", " ") for column in shown.columns]
    return {"name": name, "title": name.capitalize(), "columns": columns, "rows": rows, "cut": len(frame) - len(shown)}


def innovation_rows(content: Content) -> dict[str, Any]:
    """Return for each kind of measurement and run: mean square of the scaled innovation, number, number down-weighted."""
    runs, cells = [], {}
    for run in content.ids:
        ds = content.group(run, "navigation")
        if ds is None or "innovation_count" not in ds or "kind" not in ds.variables:
            continue
        runs.append(run)
        for i, kind in enumerate(ds["kind"].values):
            square = float(ds["innovation_square"].values[i]) if "innovation_square" in ds else np.nan
            outliers = number(ds["innovation_outliers"].values[i], 0) if "innovation_outliers" in ds else NOTHING
            cells[str(kind), run] = (number(square, 2), number(ds["innovation_count"].values[i], 0), outliers)
    kinds = list(dict.fromkeys(kind for kind, _ in cells))
    return {"runs": runs, "rows": [(kind, [cells.get((kind, run), (NOTHING, "", "")) for run in runs]) for kind in kinds]}


def _holds_places(name: str, values: Any) -> bool:
    """Return whether these are metres along a line, which want centimetres however many they are; a sigma wants its digits."""
    sizes = np.abs(np.asarray(pd.to_numeric(pd.Series(np.ravel(values)), errors="coerce"), float))
    return bool(_METRES.search(name)) and bool((sizes >= _SHORT_M).any())


def _cell(value: Any, place: bool = False) -> str:
    if isinstance(value, float | np.floating):
        if place or not np.isfinite(value):
            return number(value)
        return f"{value:.4g}" if abs(float(value)) < 1e4 else number(value, 0)
    return NOTHING if value is None or value is pd.NA else str(value)


def run_details(content: Content, name: str) -> dict[str, Any]:
    """Return every further attribute of a run, its groups, its repairs and its history."""
    run = content.run(name)
    attrs = [
        (str(k).replace("_", " "), ", ".join(_cell(x, _holds_places(str(k), v)) for x in np.ravel(v)))
        for k, v in run.attrs.items()
        if k not in _INNER
    ]
    given: dict[str, Any] = next((r for r in content.survey.get("runs", []) if r.get("id") == name), {})
    groups = []
    for group, node in run.children.items():
        groups.append(f"{group} ({', '.join(f'{dim} {number(n, 0)}' for dim, n in node.to_dataset().sizes.items())})")
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
