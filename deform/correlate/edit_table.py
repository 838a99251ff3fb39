"""The history of the welds in, the table of edits out: cut-outs, re-routes, missed, false and shifted welds, ends of runs."""

from __future__ import annotations

import numpy as np
import pandas as pd

from deform.correlate.edits import History, column_ids

COLUMNS = ["kind", "run", "first_weld", "last_weld", "start_m", "end_m", "n_old", "n_new", "reason"]


def edit_table(history: History, welds: pd.DataFrame) -> pd.DataFrame:
    """Return one row per edit of the line or of a list.

    Parameters
    ----------
    welds : rows of ``tables/welds.csv``.

    Notes
    -----
    ``run`` is the run in which the edit is seen first; ``first_weld`` and ``last_weld`` are the welds that both runs have at its
    ends; ``start_m`` and ``end_m`` are reference chainage; ``n_old`` and ``n_new`` count joints.
    """
    rows = _replaced(history) + _single(welds) + _ends(history)
    return pd.DataFrame(rows, columns=COLUMNS)


def _replaced(history: History) -> list[dict]:
    ids, place, lists = column_ids(history), history.registry.place, history.lists
    return [
        {
            "kind": c.kind,
            "run": lists[c.after].run,
            "first_weld": ids[c.first],
            "last_weld": ids[c.last],
            "start_m": place[c.first],
            "end_m": place[c.last],
            "n_old": c.n_old,
            "n_new": c.n_new,
            "reason": f"{c.n_old} joints ({c.length_old:.2f} m) in {lists[c.before].run}, "
            f"{c.n_new} ({c.length_new:.2f} m) in {lists[c.after].run}",
        }
        for c in history.changes
    ]


def _single(welds: pd.DataFrame) -> list[dict]:
    chosen = welds[welds["status"].isin(["missed", "false", "shifted"])]
    return [
        {
            "kind": w.status,
            "run": w.run,
            "first_weld": w.weld_id,
            "last_weld": w.weld_id,
            "start_m": w.reference_chainage_m,
            "end_m": w.reference_chainage_m,
            "n_old": 0,
            "n_new": 0,
            "reason": w.reason,
        }
        for w in chosen.itertuples()
    ]


def _ends(history: History) -> list[dict]:
    """Where a run begins or ends within the line of the others."""
    ids, place, member = column_ids(history), history.registry.place, history.registry.member
    rows = []
    for r, welds in enumerate(history.lists):
        have = np.flatnonzero(member[:, r] >= 0)
        for column, side, beyond in ((have[0], "begins", have[0]), (have[-1], "ends", place.size - 1 - have[-1])):
            if not beyond:
                continue
            far = place[0] if side == "begins" else place[-1]
            rows.append(
                {
                    "kind": "ends",
                    "run": welds.run,
                    "first_weld": ids[column],
                    "last_weld": ids[column],
                    "start_m": min(far, place[column]),
                    "end_m": max(far, place[column]),
                    "n_old": int(beyond),
                    "n_new": 0,
                    "reason": f"the run {side} here; other runs have {beyond} more welds",
                }
            )
    return rows
