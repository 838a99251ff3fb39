"""A matplotlib figure in, an inline SVG out whose ink follows the page (light or dark), or a PNG."""

from __future__ import annotations

import io
import re

from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.report.style import EPOCHS, FAINT, INK

_REPLACED = {INK: "currentColor", FAINT: "var(--grid)"} | {colour: f"var(--epoch-{i})" for i, colour in enumerate(EPOCHS)}


def themed_svg(figure: Figure) -> Markup:
    """Return the figure as inline SVG; ink, grid and epoch colours become variables of the page's style sheet."""
    out = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "deform"}):
        figure.savefig(out, format="svg", transparent=True, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'<g id="[^"]*">', "<g>", text)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    for colour, word in _REPLACED.items():
        text = text.replace(colour, word)
    return Markup(text)  # matplotlib escapes the texts of a figure


def png(figure: Figure, dpi: int = 110) -> bytes:
    """Return the figure as PNG."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dpi)
    return out.getvalue()
