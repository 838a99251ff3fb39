"""The matched welds of two runs in, one figure out: ribbon of joints with links, length differences, drift, or probability."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deform.report.style import EPOCHS, FAINT, INK, MATPLOTLIB, QUIET, SEVERITY

_ODD = SEVERITY["high"]
_COLOURS = {
    "matched": QUIET,
    "shifted": EPOCHS[4],
    "missed": EPOCHS[0],
    "false": EPOCHS[3],
    "added": EPOCHS[2],
    "removed": _ODD,
}


def match_data(welds: pd.DataFrame, run_a: str, run_b: str) -> xr.Dataset:
    """Return what the figures of a pair of runs show, from the rows of ``tables/welds.csv``.

    Returns
    -------
    dataset : dim ``weld`` (every weld that either run lists or should list, in the order of the reference):
        ``reference_chainage``, ``chainage_a``, ``chainage_b`` (metre, own chainage, NaN where the run does not list it),
        ``status_a``, ``status_b``, ``probability`` (of the match, NaN where only one run lists it).
    """
    table = {}
    for end, run in (("a", run_a), ("b", run_b)):
        rows = welds[welds["run"] == run].drop_duplicates("weld_id").set_index("weld_id")
        listed = rows["index"].notna()
        table[f"chainage_{end}"] = rows["chainage_m"].where(listed)
        table[f"status_{end}"] = rows["status"]
        table[f"probability_{end}"] = rows["probability"].where(listed)
        table[f"place_{end}"] = rows["reference_chainage_m"]
    frame = pd.DataFrame(table)
    frame["place"] = frame["place_a"].fillna(frame["place_b"])
    frame = frame.sort_values("place", kind="stable")
    both = frame["chainage_a"].notna() & frame["chainage_b"].notna()
    probability = frame[["probability_a", "probability_b"]].min(axis=1, skipna=False).where(both)
    values = {
        "reference_chainage": frame["place"].to_numpy(float),
        "chainage_a": frame["chainage_a"].to_numpy(float),
        "chainage_b": frame["chainage_b"].to_numpy(float),
        "status_a": frame["status_a"].fillna("").to_numpy(str),
        "status_b": frame["status_b"].fillna("").to_numpy(str),
        "probability": probability.to_numpy(float),
    }
    return xr.Dataset({k: ("weld", v) for k, v in values.items()}, attrs={"run_a": run_a, "run_b": run_b})


@rc_context(MATPLOTLIB)
def ribbon(data: xr.Dataset) -> Figure:
    """Both runs' welds as ticks along two lines, links between what is one weld, and what has no partner in its colour.

    Forty welds are shown, about the first one that has no partner.
    """
    place = data["reference_chainage"].values
    first, last = _piece(data)
    shown = (place >= first) & (place <= last)
    figure, axes = _figure(2.4)
    for level, end_name in ((1.0, "a"), (0.0, "b")):
        listed = shown & np.isfinite(data[f"chainage_{end_name}"].values)
        axes.plot([first, last], [level, level], color=FAINT, linewidth=6, solid_capstyle="butt", zorder=1)
        status = data[f"status_{end_name}"].values
        for word, colour in _COLOURS.items():
            at = place[listed & (status == word)]
            axes.vlines(at, level - 0.12, level + 0.12, color=colour, linewidth=1.4, zorder=3)
            gone = place[shown & ~listed & (status == word)]
            axes.plot(gone, np.full(gone.size, level), "x", color=colour, markersize=5, zorder=3)
    paired = shown & np.isfinite(data["probability"].values)
    doubt = 1.0 - np.nan_to_num(data["probability"].values)
    for k in np.flatnonzero(paired):
        colour = _ODD if doubt[k] > 0.1 else QUIET
        axes.plot([place[k], place[k]], [0.12, 0.88], color=colour, linewidth=0.8, alpha=0.8, zorder=2)
    for word, colour in _COLOURS.items():
        if (shown & ((data["status_a"].values == word) | (data["status_b"].values == word))).any():
            axes.plot([], [], color=colour, linewidth=2, label=word)
    axes.plot([], [], color=_ODD, linewidth=0.8, label="link below 0.9")
    axes.set_yticks([1.0, 0.0], [data.attrs["run_a"], data.attrs["run_b"]])
    axes.set_ylim(-0.35, 1.35)
    axes.set_xlim(first, last)
    axes.set_xlabel("reference chainage (m)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.28), ncols=7)
    return figure


@rc_context(MATPLOTLIB)
def length_differences(data: xr.Dataset) -> Figure:
    """Length of each joint in the second run minus that in the first, the mean scale taken out, along the line."""
    place, difference = _differences(data)
    figure, axes = _figure(2.6)
    sigma = 1.4826 * np.median(np.abs(difference - np.median(difference))) if difference.size else np.nan
    axes.axhspan(-1.96 * sigma, 1.96 * sigma, color=FAINT, label=f"± 1.96 × {sigma:.3f} m")
    most = max(10.0 * sigma, 0.1)
    inside = np.abs(difference) <= most
    axes.plot(place[inside], difference[inside], ".", markersize=2.5, color=INK)
    axes.plot(place[~inside], np.clip(difference[~inside], -most, most), "v", markersize=4, color=_ODD, label="beyond")
    axes.set_ylim(-1.1 * most, 1.1 * most)
    axes.set_ylabel("difference of length (m)\n+ = longer in the later run")
    axes.set_xlabel("reference chainage (m)")
    axes.legend(loc="upper right")
    return figure


@rc_context(MATPLOTLIB)
def drift(data: xr.Dataset) -> Figure:
    """Chainage of the second run minus that of the first at the common welds, one scale taken out."""
    both = np.isfinite(data["probability"].values)
    a, b = data["chainage_a"].values[both], data["chainage_b"].values[both]
    figure, axes = _figure(2.4)
    if a.size > 1:
        slope, offset = np.polyfit(a, b, 1)
        axes.plot(data["reference_chainage"].values[both], b - slope * a - offset, linewidth=1.0, color=EPOCHS[0])
        axes.set_title(f"scale {slope:.5f} taken out")
    axes.axhline(0.0, color=QUIET, linewidth=0.6)
    axes.set_ylabel("drift (m)\n+ = later run ahead")
    axes.set_xlabel("reference chainage (m)")
    return figure


@rc_context(MATPLOTLIB)
def probability_strip(data: xr.Dataset) -> Figure:
    """Odds against each pair along the line, on a logarithmic scale: what is sure lies low, what wants a look stands out."""
    both = np.isfinite(data["probability"].values)
    place, doubt = data["reference_chainage"].values[both], 1.0 - data["probability"].values[both]
    figure, axes = _figure(2.0)
    axes.semilogy(place, np.clip(doubt, 1e-6, 1.0), ".", markersize=2.5, color=QUIET)
    sure = doubt > 0.1
    axes.semilogy(place[sure], doubt[sure], "o", markersize=4, color=_ODD, label=f"{int(sure.sum())} below 0.9")
    axes.axhline(0.1, color=_ODD, linewidth=0.6)
    axes.set_ylim(5e-7, 1.5)
    axes.set_ylabel("1 - probability (-)")
    axes.set_xlabel("reference chainage (m)")
    axes.legend(loc="upper right")
    return figure


def _figure(height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(9.2, height), layout="constrained")
    return figure, figure.subplots()


def _piece(data: xr.Dataset) -> tuple[float, float]:
    """Where the ribbon begins and ends."""
    place = data["reference_chainage"].values
    odd = np.flatnonzero(~np.isfinite(data["probability"].values))
    middle = int(odd[0]) if odd.size else place.size // 2
    low, high = max(middle - 20, 0), min(middle + 20, place.size - 1)
    return float(place[low]), float(place[high])


def _differences(data: xr.Dataset) -> tuple[NDArray[Any], NDArray[Any]]:
    """Place and difference of length of the joints that both runs list whole."""
    listed_a, listed_b = np.isfinite(data["chainage_a"].values), np.isfinite(data["chainage_b"].values)
    rows = np.flatnonzero(listed_a | listed_b)
    whole = (listed_a & listed_b)[rows]
    joint = whole[:-1] & whole[1:]
    left, right = rows[:-1][joint], rows[1:][joint]
    a = np.abs(np.diff(np.stack([data["chainage_a"].values[left], data["chainage_a"].values[right]]), axis=0)[0])
    b = np.abs(np.diff(np.stack([data["chainage_b"].values[left], data["chainage_b"].values[right]]), axis=0)[0])
    scale = float(np.median(b / a)) if a.size else 1.0
    return data["reference_chainage"].values[left], b / scale - a
