"""Small generator of weld lists with known identities: a line of joints, edits of it, and runs that see it with faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Line:
    """Welds of a line: places (metre) and identities; identity -1 is no weld."""

    place: np.ndarray
    weld: np.ndarray


def lengths(rng: np.random.Generator, n: int, equal: float = 0.35, pups: float = 0.05) -> np.ndarray:
    """Joint lengths: mill lengths equal within 10 mm, ordinary ones around 11.8 m, pups."""
    kind = rng.random(n)
    ordinary = np.clip(rng.normal(11.8, 0.9, n), 6.0, 13.5)
    return np.where(
        kind < equal, 12.2 + rng.uniform(-0.005, 0.005, n), np.where(kind > 1 - pups, rng.uniform(1.0, 8.0, n), ordinary)
    )


def line(rng: np.random.Generator, n: int, **kinds) -> Line:
    """A line of n joints."""
    return Line(np.concatenate([[0.0], np.cumsum(lengths(rng, n, **kinds))]), np.arange(n + 1))


def cut_out(rng: np.random.Generator, old: Line, first: int, n_old: int, n_new: int, longer: float = 0.0) -> Line:
    """The line with n_old joints behind weld ``first`` replaced by n_new of the same total length (or ``longer`` by so much)."""
    a, b = old.place[first], old.place[first + n_old]
    total = b - a + longer
    new = lengths(rng, n_new)
    for _ in range(1000):
        if n_new == 1 or (new[-1] > 0.8 and new[:-1].sum() < total - 0.8):
            break
        new = lengths(rng, n_new) * rng.uniform(0.5, 1.0)
    new[-1] = total - new[:-1].sum()
    if new[-1] < 0.5:
        new = np.full(n_new, total / n_new) + 0.0
    inner = a + np.cumsum(new)[:-1]
    fresh = np.arange(inner.size) + old.weld.max() + 1
    place = np.concatenate([old.place[: first + 1], inner, old.place[first + n_old :] + longer])
    return Line(place, np.concatenate([old.weld[: first + 1], fresh, old.weld[first + n_old :]]))


def cut_outs(rng: np.random.Generator, old: Line, count: int) -> tuple[Line, list[tuple[int, int]]]:
    """The line with so many cut-outs of 2 to 12 joints, and the identities of the welds at both ends of each."""
    n = old.place.size - 1
    starts = np.sort(rng.choice(np.arange(5, n - 40, 40), count, replace=False))[::-1] if count else []
    ends = []
    for start in starts:
        n_old = int(rng.integers(2, 13))
        n_new = max(1, n_old + int(rng.integers(-1, 3)))
        ends.append((int(old.weld[start]), int(old.weld[start + n_old])))
        old = cut_out(rng, old, int(start), n_old, n_new)
    return old, ends[::-1]


def observe(
    rng: np.random.Generator,
    true: Line,
    missed: float = 0.02,
    false: float = 0.02,
    noise: float = 0.035,
    weld_noise: float = 0.0,
    scale: float = 1.0,
    wander: float = 0.0,
    reverse: bool = False,
) -> Line:
    """A run over the line: noisy joint lengths, a scale that wanders over some hundred joints, missed and false welds."""
    joints = np.diff(true.place)
    n = joints.size
    if wander:
        knots = max(n // 150, 2) + 1
        local = 1.0 + np.interp(np.linspace(0, knots - 1, n), np.arange(knots), rng.uniform(-wander, wander, knots))
    else:
        local = 1.0
    seen = np.concatenate([[0.0], np.cumsum(np.maximum(joints * scale * local + rng.normal(0, noise, n), 0.2))])
    place = seen + rng.normal(0, weld_noise, n + 1) if weld_noise else seen
    kept = rng.random(n + 1) >= missed
    kept[[0, -1]] = True
    extra = rng.uniform(seen[0] + 1, seen[-1] - 1, rng.binomial(n, false))
    near = np.searchsorted(seen, extra)
    extra = np.sort(extra[np.minimum(extra - seen[near - 1], seen[near] - extra) > 0.35])  # nearer ones are that weld
    extra = extra[np.concatenate([[True], np.diff(extra) > 0.35])[: extra.size]]
    place = np.concatenate([place[kept], extra])
    weld = np.concatenate([true.weld[kept], np.full(extra.size, -1)])
    order = np.argsort(place)
    place, weld = place[order], weld[order]
    return Line(-place[::-1], weld[::-1].copy()) if reverse else Line(place, weld)


def score(partner: np.ndarray, a: Line, b: Line) -> tuple[float, float, int]:
    """Recall, precision and number of wrong pairs of a list of partners (-1 none)."""
    claimed = partner >= 0
    right = claimed & (a.weld >= 0) & (a.weld == b.weld[partner])
    both = np.intersect1d(a.weld[a.weld >= 0], b.weld[b.weld >= 0]).size
    return right.sum() / both, right.sum() / max(claimed.sum(), 1), int((claimed & ~right).sum())
