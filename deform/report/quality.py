"""The content of an output folder in, the numbers of the data-quality page out: marks, noise, warnings, options, hashes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.report.content import Content
from deform.report.context import NOTHING, number

_CONTRACT = ("zones", "dents", "trends", "joints", "welds")
_COMPONENTS = ("east", "north", "up")
_INNER = {"Conventions", "history", "schema_version", "id", "date", "line", "source", "direction"}
_STATUSES = ("matched", "shifted", "missed", "false", "added", "removed")


def quality(content: Content) -> dict[str, Any]:
    """Return marks, weld statistics, further tables, stages, warnings, what is missing, options, inputs and history."""
    survey = content.survey
    return {
        "markers": marker_rows(content),
        "welds": weld_counts(content),
        "tables": [frame_rows(name, frame) for name, frame in content.tables.items() if name not in _CONTRACT and len(frame)],
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
        "inputs": inputs(survey),
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
    """Return any table for people: its name, columns, rows of text, and whether it was cut."""
    shown = frame.head(most)
    rows = [[_cell(value) for value in row] for row in shown.itertuples(index=False)]
    return {
        "name": name,
        "columns": [str(c).replace("_", " ") for c in frame.columns],
        "rows": rows,
        "cut": len(frame) - len(shown),
    }


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
        "repairs": [str(r) for r in given.get("repairs", [])],
        "history": str(run.attrs.get("history", "")).splitlines(),
    }


def inputs(survey: dict) -> list[tuple[str, str, str]]:
    """Return (run, file, SHA-256) of every input."""
    runs = survey.get("runs", [])
    return [(str(r.get("id")), str(name), str(digest)) for r in runs for name, digest in (r.get("inputs") or {}).items()]


def flat(options: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return nested options as (dotted name, value)."""
    if not isinstance(options, dict):
        return [(prefix, str(options))]
    return [pair for key, value in options.items() for pair in flat(value, f"{prefix}.{key}" if prefix else str(key))]
