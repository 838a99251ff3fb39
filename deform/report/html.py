"""The content of an output folder in, one self-contained page out, with no resource outside itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from deform.options import ReportOptions
from deform.report import line_figures
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.dent_views import dent_views
from deform.report.gallery import Given, drawn
from deform.report.interactive import page_data
from deform.report.quality import quality
from deform.report.svg import themed_svg
from deform.report.templates import render, script_json
from deform.run import store


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``report/index.html`` and return its path."""
    path = content.folder / "report" / "index.html"
    with store.atomic(path) as place:
        place.write_text(render("index.html", **page_context(content, options)), encoding="utf-8")
    return path


def page_context(content: Content, options: ReportOptions) -> dict[str, Any]:
    """Return what the page shows: the numbers, its pictures as inline SVG, and the data of its script."""
    numbers = build_context(content, options)
    given = Given(content, numbers["zones"], numbers["dents"], options.most_zone_details)
    data = page_data(content, options, numbers["zones"], numbers["dents"])
    cards, surfaces = dent_views(content, numbers["dents"][: options.most_dent_cards])
    return numbers | {
        "strips": strips(given),
        "pictures": drawn(given, themed_svg, "page"),
        "cards": cards,
        "more_dents": max(len(numbers["dents"]) - options.most_dent_cards, 0),
        "quality": quality(content),
        "data": script_json(data | {"surfaces": surfaces, "features": numbers["features"]["rows"]}),
        "plotly": plotly_script(),
        "printed": False,
    }


def strips(given: Given) -> list[tuple[str, Markup]]:
    """Return the strip of the whole line for a wide and for a narrow screen, as (class, inline SVG)."""
    label = "The line with its zones, and the size of the changes along it"
    figures: list[tuple[str, Figure]] = [
        ("wide", line_figures.line_strip(given.line)),
        ("narrow", line_figures.line_strip(given.line, "narrow")),
    ]
    return [(name, themed_svg(figure, label)) for name, figure in figures]


def plotly_script() -> Markup:
    """Return plotly's own bundle as shipped with the Python package, for embedding once."""
    from plotly.offline import get_plotlyjs  # imported when called: half a second

    return Markup(get_plotlyjs())  # a library's file, embedded as it is
