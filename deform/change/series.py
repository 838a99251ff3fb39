"""A comparison in, the values of each zone and each dent over the epochs with sigma out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.change.running_mean import running_mean
from deform.change.stack import day_of

Floats = NDArray[Any]
_WIDTH = 5.0  # m, over which a value at a peak is averaged


@dataclass(frozen=True)
class Series:
    """Values of one quantity of one zone or dent over the epochs.

    Attributes
    ----------
    subject, kind : zone or dent, and what changes.
    day : days since 1970 of each epoch.
    value, sigma : at each epoch (m or 1); ``sigma`` is that of the epoch alone.
    run : names of the epochs.
    outside_diameter : of the pipe (m), NaN when not known.
    """

    subject: str
    kind: str
    day: Floats
    value: Floats
    sigma: Floats
    run: tuple[str, ...]
    outside_diameter: float = float("nan")


def zone_series(comparison: Any) -> list[Series]:
    """Return the displacement along its peak direction and the bending strain change of every zone that moved or bent.

    Notes
    -----
    The sigma of a pair holds the noise of both runs. An epoch's own share is taken as σ / √2; the reference epoch, whose
    change is zero by definition, carries the same share, so that its noise enters the rate once and not as a certainty.
    """
    ds, zones = comparison.dataset, comparison.zones
    days = np.array([day_of(d) for d in ds["date"].values]) if "date" in ds else np.full(ds.sizes["epoch"], np.nan)
    names = tuple(str(e) for e in ds["epoch"].values)
    axis = ds["chainage"].values
    found = []
    for zone in zones[zones["kind"].isin(["movement", "bending"])].to_dict("records"):
        inside = (axis >= zone["start_m"]) & (axis <= zone["end_m"])
        if not inside.any():
            continue
        if "displacement_east" in ds and zone["kind"] == "movement":
            parts = [f"displacement_{n}" for n in ("east", "north", "up")]
            found.append(_series(ds, zone["zone_id"], "displacement", parts, inside, axis, days, names))
        if "bending_strain_change_horizontal" in ds:
            parts = [f"bending_strain_change_{n}" for n in ("horizontal", "vertical")]
            found.append(_series(ds, zone["zone_id"], "bending strain", parts, inside, axis, days, names))
    return [series for series in found if series is not None]


def _series(ds, subject, kind, parts, inside, axis, days, names) -> Series | None:
    """Values at the place of the largest change, along its direction there."""
    own = np.stack([ds[p].values[:, inside] for p in parts])
    stack = np.where(np.isfinite(own), running_mean(own, round(_WIDTH / (axis[1] - axis[0]))), np.nan)
    size = np.sqrt(np.nansum(stack**2, axis=0))
    if not np.isfinite(stack).any() or not size.max() > 0:
        return None
    k, i = np.unravel_index(int(np.nanargmax(size)), size.shape)
    direction = np.nan_to_num(stack[:, k, i]) / size[k, i]
    value = np.tensordot(direction, stack[:, :, i], axes=1)
    sigma = np.stack([ds[f"{p}_sigma"].values[:, inside][:, i] for p in parts])
    pair = np.sqrt(np.tensordot(direction**2, sigma**2, axes=1))
    known = np.isfinite(value)
    share = pair / np.sqrt(2.0)
    changed = known & (share > 0)
    share = np.where(known & ~changed, np.median(share[changed]) if changed.any() else np.nan, share)
    return Series(subject, kind, days, np.where(known, value, np.nan), share, names)


def dent_series(comparison: Any) -> list[Series]:
    """Return the depth over the epochs of every dent that grew or rerounded somewhere, from the runs that measured it."""
    dents: pd.DataFrame = comparison.dents
    ds = comparison.dataset
    days = {str(e): day_of(d) for e, d in zip(ds["epoch"].values, ds["date"].values, strict=True)} if "date" in ds else {}
    od = float(ds.attrs.get("outside_diameter_m", np.nan))
    found = []
    for dent_id, rows in dents.groupby("dent_id", sort=False):
        if not rows["status"].isin(["grown", "rerounded"]).any():
            continue
        rows = rows[rows["depth_m"].notna() & ~rows["status"].isin(["copied"])]
        sigma = rows["depth_sigma_m"].to_numpy(float)
        day = np.array([days.get(str(r), np.nan) for r in rows["run"]])
        names = tuple(str(r) for r in rows["run"])
        found.append(Series(str(dent_id), "dent depth", day, rows["depth_m"].to_numpy(float), sigma, names, od))
    return found
