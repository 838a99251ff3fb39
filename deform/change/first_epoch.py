"""A zone and the changes of every run in, the first run that shows the change at its known place and shape out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from deform.change.pair import PairChange
from deform.options import ChangeOptions

Floats = NDArray[Any]
_CHANCE = 1e-3  # of calling a change significant at a place and of a shape that another run has shown
_BLOCK_M = 2.0  # over which curvature is averaged: nearer values share their gauge


def first_epoch(
    told: PairChange, pairs: list[PairChange], inside: Floats, peak: dict, strain: dict, options: ChangeOptions
) -> str | None:
    """Return the first run that lies apart from the earliest one; None when none does.

    Parameters
    ----------
    told : the pair that shows the zone best. pairs : changes of every run since the reference run.
    inside : (n,) true in the zone. peak, strain : its peaks, with the direction of the displacement.
    options : least sizes.

    Notes
    -----
    Place and shape being known there is one look, not one for every wavelength of pipe. A run counts when the displacement at the
    peak, along the movement, or the part of the zone's own pattern of curvature that it holds, differs from that of the earliest
    run at one in a thousand, and reaches half the least size. The reference run holds nothing by definition.
    """
    if not pairs:
        return None
    series = [(pairs[0].reference, pairs[0].order[0], (0.0, 0.0), (0.0, 0.0))]
    series += [(p.run, p.order[1], _displacement(p, inside, peak), _part(p, told, inside)) for p in pairs]
    series.sort(key=lambda epoch: epoch[1])
    limit = float(norm.isf(_CHANCE / (2.0 * len(series))))
    least = 0.5 * options.least_displacement_m, 0.5 * options.least_strain_change / max(float(strain["size"]), 1e-12)
    for run, _, *values in series[1:]:
        for (value, sigma), (base, base_sigma), small in zip(values, series[0][2:], least, strict=True):
            change, noise = value - base, float(np.hypot(sigma, base_sigma))
            if np.isfinite(change) and noise > 0 and change > max(limit * noise, small):
                return run
    return None


def _displacement(pair: PairChange, inside: Floats, peak: dict) -> tuple[float, float]:
    """Displacement at the peak of the zone along its direction (m), run minus reference, and its sigma."""
    way, i = np.asarray(peak["vector"], float), peak["index"]
    size = float(np.linalg.norm(way))
    if pair.displacement is None or pair.displacement_sigma is None or i is None or not size > 0:
        return np.nan, np.nan
    way = way / size
    value, sigma = pair.displacement[inside, :3][i], pair.displacement_sigma[inside, :3][i]
    return float(value @ way), float(np.sqrt(np.sum((way * sigma) ** 2)))


def _part(pair: PairChange, told: PairChange, inside: Floats) -> tuple[float, float]:
    """Part of the pattern of curvature of the zone that a run holds, and its sigma."""
    top = bottom = 0.0
    for name in ("horizontal", "vertical"):
        own, pattern = pair.curvature.get(name), told.curvature.get(name)
        if own is None or pattern is None:
            continue
        size = max(round(_BLOCK_M / pair.step), 1)
        columns = [v[inside] for v in (own.change, own.sigma * pair.colour[name], told.sign * pattern.change)]
        change, sigma, shape = (_blocks(v, size) for v in columns)
        known = np.isfinite(change) & np.isfinite(shape) & (sigma > 0)
        top += float(np.sum((change * shape / sigma**2)[known]))
        bottom += float(np.sum((shape / sigma)[known] ** 2))
    return (top / bottom, bottom**-0.5) if bottom > 0 else (np.nan, np.nan)


def _blocks(values: Floats, size: int) -> Floats:
    count = values.size // size
    return values[: count * size].reshape(count, size).mean(axis=1)
