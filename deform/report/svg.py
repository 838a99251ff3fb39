"""A matplotlib figure in, an inline SVG out whose ink follows the page (light or dark), or a PNG."""

from __future__ import annotations

import io
import re

from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.report.style import EPOCHS, FAINT, INK, MATPLOTLIB, QUIET, SEVERITY

_REPLACED = {INK: "currentColor", FAINT: "var(--grid)", QUIET: "var(--quiet)"}
_REPLACED |= {colour: f"var(--epoch-{i})" for i, colour in enumerate(EPOCHS)}
_REPLACED |= {colour: f"var(--{word})" for word, colour in SEVERITY.items()}
_PX_PER_PT = 1.6
_NAMELESS = dict.fromkeys(("Date", "Creator", "Format", "Type"))


def themed_svg(figure: Figure, label: str = "") -> Markup:
    """Return the figure as inline SVG; its colours become variables of the page's style sheet, ``label`` its words for those
    who cannot see it.
    """
    out = io.StringIO()
    with rc_context(MATPLOTLIB | {"svg.fonttype": "none", "svg.hashsalt": "deform"}):
        figure.savefig(out, format="svg", transparent=True, metadata=_NAMELESS)
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'<g id="[^"]*">', "<g>", text)
    widest = _PX_PER_PT * 72 * figure.get_size_inches()[0]  # so that the letters of all figures are of one size
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', rf'\1 style="max-width: {widest:.0f}px"', text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r"<[^>]*>", _rounded, text)
    for colour, word in _REPLACED.items():
        text = text.replace(colour, word)
    said = f' role="img" aria-label="{escape(label)}"' if label else ' aria-hidden="true"'
    return Markup(text.replace("<svg", f"<svg{said}", 1))  # matplotlib escapes the texts of a figure


def _rounded(tag: re.Match[str]) -> str:
    """Return a tag with its coordinates cut to a hundredth of a point, finer than any screen; texts are no tags."""
    return re.sub(r"(\d+\.\d\d)\d+", r"\1", tag.group())


def literal(picture: Markup) -> Markup:
    """Return an inline SVG with the colours themselves in place of the variables of the page: for print."""
    known = {word: colour for colour, word in _REPLACED.items()} | {"var(--line)": FAINT, "currentColor": INK}
    text = str(picture)
    for word, colour in known.items():
        text = text.replace(word, colour)
    return Markup(text)  # as safe as it came


def png(figure: Figure, dpi: int = 110) -> bytes:
    """Return the figure as PNG."""
    out = io.BytesIO()
    with rc_context(MATPLOTLIB):
        figure.savefig(out, format="png", dpi=dpi, pil_kwargs={"compress_level": 1})  # weasyprint packs it anew
    return out.getvalue()
