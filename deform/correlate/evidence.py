"""Walls, seams, fittings, labels and locked pairs of two weld lists in, what they say about each pair of welds out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from deform.correlate._kernels import Evidence
from deform.correlate.weld_list import WeldList
from deform.errors import Fault, InputError

_CLASSES = 12  # walls beyond so many are measured, not nominal: they are no classes
_WALL_STEP = 0.0004  # metre; vendors round the same nominal wall differently
_MOST, _LEAST = 20.0, 0.1  # no single hint may weigh more, for or against
_INT, _FLOAT = np.empty(0, np.int64), np.empty(0)
LOCK_COLUMNS = ("run_a", "index_a", "run_b", "index_b", "kind")


@dataclass(frozen=True)
class Traits:
    """What is known of the joint that begins at each weld: wall (metre), seam clock (degree), fitting, label."""

    wall: np.ndarray
    seam: np.ndarray
    fitting: np.ndarray
    label: np.ndarray

    @staticmethod
    def of(welds: WeldList) -> Traits:
        """Traits of a weld list."""
        return Traits(welds.wall, welds.seam, welds.fitting, welds.label)

    def turned(self) -> Traits:
        """Traits of the list read the other way: another joint begins at each weld, clocks are mirrored."""

        def turn(values: np.ndarray, absent) -> np.ndarray:
            return np.concatenate([values[:-1][::-1], np.asarray([absent], values.dtype)])

        return Traits(
            turn(self.wall, np.nan), turn((360.0 - self.seam) % 360.0, np.nan), turn(self.fitting, ""), turn(self.label, "")
        )


@dataclass(frozen=True)
class Locks:
    """Pairs of welds (places in the two lists) that must be one weld, and that must not."""

    locked: np.ndarray
    forbidden: np.ndarray

    def turned(self, m: int) -> Locks:
        """The same with list B read the other way."""
        flip = np.asarray([0, m - 1]), np.asarray([1, -1])
        return Locks(flip[0] + flip[1] * self.locked, flip[0] + flip[1] * self.forbidden)


def read_locks(path: Path) -> pd.DataFrame:
    """Read locked and forbidden pairs: CSV with ``run_a,index_a,run_b,index_b,kind``; kind is ``lock`` or ``forbid``.

    Raises
    ------
    InputError
        When a column is missing or a kind is neither.
    """
    return check_locks(pd.read_csv(path, dtype={"run_a": str, "run_b": str}), str(path))


def check_locks(locks: pd.DataFrame, where: str = "locks") -> pd.DataFrame:
    """Return the table of locks when its columns and kinds are right; else raise `InputError` with every fault."""
    absent = [c for c in LOCK_COLUMNS if c not in locks]
    faults = [Fault(where, c, f"is missing; wanted are {', '.join(LOCK_COLUMNS)}") for c in absent]
    if not absent:
        faults += [
            Fault(where, f"row {k}", f"has kind {kind!r}; it is lock or forbid")
            for k, kind in enumerate(locks["kind"])
            if kind not in ("lock", "forbid")
        ]
    if faults:
        raise InputError(faults)
    return locks


def locks_between(locks: pd.DataFrame | None, a: WeldList, b: WeldList) -> Locks:
    """Return the locks between two runs as places in their lists.

    Raises
    ------
    InputError
        When an index is not in the run, one weld is locked twice, or locked pairs cross each other.
    """
    empty = np.empty((0, 2), np.int64)
    if locks is None or not len(locks):
        return Locks(empty, empty)
    place_a, place_b = ({int(i): k for k, i in enumerate(w.index)} for w in (a, b))
    found: dict[str, list[tuple[int, int]]] = {"lock": [], "forbid": []}
    faults = []
    for row in locks.itertuples():
        ends = {str(row.run_a): int(str(row.index_a)), str(row.run_b): int(str(row.index_b))}
        if set(ends) != {a.run, b.run}:
            continue
        if ends[a.run] not in place_a or ends[b.run] not in place_b:
            rule = (
                f"welds {ends[a.run]} of {a.run} and {ends[b.run]} of {b.run}: an index is not in the run's list, or is a double"
            )
            faults.append(Fault("locks", f"row {row.Index}", rule))
            continue
        found[str(row.kind)].append((place_a[ends[a.run]], place_b[ends[b.run]]))
    locked = np.asarray(sorted(set(found["lock"])), np.int64).reshape(-1, 2)
    step = np.diff(locked, axis=0)
    if (step == 0).any():
        faults.append(Fault("locks", f"{a.run} and {b.run}", "one weld is locked to two"))
    elif step.size and not ((step[:, 1] > 0).all() or (step[:, 1] < 0).all()):
        faults.append(
            Fault("locks", f"{a.run} and {b.run}", "locked pairs cross each other; welds keep their order along a line")
        )
    both = set(found["lock"]) & set(found["forbid"])
    faults += [
        Fault("locks", f"{a.run} and {b.run}", f"weld {a.index[i]} and weld {b.index[j]} are locked and forbidden")
        for i, j in both
    ]
    if faults:
        raise InputError(faults)
    return Locks(locked, np.asarray(found["forbid"], np.int64).reshape(-1, 2))


def from_locks(locks: Locks | None, n: int, m: int) -> Evidence:
    """Evidence of the locked and forbidden pairs alone."""
    nothing = Evidence(False, _INT, _INT, np.ones((1, 1)), _INT, _INT, 1.0, 1.0, _FLOAT, _FLOAT, 1.0, _INT, _INT, _INT, _INT)
    if locks is None or not (locks.locked.size or locks.forbidden.size):
        return nothing
    lock_a, lock_b = np.full(n, -1, np.int64), np.full(m, -1, np.int64)
    lock_a[locks.locked[:, 0]], lock_b[locks.locked[:, 1]] = locks.locked[:, 1], locks.locked[:, 0]
    order = np.argsort(locks.forbidden[:, 0], kind="stable")
    start = np.searchsorted(locks.forbidden[order, 0], np.arange(n + 1)).astype(np.int64)
    return nothing._replace(
        lock_a=lock_a,
        lock_b=lock_b,
        forbid_start=start,
        forbid=locks.forbidden[order, 1].astype(np.int64),
    )


def learn(base: Evidence, a: Traits, b: Traits, partner: np.ndarray) -> Evidence:
    """Add what walls, fittings, labels and seams say, weighed by how well they agree on the welds that the lengths pair.

    Parameters
    ----------
    partner : weld of B for each weld of A on the best path, -1 none.

    Notes
    -----
    A trait that does not agree on the pairs of the lengths, such as numbers given anew, gets a ratio near one; the ratios are
    bounded (0.1 to 20), so that the lengths can overrule each of them. The seam's one unknown roll is the circular mean of the
    differences.
    """
    i = np.flatnonzero(partner >= 0)
    j = partner[i]
    if i.size < 20:
        return base
    class_a, class_b, ratio = _classes(a, b, i, j)
    label_a, label_b, same, other = _labels(a.label, b.label, i, j)
    seam_a, seam_b, sigma = _seams(a.seam, b.seam, i, j)
    if ratio.size == 1 and not label_a.size and not seam_a.size:
        return base
    return base._replace(
        used=True,
        class_a=class_a,
        class_b=class_b,
        ratio=ratio,
        label_a=label_a,
        label_b=label_b,
        label_same=same,
        label_other=other,
        seam_a=seam_a,
        seam_b=seam_b,
        seam_sigma=sigma,
    )


def _classes(a: Traits, b: Traits, i, j):
    """Classes of wall and fitting, and the likelihood ratio of each pair of classes."""
    wall_a, wall_b = _wall_classes(a.wall, b.wall)
    words = sorted({*a.fitting, *b.fitting})
    code = {w: k for k, w in enumerate(words)}
    count = len(words)
    class_a = wall_a * count + np.asarray([code[w] for w in a.fitting], np.int64)
    class_b = wall_b * count + np.asarray([code[w] for w in b.fitting], np.int64)
    used = np.unique(np.concatenate([class_a, class_b]))
    class_a, class_b = np.searchsorted(used, class_a), np.searchsorted(used, class_b)
    k = used.size
    if k == 1:
        return class_a, class_b, np.ones((1, 1))
    share_a, share_b = (np.bincount(c, minlength=k) / c.size for c in (class_a, class_b))
    chance = np.outer(share_a, share_b)
    together = np.zeros((k, k))
    np.add.at(together, (class_a[i], class_b[j]), 1.0)
    prior = 10.0
    ratio = (together + prior * chance) / (i.size + prior) / np.maximum(chance, 1e-12)
    unknown = used // count == 0
    ratio = np.clip(ratio, _LEAST, _MOST)
    ratio[np.ix_(unknown, unknown)] = np.clip(ratio[np.ix_(unknown, unknown)], 0.5, _MOST)
    return class_a, class_b, ratio


def _wall_classes(a: np.ndarray, b: np.ndarray):
    """Class of each wall, 0 where not known; all 0 when the walls are measured, not nominal."""
    values = np.unique(np.round(np.concatenate([a, b])[np.isfinite(np.concatenate([a, b]))], 5))
    starts = np.concatenate([[0.0], values[1:][np.diff(values) > _WALL_STEP]]) if values.size else np.zeros(1)
    if starts.size > _CLASSES or values.size == 0:
        return np.zeros(a.size, np.int64), np.zeros(b.size, np.int64)
    return tuple(
        np.where(np.isfinite(w), np.searchsorted(starts, np.nan_to_num(w) + 1e-9, side="right"), 0).astype(np.int64)
        for w in (a, b)
    )


def _labels(a: np.ndarray, b: np.ndarray, i, j):
    known = sorted(({*a} & {*b}) - {""})
    if len(known) < 10:
        return _INT, _INT, 1.0, 1.0
    code = {w: k for k, w in enumerate(known)}
    other_code = len(known)
    label_a, label_b = (
        np.asarray([-1 if w == "" else code.get(w, other_code + s) for w in v], np.int64) for s, v in ((0, a), (1, b))
    )
    both = (label_a[i] >= 0) & (label_b[j] >= 0)
    agree = float(np.mean(label_a[i][both] == label_b[j][both])) if both.any() else 0.0
    ratio = np.clip(agree * len(known) / 5.0, 1.0, _MOST)  # a fifth of the evidence: numbers are reused on new pipe
    return label_a, label_b, float(ratio), float(np.clip(1.2 - agree, 0.3, 1.0))


def _seams(a: np.ndarray, b: np.ndarray, i, j):
    difference = np.radians(b[j] - a[i])
    difference = difference[np.isfinite(difference)]
    if difference.size < 20:
        return _FLOAT, _FLOAT, 1.0
    mean = np.exp(1j * difference).mean()
    if abs(mean) < 0.3:  # the seams do not go together: clocks of two rolls, or not of seams
        return _FLOAT, _FLOAT, 1.0
    roll = np.degrees(np.angle(mean))
    turned = (b - roll) % 360.0
    apart = np.abs((turned[j] - a[i] + 180.0) % 360.0 - 180.0)
    sigma = float(np.clip(np.nanmedian(apart) / 0.7649, 3.0, 40.0))
    return np.asarray(a, float), turned, sigma
