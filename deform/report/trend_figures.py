"""One dataset of a trend or of detection limits in, one matplotlib figure out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from deform.report.layout import label, panels
from deform.report.style import EPOCHS, FAINT, INK, MATPLOTLIB, QUIET, SEVERITY, epoch_style


def trend(ds: xr.Dataset) -> Figure:
    """Return the values of a zone or dent over the years with ± one sigma, its rate with interval, and the limit.

    A rate is drawn ahead only where the trend carries no reservation (attribute ``remark``).
    """
    years, values, sigma = ds["year"].values, ds["value"].values, np.nan_to_num(ds["sigma"].values)
    with rc_context(MATPLOTLIB):
        figure, (ax,) = panels([1.4], 3.5, left=0.62)
        ax.plot(years, values, color=QUIET, linewidth=0.9, zorder=1)
        for x, y, spread, epoch in zip(years, values, sigma, ds["epoch"].values, strict=True):
            ax.errorbar(x, y, yerr=spread, fmt="o", color=EPOCHS[int(epoch) % len(EPOCHS)], capsize=2.5, markersize=4.5, zorder=3)
        top = float(np.abs(values).max() + sigma.max())
        if not ds.attrs["remark"] and np.isfinite(ds.attrs["rate_per_year"]):
            _ahead(ax, ds, float(years[-1]), float(values[-1]), years[-1] - years[0])
        limit = ds.attrs["limit_value"]
        if np.isfinite(limit) and limit < 4 * max(top, 1e-9):
            ax.axhline(limit, color=SEVERITY["high"], linestyle=":", linewidth=1)
            ax.annotate(f"limit {limit:g} {ds.attrs['unit']}", (years[0], limit), fontsize=7, va="bottom", in_layout=False)
            top = max(top, limit)
        ax.set_ylim(min(0.0, float((values - sigma).min())), 1.18 * top)
        ax.set(title=f"{ds.attrs['subject']}: {ds.attrs['kind']}", xlabel="year")
        label(ax, f"{ds.attrs['kind']} ({ds.attrs['unit']})")
        ax.ticklabel_format(axis="x", useOffset=False, style="plain")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    return figure


def _ahead(ax, ds: xr.Dataset, year: float, value: float, span: float) -> None:
    ahead = np.array([year, year + max(2.0, 0.6 * span)])
    ax.plot(ahead, value + ds.attrs["rate_per_year"] * (ahead - year), linestyle="--", color=INK, linewidth=1)
    low, high = (value + ds.attrs[f"rate_{end}_per_year"] * (ahead - year) for end in ("low", "high"))
    ax.fill_between(ahead, low, high, color=FAINT, alpha=0.8, linewidth=0, zorder=0)


def detection_limits(ds: xr.Dataset) -> Figure:
    """Return the least amplitude found against the length of a movement.

    Parameters
    ----------
    ds : over ``row``, from `trend_view.limit_dataset`: ``wavelength_m``, ``limit_displacement_m`` (half of all cases),
        ``limit_90_displacement_m`` (nine of ten), ``run_from``, ``run_to``, ``component``.
    """
    rows = ds.to_dataframe()
    with rc_context(MATPLOTLIB):
        figure, (ax,) = panels([2.2], 7.2)
        groups = [c for c in ("run_from", "run_to", "component") if c in rows]
        for i, (key, group) in enumerate(rows.groupby(groups)):
            group = group.sort_values("wavelength_m")
            known = "limit_90_displacement_m" in group and group.limit_90_displacement_m.notna().any()
            ax.loglog(group.wavelength_m, group.limit_displacement_m * 1000, label=_told(key), **epoch_style(i))
            if known:
                ax.loglog(group.wavelength_m, group.limit_90_displacement_m * 1000, **(epoch_style(i) | {"linewidth": 0.6}))
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:,.0f}")
            axis.set_minor_formatter("")
        ax.set(xlabel="length of the movement (m)", title="Detection limit")
        label(ax, "least amplitude (mm)")
        ax.legend(title="thick: found in half of all cases, thin: in nine of ten", title_fontsize=7.5, alignment="left")
    return figure


def _told(key: tuple) -> str:
    words = [str(part) for part in key if not pd.isna(part)]
    return f"{words[0]} to {words[1]}, {', '.join(words[2:])}" if len(words) > 2 else " ".join(words)
