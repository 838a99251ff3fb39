"""The content of an output folder in, one self-contained page out, with no resource outside itself."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from deform.options import ReportOptions
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.dent_views import dent_views
from deform.report.interactive import page_data
from deform.report.quality import quality
from deform.report.templates import render, script_json
from deform.run import store


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``report/index.html`` and return its path."""
    numbers = build_context(content, options)
    data = page_data(content, options, numbers["zones"], numbers["dents"])
    cards, surfaces = dent_views(content, numbers["dents"][: options.most_dent_cards])
    page = render(
        "index.html",
        **numbers,
        cards=cards,
        more_dents=max(len(numbers["dents"]) - options.most_dent_cards, 0),
        quality=quality(content),
        data=script_json(data | {"surfaces": surfaces, "features": numbers["features"]["rows"]}),
        plotly=plotly_script(),
    )
    path = content.folder / "report" / "index.html"
    with store.atomic(path) as place:
        place.write_text(page, encoding="utf-8")
    return path


def plotly_script() -> Markup:
    """Return plotly's own bundle as shipped with the Python package, for embedding once."""
    from plotly.offline import get_plotlyjs  # imported when called: half a second

    return Markup(get_plotlyjs())  # a library's file, embedded as it is
