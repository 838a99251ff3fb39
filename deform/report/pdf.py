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
from deform.report.findings import joined_welds
from deform.report.gallery import Given, drawn
from deform.report.quality import quality
from deform.report.svg import literal, png
from deform.report.templates import render, template_folder
from deform.report.welds import odd_rows, weld_table
from deform.run import store

_log = logging.getLogger(__name__)
_MOST_WELD_ROWS = 400
_DPI = 170


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
        HTML(string=page, base_url=str(template_folder())).write_pdf(place)
    return path


def pdf_context(content: Content, options: ReportOptions) -> dict[str, Any]:
    """Return what the printed report shows: the numbers of the page, and its pictures as data addresses."""
    numbers = build_context(content, options)
    given = Given(content, numbers["zones"], numbers["dents"], options.most_zone_details)
    cards = []
    for dent in numbers["dents"][: options.most_dent_cards]:
        window = dent_dataset(content, dent)
        if window is not None or len(dent["epochs"]) > 1:
            cards.append({"dent": dent, "picture": None if window is None else picture(figures.dent_card(window))})
    welds = weld_table(content)
    odd = odd_rows(welds)
    return numbers | {
        "zones": [zone | {"spark": literal(zone["spark"])} for zone in numbers["zones"]],
        "strips": [("wide", picture(line_figures.line_strip(given.line, "print")))],
        "pictures": drawn(given, picture, "print"),
        "cards": cards,
        "more_dents": max(len(numbers["dents"]) - options.most_dent_cards, 0),
        "quality": quality(content),
        "weld_runs": welds["runs"],
        "weld_rows": odd[:_MOST_WELD_ROWS],
        "weld_count": joined_welds(content)[1],
        "weld_cut": max(len(odd) - _MOST_WELD_ROWS, 0),
        "printed": True,
    }


def picture(figure: Figure, _: str = "") -> str:
    """Return a figure as a data address.

    A PNG of print quality: weasyprint draws an SVG of a few thousand points ten times slower.
    """
    return "data:image/png;base64," + base64.b64encode(png(figure, _DPI)).decode("ascii")
