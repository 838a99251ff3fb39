"""The colours and lines of every picture: colour-blind safe (Okabe and Ito), and told apart by line style in greyscale."""

from __future__ import annotations

from typing import Any

INK = "#111213"
FAINT = "#c9cacb"
EPOCHS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f6000", "#5d3a9b")
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)), (0, (3, 3)))
DEPTH_COLOURS = "cividis_r"

MATPLOTLIB: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.unicode_minus": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "figure.constrained_layout.use": True,
}


def epoch_style(i: int) -> dict:
    """Return colour and line style of the i-th epoch for matplotlib."""
    return {"color": EPOCHS[i % len(EPOCHS)], "linestyle": DASHES[i % len(DASHES)]}
