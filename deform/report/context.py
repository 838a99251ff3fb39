"""The content of an output folder in, everything that the templates show out, as text; templates do no arithmetic."""

from __future__ import annotations

import datetime
from typing import Any

from deform.options import ReportOptions
from deform.report.alignment import alignment_tables
from deform.report.content import Content
from deform.report.dents import dent_rows
from deform.report.features import feature_rows
from deform.report.findings import facts, verdict, what_is_missing
from deform.report.quantities import measure
from deform.report.runs import run_reports, run_rows
from deform.report.sparkline import sparkline
from deform.report.trend_view import trend_dataset
from deform.report.trends import trend_rows
from deform.report.zones import zone_rows
from deform.run.history import toolkit_version


def build_context(content: Content, options: ReportOptions) -> dict[str, Any]:
    """Return what page, PDF, workbook and map show: one set of numbers, rounded by `quantities` alone."""
    zones = [zone | {"spark": sparkline(trend_dataset(content, zone["id"]))} for zone in zone_rows(content, options)]
    dents = dent_rows(content)
    alone = len(content.runs) == 1
    return {
        "title": options.title or f"{content.line}: {'inspection' if alone else 'deformation'} report",
        "line": content.line,
        "subject": "Inspection report" if alone else "Deformation report",
        "made": made(),
        "version": str(content.survey.get("deform_version") or toolkit_version()),
        "reference": content.reference,
        "metadata": _metadata(content),
        "verdict": verdict(content, zones, dents),
        "limits_of_sources": what_is_missing(content),
        "facts": facts(content, zones, dents),
        "runs": run_rows(content),
        "run_reports": run_reports(content),
        "alignment": alignment_tables(content),
        "zones": zones,
        "dents": dents,
        "trends": trend_rows(content),
        "features": feature_rows(content),
        "limit_names": _limit_names(content),
        "compared": content.compares_movement,
        "options": options,
        "strain_attention": measure("strain", options.strain_attention),
        "displacement_attention": measure("displacement", options.displacement_attention_m),
    }


def _limit_names(content: Content) -> list[str]:
    """Return the limits of the trends, those on one basis together: ``displacement, dent depth (chosen by the reader)``."""
    bases: dict[str, list[str]] = {}
    for name in dict.fromkeys(n for n in content.tables["trends"].limit_name if n):
        limit, _, basis = name.partition(" (")
        bases.setdefault(basis, []).append(limit)
    return [", ".join(limits) + (f" ({basis}" if basis else "") for basis, limits in bases.items()]


def made() -> str:
    """Return the time at which a report is made."""
    return datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")


def _metadata(content: Content) -> list[tuple[str, str]]:
    """Return the lines of a report's head: runs, reference, pipe, length."""
    rows = run_rows(content)
    reference = next(row for row in rows if row["is_reference"])
    dates = list(dict.fromkeys(row["date"] for row in (rows[0], rows[-1]) if row["date"]))
    sources = list(dict.fromkeys(row["source"] for row in rows if row["source"]))
    found = [
        ("Line", content.line),
        ("Runs", f"{len(rows)}, {' to '.join(dates)}" if dates else str(len(rows))),
        ("Source", ", ".join(sources)),
        ("Reference", content.reference if len(rows) > 1 else ""),
        ("Length", str(reference["length"]) if reference["length"] else ""),
        ("Pipe", _pipe(content)),
    ]
    return [(name, text) for name, text in found if text]


def _pipe(content: Content) -> str:
    diameter = measure("diameter", content.outside_diameter)
    walls = [row["wall"] for row in run_rows(content) if row["wall"]]
    parts = [f"OD {diameter}" if diameter else "", f"wall {walls[0]}" if walls else ""]
    return ", ".join(part for part in parts if part)
