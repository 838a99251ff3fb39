"""Walls, seams, bends, fittings, labels, markers and locks of two weld lists in, their weight for each pair of welds out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from deform.correlate._kernel_evidence import LEAST, MOST, SEAM_STEP, Hints, weigh_joints, weigh_welds
from deform.correlate._kernel_moves import student
from deform.correlate._kernel_types import NOTHING, Band, Evidence
from deform.correlate.weld_list import WeldList
from deform.errors import Fault, InputError

_CLASSES = 12  # walls beyond so many are measured, not nominal: they are no classes
_WALL_STEP = 0.0004  # metre; vendors round the same nominal wall differently
_FEW = 20  # pairs from which a trait is learned
_APART = (-5, -4, -3, -2, 2, 3, 4, 5)  # joints; how far off the strangers are that a trait is weighed against
_PRIOR = 10.0  # pairs of strangers as good as the shares of the classes
_MARK_M = 30.0  # metre; markers of two runs that stand further apart are two
_INT, _FLOAT = np.empty(0, np.int64), np.empty(0)
LOCK_COLUMNS = ("run_a", "index_a", "run_b", "index_b", "kind")


@dataclass(frozen=True)
class Traits:
    """What is known of the joint that begins at each weld, and of the markers along a run.

    Attributes
    ----------
    wall : metre, NaN unknown (n).
    seam : clock, degree, NaN unknown (n).
    fitting : what stands in the joint, bends with the way they turn, in words (n).
    bend : angle, degree, NaN where straight (n).
    label : vendor's number (n).
    mark_name, mark_at : name of each marker, and where it stands as a fractional place in the weld list.
    """

    wall: np.ndarray
    seam: np.ndarray
    fitting: np.ndarray
    bend: np.ndarray
    label: np.ndarray
    mark_name: np.ndarray
    mark_at: np.ndarray

    @staticmethod
    def of(welds: WeldList) -> Traits:
        """Traits of a weld list."""
        known = zip(welds.fitting, welds.bend, welds.bend_clock, strict=True)
        fitting = np.asarray([w + _turns(clock) if np.isfinite(angle) else w for w, angle, clock in known], object)
        return Traits(welds.wall, welds.seam, fitting, welds.bend, welds.label, welds.mark_name, welds.mark_at)

    def turned(self) -> Traits:
        """Traits of the list read the other way: another joint begins at each weld, clocks are mirrored."""

        def turn(values: np.ndarray, absent) -> np.ndarray:
            return np.concatenate([values[:-1][::-1], np.asarray([absent], values.dtype)])

        mirrored = np.asarray([w.translate(_MIRROR) for w in self.fitting], object)
        return Traits(
            wall=turn(self.wall, np.nan),
            seam=turn((360.0 - self.seam) % 360.0, np.nan),
            fitting=turn(mirrored, ""),
            bend=turn(self.bend, np.nan),
            label=turn(self.label, ""),
            mark_name=self.mark_name[::-1],
            mark_at=self.wall.size - 1 - self.mark_at[::-1],
        )


_MIRROR = str.maketrans("<>", "><")


def _turns(clock: float) -> str:
    """A bend as a word: to the right, down, to the left, up, or of unknown plane."""
    return " bend" + ("^>v<"[int(((clock + 45.0) % 360.0) // 90.0)] if np.isfinite(clock) else "")


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


def from_locks(locks: Locks | None, n: int, m: int) -> Hints:
    """Hints of the locked and forbidden pairs alone."""
    none = np.empty((0, 0), np.int64)
    hints = Hints(
        *(none, none, np.empty((0, 0, 0)), _INT, _INT, 1.0, 1.0, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, 1.0, 1.0),
        *(np.empty((0, 2)), _FLOAT, 1.0, _INT, _INT, _INT, _INT),
    )
    if locks is None or not (locks.locked.size or locks.forbidden.size):
        return hints
    lock_a, lock_b = np.full(n, -1, np.int64), np.full(m, -1, np.int64)
    lock_a[locks.locked[:, 0]], lock_b[locks.locked[:, 1]] = locks.locked[:, 1], locks.locked[:, 0]
    order = np.argsort(locks.forbidden[:, 0], kind="stable")
    start = np.searchsorted(locks.forbidden[order, 0], np.arange(n + 1)).astype(np.int64)
    forbid = locks.forbidden[order, 1].astype(np.int64)
    return hints._replace(lock_a=lock_a, lock_b=lock_b, forbid_start=start, forbid=forbid)


def over_band(hints: Hints, strip: Band, y: np.ndarray) -> Evidence:
    """Weight of the hints in every cell of a band; ``y`` are the welds of B, metre."""
    joints = hints.class_a.size or hints.label_a.size or hints.seam_a.size or hints.bend_a.size
    welds = hints.lock_a.size or hints.mark_a.size
    if not (joints or welds):
        return NOTHING
    spacing = float(np.median(np.diff(y)))
    return Evidence(
        weigh_welds(*strip, y, spacing, hints) if welds else NOTHING.weld,
        weigh_joints(*strip, hints) if joints else NOTHING.joint,
    )


def learn(base: Hints, a: Traits, b: Traits, x: np.ndarray, y: np.ndarray, partner: np.ndarray) -> Hints:
    """Add what the traits say, each weighed by how well it agrees on the welds that the lengths pair.

    Parameters
    ----------
    x, y : welds of A and of B on one scale, metre.
    partner : weld of B for each weld of A on the best path, -1 none.

    Notes
    -----
    A trait that does not agree on the pairs of the lengths, such as numbers given anew, gets a ratio near one; the ratios are
    bounded (`LEAST` to `MOST`), so that the lengths can overrule each of them. The seam's one unknown roll is the circular mean
    of the differences.
    """
    i = np.flatnonzero(partner >= 0)
    j = partner[i]
    if i.size < _FEW:
        return base
    pairs = _wall_classes(a.wall, b.wall), _words(a.fitting, b.fitting)
    known = [c for of_a, of_b in pairs if (c := _classes(of_a, of_b, i, j)) is not None]
    if known:
        most = max(ratio.shape[0] for _, _, ratio in known)
        ratio = np.ones((len(known), most, most))
        for k, (_, _, part) in enumerate(known):
            ratio[k, : part.shape[0], : part.shape[0]] = part
        base = base._replace(class_a=np.asarray([c[0] for c in known]), class_b=np.asarray([c[1] for c in known]), ratio=ratio)
    label_a, label_b, same, other = _labels(a.label, b.label, i, j)
    seam_a, seam_b, seam_ratio = _seams(a.seam, b.seam, i, j)
    bend_a, bend_b, bend_sigma, spread = _bends(a.bend, b.bend, i, j)
    mark_a, mark_b, mark_sigma = _marks(a, b, x, y, i, j)
    return base._replace(
        label_a=label_a,
        label_b=label_b,
        label_same=same,
        label_other=other,
        seam_a=seam_a,
        seam_b=seam_b,
        seam_ratio=seam_ratio,
        bend_a=bend_a,
        bend_b=bend_b,
        bend_sigma=bend_sigma,
        bend_spread=spread,
        mark_a=mark_a,
        mark_b=mark_b,
        mark_sigma=mark_sigma,
    )


def _strangers(i: np.ndarray, j: np.ndarray, n: int, m: int):
    """Pairs of joints that are not one but lie near each other: what new pipe, or a match some joints off, would show."""
    for apart in _APART:
        there = (j + apart >= 0) & (j + apart < m)
        yield i[there], j[there] + apart


def _classes(class_a, class_b, i, j):
    """Classes, 0 unknown, and the likelihood ratio of each pair of them; None where all joints are of one class.

    Notes
    -----
    Strangers are joints that lie near each other: walls come in spells, and to agree with the wall around proves little.
    """
    used = np.unique(np.concatenate([class_a, class_b]))
    k = int(used[-1]) + 1
    if used.size == 1 or not (class_a > 0).any() or not (class_b > 0).any():
        return None
    share_a, share_b = (np.bincount(c, minlength=k) / c.size for c in (class_a, class_b))
    apart, together = np.outer(share_a, share_b) * _PRIOR, np.zeros((k, k))
    for p, q in _strangers(i, j, class_a.size, class_b.size):
        np.add.at(apart, (class_a[p], class_b[q]), 1.0)
    apart /= apart.sum()
    np.add.at(together, (class_a[i], class_b[j]), 1.0)
    ratio = (together + _PRIOR * apart) / (i.size + _PRIOR) / np.maximum(apart, 1e-12)
    return class_a, class_b, np.clip(ratio, LEAST, MOST)


def _wall_classes(a: np.ndarray, b: np.ndarray):
    """Class of each wall, 0 where not known; all 0 when the walls are measured, not nominal."""
    both = np.concatenate([a, b])
    values = np.unique(np.round(both[np.isfinite(both)], 5))
    starts = np.concatenate([[0.0], values[1:][np.diff(values) > _WALL_STEP]]) if values.size else np.zeros(1)
    if starts.size > _CLASSES or values.size == 0:
        return np.zeros(a.size, np.int64), np.zeros(b.size, np.int64)
    return tuple(
        np.where(np.isfinite(w), np.searchsorted(starts, np.nan_to_num(w) + 1e-9, side="right"), 0).astype(np.int64)
        for w in (a, b)
    )


def _words(a: np.ndarray, b: np.ndarray):
    """Class of each word, that of no word first; all 0 where one of the runs has none."""
    code = {w: k for k, w in enumerate(sorted({"", *a, *b}))}
    return tuple(np.asarray([code[w] for w in v], np.int64) for v in (a, b))


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
    ratio = np.clip(agree * len(known) / 5.0, 1.0, MOST)  # a fifth of the evidence: numbers are reused on new pipe
    return label_a, label_b, float(ratio), float(np.clip(1.2 - agree, 0.3, 1.0))


def _seams(a: np.ndarray, b: np.ndarray, i, j):
    """Clocks of the seams, those of B turned by the one unknown roll, and the likelihood ratio of their differences.

    Notes
    -----
    One joint: Student's t about zero, and a share of clocks that are of no use. Strangers: the differences between joints that
    lie near each other, so that seams which all lie on one side, or alternate, say no more than they can.
    """
    none = _FLOAT, _FLOAT, _FLOAT
    difference = np.radians(b[j] - a[i])
    difference = difference[np.isfinite(difference)]
    if difference.size < _FEW:
        return none
    turned = (b - np.degrees(np.angle(np.exp(1j * difference).mean()))) % 360.0
    for _ in range(2):  # a few wrong clocks pull the mean, not the median
        apart = (turned[j] - a[i] + 180.0) % 360.0 - 180.0
        turned = (turned - float(np.nanmedian(apart))) % 360.0
    same = np.abs(apart[np.isfinite(apart)])
    sigma = float(np.clip(np.median(same) / 0.69, 2.0, 60.0))
    wrong = float(np.clip(np.mean(same > 5.0 * sigma) * 180.0 / max(180.0 - 5.0 * sigma, 20.0), LEAST, 1.0))
    others = np.concatenate([np.abs((turned[q] - a[p] + 180.0) % 360.0 - 180.0) for p, q in _strangers(i, j, a.size, b.size)])
    edges = np.arange(0.0, 181.0, SEAM_STEP)
    null = np.histogram(others[np.isfinite(others)], edges)[0] + _PRIOR / edges.size
    null = uniform_filter1d(null / null.sum() / SEAM_STEP, 9, mode="nearest")  # over 18 degree
    middle = 0.5 * (edges[1:] + edges[:-1])
    one = (1.0 - wrong) * 2.0 * np.asarray([student(d, sigma, 3) for d in middle]) + wrong / 180.0
    ratio = np.clip(one / null, LEAST, MOST)
    return np.asarray(a, float), turned, np.append(ratio, ratio[-1])


def _bends(a: np.ndarray, b: np.ndarray, i, j):
    """Angles of the bends, the scale of their differences and the range they have, degree."""
    difference = b[j] - a[i]
    difference = difference[np.isfinite(difference)]
    if difference.size < _FEW:
        return _FLOAT, _FLOAT, 1.0, 1.0
    low, high = np.nanquantile(np.concatenate([a, b]), [0.1, 0.9])
    sigma = float(max(np.median(np.abs(difference)) / 0.7649, 0.3))
    return np.asarray(a, float), np.asarray(b, float), sigma, float(max(1.25 * (high - low), sigma))


def _marks(a: Traits, b: Traits, x: np.ndarray, y: np.ndarray, i, j):
    """Markers that both runs name alike: the first weld of A after each, how far it stands, and the place in B, metre."""
    none = np.empty((0, 2)), _FLOAT, 1.0
    names, of_a, of_b = np.intersect1d(a.mark_name, b.mark_name, return_indices=True)
    if not names.size:
        return none
    place_a = np.interp(a.mark_at[of_a], np.arange(x.size), x)
    place_b = np.interp(b.mark_at[of_b], np.arange(y.size), y)
    off = np.interp(place_a, x[i], y[j]) - place_b
    near = np.abs(off) < _MARK_M
    if near.sum() < max(3, 0.8 * names.size):  # most stand elsewhere: the names were given anew
        return none
    first = np.searchsorted(x, place_a)
    inside = (first < x.size) & (place_a > x[0])
    mark_a = np.full((x.size, 2), -1.0)
    mark_a[first[inside], 0] = np.flatnonzero(inside)
    mark_a[first[inside], 1] = x[first[inside]] - place_a[inside]
    return mark_a, place_b, float(max(np.median(np.abs(off[near])) / 0.7649, 0.5))
