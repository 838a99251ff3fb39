"""The values of a zone or dent over the runs in, a picture of one line height out: inline SVG in the colours of the runs."""

from __future__ import annotations

import numpy as np
import xarray as xr
from markupsafe import Markup, escape

from deform.report.words import number

_WIDTH, _HEIGHT, _EDGE = 132, 34, 6.0


def sparkline(ds: xr.Dataset | None) -> Markup:
    """Return the sizes over the years as a small SVG with one dot per run and bars of ± one sigma; empty without values.

    Parameters
    ----------
    ds : ``value``, ``sigma``, ``year``, ``epoch`` over ``run``, from `trend_view.trend_dataset`; None gives nothing.

    Notes
    -----
    The lower edge is zero, so that steepness compares between rows by share and not by size; the words of the picture say the
    values for those who cannot see it.
    """
    if ds is None:
        return Markup("")
    years, values, sigma = ds["year"].values, np.abs(ds["value"].values), np.nan_to_num(ds["sigma"].values)
    top = max(float((values + sigma).max()), 1e-12)
    x = _EDGE + (years - years[0]) / max(years[-1] - years[0], 1e-9) * (_WIDTH - 2 * _EDGE)
    y, upper, lower = (_y(v, top) for v in (values, values + sigma, values - sigma))
    path = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    parts = [
        f'<path d="M0 {_HEIGHT - 4}H{_WIDTH}" stroke="var(--line)"/>',
        f'<path d="{path}" fill="none" stroke="var(--quiet)" stroke-width="1.5"/>',
    ]
    for k, epoch in enumerate(ds["epoch"].values):
        colour = f"var(--epoch-{int(epoch) % 8})"
        parts.append(f'<path d="M{x[k]:.1f} {upper[k]:.1f}V{lower[k]:.1f}" stroke="{colour}" stroke-width="1.5" opacity=".6"/>')
        parts.append(f'<circle cx="{x[k]:.1f}" cy="{y[k]:.1f}" r="{3.6 if k == len(x) - 1 else 2.6}" fill="{colour}"/>')
    frame = f'class="spark" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}" role="img"'
    return Markup(f"<svg {frame}><title>{escape(_said(ds))}</title>{''.join(parts)}</svg>")


def _y(values: np.ndarray, top: float) -> np.ndarray:
    return _HEIGHT - 4 - np.clip(values, 0, None) / top * (_HEIGHT - 10)


def _said(ds: xr.Dataset) -> str:
    values = zip(ds["run"].values, ds["value"].values, ds["sigma"].values, strict=True)
    decimals, unit = int(ds.attrs["decimals"]), ds.attrs["unit"]
    parts = [
        f"{run}: {number(value, decimals)}" + (f" ± {number(sigma, decimals)}" if np.isfinite(sigma) else "")
        for run, value, sigma in values
    ]
    return f"{ds.attrs['kind']} ({unit}): {', '.join(parts)}"
