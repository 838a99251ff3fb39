"""A run in, its weld list out: places in order, doubles set aside, with what else is known of each weld and joint."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import xarray as xr

from deform.errors import Fault, InputError

_log = logging.getLogger(__name__)
_FITTINGS = ("valve", "tee", "flange")
_DENT_M = 0.5  # from a dent within which what passes for a weld may be the dent
_TURN = {"sag": 0.0, "right": 90.0, "over": 180.0, "left": 270.0}  # clock to which a bend turns, as listings name it


@dataclass(frozen=True)
class WeldList:
    """Girth welds of one run in the order of its chainage.

    Attributes
    ----------
    run : id of the run.
    index : place of each weld in the run's group ``/welds`` (n).
    place : chainage (n), metre, rising.
    probability : of the detection (n).
    log_distance : metre, NaN where not known (n).
    label : vendor's number of the joint that begins here, empty where not known (n).
    wall, seam : wall thickness (metre) and clock of the seam (degree) of the joint that begins here, NaN where not known (n).
    fitting : what stands in the joint that begins here, in sorted words, empty where nothing (n).
    bend, bend_clock : angle of the largest bend in the joint that begins here, and the clock it turns to (degree), NaN if none.
    dented : whether a dent of the run lies at the weld (n): what a detector and arms hear of a deep one may pass for a weld.
    mark_name, mark_at : markers within the list: name, and place as a fractional place in the list.
    doubles : index in ``/welds`` of rows that stand upon another weld, and the index of that weld.
    size : welds in ``/welds``, the doubles included.
    """

    run: str
    index: np.ndarray
    place: np.ndarray
    probability: np.ndarray
    log_distance: np.ndarray
    label: np.ndarray
    wall: np.ndarray
    seam: np.ndarray
    fitting: np.ndarray
    bend: np.ndarray
    bend_clock: np.ndarray
    dented: np.ndarray
    mark_name: np.ndarray
    mark_at: np.ndarray
    doubles: dict[int, int]
    size: int

    @property
    def n(self) -> int:
        """Welds that take part."""
        return self.place.size


def weld_list(run: xr.DataTree, least_joint: float = 0.1) -> WeldList:
    """Return the weld list of a run; joints shorter than ``least_joint`` (metre) are doubles of one weld.

    Raises
    ------
    InputError
        When the run has no welds, or a chainage that is not finite.
    """
    name = str(run.attrs.get("id", "run"))
    if "welds" not in run.children:
        raise InputError(
            Fault(name, "/welds", "is absent; runs are matched by their girth welds", "detect welds or give a listing with them")
        )
    ds = run["welds"].to_dataset()
    place = np.asarray(ds["chainage"].values, float)
    if not np.isfinite(place).all():
        at = int(np.flatnonzero(~np.isfinite(place))[0])
        raise InputError(Fault(f"{name}/welds", "chainage", f"is not finite at weld {at}", "remove the weld or give its place"))
    if place.size < 2:
        raise InputError(Fault(f"{name}/welds", "chainage", f"holds {place.size} welds; a match needs two at least"))
    probability = _floats(ds, "probability", 1.0)
    probability = np.where(np.isfinite(probability), probability, 1.0)
    order = np.argsort(place, kind="stable")
    if (order != np.arange(place.size)).any():
        _log.warning("%s: welds are not sorted by chainage; they are matched in the order of their chainage", name)
    kept, doubles = _without_doubles(place, probability, order, least_joint)
    if doubles:
        _log.warning(
            "%s: %d welds stand within %.2f m of another weld and count as doubles of it", name, len(doubles), least_joint
        )
    _say_mixed_units(name, place[kept])
    label = np.asarray([str(v) for v in ds["label"].values], object) if "label" in ds else np.full(place.size, "", object)
    fitting, bend, bend_clock = _features(run, place[kept])
    mark_name, mark_at = _markers(run, place[kept])
    return WeldList(
        run=name,
        index=kept,
        place=place[kept],
        probability=probability[kept],
        log_distance=_floats(ds, "log_distance", np.nan)[kept],
        label=label[kept],
        wall=_floats(ds, "wall_thickness", np.nan)[kept],
        seam=_floats(ds, "seam_clock", np.nan)[kept],
        fitting=fitting,
        bend=bend,
        bend_clock=bend_clock,
        dented=_dented(run, place[kept]),
        mark_name=mark_name,
        mark_at=mark_at,
        doubles=doubles,
        size=place.size,
    )


def _say_mixed_units(name: str, place: np.ndarray, window: int = 20) -> None:
    """Warn where the lengths of the joints jump by the ratio of metre and foot: part of the list is in another unit."""
    joints = np.diff(place)
    if joints.size < 2 * window:
        return
    middle = np.median(np.lib.stride_tricks.sliding_window_view(joints, window), axis=1)
    ratio = middle[window:] / middle[:-window]
    jumps = np.flatnonzero(np.abs(np.abs(np.log(ratio)) - np.log(1 / 0.3048)) < 0.06)
    if jumps.size:
        at = int(jumps[jumps.size // 2 if jumps.size < window else window // 2]) + window
        before, after = middle[at - window], middle[at]
        text = (
            "%s: joints are %.1f long before and %.1f behind chainage %.0f, the ratio of foot and metre: part is in another unit"
        )
        _log.warning(text, name, before, after, place[at])


def _floats(ds: xr.Dataset, name: str, absent: float) -> np.ndarray:
    return np.asarray(ds[name].values, float) if name in ds else np.full(ds.sizes["weld"], absent)


def _without_doubles(place, probability, order, least_joint):
    gap = np.diff(place[order])
    if (gap >= least_joint).all():
        return order, {}
    kept: list[int] = []
    doubles: dict[int, int] = {}
    for k in order:
        if kept and place[k] - place[kept[-1]] < least_joint:
            loser, winner = (int(k), kept[-1]) if probability[k] <= probability[kept[-1]] else (kept[-1], int(k))
            doubles[loser] = winner
            kept[-1] = winner
        else:
            kept.append(int(k))
    return np.asarray(kept), doubles


def _features(run: xr.DataTree, place: np.ndarray):
    """Fittings in words, and angle and clock of the largest bend, of the joint that begins at each weld."""
    words: list[set[str]] = [set() for _ in place]
    bend, clock = np.full(place.size, np.nan), np.full(place.size, np.nan)
    if "features" not in run.children:
        return np.full(place.size, "", object), bend, clock
    ds = run["features"].to_dataset()
    kinds = np.asarray(ds["kind"].values).astype(str)
    at = np.searchsorted(place, np.asarray(ds["chainage"].values, float), side="right") - 1
    for k in np.flatnonzero(np.isin(kinds, _FITTINGS) & (at >= 0)):
        words[at[k]].add(kinds[k])
    angle = np.abs(np.asarray(ds["value"].values, float)) if "value" in ds else np.full(kinds.size, np.nan)
    turn = np.asarray(ds["clock"].values, float) if "clock" in ds else np.full(kinds.size, np.nan)
    if "direction" in ds:
        said = np.asarray([_TURN.get(str(d), np.nan) for d in ds["direction"].values])
        turn = np.where(np.isfinite(said), said, turn)
    for k in np.flatnonzero((kinds == "bend") & (at >= 0) & np.isfinite(angle)):
        if not angle[k] <= bend[at[k]]:
            bend[at[k]], clock[at[k]] = angle[k], turn[k]
    return np.asarray(["+".join(sorted(w)) for w in words], object), bend, clock


def _dented(run: xr.DataTree, place: np.ndarray) -> np.ndarray:
    """True for places at which a dent of the run lies."""
    if "dents" not in run.children:
        return np.zeros(place.size, bool)
    dents = np.sort(np.asarray(run["dents"]["chainage"].values, float))
    dents = np.concatenate([[-np.inf], dents[np.isfinite(dents)], [np.inf]])
    after = np.searchsorted(dents, place)
    return np.minimum(place - dents[after - 1], dents[after] - place) < _DENT_M


def _markers(run: xr.DataTree, place: np.ndarray):
    """Names of the markers that stand within the list, and their fractional places in it."""
    if "markers" not in run.children or "chainage" not in run["markers"]:
        return np.empty(0, object), np.empty(0)
    ds = run["markers"].to_dataset()
    at = np.asarray(ds["chainage"].values, float)
    names = np.asarray([" ".join(str(v).upper().split()) for v in ds["name"].values], object)
    inside = np.flatnonzero((at >= place[0]) & (at <= place[-1]) & (names != ""))
    inside = inside[np.argsort(at[inside], kind="stable")]
    return names[inside], np.interp(at[inside], place, np.arange(place.size))
