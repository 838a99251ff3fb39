"""A number of joints and what surveys do to them in, weld lists of several runs with true identities out; no geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.synthetic.route import draw_lengths, stream

Floats = NDArray[Any]


@dataclass(frozen=True)
class WeldList:
    """The welds that one run lists.

    Attributes
    ----------
    distance : log distance of each listed weld, rising (metre).
    identity : which steel it is, the same number in all runs; -1 for a false weld.
    present : identities of all welds that are in the pipe in this run, listed or missed.
    """

    distance: Floats
    identity: NDArray[np.int64]
    present: NDArray[np.int64]


def joint_lists(
    joints: int = 1000,
    runs: int = 2,
    *,
    seed: int = 1,
    joint_m: float = 12.2,
    pup_share: float = 0.05,
    sigma_m: float = 0.015,
    scale: float = 0.003,
    scale_wander: float = 0.0005,
    miss: float = 0.02,
    false: float = 0.01,
    cutouts: int = 1,
    cutout_joints: int = 6,
    reroutes: int = 0,
    reroute_joints: int = 40,
    reverse: tuple[int, ...] = (),
) -> list[WeldList]:
    """Return the weld lists of runs over one line.

    Parameters
    ----------
    joints : joints of the line as built.
    runs : number of lists.
    seed : same seed, same lists.
    joint_m, pup_share : nominal length of a joint (metre), share of short ones.
    sigma_m : noise of the place of each weld (metre).
    scale : sigma of a run's odometer scale.
    scale_wander : sigma of its slow change along the line (correlated over about 2 km).
    miss, false : shares of welds not listed and of false ones added.
    cutouts, cutout_joints : replacements between each two runs, of about so many old joints by one more new ones.
    reroutes, reroute_joints : pieces laid anew between the first two runs, longer by a fifth.
    reverse : indices of runs whose list was made in the other direction.

    Examples
    --------
    >>> first, second = joint_lists(50, 2, cutouts=0)
    >>> bool((first.present == second.present).all())
    True
    """
    lengths = draw_lengths(joints * joint_m * 1.2, joint_m, pup_share, stream(seed, "lengths"))[:joints]
    identity = np.arange(joints + 1)  # the weld at the start of each joint, and the last one
    fresh = joints + 1  # next identity
    lists: list[WeldList] = []
    for run in range(runs):
        rng = stream(seed, "list", run)
        if run > 0:
            for _ in range(cutouts):
                lengths, identity, fresh = _exchange(lengths, identity, fresh, cutout_joints, 1.0, joint_m, rng)
            for _ in range(reroutes if run == 1 else 0):
                lengths, identity, fresh = _exchange(lengths, identity, fresh, reroute_joints, 1.2, joint_m, rng)
        place = np.concatenate([[0.0], np.cumsum(lengths)])
        measured = _stretched(place, scale, scale_wander, rng) + rng.normal(0.0, sigma_m, place.size)
        listed = rng.random(place.size) >= miss
        extra = rng.uniform(0.0, place[-1], int(rng.poisson(false * place.size)))
        distance = np.concatenate([measured[listed], extra])
        known = np.concatenate([identity[listed], np.full(extra.size, -1)])
        if run in reverse:
            distance = measured.max() - distance
        order = np.argsort(distance, kind="stable")
        lists.append(WeldList(distance[order], known[order], identity.copy()))
    return lists


def _exchange(
    lengths: Floats, identity: NDArray[np.int64], fresh: int, count: int, longer: float, joint_m: float, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.int64], int]:
    """Exchange some joints for others, their inner welds numbered from ``fresh`` on; the welds at both ends stay."""
    count = min(count, lengths.size // 3)
    first = int(rng.integers(1, lengths.size - count - 1))
    total = longer * lengths[first : first + count].sum() + rng.normal(0.0, 0.01)
    parts = rng.uniform(0.6, 1.0, max(2, round(total / (0.85 * joint_m))))
    new = fresh + np.arange(parts.size - 1)
    lengths = np.concatenate([lengths[:first], total * parts / parts.sum(), lengths[first + count :]])
    identity = np.concatenate([identity[: first + 1], new, identity[first + count :]])
    return lengths, identity, fresh + new.size


def _stretched(place: Floats, scale: float, wander: float, rng: np.random.Generator) -> Floats:
    """Log distance of true places: one scale for the run, and one that wanders along the line."""
    nodes = np.arange(0.0, place[-1] + 4000.0, 2000.0)
    local = rng.normal(0.0, scale) + np.interp(place, nodes, rng.normal(0.0, wander, nodes.size))
    steps = np.diff(place) * (1.0 + 0.5 * (local[1:] + local[:-1]))
    return rng.uniform(0.0, 5.0) + np.concatenate([[0.0], np.cumsum(steps)])
