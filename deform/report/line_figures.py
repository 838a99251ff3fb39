"""One dataset of the line in, one matplotlib figure out: strip of the whole line, plan, panels, zones, curvature, joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.report.layout import label, legend, panels
from deform.report.style import FAINT, INK, MATPLOTLIB, QUIET, SYMBOLS, epoch_style, tint

_WIDE = 7.2
_CHAINAGE = "reference chainage (m), rising downstream"
_LABELS = {
    # variable: label with unit and sign, factor
    "height": ("height (m)", 1.0),
    "bending_strain": ("bending strain,\ntotal (µε)", 1e6),
    "ovality": ("ovality (%)", 1e2),
    "displacement": ("displacement\n(m)", 1.0),
    "bending_strain_change": ("strain change\n(µε)", 1e6),
    "displacement_lateral": ("lateral (m)\n+ = right", 1.0),
    "displacement_up": ("vertical (m)\n+ = up", 1.0),
    "bending_strain_change_horizontal": ("strain change (µε)\n+ = bend to right", 1e6),
    "bending_strain_change_vertical": ("strain change (µε)\n+ = sag", 1e6),
}
_POINTS: Any = {"textcoords": "offset points"}
_STRIPS = (("displacement", "bending_strain_change"), ("height", "bending_strain"), ("height",))
_SIZES = {"wide": (11.6, 0.38, 0.68), "narrow": (4.4, 0.42, 0.8), "print": (_WIDE, 0.38, 0.66)}  # width, pipe, each row (inch)
_CHANGES = ("bending_strain_change_horizontal", "bending_strain_change_vertical", "displacement_lateral", "displacement_up")


def line_strip(ds: xr.Dataset, medium: str = "wide") -> Figure:
    """Return the whole line at a glance: the pipe with its zones and dents, and below it the size of the changes.

    Parameters
    ----------
    ds : from `line_view.line_dataset`.
    medium : ``wide`` for a screen, ``narrow`` for one of the width of a hand, ``print`` for paper.

    Notes
    -----
    A line without a comparison shows its profile and strain, listings the changes of their joint lengths.
    """
    names = next((found for pair in _STRIPS if (found := [n for n in pair if n in ds])), [])
    joints = not names and bool(np.isfinite(ds["joint_change"].values).any())
    rows = len(names) + joints
    narrow, (width, pipe, row) = medium == "narrow", _SIZES[medium]
    with rc_context(MATPLOTLIB):
        figure, axes = panels([pipe, *[row] * rows], width, head=0.18, foot=0.4, gap=0.2)
        _pipe(axes[0], ds, narrow)
        for ax, name in zip(axes[1:], names, strict=False):
            _curves(ax, ds, name)
            if name == "bending_strain":
                _cut(ax, ds[name].values * 1e6)
        if joints:
            _joint_points(axes[-1], ds)
            _cut(axes[-1], ds["joint_change"].values * 1000)
        _finish_strip(axes, ds, narrow)
    return figure


def _pipe(ax: Any, ds: xr.Dataset, narrow: bool) -> None:
    """Draw the pipe as a bar, its zones as blocks with their names, dents and markers as symbols."""
    start, end = _ends(ds)
    ax.plot([start, end], [0, 0], color=QUIET, linewidth=5, solid_capstyle="butt", zorder=1)
    for zone in _zones(ds):
        middle = (zone["start"] + zone["end"]) / 2
        size = max(zone["end"] - zone["start"], (end - start) / (90 if narrow else 250))
        ax.barh(0, size, left=middle - size / 2, height=0.9, color=tint(zone["severity"]), zorder=2)
        shade = tint(zone["severity"])
        ax.annotate(zone["id"], (middle, 0.5), xytext=(0, 3), ha="center", va="bottom", fontweight="bold", color=shade, **_POINTS)
    changed = np.isin(ds["dent_status"].values.astype(str), ["grown", "new"])
    for pick, face in ((changed, INK), (~changed, "none")):
        at = ds["dent_chainage"].values[pick]
        ax.plot(
            at, np.full(at.size, -0.95), linestyle="none", marker="^", markersize=5, color=INK, markerfacecolor=face, zorder=3
        )
    kinds = ds["point_kind"].values.astype(str)
    at = ds["point_chainage"].values[~np.isin(kinds, ["bend", "tap", "other", "support"])]
    ax.plot(at, np.zeros(at.size), linestyle="none", marker="|", markersize=9, color=INK, zorder=3)
    ax.set_ylim(-1.7, 1.9)
    ax.set_yticks([])
    ax.grid(visible=False)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
    ax.tick_params(bottom=False)


def _finish_strip(axes: Any, ds: xr.Dataset, narrow: bool) -> None:
    start, end = _ends(ds)
    for ax in axes[1:]:
        _shade(ax, ds, named=False)
    if len(axes) > 1:
        handles, labels = axes[1].get_legend_handles_labels()
        columns = 1 if narrow and len(handles) > 3 else len(handles) or 1
        axes[1].legend(handles, labels, ncols=columns, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0)
        _along(
            axes[-1], ds, "reference chainage (m)" if narrow else f"{_CHAINAGE}; ▲ dent (filled: grown or new), | marker or valve"
        )
    axes[0].set_xlim(start, end)


def plan(ds: xr.Dataset) -> Figure:
    """Return the plan with true proportions, kilometre posts, zones and north."""
    spans = [float(np.nanmax(ds[v].values) - np.nanmin(ds[v].values)) for v in ("along", "across")]
    with rc_context(MATPLOTLIB):
        figure, axes = panels([float(np.clip(6.3 * (spans[1] + 1) / (spans[0] + 1), 1.3, 5.2))], _WIDE)
        _plan(axes[0], ds)
    return figure


def _plan(ax: Any, ds: xr.Dataset) -> None:
    along, across, s = ds["along"].values, ds["across"].values, ds["chainage"].values
    ax.plot(along, across, color=INK, linewidth=1.2)
    for zone in _zones(ds) if "zone_id" in ds else []:
        inside = np.flatnonzero((s >= zone["start"]) & (s <= zone["end"]))
        inside = inside if inside.size > 1 else np.flatnonzero(np.isin(s, np.sort(s[np.argsort(np.abs(s - zone["start"]))[:2]])))
        ax.plot(along[inside], across[inside], color=tint(zone["severity"]), linewidth=5, solid_capstyle="butt", alpha=0.85)
        middle = inside[inside.size // 2]
        ax.annotate(zone["id"], (along[middle], across[middle]), xytext=(6, 7), textcoords="offset points", fontweight="bold")
    length = s[-1] - s[0]
    step = next(v for v in (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000) if length / v < 13)
    for post in np.arange(np.ceil(s[0] / step), np.floor(s[-1] / step) + 1) * step:
        i = int(np.argmin(np.abs(s - post)))
        ax.plot(along[i], across[i], marker="|", color=INK, markersize=7)
        ax.annotate(
            f"{post / 1000:g} km", (along[i], across[i]), xytext=(0, -11), fontsize=7, ha="center", color=QUIET, **_POINTS
        )
    turn = ds.attrs.get("turn_deg", 90.0)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=f"along azimuth {turn % 360:.0f}° (m)", title="Plan")
    label(ax, "across (m)\n+ = left")
    tip = 24 * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    ax.annotate("N", (0.96, 0.85), xytext=(float(tip[0]), float(tip[1])), xycoords="axes fraction", textcoords="offset points",
                arrowprops={"arrowstyle": "<-", "color": INK}, ha="center", va="center")  # fmt: skip


def profile_and_strain(ds: xr.Dataset) -> Figure:
    """Return height, total bending strain and ovality of every run along the line."""
    return _strips(ds, ("height", "bending_strain", "ovality"))


def changes(ds: xr.Dataset) -> Figure:
    """Return changes of bending strain and displacements against the reference run, with a grey band of ± k sigma."""
    return _strips(ds, _CHANGES)


def _strips(ds: xr.Dataset, names: tuple[str, ...]) -> Figure:
    names = tuple(name for name in names if name in ds)
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.3] * len(names), _WIDE, head=0.36)
        for i, (ax, name) in enumerate(zip(axes, names, strict=True)):
            _curves(ax, ds, name)
            _shade(ax, ds, named=i == 0)
            if name == "bending_strain":
                _cut(ax, ds[name].values * 1e6)
        legend(figure, max(axes, key=lambda ax: len(ax.lines)))
        _along(axes[-1], ds)
    return figure


def _curves(ax: Any, ds: xr.Dataset, name: str) -> None:
    """Draw one curve per run; where the variable has its sigma, a grey band of ± k sigma of the last run."""
    s, (text, factor) = ds["chainage"].values, _LABELS[name]
    change = "change" in name or "displacement" in name
    for k, run in enumerate(ds["run"].values):
        y = ds[name].values[k] * factor
        if np.isfinite(y).any() and not (change and str(run) == ds.attrs.get("reference")):
            ax.plot(s, y, label=_told(ds, k), linewidth=1.0 if s.size > 500 else 1.2, **epoch_style(k))
    if f"{name}_sigma" in ds:
        band = ds.attrs.get("k_sigma", 3.0) * factor * ds[f"{name}_sigma"].values[-1]
        band = np.minimum(
            band, 1.1 * np.nanmax(np.abs(ds[name].values)) * factor
        )  # an unknown place is no reason to hide all others
        ax.fill_between(s, -band, band, color=FAINT, alpha=0.8, linewidth=0, zorder=0)
    label(ax, text)


def zone_detail(ds: xr.Dataset) -> Figure:
    """Return displacement and change of bending strain of one zone at full rate, each run with a band of ± one sigma."""
    names = [name for name in (*_CHANGES[2:], *_CHANGES[:2]) if name in ds]
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.25] * -(-max(len(names), 1) // 2), _WIDE, columns=2, gap=0.2)
        for ax, name in zip(axes, names, strict=False):
            text, factor = _LABELS[name]
            _banded(ax, ds, name, factor)
            label(ax, text)
            ax.axvspan(ds.attrs["start_m"], ds.attrs["end_m"], color=FAINT, alpha=0.5, linewidth=0, zorder=0)
        legend(figure, axes[0])
        for ax in axes[-2:]:
            _along(ax, ds, "reference chainage (m)")
    return figure


def _banded(ax: Any, ds: xr.Dataset, name: str, factor: float) -> None:
    s = ds["chainage"].values
    for k, run in enumerate(ds["run"].values):
        y = ds[name].values[k] * factor
        if str(run) == ds.attrs.get("reference") or not np.isfinite(y).any():
            continue
        style = epoch_style(k)
        ax.plot(s, y, label=_told(ds, k), **style)
        if f"{name}_sigma" in ds:
            sigma = ds[f"{name}_sigma"].values[k] * factor
            ax.fill_between(s, y - sigma, y + sigma, color=style["color"], alpha=0.18, linewidth=0)


def curvature_comparison(ds: xr.Dataset) -> Figure:
    """Return curvature of the reference run, both components, and the others minus it (Porter 1990, Fig. 4-10 to 4-13)."""
    components = [c for c in ("vertical", "horizontal") if f"curvature_{c}" in ds]
    with rc_context(MATPLOTLIB):
        figure, axes = panels([0.6] * 2 * len(components), _WIDE, head=0.42, gap=0.26)
        for i, component in enumerate(components):
            _curvature_pair(axes[2 * i], axes[2 * i + 1], ds, component)
        legend(figure, axes[1])
        _along(axes[-1], ds)
    return figure


def _curvature_pair(top: Any, bottom: Any, ds: xr.Dataset, component: str) -> None:
    sign = {"vertical": "+ = sag", "horizontal": "+ = to the right"}[component]
    s, values = ds["chainage"].values, ds[f"curvature_{component}"].values * 1000
    runs = [str(r) for r in ds["run"].values]
    first, change = runs.index(ds.attrs["reference"]), f"curvature_change_{component}"
    top.plot(s, values[first], **epoch_style(first))
    top.set_title(f"Curvature of {runs[first]}, {component}, {sign}", pad=3)
    label(top, "(1/km)")
    for k in range(len(runs)):
        if k != first:
            y = ds[change].values[k] * 1000 if change in ds else values[k] - values[first]
            bottom.plot(s, y, label=f"{runs[k]} minus {runs[first]}", **epoch_style(k))
    label(bottom, "difference\n(1/km)")


def navigation_panel(ds: xr.Dataset) -> Figure:
    """Return plan, profile, pitch, roll and azimuth of one run along its own chainage (Porter 1990, Fig. 4-5)."""
    rows = [
        ("height", "height (m)"),
        ("pitch", "pitch (°)\n+ = rising"),
        ("tool_roll", "tool roll (°)\n+ = right down"),
        ("azimuth", "azimuth (°)"),
        ("speed", "speed (m/s)"),
    ]
    rows = [row for row in rows if row[0] in ds]
    seen = int("along" in ds)
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.5] * seen + [0.85] * len(rows), _WIDE, head=0.25, share=False)
        if seen:
            _plan(axes[0], ds)
            axes[0].tick_params(labelbottom=False)
            axes[0].set(xlabel="", title=f"Plan, to the right: azimuth {ds.attrs['turn_deg'] % 360:.0f}°")
        for ax, (name, text) in zip(axes[seen:], rows, strict=True):
            ax.plot(ds["chainage"].values, ds[name].values, color=INK, linewidth=0.9)
            label(ax, text)
            _along(ax, ds, f"chainage of {ds.attrs['run']} (m), rising downstream" if ax is axes[-1] else "")
            ax.tick_params(labelbottom=ax is axes[-1])
    return figure


def joint_changes(ds: xr.Dataset) -> Figure:
    """Return the change of every joint's length against the reference run, with a band of ± k sigma."""
    with rc_context(MATPLOTLIB):
        figure, axes = panels([1.5], _WIDE, head=0.36)
        _joint_points(axes[0], ds)
        _cut(axes[0], ds["joint_change"].values * 1000)
        _shade(axes[0], ds, named=True)
        legend(figure, axes[0])
        _along(axes[0], ds)
    return figure


