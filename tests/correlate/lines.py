"""Weld lists of the simulator as runs and as traits, for tests and benchmarks of the matching."""

from __future__ import annotations

import numpy as np

from deform.correlate.alignment import align
from deform.correlate.evidence import Traits
from deform.correlate.weld_list import weld_list
from deform.options import MatchOptions
from deform.run import build
from deform.synthetic.lists import JointList, bare, build_line, cut_out, cut_outs, observe, score, turned

__all__ = [
    "OPTIONS",
    "JointList",
    "aligned",
    "bare",
    "build_line",
    "cut_out",
    "cut_out_ends",
    "cut_outs",
    "observe",
    "run_of",
    "score",
    "traits_of",
    "turned",
]

OPTIONS = MatchOptions()


def aligned(a: JointList, b: JointList, **more):
    """The alignment of two lists with the options that all tests of it share."""
    return align(a.place, b.place, OPTIONS, **more)


def run_of(name: str, seen: JointList, **more):
    """A run that holds the welds of a list, with what the list knows of its joints."""
    values = {"chainage": seen.place, "probability": np.full(seen.n, 0.95)}
    values |= {k: v for k, v in (("wall_thickness", seen.wall), ("seam_clock", seen.seam)) if np.isfinite(v).any()}
    welds = build.dataset("welds", {**values, **more})
    return build.run_tree({"id": name, "date": name, "source": "listing"}, welds=welds, features=_features(seen))


def _features(seen: JointList):
    bent, fitted = np.flatnonzero(seen.bend > 0), np.flatnonzero(seen.fitting != "")
    at = np.concatenate([bent, fitted])
    if not at.size:
        return None
    nothing = np.full(fitted.size, np.nan)
    values = {
        "chainage": seen.place[at] + 0.3,
        "kind": np.concatenate([np.full(bent.size, "bend", object), seen.fitting[fitted]]),
        "value": np.concatenate([seen.bend[bent], nothing]),
        "clock": np.concatenate([seen.bend_clock[bent], nothing]),
    }
    return build.dataset("features", values)


def traits_of(seen: JointList) -> Traits:
    """Traits of a list, as the matching reads them from its run."""
    return Traits.of(weld_list(run_of("run", seen), least_joint=0.0))


def cut_out_ends(partner: np.ndarray, a: JointList, b: JointList, ends: list[tuple[int, int]]) -> tuple[int, int]:
    """How many ends of cut-outs were found to the weld, of how many.

    List A is of the line before the cut-outs, in their direction. An end is right when the last weld before it that both lists
    show is paired with itself, and no weld behind it is paired (a pair inside the cut-out counts against the nearer end).
    """
    place = {int(w): k for k, w in enumerate(a.weld) if w >= 0}
    common = np.asarray(sorted(place[int(w)] for w in np.intersect1d(a.weld[a.weld >= 0], b.weld)))
    right = 0
    for first, last in ends:
        at = common[np.searchsorted(a.weld[common], first, side="right") - 1]
        to = common[np.searchsorted(a.weld[common], last)]
        inside = np.flatnonzero(partner[at + 1 : to] >= 0) + at + 1
        sound = [partner[q] >= 0 and a.weld[q] == b.weld[partner[q]] for q in (at, to)]
        near = inside - at <= to - inside
        right += bool(sound[0] and not near.any()) + bool(sound[1] and near.all())
    return right, 2 * len(ends)
