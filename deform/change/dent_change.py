"""Dents of all runs in, each dent followed through the runs with the change of its depth and what became of it out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from deform.change.dent_surface import depth_at
from deform.change.stack import run_id
from deform.options import ChangeOptions
from deform.run import build
from deform.units import wrap_degree

Floats = NDArray[Any]
_SIZES = ("depth", "length", "width")
_VENDOR_SIGMA_OD = 0.005  # of the outside diameter, where a listing states no sigma of its depths
_TOOL_SIGMA_M = 0.0005  # where a measured dent states none
_LEAST_READ_M = 0.001  # a wall map shows a dent that was not listed from this depth on
_NEAR_SIGMA = (0.05, 8.0)  # m and degree: how near the same dent lies in two runs


@dataclass
class Track:
    """One dent through the runs: its rows by run, and where it lies on the reference chainage."""

    place: float
    clock: float
    born: int
    rows: dict[int, dict] = field(default_factory=dict)
    could_be_seen: bool = False

    def last(self, before: int) -> dict | None:
        """The last row with a measured depth before a run."""
        for k in sorted(self.rows, reverse=True):
            if k < before and np.isfinite(self.rows[k]["depth_m"]):
                return self.rows[k]
        return None


def compare_dents(runs: list[xr.DataTree], matching: Any, options: ChangeOptions, joints: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``dents``: one row per dent and run.

    Parameters
    ----------
    runs : in the order of their dates.
    matching : `correlate.weld_matching.Matching` (its ``maps`` tie the places by the welds).
    options : gates and least growth.
    joints : joint table, for the joint in which each dent lies.

    Notes
    -----
    Dents are paired by place relative to the welds and by clock, nearest first. Depths are compared with the last run that
    measured: grown (or rerounded) when the change exceeds both ``k_sigma`` times its sigma and ``least_dent_growth_m``. A
    dent that a run does not list is looked for in that run's wall map; what a vendor repeated to the digit is `copied`, no
    proof of rest.
    """
    tracks: list[Track] = []
    for k, run in enumerate(runs):
        chain_map = matching.maps[run_id(run)]
        listed = _listed(run, chain_map)
        pairs = _pairs(tracks, listed, options, chain_map)
        for i, row in enumerate(listed):
            if i in pairs:
                track = tracks[pairs[i]]
                track.rows[k] = row
            else:
                tracks.append(Track(row["reference_chainage_m"], row["clock_deg"], k, {k: row}))
        for track in tracks:
            if k not in track.rows:
                absent = _absent(run, chain_map, track)
                if absent is not None:
                    track.rows[k] = absent
    _look_back(runs, matching, tracks)
    return _table(runs, tracks, _copied_pairs(runs, tracks), options, joints)


def _look_back(runs: list[xr.DataTree], matching: Any, tracks: list[Track]) -> None:
    """Mark which tracks an earlier run could have shown, and read their depth from the wall map of the run before."""
    for track in tracks:
        if track.rows[track.born]["replaced"]:
            continue
        for k in range(track.born - 1, -1, -1):
            chain_map = matching.maps[run_id(runs[k])]
            place = float(chain_map.to_run(track.place))
            if not _reaches(runs[k], place) or not _held(chain_map, track.place):
                continue
            track.could_be_seen |= "dents" in runs[k].children
            depth, sigma = depth_at(runs[k], place, track.clock)
            if np.isfinite(depth) and depth > max(3.0 * sigma, _LEAST_READ_M):
                track.rows[k] = _unlisted(runs[k], track, place) | {"depth_m": depth, "depth_sigma_m": sigma}
                break


