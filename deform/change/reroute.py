"""Edits of a line and the changes between its runs in, the edits out, a cut-out that left its old place called a re-route."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from deform.change.bridge import Bridges
from deform.change.datum import Datum
from deform.change.pair import PairChange
from deform.change.position_change import finer
from deform.change.running_mean import running_mean
from deform.change.stack import POSITION, run_id
from deform.geometry.earth import enu_difference
from deform.options import ChangeOptions

Floats = NDArray[Any]
_IN_PLACE = 1.0  # m: pipe laid anew within its old trench lies no further from where the old pipe lay
_SMOOTH = 5.0  # m over which the two centrelines are held against each other
_LEAST_POINTS = 20


def told_by_geometry(
    edits: pd.DataFrame, pairs: list[PairChange], runs: list[xr.DataTree], maps: Any, options: ChangeOptions
) -> pd.DataFrame:
    """Return the edits with a cut-out whose new pipe lies beside the old one as ``reroute``, and why.

    Parameters
    ----------
    edits : as `Matching.edits`; its kinds rest on the number and the lengths of the joints alone.
    pairs : changes between runs.
    runs : of the line, in the order of their dates. maps : `correlate.chainage.ChainageMap` of each.
    options : how many sigma a departure must have.

    Notes
    -----
    The new pipe departs from the old one by the greatest of the distances of its points from the old centreline, the drift of
    the two runs taken off as it is bridged from the pipe on either side. Its sigma is that of the bridge, widened by what bridges
    over stable pipe miss, and of the short noise of the pair. A re-route is called from a metre and ``k_sigma`` sigma on; below,
    it may be either, and what the joints say stands.
    """
    if edits is None or "kind" not in edits or not (edits["kind"] == "cutout").any():
        return edits
    order, tree = [run_id(run) for run in runs], {run_id(run): run for run in runs}
    edits = edits.copy()
    chosen = edits[edits["kind"] == "cutout"]
    for index, row in zip(chosen.index, chosen.to_dict("records"), strict=True):
        pair = _across(pairs, order.index(str(row["run"])))
        if pair is None:
            continue
        found = departure(pair, tree, maps, float(row["start_m"]), float(row["end_m"]))
        if found is None:
            continue
        apart, sigma, place = found
        if apart > max(_IN_PLACE, options.k_sigma * sigma):
            words = f"the new pipe lies up to {apart:.2f} m (sigma {sigma:.2f} m) beside the old, at {place:.0f} m"
            edits.loc[index, ["kind", "reason"]] = ["reroute", "; ".join(w for w in (words, str(row["reason"])) if w)]
    return edits


def _across(pairs: list[PairChange], first: int) -> PairChange | None:
    """The pair with the runs nearest to each other of which one holds the old pipe, the other (``first`` or later) the new."""
    found = [pair for pair in pairs if min(pair.order) < first <= max(pair.order)]
    return min(found, key=lambda pair: abs(pair.order[1] - pair.order[0]), default=None)


def departure(
    pair: PairChange, runs: dict[str, xr.DataTree], maps: Any, start: float, end: float
) -> tuple[float, float, float] | None:
    """Return how far a run's pipe between two welds lies from that of the reference run of a pair, sigma, and where (m).

    Parameters
    ----------
    pair : change between the two runs, with its datum. runs, maps : by name.
    start, end : places of the welds on the reference chainage of the line (m).

    Returns
    -------
    Greatest distance, its sigma, and its place on the reference chainage; None where either run has no positions there.
    """
    old, new = (_centreline(runs[name], maps[name], start, end) for name in (pair.reference, pair.run))
    if old is None or new is None or pair.datum is None or pair.bridges is None:
        return None
    drift, sigma = _bridged(pair.datum, pair.bridges, np.linspace(start, end, len(new)))
    here = np.column_stack(enu_difference(*new.T, *np.broadcast_to(old[0], new.shape).T)) - drift
    there = np.column_stack(enu_difference(*old.T, *np.broadcast_to(old[0], old.shape).T))
    width = max(round(_SMOOTH / (end - start) * len(new)), 1)
    apart = running_mean(cKDTree(there).query(here)[0], width)
    top = int(np.argmax(apart))
    return float(apart[top]), float(sigma[top]), float(start + (end - start) * top / max(len(new) - 1, 1))


def _centreline(run: xr.DataTree, chain_map: Any, start: float, end: float) -> Floats | None:
    """Latitude, longitude, height of a run between two places of the reference chainage, in the direction of the reference."""
    if "centreline" not in run.children or any(name not in run["centreline"] for name in POSITION):
        return None
    line = run["centreline"].to_dataset()
    ends = np.sort(np.asarray(chain_map.to_run(np.array([start, end])), float))
    window = line.isel(chainage=slice(*np.searchsorted(line["chainage"].values, ends)))
    points = np.column_stack([np.asarray(window[name].values, float) for name in POSITION])[:: chain_map.direction]
    points = points[np.isfinite(points).all(axis=1)]
    return points if len(points) >= _LEAST_POINTS else None


def _bridged(datum: Datum, bridges: Bridges, at: Floats) -> tuple[Floats, Floats]:
    """Drift (n, 3) at places in one bridge (m) and the sigma (n,) of a distance across the pipe there."""
    drift, variance = (finer(at, bridges.place, part) for part in (datum.drift, datum.variance))
    variance = variance.max(axis=1) + float(datum.model.noise[:2].max())
    return drift, np.sqrt(variance) * float(bridges.factor(at[-1] - at[0]).max())
