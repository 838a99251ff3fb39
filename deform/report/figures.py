"""One dataset in, one matplotlib figure out: the pictures of the page, the PDF and of notebooks alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.palette import DEPTH_LEAST
from deform.report.style import DEPTH_COLOURS, FAINT, INK, MATPLOTLIB, QUIET, epoch_style
from deform.units import clock_text

_WIDTH, _HEIGHT = 9.2, 4.95
_DEPTH_IMAGE = {"cmap": DEPTH_COLOURS, "interpolation": "bilinear"}


def dent_card(window: xr.Dataset) -> Figure:
    """Return the picture of one dent: unrolled wall of every epoch, profiles through the apex, cross-section.

    Parameters
    ----------
    window : ``depth(run, distance, clock)`` in metre, positive inward, from `dent_views.dent_dataset`.
    """
    n = window.sizes["run"]
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDTH, _HEIGHT))
        each = (_WIDTH - 1.9) / n
        maps = [_place(figure, 0.7 + i * each, 3.4, each - 0.12, 1.3) for i in range(n)]
        _unrolled(figure, maps, _place(figure, _WIDTH - 0.95, 3.4, 0.1, 1.3), window)
        _profile_along(_place(figure, 0.7, 0.55, 2.45, 1.75), window)
        _profile_around(_place(figure, 3.85, 0.55, 2.45, 1.75), window)
        _section(_place(figure, 6.75, 0.3, 2.0, 2.0, projection="polar"), window)
    return figure


def _place(figure: Figure, left: float, low: float, wide: float, high: float, projection: str | None = None) -> Any:
    """Return axes at a place in inch."""
    size = figure.get_size_inches()
    return figure.add_axes((left / size[0], low / size[1], wide / size[0], high / size[1]), projection=projection)


def _unrolled(figure: Figure, axes: list, bar_axes: Any, window: xr.Dataset) -> None:
    """Draw depth over distance and clock; the clock axis is cut opposite to the dent."""
    at = _apex_clock(window)
    clock = (window["clock"].values - at + 180) % 360 - 180
    order = np.argsort(clock)
    depth = window["depth"].values[:, :, order] * 1000
    top = float(np.nanmax(np.abs(depth))) if np.isfinite(depth).any() else 1.0
    distance = window["distance"].values
    extent = (distance[0] * 1000, distance[-1] * 1000, clock[order][-1], clock[order][0])
    lines = [share * top for share in (0.1, 0.25, 0.5, 0.75)]
    picture = None
    for i, (ax, name) in enumerate(zip(axes, window["run"].values, strict=True)):
        picture = ax.imshow(depth[i].T, extent=extent, aspect="auto", vmin=DEPTH_LEAST * top, vmax=top, **_DEPTH_IMAGE)
        ax.contour(distance * 1000, clock[order], np.nan_to_num(depth[i].T), levels=lines, colors=QUIET, linewidths=0.5)
        ax.grid(visible=False)
        ax.set_title(f"{name}, {window['date'].values[i]}" if "date" in window else str(name))
        ticks = _whole_hours(at)
        ax.set_yticks(ticks, [clock_text(at + t) for t in ticks] if i == 0 else [""] * ticks.size)
        ax.set_ylim(min(150, extent[2]), max(-150, extent[3]))
        ax.set_xlabel("along the pipe (mm), + = downstream")
    axes[0].set_ylabel("clock (h:mm)")
    if picture is not None:
        bar = figure.colorbar(picture, cax=bar_axes, label="depth (mm), + = inward")
        for line in lines:
            bar.ax.axhline(line, color=QUIET, linewidth=0.5)


def _profile_along(ax, window: xr.Dataset) -> None:
    i = _nearest_clock(window)
    for k, name in enumerate(window["run"].values):
        ax.plot(
            window["distance"].values * 1000,
            -window["depth"].values[k][:, i] * 1000,
            label=str(name),
            **epoch_style(_epoch_index(window, k)),
        )
    ax.set(title="Profile along", xlabel="along the pipe (mm), + = downstream", ylabel="wall (mm), + = outward")
    ax.legend(fontsize=7)


def _profile_around(ax, window: xr.Dataset) -> None:
    j, at = _apex_scan(window), _apex_clock(window)
    clock = (window["clock"].values - at + 180) % 360 - 180
    order = np.argsort(clock)
    for k in range(window.sizes["run"]):
        ax.plot(clock[order], -window["depth"].values[k][j][order] * 1000, **epoch_style(_epoch_index(window, k)))
    ticks = _whole_hours(at)
    ax.set_xticks(ticks, [clock_text(at + t) for t in ticks], rotation=45)
    ax.set(title="Profile around", xlabel="clock (h:mm)", ylabel="wall (mm), + = outward")


def _section(ax, window: xr.Dataset) -> None:
    """Draw the ideal circle and the residuals of several sections, scaled so that the deepest takes a third of the radius."""
    depth, radius = window["depth"].values, window.attrs["radius_m"]
    deepest = float(np.nanmax(np.abs(depth))) if np.isfinite(depth).any() else radius
    scale = max(1.0, round(radius / 3 / max(deepest, 1e-6)))
    theta = np.radians(np.append(window["clock"].values, window["clock"].values[0] + 360))
    j, n = _apex_scan(window), window.sizes["distance"]
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.plot(np.linspace(0, 2 * np.pi, 181), np.full(181, radius), color=INK, linewidth=0.8, linestyle=":")
    for near in range(max(j - 8, 0), min(j + 9, n), 2):
        row = radius - scale * depth[-1][near]
        ax.plot(theta, np.append(row, row[0]), color=FAINT, linewidth=0.5)
    for k in range(window.sizes["run"]):
        row = radius - scale * depth[k][j]
        ax.plot(theta, np.append(row, row[0]), **epoch_style(_epoch_index(window, k)))
    ax.set_xticks(np.radians(np.arange(0, 360, 90)), ["12:00", "3:00", "6:00", "9:00"])
    ax.set_yticks([])
    ax.set_ylim(0, radius * 1.15)
    ax.set_title(f"Section at the apex, residuals × {scale:.0f}", loc="center", pad=12)


def _whole_hours(at: float) -> np.ndarray:
    """Return the offsets (degree, within a half turn) from a clock angle at which every second hour stands."""
    hours = np.arange(-360, 721, 60) - at
    return np.sort(hours[(hours > -170) & (hours < 170)])


def _apex_clock(window: xr.Dataset) -> float:
    given = float(window.attrs.get("clock_deg", np.nan))
    if np.isfinite(given):
        return given
    deepest = int(np.argmax(np.nan_to_num(window["depth"].values[-1])))
    return float(window["clock"].values[deepest % window.sizes["clock"]])


def _epoch_index(window: xr.Dataset, k: int) -> int:
    return int(window["epoch"].values[k]) if "epoch" in window else k


def _nearest_clock(window: xr.Dataset) -> int:
    return int(np.argmin(np.abs((window["clock"].values - _apex_clock(window) + 180) % 360 - 180)))


def _apex_scan(window: xr.Dataset) -> int:
    column = np.nan_to_num(window["depth"].values[-1][:, _nearest_clock(window)])
    near = np.abs(window["distance"].values) < 0.15
    return int(np.argmax(np.where(near, column, -np.inf))) if near.any() else column.size // 2
