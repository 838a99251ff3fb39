"""A comparison in, the change between two of its runs, neither of them the reference, out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.change.noise_floor import spread
from deform.errors import Fault, InputError

Floats = NDArray[Any]


def between(dataset: xr.Dataset, before: str, after: str) -> xr.Dataset:
    """Return what changed from one run to another, per component, on the reference chainage.

    Parameters
    ----------
    dataset : group ``comparison`` (`change.compare.Comparison.dataset`, or ``comparison.nc``).
    before, after : names of two of its runs.

    Returns
    -------
    Dataset over ``chainage`` with the change variables of the group and their sigma; ``stable`` where both runs were judged so.

    Raises
    ------
    InputError
        When a run is not in the dataset.

    Notes
    -----
    The reference run cancels in the difference of two differences, its noise as well: (x₂ - x₀) - (x₁ - x₀). The two sigmas
    hold that noise once each, and their root sum of squares is too large; it is scaled by the spread of the difference over
    pipe that both runs call stable. Where that pipe is short the scale stays one.
    """
    names = [str(e) for e in dataset["epoch"].values]
    missing = [n for n in (before, after) if n not in names]
    if missing:
        raise InputError([Fault("comparison", "epoch", f"holds no run {n!r}; there are {', '.join(names)}") for n in missing])
    first, last = (dataset.isel(epoch=names.index(n)) for n in (before, after))
    stable = np.asarray((first["stable"] & last["stable"]).values, bool) if "stable" in dataset else None
    out = xr.Dataset(coords={"chainage": dataset["chainage"]}, attrs={"before": before, "after": after})
    for name in (str(n) for n in dataset.data_vars if f"{n}_sigma" in dataset and n != "run_chainage"):
        change = last[name].values - first[name].values
        sigma = np.hypot(last[f"{name}_sigma"].values, first[f"{name}_sigma"].values)
        out[name] = ("chainage", change, _attrs(dataset[name], before))
        out[f"{name}_sigma"] = ("chainage", sigma * _scale(change, sigma, stable), dict(dataset[f"{name}_sigma"].attrs))
    if stable is not None:
        out["stable"] = ("chainage", stable)
    return out


def _attrs(variable: xr.DataArray, before: str) -> dict:
    attrs = dict(variable.attrs)
    attrs["long_name"] = str(attrs.get("long_name", variable.name)).replace("the reference run", before)
    return attrs


def _scale(change: Floats, sigma: Floats, stable: Floats | None) -> float:
    """Spread of the difference over its claimed sigma on stable pipe, one where there is little of it; never above one."""
    if stable is None:
        return 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (change / sigma)[stable & (sigma > 0)]
    seen = spread(ratio) if np.isfinite(ratio).sum() > 200 else float("nan")
    return float(np.clip(seen, 0.1, 1.0)) if np.isfinite(seen) else 1.0