def _joint_points(ax: Any, ds: xr.Dataset) -> None:
    order = np.argsort(ds["joint_chainage"].values)
    at, band = ds["joint_chainage"].values[order], None
    for k, run in enumerate(ds["run"].values):
        y = ds["joint_change"].values[k][order] * 1000
        if str(run) == ds.attrs["reference"] or not np.isfinite(y).any():
            continue
        band = ds.attrs["k_sigma"] * ds["joint_change_sigma"].values[k][order] * 1000
        ax.plot(at, y, linestyle="none", marker=SYMBOLS[k % len(SYMBOLS)], markersize=2.2, color=epoch_style(k)["color"],
                label=_told(ds, k))  # fmt: skip
    if band is not None:
        ax.fill_between(at, -band, band, color=FAINT, alpha=0.8, linewidth=0, zorder=0)
    label(ax, "joint length (mm)\n+ = longer")


def _cut(ax: Any, values: np.ndarray) -> None:
    """End the axis where bends or outliers would flatten all else, and say how many values lie beyond."""
    sizes = np.abs(values[np.isfinite(values)])
    if not sizes.size:
        return
    limit = 2.5 * float(np.quantile(sizes, 0.9))
    beyond = int((sizes > limit).sum())
    if limit > 0 and sizes.max() > 4 * limit:
        ax.set_ylim(-limit if (values < 0).any() else 0, limit)
        said = f"off the scale: up to {sizes.max():,.0f}" if beyond > 200 else f"{beyond} off the scale, up to {sizes.max():,.0f}"
        ax.annotate(said, (1, 1), xycoords="axes fraction", ha="right", va="bottom", fontsize=7, color=QUIET)


