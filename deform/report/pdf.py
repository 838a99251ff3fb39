"""The content of an output folder in, a printed report out: cover, contents, page numbers, figures that stand in greyscale."""

from __future__ import annotations

import base64
import logging
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from deform.errors import MissingExtraError
from deform.options import ReportOptions
from deform.report import figures, line_figures
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.dent_views import dent_dataset
from deform.report.interactive import weld_table
from deform.report.line_view import cut, line_dataset, trend_dataset
from deform.report.quality import quality
from deform.report.svg import png
from deform.report.templates import render
from deform.run import store

_log = logging.getLogger(__name__)
_OVERVIEW = [("height", "height (m)", 1.0), ("bending_strain", "bending strain\ntotal (µε)", 1e6)]
_CHANGES = [
    ("bending_strain_change_horizontal", "strain change (µε)\n+ = to the right", 1e6),
    ("bending_strain_change_vertical", "strain change (µε)\n+ = sag", 1e6),
    ("displacement_lateral", "lateral (m)\n+ = right", 1.0),
    ("displacement_up", "vertical (m)\n+ = up", 1.0),
]
_MOST_WELD_ROWS = 400
_DPI = 150
_ZONE_MARGIN_M = 60.0


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``report/report.pdf`` and return its path.

    Raises
    ------
    MissingExtraError
        When weasyprint, or the system's pango that it needs, is not installed.
    """
    try:
        from weasyprint import HTML  # imported when called: it loads the system's pango
    except (ImportError, OSError) as fault:
        _log.warning("weasyprint cannot be loaded: %s", fault)
        raise MissingExtraError(
            "the PDF report (it needs libpango-1.0-0 and libpangoft2-1.0-0 of the system as well)", "pdf"
        ) from None
    page = render("pdf.html", **pdf_context(content, options))
    path = content.folder / "report" / "report.pdf"
    with store.atomic(path) as place:
        HTML(string=page).write_pdf(place)
    return path


def pdf_context(content: Content, options: ReportOptions) -> dict[str, Any]:
    """Return what the printed report shows: the numbers of the page, and its pictures as data addresses."""
    numbers = build_context(content, options)
    ds = line_dataset(content)
    moved = [z for z in numbers["zones"] if z["kind"] != "reconfiguration"]
    cards = []
    for dent in numbers["dents"][: options.most_dent_cards]:
        window = dent_dataset(content, dent)
        if window is not None or len(dent["epochs"]) > 1:
            cards.append({"dent": dent, "picture": None if window is None else picture(figures.dent_card(window))})
    limit_picture, held = _limit_picture(content), quality(content)
    if limit_picture is not None:  # the picture says it; the rows are in the page and the workbook
        held["tables"] = [table for table in held["tables"] if table["name"] != "limits"]
    welds = weld_table(content)
    odd = [row for row in welds["rows"] if any(word not in ("matched", "shifted") for word in row[3:-2:2])]
    return numbers | {
        "cards": cards,
        "more_dents": max(len(numbers["dents"]) - options.most_dent_cards, 0),
        "quality": held,
        "overview": [] if ds is None else _overview(ds, numbers["zones"], content),
        "zone_pictures": [] if ds is None else _zone_pictures(ds, moved[: options.most_zone_details]),
        "trend_pictures": _trend_pictures(content),
        "limit_picture": limit_picture,
        "navigation_pictures": [] if ds is None else _navigation_pictures(ds, content),
        "weld_runs": welds["runs"],
        "weld_rows": odd[:_MOST_WELD_ROWS],
        "weld_count": len(welds["rows"]),
        "weld_cut": max(len(odd) - _MOST_WELD_ROWS, 0),
    }


def picture(figure: Figure) -> str:
    """Return a figure as a data address.

    A PNG of print quality: weasyprint draws an SVG of a few thousand points ten times slower.
    """
    return "data:image/png;base64," + base64.b64encode(png(figure, _DPI)).decode("ascii")


def _overview(ds: Any, zones: list[dict], content: Content) -> list[tuple[str, str]]:
    pictures = [("Plan of the reference run with its zones.", picture(line_figures.plan(ds, zones)))] if "along" in ds else []
    if any(name in ds for name, *_ in _OVERVIEW):
        text = "Profile and total bending strain of every run; peaks are kept."
        pictures.append((text, picture(line_figures.strips(ds, _OVERVIEW, zones))))
    if any(name in ds for name, *_ in _CHANGES):
        k = float(content.survey.get("options", {}).get("change", {}).get("k_sigma", 3.0))
        text = (
            f"Change of bending strain and displacement against {content.reference}; grey: within {k:g} sigma of none (last run)."
        )
        pictures.append((text, picture(line_figures.strips(ds, _CHANGES, zones, k))))
    return pictures


def _zone_pictures(ds: Any, zones: list[dict]) -> list[dict[str, Any]]:
    found = []
    for zone in zones:
        part = cut(ds, zone["start"], zone["end"], _ZONE_MARGIN_M)
        if part.sizes["chainage"] < 2:
            continue
        shown = [picture(line_figures.zone_detail(part))] if "displacement_lateral" in part else []
        bent = [component for component in ("vertical", "horizontal") if f"curvature_{component}" in part]
        shown += [picture(line_figures.curvature_comparison(part, *bent))] if bent else []
        found.append({"zone": zone, "pictures": shown})
    return found


def _trend_pictures(content: Content) -> list[str]:
    subjects = list(dict.fromkeys(content.tables["trends"].subject))[:12]
    found = [trend_dataset(content, subject) for subject in subjects]
    return [picture(line_figures.trend(ds)) for ds in found if ds is not None]


def _limit_picture(content: Content) -> str | None:
    figure = line_figures.detection_limits(content.tables["limits"]) if "limits" in content.tables else None
    return None if figure is None else picture(figure)


def _navigation_pictures(ds: Any, content: Content) -> list[tuple[str, str]]:
    runs = [run for run in content.ids if (line := content.group(run, "centreline")) is not None and "pitch" in line]
    return [(run, picture(line_figures.navigation_panel(ds, run))) for run in runs]
