"""Changes of ovality of every pair of runs in, the stretches where it is significant out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.change.noise_floor import spread
from deform.change.pair import PairChange
from deform.change.running_mean import running_mean
from deform.change.significance import caution_factor, limit_of
from deform.options import ChangeOptions
from deform.run import build

Floats = NDArray[Any]
_WINDOWS = (1.0, 4.0, 12.0)  # m: a fitting, a bend, a joint
_LOOKS = 2.0  # independent means per window


def ovality_table(pairs: list[PairChange], axis: Floats, dents: pd.DataFrame, options: ChangeOptions) -> pd.DataFrame:
    """Return the table ``ovality``: stretches whose ovality changed since the reference run.

    Parameters
    ----------
    pairs : changes since the reference run.
    axis : reference chainage (m).
    dents : table ``dents``: a dent that changed is named, it makes the section oval by itself.
    options : rate of false alarms, least change.

    Notes
    -----
    Means over 1, 4 and 12 m against the spread of such means over the line, with the threshold raised for heavy tails. A stretch
    is where such a mean exceeds it; its change is that of the window that shows it best.
    """
    rows: list[dict] = []
    for pair in pairs:
        if pair.ovality is not None:
            rows += [row | {"run": pair.later, "since": pair.earlier} for row in _stretches(pair, axis, options)]
    for row in rows:
        row["remark"] = _near(row, dents)
    return build.table("ovality", pd.DataFrame(rows))


def _stretches(pair: PairChange, axis: Floats, options: ChangeOptions) -> list[dict]:
    assert pair.ovality is not None
    assert pair.ovality_sigma is not None
    step = float(axis[1] - axis[0])
    known = np.isfinite(pair.ovality)
    kilometres = known.sum() * step / 1000.0
    looks_per_100_km = sum(_LOOKS * 1e5 / w for w in _WINDOWS)
    limit = limit_of(options.false_alarms_per_100_km, looks_per_100_km, 1)
    best, change, noise = np.zeros(axis.size), np.zeros(axis.size), np.full(axis.size, np.nan)
    for window in _WINDOWS:
        width = round(window / step)
        mean, sigma = (running_mean(part, width, least=0.5) for part in (pair.ovality, pair.ovality_sigma))
        z = mean / sigma
        scale, looks = spread(z[pair.stable]), _LOOKS * 1000.0 * kilometres / window
        if not (np.isfinite(scale) and scale > 0 and looks >= 10):
            continue
        caution = caution_factor(z[pair.stable] / scale, looks, np.sqrt(limit))
        score = np.nan_to_num((z / (scale * caution)) ** 2)
        better = score > best
        best[better], change[better], noise[better] = score[better], mean[better], (sigma * scale)[better]
    found = (best > limit) & (np.abs(change) >= options.least_ovality_change)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], found, [False]]).astype(np.int8))).reshape(-1, 2)
    rows = []
    for first, last in _joined(edges, round(2.0 / step)):
        top = first + int(np.argmax(best[first:last]))
        row = {"start_m": axis[first], "end_m": axis[last - 1], "peak_m": axis[top]}
        rows.append(row | {"ovality_change": pair.sign * change[top], "ovality_change_sigma": noise[top]})
    return rows


def _joined(edges: Floats, gap: int) -> list[tuple[int, int]]:
    out: list[tuple[int, int]] = []
    for first, last in edges:
        if out and first - out[-1][1] <= gap:
            out[-1] = out[-1][0], int(last)
        else:
            out.append((int(first), int(last)))
    return out


def _near(row: dict, dents: pd.DataFrame) -> str:
    if not len(dents):
        return ""
    own = dents[dents["reference_chainage_m"].between(row["start_m"] - 1.0, row["end_m"] + 1.0)]
    names = sorted(set(own.loc[own["status"].isin(["grown", "rerounded", "new"]), "dent_id"]))
    return f"at dent {', '.join(names)}, which changed" if names else ""
