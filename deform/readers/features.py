"""Rows of a listing that are neither weld, seam nor dent in, group ``features`` out: points, stretches, and steps of the wall."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import xarray as xr

from deform.readers import joints
from deform.readers.findings import Findings
from deform.readers.frame import Frame
from deform.run import build

_WALL_STEP_M = 0.0003
_NO_FEATURES = ("weld", "seam", "dent")
_TEXTS = ("kind", "text", "label")


def read_features(frame: Frame, welds: Frame, findings: Findings) -> xr.Dataset | None:
    """Return group ``features``, sorted by chainage; None when the listing has none.

    Parameters
    ----------
    frame : rows sorted by distance, with ``chainage`` and ``chainage_end``.
    welds : girth welds with ``chainage``, ``wall``, ``label``.
    findings : takes remarks about starts without an end.

    Notes
    -----
    Where the walls of the joints stand in the rows of the welds, each step of at least 0.3 mm becomes a ``wall_change``.
    """
    rows = frame.take(~np.isin(frame["kind"].astype(str), _NO_FEATURES))
    rows = rows.put({"label": joints.labels_at(welds, rows), "value": _values(rows)})
    rows = _stretches(rows, findings)
    names = (*_TEXTS, "direction", "chainage", "chainage_end", "clock", "value")
    steps = _wall_steps(rows, welds)
    joined = Frame(len(rows) + len(steps), {n: np.concatenate([rows[n], steps[n]]) for n in names}).sorted_by("chainage")
    if not len(joined):
        return None
    values = {name: joined[name] for name in ("chainage", *_TEXTS)}
    values |= {n: joined[n] for n in ("chainage_end", "clock", "value") if np.isfinite(joined[n]).any()}
    values |= {"direction": joined["direction"]} if (joined["direction"] != "").any() else {}
    return build.dataset("features", values)


def _values(rows: Frame) -> np.ndarray:
    """Size of each feature: angle of a bend (degree), wall after a change (metre), depth of metal loss (fraction of the wall)."""
    kind = rows["kind"].astype(str)
    loss = np.where(np.isfinite(rows["depth_wall"]), rows["depth_wall"], rows["depth"] / rows["wall"])
    sizes = {"bend": rows["bend_angle"], "wall_change": rows["wall"], "metal_loss": loss}
    return np.select([kind == k for k in sizes], list(sizes.values()), default=np.nan)


def _stretches(rows: Frame, findings: Findings) -> Frame:
    """Join the rows at which a stretch starts and ends; what has no partner stays a point and is counted."""
    open_: dict[str, list[int]] = defaultdict(list)
    lost = []
    keep, end = np.ones(len(rows), bool), rows["chainage_end"].copy()
    for i, (part, pair) in enumerate(zip(rows["part"], rows["pair"], strict=True)):
        if part == "start":
            open_[pair].append(i)
        elif part == "end" and open_[pair]:
            end[open_[pair].pop()] = rows["chainage"][i]
            keep[i] = False
        elif part == "end":
            lost.append(i)
    lost += [i for several in open_.values() for i in several]
    if lost:
        first = f"line {rows['line'][min(lost)]} ({rows['text'][min(lost)]})"
        findings.repair("", "rows", f"{len(lost)} starts or ends of a stretch have no partner, first {first}; kept as points")
    return rows.put({"chainage_end": end}).take(keep)


def _wall_steps(rows: Frame, welds: Frame) -> Frame:
    wall = welds["wall"]
    stated = bool((rows["kind"] == "wall_change").any())
    at = np.array([], int) if stated else np.flatnonzero(np.abs(np.diff(wall)) >= _WALL_STEP_M) + 1
    words = [f"wall {a * 1e3:.2f} mm, then {b * 1e3:.2f} mm" for a, b in zip(wall[at - 1], wall[at], strict=True)]
    texts = {"kind": ["wall_change"] * at.size, "direction": [""] * at.size, "text": words}
    columns = {name: np.array(column, dtype=object) for name, column in texts.items()}
    columns |= {"chainage": welds["chainage"][at], "value": wall[at], "label": welds["label"][at]}
    return Frame(at.size, columns | {name: np.full(at.size, np.nan) for name in ("chainage_end", "clock")})