def _listed(run: xr.DataTree, chain_map: Any) -> list[dict]:
    """Rows of the dents that a run lists, on the reference chainage."""
    if "dents" not in run.children or run["dents"].sizes.get("dent", 0) == 0:
        return []
    dents = run["dents"].to_dataset()
    n = dents.sizes["dent"]

    def column(name: str) -> Floats:
        return np.asarray(dents[name].values, float) if name in dents else np.full(n, np.nan)

    place, sizing = column("chainage"), [str(v) for v in dents["sizing"].values] if "sizing" in dents else [""] * n
    reference = np.asarray(chain_map.to_reference(place), float)
    od = float(run.attrs.get("outside_diameter_m", 0.5))
    fallback = _VENDOR_SIGMA_OD * od if run.attrs.get("source") == "listing" else _TOOL_SIGMA_M
    depth, sigma = column("depth"), column("depth_sigma")
    clock, length, width, strain = (column(name) for name in ("clock", "length", "width", "strain_max"))
    return [
        {
            "run": run_id(run),
            "reference_chainage_m": reference[i],
            "run_chainage_m": place[i],
            "clock_deg": clock[i],
            "depth_m": np.nan if sizing[i] == "unmeasured" else depth[i],
            "depth_sigma_m": sigma[i] if np.isfinite(sigma[i]) else fallback,
            "length_m": length[i],
            "width_m": width[i],
            "strain_max": strain[i],
            "listed": True,
            "replaced": not bool(np.all(_held(chain_map, reference[i]))),
        }
        for i in range(n)
        if np.isfinite(place[i])
    ]


def _held(chain_map: Any, place: float) -> bool:
    """True where the steel of the reference run is still there in the run, and beyond the outermost welds."""
    return not any(first < place < last for first, last in chain_map.broken)


def _pairs(tracks: list[Track], listed: list[dict], options: ChangeOptions, chain_map: Any) -> dict[int, int]:
    """Which row continues which track, nearest first; new pipe continues nothing older."""
    found = []
    order = np.argsort([t.place for t in tracks]) if tracks else np.array([], int)
    places = np.array([tracks[t].place for t in order])
    for i, row in enumerate(listed):
        low, high = np.searchsorted(
            places, [row["reference_chainage_m"] - options.dent_distance_m, row["reference_chainage_m"] + options.dent_distance_m]
        )
        for t in order[low:high]:
            track = tracks[t]
            if row["replaced"] and not any(r["replaced"] for r in track.rows.values()):
                continue
            apart = abs(row["reference_chainage_m"] - track.place)
            turn = abs(float(wrap_degree(row["clock_deg"] - track.clock)))
            turn = 0.0 if not np.isfinite(turn) else turn
            if apart <= options.dent_distance_m and turn <= options.dent_clock_deg:
                found.append(((apart / _NEAR_SIGMA[0]) ** 2 + (turn / _NEAR_SIGMA[1]) ** 2, i, int(t)))
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, t in sorted(found):
        if i not in pairs and t not in taken:
            pairs[i] = t
            taken.add(t)
    return pairs


def _absent(run: xr.DataTree, chain_map: Any, track: Track) -> dict | None:
    """What a run that does not list a dent tells of it; None when the run does not reach the place."""
    row = _unlisted(run, track, np.nan)
    if not _held(chain_map, track.place):
        return row | {"gone": True} if not any(r.get("gone") for r in track.rows.values()) else None
    if any(r.get("gone") for r in track.rows.values()):
        return None
    place = float(chain_map.to_run(track.place))
    if not _reaches(run, place):
        return None
    depth, sigma = depth_at(run, place, track.clock)
    return row | {"run_chainage_m": place, "depth_m": depth, "depth_sigma_m": sigma}


def _unlisted(run: xr.DataTree, track: Track, place: float) -> dict:
    """An empty row of a dent in a run that does not list it."""
    row = {"run": run_id(run), "reference_chainage_m": track.place, "clock_deg": track.clock, "run_chainage_m": place}
    row |= dict.fromkeys(("depth_m", "depth_sigma_m", "length_m", "width_m", "strain_max"), np.nan)
    return row | {"listed": False, "replaced": False}


def _reaches(run: xr.DataTree, place: float) -> bool:
    for group in ("centreline", "welds"):
        if group in run.children and run[group]["chainage"].size:
            axis = np.asarray(run[group].to_dataset()["chainage"].values, float)
            return bool(np.nanmin(axis) <= place <= np.nanmax(axis))
    return False


