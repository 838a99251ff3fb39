"""Sizes in inch in, a figure with axes at fixed places out: figures line up with each other, and no text has to be measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

LEFT, RIGHT, HEAD, FOOT, GAP = 0.74, 0.12, 0.30, 0.42, 0.16


def panels(
    heights: Sequence[float],
    width: float,
    *,
    columns: int = 1,
    left: float = LEFT,
    right: float = RIGHT,
    head: float = HEAD,
    foot: float = FOOT,
    gap: float = GAP,
    share: bool = True,
) -> tuple[Figure, list[Any]]:
    """Return a figure and its panels, row by row from the top.

    Parameters
    ----------
    heights : of the rows of panels.
    width : of the figure.
    columns : panels in a row, each with its own room for labels on the left.
    left, right, head, foot, gap : room for labels left and right of a panel, above all, below all, and between rows.
    share : one axis for all panels; only the lowest row carries its numbers.
    """
    total = head + sum(heights) + gap * (len(heights) - 1) + foot
    figure = Figure(figsize=(width, total))
    each = width / columns - left - right
    axes: list[Any] = []
    top = total - head
    for row, height in enumerate(heights):
        for column in range(columns):
            place = ((column * (each + left + right) + left) / width, (top - height) / total, each / width, height / total)
            ax = figure.add_axes(place, sharex=axes[0] if share and axes else None)
            if share and row < len(heights) - 1:
                ax.tick_params(labelbottom=False)
            axes.append(ax)
        top -= height + gap
    return figure, axes


def label(ax: Any, text: str, room: float = 0.44) -> None:
    """Name the axis to the left of a panel, at one distance for all panels."""
    width = ax.get_position().width * ax.figure.get_figwidth()
    ax.set_ylabel(text)
    ax.yaxis.set_label_coords(-room / width, 0.5)


def legend(figure: Figure, ax: Any, *, left: float = LEFT, columns: int = 4) -> None:
    """Put the legend of a panel above all panels, on the left."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, ncols=columns, loc="upper left", bbox_to_anchor=(left / figure.get_figwidth(), 1.0),
                      borderaxespad=0.2, borderpad=0.1, handlelength=2.4)  # fmt: skip
