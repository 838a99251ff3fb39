"""A number of joints and what time and surveys do to them in, weld lists with true identities and traits out, without geometry:
the simulator for studies of the matching (`benchmarks/matching.py`, `tests/correlate`), which no other part of deform calls.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]
Ints = NDArray[np.int64]

LONGEST_M = 13.5
WALLS_M = (0.0087, 0.0095, 0.0127)  # nominal walls of a line: most of it, heavier at crossings and roads
_LEAST_PIECE_M = 0.8  # no shorter piece is welded in
_LEAST_SPACE_M = 0.35  # a false weld nearer than this to another one is that weld


@dataclass(frozen=True)
class JointList:
    """Welds along a line, as built or as one run lists them, with the traits of the joint that begins at each weld.

    Attributes
    ----------
    place : place of each weld (n), metre, rising.
    weld : which steel it is (n), the same number in all runs; -1 for a false weld.
    wall : wall thickness (n), metre, NaN where not known.
    seam : clock of the longitudinal seam (n), degree, NaN where not known.
    bend, bend_clock : angle of a field or mill bend in the joint (n), degree, 0 where straight, and the clock it turns to.
    fitting : ``valve``, ``tee`` or empty (n).
    """

    place: Floats
    weld: Ints
    wall: Floats
    seam: Floats
    bend: Floats
    bend_clock: Floats
    fitting: Floats

    @property
    def n(self) -> int:
        """Number of welds."""
        return self.place.size

    def take(self, rows) -> JointList:
        """The welds of these rows."""
        return JointList(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


def bare(place: Floats, weld: Ints) -> JointList:
    """A list of which nothing but places is known."""
    nothing = np.full(place.size, np.nan)
    return JointList(place, weld, nothing, nothing, np.zeros(place.size), nothing, np.full(place.size, "", object))


def draw_joints(rng: np.random.Generator, n: int, equal: float = 0.35, pups: float = 0.05) -> Floats:
    """Joint lengths (metre): a share of one mill, equal within 10 mm, ordinary ones around 11.8 m, and a share of pups."""
    kind = rng.random(n)
    ordinary = np.clip(rng.normal(11.8, 0.9, n), 6.0, LONGEST_M)
    return np.where(
        kind < equal, 12.2 + rng.uniform(-0.005, 0.005, n), np.where(kind > 1 - pups, rng.uniform(1.0, 8.0, n), ordinary)
    )


def build_line(rng: np.random.Generator, joints: int, equal: float = 0.35, pups: float = 0.05) -> JointList:
    """A line as built.

    Notes
    -----
    Walls come in spells of some thirty joints; seams lie anywhere in the upper half; one joint in twenty is bent by 2 to 40
    degrees; one in 1500 holds a valve, one in 700 a tee.
    """
    place = np.concatenate([[0.0], np.cumsum(draw_joints(rng, joints, equal, pups))])
    return replace(_with_traits(rng, bare(place, np.arange(joints + 1))), wall=_walls(rng, joints + 1))


def _with_traits(rng: np.random.Generator, line: JointList) -> JointList:
    n = line.n
    bent, kind = rng.random(n) < 0.05, rng.random(n)
    return replace(
        line,
        seam=rng.uniform(-90.0, 90.0, n) % 360.0,
        bend=np.where(bent, rng.uniform(2.0, 40.0, n), 0.0),
        bend_clock=rng.choice(np.arange(0.0, 360.0, 90.0), n),
        fitting=np.where(kind < 1 / 1500, "valve", np.where(kind < 1 / 1500 + 1 / 700, "tee", "")).astype(object),
    )


def _walls(rng: np.random.Generator, n: int) -> Floats:
    new = rng.random(n) < 1 / 30
    new[0] = True
    spells = rng.choice(WALLS_M, new.sum(), p=(0.8, 0.15, 0.05))
    return spells[np.cumsum(new) - 1]


def cut_out(
    rng: np.random.Generator,
    old: JointList,
    first: int,
    n_old: int,
    n_new: int | None = None,
    longer: float = 0.0,
    same_mill: bool = True,
) -> JointList:
    """The line with the joints between weld ``first`` and weld ``first + n_old`` replaced; both welds stay.

    Parameters
    ----------
    n_new : number of new joints; None lays joints of the line's lengths until one piece, cut to fit, closes the gap.
    longer : how much longer the new pipe is, metre.
    same_mill : the new joints have lengths of the line, and hence every third the very length of a third of the old ones; else
        any length from 7 to 12 m.
    """
    last = first + n_old
    total = old.place[last] - old.place[first] + longer
    new = _fill(rng, total, n_new) if same_mill else _cut_to_fit(rng, total, n_new or max(1, round(total / 9.8)))
    inner = bare(old.place[first] + np.cumsum(new)[:-1], np.arange(new.size - 1) + old.weld.max() + 1)
    # the joint that begins at the first weld is new as well
    fresh = _with_traits(rng, join(old.take([first]), inner))
    wall = old.wall[first] if rng.random() < 0.5 else rng.choice(WALLS_M)
    after = old.take(slice(last, None))
    return join(
        old.take(slice(0, first)),
        replace(fresh, wall=np.full(fresh.n, wall)),
        replace(after, place=after.place + longer),
    )


def _fill(rng: np.random.Generator, total: float, n_new: int | None) -> Floats:
    """Lengths of new joints of a given total, of the lengths of the line but for one piece."""
    for _ in range(1000):
        drawn = draw_joints(rng, n_new - 1 if n_new else int(total / 8.0) + 3)
        whole = np.cumsum(drawn)
        if n_new or total <= LONGEST_M:
            laid = drawn.size if n_new else 0
        else:  # joints are laid until one piece closes the gap
            laid = min(int(np.searchsorted(whole, total - LONGEST_M)) + 1, drawn.size)
        rest = total - (whole[laid - 1] if laid else 0.0)
        if _LEAST_PIECE_M <= rest <= LONGEST_M:
            return np.roll(np.append(drawn[:laid], rest), int(rng.integers(laid + 1)))
    return _cut_to_fit(rng, total, n_new or max(1, round(total / 10.0)))  # no such joints have this total


def _cut_to_fit(rng: np.random.Generator, total: float, count: int) -> Floats:
    parts = rng.uniform(0.6, 1.0, count)
    return total * parts / parts.sum()


def cut_outs(
    rng: np.random.Generator, old: JointList, count: int, least: int = 2, most: int = 12, same_mill: bool = True
) -> tuple[JointList, list[tuple[int, int]]]:
    """The line with so many cut-outs of ``least`` to ``most`` joints, and the welds (identities) at both ends of each."""
    starts = np.sort(rng.choice(np.arange(5, old.n - 41, 40), count, replace=False)) if count else np.empty(0, int)
    pieces, ends, done, fresh = [], [], 0, int(old.weld.max()) + 1
    for start in starts:
        n_old = int(rng.integers(least, most + 1))
        piece = cut_out(rng, old.take(slice(start, start + n_old + 1)), 0, n_old, same_mill=same_mill)
        inner = piece.weld[1:-1]
        weld = np.concatenate([piece.weld[:1], fresh + np.arange(inner.size), piece.weld[-1:]])
        fresh += inner.size
        pieces += [old.take(slice(done, start)), replace(piece, weld=weld).take(slice(0, -1))]
        ends.append((int(old.weld[start]), int(old.weld[start + n_old])))
        done = int(start) + n_old
    return join(*pieces, old.take(slice(done, None))), ends


def join(*pieces: JointList) -> JointList:
    """One list after the other."""
    return JointList(**{f.name: np.concatenate([getattr(p, f.name) for p in pieces]) for f in fields(JointList)})


@dataclass(frozen=True)
class Seen:
    """How well a run sees the traits of joints."""

    wall_wrong: float = 0.02  # share of joints whose wall is read as another one
    seam_sigma: float = 5.0  # degree
    seam_absent: float = 0.05
    seam_wrong: float = 0.02  # share of seams at any clock
    roll: float = 0.0  # degree, of the tool's clock against the pipe's
    bend_sigma: float = 1.5  # degree
    least_bend: float = 3.0  # degree, a smaller one is not listed
    fitting_absent: float = 0.03


def observe(
    rng: np.random.Generator,
    true: JointList,
    missed: float = 0.02,
    false: float = 0.02,
    noise: float = 0.035,
    weld_noise: float = 0.0,
    scale: float = 1.0,
    wander: float = 0.0,
    reverse: bool = False,
    traits: Seen | None = None,
) -> JointList:
    """What one run lists of the line.

    Parameters
    ----------
    missed, false : shares of welds not listed, and of false ones added.
    noise : sigma of each joint's length, metre (of a difference between two runs it is 1.4 times that).
    weld_noise : sigma of each weld's place, metre.
    scale, wander : scale of the odometer, and how far it wanders about that, changing over some 150 joints.
    reverse : the list is made in the other direction (clocks are then mirrored).
    traits : how the run sees traits; None, and it lists places alone.
    """
    local = _wander(rng, true.n - 1, wander)
    joints = np.maximum(np.diff(true.place) * scale * local + rng.normal(0, noise, true.n - 1), 0.2)
    seen = np.concatenate([[0.0], np.cumsum(joints)])
    place = seen + rng.normal(0, weld_noise, true.n) if weld_noise else seen
    kept = rng.random(true.n) >= missed
    kept[[0, -1]] = True
    extra = _false_places(rng, seen, false)
    listed = _see(rng, true, traits) if traits else bare(place, true.weld)
    listed = replace(listed, place=place)
    inside = listed.take(np.maximum(np.searchsorted(seen, extra) - 1, 0))  # a false weld splits the joint: its traits go on
    inside = replace(inside, place=extra, weld=np.full(extra.size, -1), fitting=np.full(extra.size, "", object))
    both = join(listed.take(kept), inside)
    both = both.take(np.argsort(both.place, kind="stable"))
    return turned(both) if reverse else both


def _wander(rng, n: int, wander: float) -> Floats:
    if not wander:
        return np.ones(n)
    knots = max(n // 150, 2) + 1
    return 1.0 + np.interp(np.linspace(0, knots - 1, n), np.arange(knots), rng.uniform(-wander, wander, knots))


def _false_places(rng, seen: Floats, false: float) -> Floats:
    extra = rng.uniform(seen[0] + 1, seen[-1] - 1, rng.binomial(seen.size - 1, false))
    near = np.searchsorted(seen, extra)
    extra = np.sort(extra[np.minimum(extra - seen[near - 1], seen[near] - extra) > _LEAST_SPACE_M])
    return extra[np.concatenate([[True], np.diff(extra) > _LEAST_SPACE_M])[: extra.size]]


def _see(rng, true: JointList, how: Seen) -> JointList:
    n = true.n
    seam = true.seam + how.roll + rng.normal(0, how.seam_sigma, n)
    seam = np.where(rng.random(n) < how.seam_wrong, rng.uniform(0, 360, n), seam) % 360.0
    bend = true.bend + rng.normal(0, how.bend_sigma, n)
    return replace(
        true,
        wall=np.where(rng.random(n) < how.wall_wrong, rng.choice(WALLS_M, n), true.wall),
        seam=np.where(rng.random(n) < how.seam_absent, np.nan, seam),
        bend=np.where((true.bend > 0) & (bend > how.least_bend), bend, 0.0),
        fitting=np.where(rng.random(n) < how.fitting_absent, "", true.fitting),
    )


def turned(one: JointList) -> JointList:
    """The list made in the other direction: another joint begins at each weld, clocks are mirrored."""

    def turn(values, absent):
        return np.append(values[:-1][::-1], np.asarray([absent], values.dtype))

    return JointList(
        place=one.place[-1] - one.place[::-1],
        weld=one.weld[::-1].copy(),
        wall=turn(one.wall, np.nan),
        seam=turn((360.0 - one.seam) % 360.0, np.nan),
        bend=turn(one.bend, 0.0),
        bend_clock=turn((360.0 - one.bend_clock) % 360.0, np.nan),
        fitting=turn(one.fitting, ""),
    )


def score(partner: Ints, a: JointList, b: JointList) -> tuple[float, float, int]:
    """Recall, precision and number of wrong pairs of the partners in B of the welds of A (-1 none)."""
    claimed = partner >= 0
    right = claimed & (a.weld >= 0) & (a.weld == b.weld[partner])
    both = np.intersect1d(a.weld[a.weld >= 0], b.weld[b.weld >= 0]).size
    return right.sum() / both, right.sum() / max(claimed.sum(), 1), int((claimed & ~right).sum())
