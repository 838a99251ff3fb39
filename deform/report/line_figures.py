"""One dataset on the chainage in, one matplotlib figure out: plan, profile, strain, changes, curvature, trends, limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deform.report.series import thinned
from deform.report.style import FAINT, INK, MATPLOTLIB, epoch_style

_POINTS = 2400
_WIDE = 7.2
_CHAINAGE = "reference chainage (m), rising downstream"


def plan(ds: xr.Dataset, zones: list[dict]) -> Figure:
    """Return the plan with true proportions, kilometre posts, zones and north; ``along``, ``across`` (chainage) in metre."""
    with rc_context(MATPLOTLIB):
        east, north, s = ds["along"].values, ds["across"].values, ds["chainage"].values
        spans = [float(np.nanmax(v) - np.nanmin(v)) for v in (east, north)]
        figure = Figure(figsize=(_WIDE, float(np.clip(_WIDE * (spans[1] + 1) / (spans[0] + 1) + 0.6, 2.0, 6.0))))
        ax = figure.add_subplot()
        step = max(s.size // 4000, 1)
        ax.plot(east[::step], north[::step], color=INK, linewidth=1.0)
        for zone in zones:
            inside = (s >= zone["start"]) & (s <= zone["end"])
            if not inside.any():
                continue
            ax.plot(east[inside], north[inside], color=_tint(zone), linewidth=5, solid_capstyle="butt", alpha=0.8)
            middle = np.flatnonzero(inside)[inside.sum() // 2]
            ax.annotate(zone["id"], (east[middle], north[middle]), xytext=(8, 6), textcoords="offset points", fontweight="bold")
        for post in np.arange(np.ceil(s[0] / 1000), np.floor(s[-1] / 1000) + 1, max(1, round((s[-1] - s[0]) / 1e4))) * 1000:
            i = int(np.argmin(np.abs(s - post)))
            ax.plot(east[i], north[i], marker="|", color=INK, markersize=7)
            ax.annotate(f"{post / 1000:.0f} km", (east[i], north[i]), xytext=(6, -10), textcoords="offset points", fontsize=7)
        ax.set_aspect("equal", adjustable="datalim")
        turn = ds.attrs.get("turn_deg", 90.0)
        ax.set(xlabel=f"along {turn % 360:.0f}° (m)", ylabel="across (m)", title="Plan")
        tip = 28 * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
        arrow = {"arrowstyle": "<-", "color": INK}
        ax.annotate(
            "N",
            (0.95, 0.85),
            xytext=(float(tip[0]), float(tip[1])),
            xycoords="axes fraction",
            textcoords="offset points",
            arrowprops=arrow,
        )
    return figure


def strips(ds: xr.Dataset, panels: list[tuple[str, str, float]], zones: list[dict], k_sigma: float = 3.0) -> Figure:
    """Return panels along the chainage, one curve per run; where a variable has its sigma, a grey band of ± k sigma.

    Parameters
    ----------
    ds : variables (run, chainage) and ``<name>_sigma``.
    panels : (variable, axis label, factor).
    zones : shaded and named.
    k_sigma : width of the band.
    """
    panels = [p for p in panels if p[0] in ds]
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDE, 1.45 * max(len(panels), 1) + 0.5))
        axes = np.ravel(figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False))
        for ax, (name, label, factor) in zip(axes, panels, strict=False):
            _curves(ax, ds, name, factor, k_sigma)
            ax.set_ylabel(label, fontsize=7)
            _shade(ax, zones)
        for zone in zones:
            top = axes[0]
            middle = (zone["start"] + zone["end"]) / 2
            if float(ds["chainage"].values[0]) <= middle <= float(ds["chainage"].values[-1]):
                top.annotate(
                    zone["id"], (middle, 1), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontweight="bold"
                )
        axes[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1.12), fontsize=7, borderaxespad=0)
        axes[-1].set_xlabel(_CHAINAGE)
        axes[-1].set_xlim(float(ds["chainage"].values[0]), float(ds["chainage"].values[-1]))
    return figure


def _curves(ax: Any, ds: xr.Dataset, name: str, factor: float, k_sigma: float) -> None:
    s, change = ds["chainage"].values, f"{name}_sigma" in ds
    for k, run in enumerate(ds["run"].values):
        y = ds[name].values[k] * factor
        if not np.isfinite(y).any() or (change and str(run) == ds.attrs.get("reference")):
            continue
        keep = thinned(s, y, _POINTS)
        ax.plot(s[keep], y[keep], label=f"{run} {ds['date'].values[k]}", **epoch_style(k))
    if change:
        band = k_sigma * factor * ds[f"{name}_sigma"].values[-1]
        keep = thinned(s, band, _POINTS // 3)
        ax.fill_between(s[keep], -band[keep], band[keep], color=FAINT, alpha=0.6, linewidth=0, zorder=0)


def _shade(ax: Any, zones: list[dict]) -> None:
    for zone in zones:
        ax.axvspan(zone["start"], zone["end"], color=_tint(zone), alpha=0.13, linewidth=0)


def _tint(zone: dict) -> str:
    return {"high": "#b3261e", "medium": "#b87d00", "low": "#2f6d3a"}.get(zone.get("severity", ""), "#5b626b")


def zone_detail(ds: xr.Dataset) -> Figure:
    """Return displacement with its sigma band and change of bending strain of one zone, at full rate."""
    ends = [{"start": ds.attrs["start_m"], "end": ds.attrs["end_m"], "id": "", "severity": "construction"}]
    rows = [
        ("displacement_lateral", "lateral (m)\n+ = right"),
        ("displacement_up", "vertical (m)\n+ = up"),
        ("bending_strain_change_horizontal", "strain, horizontal (µε)\n+ = bend to the right"),
        ("bending_strain_change_vertical", "strain, vertical (µε)\n+ = sag"),
    ]
    rows = [row for row in rows if row[0] in ds]
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDE, 3.2))
        axes = np.ravel(figure.subplots(-(-max(len(rows), 1) // 2), 2, sharex=True, squeeze=False))
        for ax, (name, label) in zip(axes, rows, strict=False):
            factor = 1.0 if "displacement" in name else 1e6
            _banded(ax, ds, name, factor)
            ax.set_ylabel(label, fontsize=7)
            _shade(ax, ends)
        axes[0].legend(fontsize=7)
        for ax in axes[-2:]:
            ax.set_xlabel(_CHAINAGE, fontsize=7)
    return figure


def _banded(ax: Any, ds: xr.Dataset, name: str, factor: float) -> None:
    s = ds["chainage"].values
    for k, run in enumerate(ds["run"].values):
        y = ds[name].values[k] * factor
        if str(run) == ds.attrs.get("reference") or not np.isfinite(y).any():
            continue
        style = epoch_style(k)
        ax.plot(s, y, label=str(run), **style)
        if f"{name}_sigma" in ds:
            sigma = ds[f"{name}_sigma"].values[k] * factor
            ax.fill_between(s, y - sigma, y + sigma, color=style["color"], alpha=0.2, linewidth=0)


def curvature_comparison(ds: xr.Dataset, *components: str) -> Figure:
    """Return the curvature of the reference run, and the other runs minus it (Porter 1990, Fig. 4-10 to 4-13).

    ``components`` are of ``vertical`` (+ = sag) and ``horizontal`` (+ = to the right); each has two panels, scaled apart.
    """
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDE, 2.15 * len(components)))
        axes = np.ravel(figure.subplots(2 * len(components), 1, sharex=True))
        for i, component in enumerate(components):
            _curvature_pair(axes[2 * i], axes[2 * i + 1], ds, component)
        axes[-1].set_xlabel(_CHAINAGE)
    return figure


def _curvature_pair(top: Any, bottom: Any, ds: xr.Dataset, component: str) -> None:
    sign = {"vertical": "+ = sag", "horizontal": "+ = to the right"}[component]
    s, values = ds["chainage"].values, ds[f"curvature_{component}"].values
    runs = [str(r) for r in ds["run"].values]
    first = runs.index(ds.attrs["reference"])
    keep = thinned(s, values[first], _POINTS)
    top.plot(s[keep], values[first][keep], label=runs[first], **epoch_style(first))
    top.set_title(f"Curvature, {component}, {sign}")
    top.set_ylabel("(1/m)", fontsize=7)
    change = f"curvature_change_{component}"
    for k, run in enumerate(runs):
        if k == first:
            continue
        y = ds[change].values[k] if change in ds else values[k] - values[first]
        keep = thinned(s, y, _POINTS)
        bottom.plot(s[keep], y[keep], label=f"{run} minus {runs[first]}", **epoch_style(k))
    bottom.set_ylabel("difference (1/m)", fontsize=7)
    top.legend(fontsize=7, loc="upper right")
    if len(runs) > 1:
        bottom.legend(fontsize=7, loc="upper right")


def navigation_panel(ds: xr.Dataset, run: str) -> Figure:
    """Return profile, pitch, roll and azimuth of one run along the chainage (Porter 1990, Fig. 4-5)."""
    one = ds.sel(run=[run])
    rows = [
        ("height", "height (m)"),
        ("pitch", "pitch (°)\n+ = rising"),
        ("tool_roll", "tool roll (°)\n+ = right down"),
        ("azimuth", "azimuth (°)"),
    ]
    rows = [row for row in rows if row[0] in one]
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDE, 1.25 * max(len(rows), 1) + 0.5))
        axes = np.ravel(figure.subplots(max(len(rows), 1), 1, sharex=True, squeeze=False))
        for ax, (name, label) in zip(axes, rows, strict=False):
            y = one[name].values[0]
            keep = thinned(one["chainage"].values, y, _POINTS)
            ax.plot(one["chainage"].values[keep], y[keep], color=INK, linewidth=0.8)
            ax.set_ylabel(label, fontsize=7)
        axes[0].set_title(f"Navigation of {run}")
        axes[-1].set_xlabel(_CHAINAGE)
    return figure


def trend(ds: xr.Dataset) -> Figure:
    """Return the values of a zone or dent over the years with ± one sigma, its rate with interval, and the limit."""
    unit, years, values = ds.attrs["unit"], ds["year"].values, ds["value"].values
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(3.5, 2.3))
        ax = figure.add_subplot()
        ax.errorbar(years, values, yerr=np.nan_to_num(ds["sigma"].values), fmt="o", color=INK, capsize=3, markersize=4)
        ahead = np.array([years[-1], years[-1] + max(2.0, 0.6 * (years[-1] - years[0]))])
        start = values[-1]
        ax.plot(ahead, start + ds.attrs["rate_per_year"] * (ahead - ahead[0]), linestyle="--", color=INK)
        low, high = (start + ds.attrs[f"rate_{end}_per_year"] * (ahead - ahead[0]) for end in ("low", "high"))
        ax.fill_between(ahead, low, high, color=FAINT, alpha=0.7, linewidth=0)
        limit = ds.attrs["limit_value"]
        if np.isfinite(limit) and limit < 4 * max(abs(values).max(), 1e-9):
            ax.axhline(limit, color="#b3261e", linestyle=":", linewidth=1)
            ax.annotate(str(ds.attrs["limit_name"]).split(" (")[0], (years[0], limit), fontsize=7, va="bottom", in_layout=False)
        ax.set(title=f"{ds.attrs['subject']}: {ds.attrs['kind']}", ylabel=f"{ds.attrs['kind']} ({unit})", xlabel="year")
        ax.ticklabel_format(axis="x", useOffset=False, style="plain")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def detection_limits(limits: Any) -> Figure | None:
    """Return the least amplitude found against the length of a movement (``tables/limits.csv``); None when it has none."""
    if not {"wavelength_m", "limit_displacement_m"} <= set(limits.columns):
        return None
    rows = limits[limits.wavelength_m.notna() & limits.limit_displacement_m.notna()]
    if rows.empty:
        return None
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(_WIDE, 3.0))
        ax = figure.add_subplot()
        groups = [c for c in ("run_from", "run_to", "component") if c in rows]
        for i, (key, group) in enumerate(rows.groupby(groups)):
            group = group.sort_values("wavelength_m")
            ax.loglog(group.wavelength_m, group.limit_displacement_m, label=" ".join(str(part) for part in key), **epoch_style(i))
            if "limit_90_displacement_m" in group and group.limit_90_displacement_m.notna().any():
                ax.loglog(group.wavelength_m, group.limit_90_displacement_m, **(epoch_style(i) | {"linewidth": 0.6}))
        ax.set(
            xlabel="length of the movement (m)",
            ylabel="least amplitude found (m)",
            title="Detection limit (thick: half of all cases, thin: nine of ten)",
        )
        ax.legend(fontsize=7)
    return figure