def _along(ax: Any, ds: xr.Dataset, text: str = _CHAINAGE) -> None:
    ax.set_xlabel(text)
    ax.set_xlim(*_ends(ds))
    ax.xaxis.set_major_formatter("{x:,.0f}")


def _told(ds: xr.Dataset, k: int) -> str:
    run, date = str(ds["run"].values[k]), str(ds["date"].values[k])
    return run if date[:4] in run else f"{run} ({date[:4]})"


def _ends(ds: xr.Dataset) -> tuple[float, float]:
    s = ds["chainage"].values
    return float(s[0]), float(s[-1]) if s[-1] > s[0] else float(s[0]) + 1.0


def _zones(ds: xr.Dataset) -> list[dict[str, Any]]:
    keys = ("id", "kind", "severity", "start", "end")
    rows = zip(*(ds[f"zone_{key}"].values for key in keys), strict=True)
    low, high = _ends(ds)
    return [zone for row in rows if (zone := dict(zip(keys, row, strict=True)))["end"] >= low and zone["start"] <= high]


def _shade(ax: Any, ds: xr.Dataset, *, named: bool) -> None:
    for zone in _zones(ds):
        ax.axvspan(zone["start"], zone["end"], color=tint(zone["severity"]), alpha=0.13, linewidth=0)
        middle = (zone["start"] + zone["end"]) / 2
        if named and _ends(ds)[0] <= middle <= _ends(ds)[1]:
            ax.annotate(zone["id"], (middle, 1), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontweight="bold")
