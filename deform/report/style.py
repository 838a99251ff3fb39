"""Typeface, colours and lines of every picture: colour-blind safe, told apart by line style in greyscale."""

from __future__ import annotations

from typing import Any

from matplotlib import font_manager
from matplotlib.colors import LinearSegmentedColormap

from deform.palette import DEPTH
from deform.report.templates import template_folder

INK = "#17191c"
QUIET = "#5b626c"
FAINT = "#d9dde2"
EPOCHS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f6000", "#5d3a9b")  # Okabe and Ito, two added
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)), (0, (3, 3)))
SYMBOLS = ("o", "s", "D", "^", "v", "P", "X", "*")
SEVERITY = {"high": "#b3261e", "medium": "#b35c00", "low": "#2b6c8f", "construction": "#6a717b"}
DEPTH_COLOURS = LinearSegmentedColormap.from_list("depth", [(place, [c / 255 for c in colour]) for place, colour in DEPTH])

MATPLOTLIB: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Inter", "DejaVu Sans"],
    "font.size": 8,
    "text.hinting": "none",  # the typeface has no hints of its own
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.6,
    "axes.labelcolor": QUIET,
    "axes.labelsize": 7.5,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "text.color": INK,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.2,
}


def epoch_style(i: int) -> dict:
    """Return colour and line style of the i-th epoch for matplotlib."""
    return {"color": EPOCHS[i % len(EPOCHS)], "linestyle": DASHES[i % len(DASHES)]}


def tint(severity: str) -> str:
    """Return the colour of a severity."""
    return SEVERITY.get(severity, SEVERITY["construction"])


def _register() -> None:
    """Make the typeface of page and print known to matplotlib."""
    for path in sorted((template_folder() / "fonts").glob("*.ttf")):
        font_manager.fontManager.addfont(path)


_register()
