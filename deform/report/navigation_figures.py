"""One dataset of a run's navigation in, one figure out: raw sensors, rest, residuals at marks, innovations, biases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.report.layout import label, legend, panels
from deform.report.style import FAINT, INK, MATPLOTLIB, QUIET, SYMBOLS, epoch_style

_WIDE, _ROW, _HEAD = 7.2, 0.95, 0.42
_TIME = "time on the tool's clock (s)"
_DIRECTIONS = ("east", "north", "up")


def raw_panel(ds: xr.Dataset) -> Figure:
    """Return rates, specific forces and wheel speed as recorded, from `nav.raw_view.raw_dataset` (Porter 1990, Fig. 4-4)."""
    rows = [(ds["gyro_rate"].values[:, i], f"gyro {axis}\n(°/s)") for i, axis in enumerate(ds["axis"].values)]
    rows += [(ds["specific_force"].values[:, i], f"force {axis}\n(m/s²)") for i, axis in enumerate(ds["axis"].values)]
    rows.append((ds["wheel_speed"].values, "wheels\n(m/s)"))
    with rc_context(MATPLOTLIB):
        figure, axes = panels([0.62] * len(rows), _WIDE, head=0.3, gap=0.12)
        for ax, (values, text) in zip(axes, rows, strict=True):
            ax.plot(ds["time"].values, values, color=INK, linewidth=0.4)
            label(ax, text)
        axes[0].set_title(f"{ds.attrs['run']}: least and largest sample of each stretch", pad=3)
        axes[-1].set_xlabel(_TIME)
    return figure


def rest_errors(ds: xr.Dataset) -> Figure:
    """Return velocity and position of a tool at rest by free navigation, from `nav.raw_view.rest_dataset` (Fig. 4-1 to 4-3)."""
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.3, 1.3], _WIDE, head=_HEAD)
        for ax, name, text in zip(
            axes, ("velocity_error", "position_error"), ("velocity error\n(m/s)", "position error\n(m)"), strict=True
        ):
            for i, axis in enumerate(ds["axis"].values):
                ax.plot(ds["time"].values, ds[name].values[:, i], label=str(axis), **epoch_style(i))
            label(ax, text)
        legend(figure, axes[0])
        axes[-1].set_xlabel(f"{_TIME}; {ds.attrs['run']} at rest, no aid, alignment: {ds.attrs['alignment_method']}")
    return figure


def mark_residuals(ds: xr.Dataset) -> Figure:
    """Return misclosures at the markers before (without the mark itself) and after, from group ``markers`` of a run."""
    at = np.arange(ds.sizes["marker"])
    used = ds["used"].values.astype(bool)
    with rc_context(MATPLOTLIB):
        figure, axes = panels([_ROW] * 3, _WIDE, head=_HEAD, foot=0.7)
        for ax, axis in zip(axes, _DIRECTIONS, strict=True):
            sigma = 1.96 * ds["sigma_vertical" if axis == "up" else "sigma_horizontal"].values
            ax.bar(at, 2 * sigma, bottom=-sigma, width=0.7, color=FAINT, label="± 1.96 sigma of the mark")
            before, after = ds[f"misclosure_{axis}_before"].values, ds[f"misclosure_{axis}_after"].values
            for k, (values, said) in enumerate(((before, "without the mark"), (after, "final"))):
                ax.plot(at, values, linestyle="none", marker=SYMBOLS[k], markersize=4, color=epoch_style(k)["color"],
                        markerfacecolor="none" if k == 0 else None, label=said)  # fmt: skip
            ax.plot(at[~used], before[~used], linestyle="none", marker="x", markersize=8, color=INK, label="not used")
            _scaled(ax, np.concatenate([before[used], after[used], sigma]))
            label(ax, f"{axis} (m)")
        axes[-1].set_xticks(at, [str(name) for name in ds["name"].values], rotation=45 if at.size > 8 else 0)
        legend(figure, axes[0])
    return figure


def innovations(ds: xr.Dataset) -> Figure:
    """Return the history of innovations over their sigmas, from group ``navigation`` of a run: within ± 1.96 most of the time."""
    rows = [(f"innovation_{axis}", f"{axis} (sigma)") for axis in ("along", "right", "up") if f"innovation_{axis}" in ds]
    with rc_context(MATPLOTLIB):
        figure, axes = panels([_ROW] * len(rows), _WIDE, head=0.36)
        for ax, (name, text) in zip(axes, rows, strict=True):
            values = ds[name].values
            ax.axhspan(-1.96, 1.96, color=FAINT, linewidth=0)
            ax.plot(ds["time"].values, values, linestyle="none", marker=".", markersize=1.5, color=INK)
            inside = np.isfinite(values)
            share = float(np.mean(np.abs(values[inside]) < 1.96)) if inside.any() else np.nan
            beyond = int((np.abs(values[inside]) > 6.0).sum())
            ax.set_ylim(-6, 6)
            ax.annotate(f"{share:.1%} within ± 1.96; {beyond} beyond the axis", (1, 1), xycoords="axes fraction", ha="right",
                        va="bottom", fontsize=7, color=QUIET)  # fmt: skip
            label(ax, text)
        axes[-1].set_xlabel(_TIME)
    return figure


def biases(ds: xr.Dataset) -> Figure:
    """Return the history of gyro and accelerometer biases and odometer scale with ± one sigma, from group ``navigation``."""
    rows: list[tuple[np.ndarray, np.ndarray, str, Sequence[str]]] = []
    body = ("right", "forward", "up")
    for name, factor, text in (("gyro_bias", 1.0, "gyro bias\n(°/h)"), ("accel_bias", 1e6 / 9.80665, "accelerometer\nbias (µg)")):
        rows.append((ds[name].values * factor, ds[f"{name}_sigma"].values * factor, text, body))
    if "odometer_scale" in ds:
        scale, sigma = (ds[name].values[:, None] * 1e6 for name in ("odometer_scale", "odometer_scale_sigma"))
        rows.append((scale, sigma, "odometer scale\n(ppm)", ("scale",)))
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.2] * len(rows), _WIDE, head=_HEAD)
        for ax, (values, sigma, text, names) in zip(axes, rows, strict=True):
            for i, axis in enumerate(names):
                style = epoch_style(i) if len(names) > 1 else {"color": INK}
                ax.plot(ds["time"].values, values[:, i], label=axis, **style)
                low, high = values[:, i] - sigma[:, i], values[:, i] + sigma[:, i]
                ax.fill_between(ds["time"].values, low, high, color=style["color"], alpha=0.15, linewidth=0)
            label(ax, text)
        legend(figure, axes[0])
        axes[-1].set_xlabel(_TIME)
    return figure


def _scaled(ax: Any, values: np.ndarray) -> None:
    """Let what counts fill the axis; a mark left out as gross may lie beyond it."""
    sizes = np.abs(values[np.isfinite(values)])
    if sizes.size:
        limit = 1.25 * float(sizes.max())
        ax.set_ylim(-limit, limit)
