"""Posteriors of all pairs of runs in, one ordered list of welds through all runs out: what is one weld has one column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from deform.correlate._seed_kernels import heaviest_chain
from deform.correlate.weld_list import WeldList


@dataclass(frozen=True)
class Registry:
    """Welds of a line through all runs, in the order of the line.

    Attributes
    ----------
    member : (c, runs) place of the weld in each run's weld list, -1 where the run does not have it.
    probability : (c, runs) posterior that the run's weld is the weld of the column, NaN where it has none or nobody else has it.
    place : (c) reference chainage, metre, rising; proportional between common welds where the reference has none.
    """

    member: np.ndarray
    probability: np.ndarray
    place: np.ndarray


Posteriors = dict[tuple[int, int], sparse.csr_matrix]


def merge(lists: list[WeldList], posteriors: Posteriors, reference: int, scales: dict[int, float], least: float) -> Registry:
    """Merge all runs into one registry in which every cycle closes.

    Parameters
    ----------
    lists : weld lists.
    posteriors : for pairs (a, b) with a < b the matrix (welds of a, welds of b).
    reference : which list carries the axis.
    scales : signed scale of each run against the reference (negative when its chainage runs the other way).
    least : posterior that a weld needs to join a column.

    Notes
    -----
    The posteriors of each pair are first made consistent through all third runs that have the weld (the consistency
    transformation of multiple alignment, Do et al. 2005, Genome Research 15, 330, eq. 5, weighted by the probability that the
    third run has the weld at all). Then run after run joins the list by the heaviest chain that keeps the order of both, so no
    weld can have two columns, and no cycle stays open.
    """
    full = _both_ways(consistent(posteriors, [w.n for w in lists]))
    member = np.full((lists[reference].n, len(lists)), -1, np.int64)
    member[:, reference] = np.arange(lists[reference].n)
    place = lists[reference].place.copy()
    for r in _order(full, reference, len(lists)):
        member, place = _join(member, place, r, lists[r].place, full, scales[r], least)
    return Registry(member, _probabilities(member, full), place)


def consistent(posteriors: Posteriors, sizes: list[int]) -> Posteriors:
    """Posteriors of all pairs after one round through every third run (csr matrices, pairs (a, b) with a < b)."""
    full = _both_ways(posteriors)
    has = {key: np.asarray(p.sum(axis=1)).ravel().clip(0, 1) for key, p in full.items()}
    result = {}
    for (a, b), direct in posteriors.items():
        thirds = [c for c in range(len(sizes)) if c not in (a, b) and (a, c) in full and (c, b) in full]
        if not thirds:
            result[a, b] = direct
            continue
        through, weight_a, weight_b = 2.0 * direct, np.zeros(sizes[a]), np.zeros(sizes[b])
        for c in thirds:
            through = through + full[a, c] @ full[c, b]
            weight_a, weight_b = weight_a + has[a, c], weight_b + has[b, c]
        through = through.tocoo()
        total = 2.0 + np.maximum(weight_a[through.row], weight_b[through.col])
        value = through.data / total
        kept = value > 1e-3
        result[a, b] = sparse.csr_matrix((value[kept], (through.row[kept], through.col[kept])), shape=direct.shape)
    return result


def _both_ways(posteriors: Posteriors) -> Posteriors:
    return {**posteriors, **{(b, a): p.T.tocsr() for (a, b), p in posteriors.items()}}


def _order(full: Posteriors, reference: int, n: int) -> list[int]:
    """Runs in the order in which they join: always the one that has most in common with those that are in."""
    inside, outside = [reference], [r for r in range(n) if r != reference]
    order = []
    while outside:
        best = max(outside, key=lambda r: (max((full[q, r].sum() for q in inside if (q, r) in full), default=0.0), -r))
        outside.remove(best)
        inside.append(best)
        order.append(best)
    return order


def _scores(member: np.ndarray, r: int, full: Posteriors, n: int) -> sparse.coo_matrix:
    """Mean posterior of (column, weld of run r) over the members of the column."""
    total, count = None, np.zeros(member.shape[0])
    for q in range(member.shape[1]):
        if q == r or (q, r) not in full:
            continue
        rows = np.flatnonzero(member[:, q] >= 0)
        if not rows.size:
            continue
        select = sparse.csr_matrix((np.ones(rows.size), (rows, member[rows, q])), shape=(member.shape[0], full[q, r].shape[0]))
        part = select @ full[q, r]
        total = part if total is None else total + part
        count[rows] += 1
    if total is None:
        return sparse.coo_matrix((member.shape[0], n))
    total = total.tocoo()
    return sparse.coo_matrix((total.data / np.maximum(count[total.row], 1), (total.row, total.col)), shape=total.shape)


def _join(member, place, r, own, full, scale, least):
    """Add run r: each of its welds to its column, or as a new column between those of its neighbours."""
    n = own.size
    turned = scale < 0
    score = _scores(member, r, full, n)
    kept = np.flatnonzero(score.data > least)
    col, weld, weight = score.row[kept].astype(np.int64), score.col[kept].astype(np.int64), score.data[kept]
    ranked = n - 1 - weld if turned else weld
    order = np.lexsort((-ranked, col))
    col, ranked, weight = col[order], ranked[order], weight[order]
    chain = heaviest_chain(col, ranked, weight, n) if col.size else np.empty(0, np.int64)
    column_of = np.full(n, -1, np.int64)
    column_of[ranked[chain]] = col[chain]
    forward = own[::-1] * -1.0 if turned else own
    new_place = _places(forward, column_of, place, abs(scale))
    weld_of = np.arange(n)[::-1] if turned else np.arange(n)
    member = member.copy()
    known = column_of >= 0
    member[column_of[known], r] = weld_of[known]
    extra = np.full((int((~known).sum()), member.shape[1]), -1, np.int64)
    extra[:, r] = weld_of[~known]
    member, place = np.vstack([member, extra]), np.concatenate([place, new_place[~known]])
    order = np.argsort(place, kind="stable")
    return member[order], place[order]


def _places(own, column_of, place, scale):
    """Reference chainage of every weld of a run (forward order): of its column, or proportional between its neighbours."""
    known = np.flatnonzero(column_of >= 0)
    if not known.size:
        return place[-1] + 1.0 + (own - own[0]) / scale
    x, y = own[known], place[column_of[known]]
    at = np.interp(own, x, y)
    at = np.where(own < x[0], y[0] + (own - x[0]) / scale, at)
    return np.where(own > x[-1], y[-1] + (own - x[-1]) / scale, at)


def _probabilities(member: np.ndarray, full: Posteriors) -> np.ndarray:
    """Mean posterior of each member with the other members of its column."""
    total, count = np.zeros(member.shape), np.zeros(member.shape)
    for (a, b), p in full.items():
        rows = np.flatnonzero((member[:, a] >= 0) & (member[:, b] >= 0))
        if rows.size:
            total[rows, a] += np.asarray(p[member[rows, a], member[rows, b]]).ravel()
            count[rows, a] += 1
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, total / count, np.nan)
