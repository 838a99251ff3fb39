"""An alignment of two runs in, its stretches of unchanged pipe out, and how much each outweighs the next best alignment."""

from __future__ import annotations

from typing import Any

import numpy as np

from deform.correlate._kernel_sweeps import ahead
from deform.correlate._kernel_types import Band, Evidence
from deform.correlate.alignment import Frame, PairAlignment
from deform.correlate.weld_list import WeldList

_AROUND = 60  # welds of neighbouring pipe on each side that may take part in another alignment


def stretch_rows(pair: PairAlignment, a: WeldList, b: WeldList) -> list[dict[str, Any]]:
    """Rows of ``tables/stretches.csv`` for a pair of runs.

    Notes
    -----
    A stretch ends where pipe was replaced between two pairs: where both runs list welds between them that have no partner.
    ``margin_nats`` is the log weight of the best alignment minus that of the best one which pairs no weld of the stretch as the
    best one does, both over the stretch and 60 welds on each side, within the band of the posteriors (4 welds on each
    side of the best path): rivals further off do not count. A locked pair adds 41 nats, which is no evidence.
    ``least_probability`` is that of its least certain weld. A margin below some 7 nats (odds of a thousand) wants a look.
    """
    at = np.flatnonzero(pair.partner >= 0)
    if not at.size:
        return []
    best = np.zeros(a.n)
    np.maximum.at(best, pair.i, pair.posterior)
    of = pair.partner[at]
    broken = (np.diff(at) > 1) & (np.abs(np.diff(of)) > 1)
    starts, ends = np.concatenate([[0], np.flatnonzero(broken) + 1]), np.concatenate([np.flatnonzero(broken), [at.size - 1]])
    rows = []
    for s, e in zip(starts, ends, strict=True):
        held = slice(s, e + 1)
        rows.append(
            {
                "run_a": a.run,
                "run_b": b.run,
                "first_index_a": int(a.index[at[s]]),
                "last_index_a": int(a.index[at[e]]),
                "first_index_b": int(b.index[of[s]]),
                "last_index_b": int(b.index[of[e]]),
                "start_a_m": float(a.place[at[s]]),
                "end_a_m": float(a.place[at[e]]),
                "welds": int(e - s + 1),
                "margin_nats": margin(pair.frame, at[held], _columns(pair, of[held], b.n)),
                "least_probability": float(best[at[held]].min()),
            }
        )
    return rows


def _columns(pair: PairAlignment, of: np.ndarray, m: int) -> np.ndarray:
    return of if pair.direction > 0 else m - 1 - of


def margin(frame: Frame, rows: np.ndarray, columns: np.ndarray) -> float:
    """Log weight of the best alignment minus that of the best one without any of these pairs, about them (nats)."""
    strip, lists, ev = frame.strip, frame.lists, frame.evidence
    r0, r1 = max(int(rows[0]) - _AROUND, 0), min(int(rows[-1]) + _AROUND + 1, strip.low.size)
    c0, c1, o = int(strip.low[r0]), int(strip.high[r1 - 1]) + 1, strip.offset[r0 : r1 + 1]
    part = Band(strip.low[r0:r1] - c0, strip.high[r0:r1] - c0, o - o[0])
    cut = lists._replace(
        x=lists.x[r0:r1],
        y=lists.y[c0:c1],
        inv_a=lists.inv_a[r0:r1],
        inv_b=lists.inv_b[c0:c1],
        fresh=lists.fresh[c0:c1],
        closing=lists.closing[c0:c1],
    )
    joint = ev.joint[o[0] : o[-1]] if ev.joint.size else ev.joint
    weld = ev.weld[o[0] : o[-1]].copy() if ev.weld.size else np.ones(o[-1] - o[0], np.float32)
    held = ahead(cut, part, frame.rates, Evidence(weld, joint), True)[3]
    inside = (columns >= strip.low[rows]) & (columns <= strip.high[rows])
    weld[(strip.offset[rows] + columns - strip.low[rows])[inside] - o[0]] = 0.0
    other = ahead(cut, part, frame.rates, Evidence(weld, joint), True)[3]
    return float(held - max(other, 0.0))  # 0 is the weight of two strangers