def _copied_pairs(runs: list[xr.DataTree], tracks: list[Track]) -> set[tuple[int, int, int]]:
    """(track, run before, run) whose sizes a listing repeats to the digit.

    Two sizes or more that agree to the digit are a copy. Where a listing gives the depth alone it counts as copied when so
    many of its depths agree that chance does not explain it.
    """
    found = set()
    for k in range(1, len(runs)):
        if runs[k].attrs.get("source") != "listing":
            continue
        alone, compared = [], []
        for t, track in enumerate(tracks):
            row = track.rows.get(k)
            if row is None or not row["listed"]:
                continue
            for j in range(k - 1, -1, -1):
                before = track.rows.get(j)
                if before is None or not before["listed"] or runs[j].attrs.get("source") != "listing":
                    continue
                equal = [
                    row[f"{s}_m"] == before[f"{s}_m"]
                    for s in _SIZES
                    if np.isfinite(row[f"{s}_m"]) and np.isfinite(before[f"{s}_m"])
                ]
                if len(equal) >= 2 and all(equal):
                    found.add((t, j, k))
                elif len(equal) == 1:
                    compared.append((t, j, k))
                    if equal[0]:
                        alone.append((t, j, k))
                break
        if len(alone) >= 3 and len(alone) > 0.5 * len(compared):
            found |= set(alone)
    return found


def _table(runs, tracks, copied, options, joints) -> pd.DataFrame:
    order = sorted(range(len(tracks)), key=lambda t: (tracks[t].place, tracks[t].clock))
    names = [run_id(run) for run in runs]
    rows = []
    for number, t in enumerate(order):
        track = tracks[t]
        for k in sorted(track.rows):
            row = dict(track.rows[k])
            row["dent_id"] = f"D{number + 1:04d}"
            row["joint_id"] = _joint(joints, row["reference_chainage_m"])
            row |= _status(track, t, k, names, copied, options)
            rows.append({key: value for key, value in row.items() if key not in ("listed", "replaced", "gone")})
    return build.table("dents", pd.DataFrame(rows))


def _joint(joints: pd.DataFrame, place: float) -> str:
    if not len(joints) or not np.isfinite(place):
        return ""
    i = int(np.searchsorted(joints["reference_chainage_m"].to_numpy(float), place, side="right")) - 1
    return str(joints["joint_id"].iloc[i]) if i >= 0 else ""


def _status(track: Track, t: int, k: int, names: list[str], copied: set, options: ChangeOptions) -> dict:
    """Status, change of depth with sigma, and the reason in words."""
    row, before = track.rows[k], track.last(k)
    if row.get("gone"):
        return {"status": "removed", "reason": "the pipe it lay in was cut out"}
    for j in range(k):
        if (t, j, k) in copied:
            return {"status": "copied", "reason": f"sizes repeat those of {names[j]} to the digit: copied forward, not measured"}
    if not np.isfinite(row["depth_m"]):
        known = "listed without a depth" if row["listed"] else "not listed, and the run has no wall map here"
        return {"status": "unmeasured", "reason": known}
    if before is None:
        if row["replaced"] and track.born == k:
            return {"status": "new", "reason": "on new pipe"}
        if track.born == k and track.could_be_seen:
            return {"status": "new", "reason": "no earlier run shows it"}
        return {"status": "stable", "reason": "first run that measured it; nothing earlier to compare with"}
    change = float(row["depth_m"] - before["depth_m"])
    sigma = float(np.hypot(row["depth_sigma_m"], before["depth_sigma_m"]))
    found = {"depth_change_m": change, "depth_change_sigma_m": sigma}
    words = f"{1e3 * change:+.1f} mm since {before['run']}, sigma {1e3 * sigma:.1f} mm"
    if not row["listed"]:
        words += f"; not listed in {row['run']}, read from its wall map"
    if abs(change) > options.k_sigma * sigma and abs(change) >= options.least_dent_growth_m:
        return found | {"status": "grown" if change > 0 else "rerounded", "reason": words}
    return found | {"status": "stable", "reason": f"{words}: not significant"}
