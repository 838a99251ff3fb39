"""The content of an output folder in, its findings in sentences out: what changed, what could not be judged, key numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from deform.report.content import Content
from deform.report.dents import deepest
from deform.report.quantities import measure
from deform.report.runs import largest
from deform.report.words import NOTHING, count, number
from deform.report.zones import moved

_DENT_WORDS = {
    "grown": "grown",
    "new": "new",
    "rerounded": "re-rounded",
    "removed": "removed",
    "copied": "copied forward by the vendor, so not measured anew",
    "unmeasured": "not measured",
}
_TYPICAL_WAVELENGTH_M = 60.0


def verdict(content: Content, zones: list[dict], dents: list[dict]) -> list[str]:
    """Return the findings of the survey, one sentence each, the gravest first."""
    if len(content.runs) == 1:
        alone = f"One run ({content.ids[0]}): what the pipe is like today. Change needs a second run."
        return [alone, *_extremes(content), *_dent_verdict(content, dents)]
    return [*_movement(content, zones), *_joint_verdict(content), *_dent_verdict(content, dents)]


def _movement(content: Content, zones: list[dict]) -> list[str]:
    first, last = (content.dates[run].replace("-", "\u2011") for run in (content.ids[0], content.ids[-1]))  # a date stays whole
    span = f"between {first} and {last}"
    changed, said = moved(zones), []
    if changed:
        said.append(f"{count(len(changed), 'zone')} moved or bent significantly {span}.")
        said += _peaks(changed)
        said += [f"{z['id']} goes on: {'; '.join(z['trends'])}." for z in changed[:3] if z["trends"]]
    elif content.compares_movement:
        said.append(f"No zone moved or bent significantly {span}; the detection limits say what could have been seen.")
    else:
        joined, known = joined_welds(content)
        said.append(f"{number(joined, 0)} of {number(known, 0)} welds are the same steel in all runs {span}.")
        said.append("Movement cannot be judged: these runs hold no positions and no curvature that could be compared.")
    replaced = len(zones) - len(changed)
    if replaced:
        were = "was" if replaced == 1 else "were"
        said.append(f"{count(replaced, 'stretch', 'stretches')} of pipe {were} replaced or re-routed.")
    return said


def _peaks(changed: list[dict]) -> list[str]:
    said = []
    for key, name in (("displacement", "displacement"), ("strain", "change of bending strain")):
        measured = [z for z in changed if z[key]]
        if measured:
            peak = max(measured, key=lambda z: abs(z[key].value))
            direction = f", {peak['direction']}" if key == "displacement" and peak["direction"] else ""
            said.append(f"Largest {name}: {peak[key]} in {peak['id']} at {peak['place']}{direction}.")
    return said


def _extremes(content: Content) -> list[str]:
    """Return where the bending strain and the ovality of a single run are largest, outside bends and in them."""
    run, said = content.ids[0], []
    for name, title, of in (("bending_strain", "bending strain", "strain"), ("ovality", "ovality", "ovality")):
        outside, inside = largest(content, run, name, of), largest(content, run, name, of, bends=True)
        if outside:
            said.append(
                f"Largest {title} outside bends: {outside[0]} at {outside[1]}" + (f"; in bends {inside[0]}." if inside else ".")
            )
    return said


def joined_welds(content: Content) -> tuple[int, int]:
    """Return how many welds are the same steel in all runs, and how many are known; a false one is no weld."""
    welds = content.tables["welds"]
    welds = welds[welds.status != "false"]
    same = welds[welds.status.isin(["matched", "shifted"])]
    return int((same.groupby("weld_id").run.nunique() == len(content.runs)).sum()), int(welds.weld_id.nunique())


def _joint_verdict(content: Content) -> list[str]:
    """Return what the joint lengths say of the last run that has them: how many differ, and how many chance alone would give."""
    table, k = content.tables["joints"], content.k_sigma
    for run in reversed(content.ids):
        names = f"change_m:{run}", f"change_sigma_m:{run}"
        if not set(names) <= set(table.columns) or not table[names[0]].notna().any():
            continue
        rows = table[table[names[0]].notna() & (table[names[1]] > 0)]
        far = rows[(rows[names[0]] / rows[names[1]]).abs() > k]
        chance = len(rows) * math.erfc(k / math.sqrt(2))
        share = f"{number(len(far), 0)} of {count(len(rows), 'joint')}"
        said = f"Joint lengths: {share} differ from {content.reference} by more than {k:g} sigma in {run}"
        said += f"; chance alone gives about {number(chance, 0 if chance >= 1 else 1)}."
        if len(far):
            worst = far.iloc[int(far[names[0]].abs().to_numpy().argmax())]
            size = measure("joint length change", worst[names[0]], worst[names[1]])
            said += f" Largest: {size} in {worst.joint_id} at {measure('place', worst.reference_chainage_m)}."
        return [said]
    return []


def _dent_verdict(content: Content, dents: list[dict]) -> list[str]:
    if not dents:
        return []
    first, deep = deepest(dents), ""
    if first:
        share = f" ({first['depth_share']})" if first["depth_share"] else ""
        when = f" in {first['run']}" if first["run"] != content.ids[-1] else ""
        deep = f"; the deepest is {first['id']}, {first['depth']}{share}{when}"
    said = [f"{count(len(dents), 'dent')}{deep}."]
    if len(content.runs) == 1:
        return said
    changes = []
    for word, text in _DENT_WORDS.items():
        ids = [d["id"] for d in dents if d["status"] == word]
        if ids:
            changes.append(f"{number(len(ids), 0)} {text}" + (f" ({', '.join(ids)})" if len(ids) <= 4 else ""))
    if changes:
        said.append(f"Of the dents {', '.join(changes)}.")
    elif any(d["compared"] for d in dents):
        said.append("No dent changed significantly.")
    else:
        said.append("No dent has a size in two runs: whether any has grown is not known.")
    return said


def what_is_missing(content: Content) -> list[str]:
    """Return in words what these sources cannot tell."""
    said = []
    listings = [str(r.attrs["id"]) for r in content.runs if r.attrs.get("source") == "listing"]
    if listings:
        said.append(
            f"{', '.join(listings)}: made of a vendor listing. A listing tells joints, features and the vendor's sizes; it holds "
            "no attitude, so no curvature, bending strain or movement, and its sizes carry the vendor's accuracy."
        )
    blind = [str(r.attrs["id"]) for r in content.runs if r.attrs.get("source") != "listing" and "dents" not in r.children]
    if blind:
        said.append(f"{', '.join(blind)}: no caliper data, so no dents, ovality or wall shape.")
    unsized = [str(r.attrs["id"]) for r in content.runs if r.attrs.get("source") == "listing" and "dents" not in r.children]
    if unsized:
        said.append(f"{', '.join(unsized)}: the listing names no dent; that is no proof that there was none.")
    if len(content.runs) == 1:
        said.append("One run alone shows shape and strain as they are; whether they change cannot be said.")
    if "centreline" in content.run(content.reference).children:
        said.append("An inertial unit sees bending, not axial strain; the change of joint length is the only axial cue.")
    return said


def facts(content: Content, zones: list[dict], dents: list[dict]) -> list[dict[str, str]]:
    """Return the key numbers of the first screen."""
    changed = moved(zones)
    rows = [
        ("zones of change", _counted(content, changed), _zone_note(content, zones, changed)),
        ("dents", number(len(dents), 0), f"{sum(d['status'] in ('grown', 'new') for d in dents)} grown or new"),
    ]
    if len(content.runs) == 1:
        rows = [("dents", number(len(dents), 0), "sizes in the table below"), *_alone(content)]
        return [{"name": n, "value": v, "note": t} for n, v, t in rows]
    joined, known = joined_welds(content)
    rows.append(("welds in all runs", number(joined, 0), f"of {number(known, 0)} known"))
    seen = least_movement(content)
    if seen:
        rows.append(("smallest movement seen", str(seen), f"over {_TYPICAL_WAVELENGTH_M:.0f} m, in nine of ten cases"))
    return [{"name": n, "value": v, "note": t} for n, v, t in rows]


def _counted(content: Content, changed: list[dict]) -> str:
    return number(len(changed), 0) if changed or content.compares_movement else NOTHING


def _zone_note(content: Content, zones: list[dict], changed: list[dict]) -> str:
    replaced = f"{len(zones) - len(changed)} replaced or re-routed"
    return replaced if changed or content.compares_movement else f"movement not judged; {replaced}"


def _alone(content: Content) -> list[tuple[str, str, str]]:
    """Return how many welds, bends and markers a single run holds."""
    rows = []
    for group, name, note in (("welds", "girth welds", "and as many joints, less one"), ("markers", "markers", "on this line")):
        ds = content.group(content.ids[0], group)
        rows.append((name, NOTHING if ds is None else number(next(iter(ds.sizes.values()), 0), 0), note))
    features = content.group(content.ids[0], "features")
    bends = 0 if features is None else int((features["kind"].values.astype(str) == "bend").sum())
    return [*rows, ("bends", NOTHING if features is None else number(bends, 0), "angles in the inventory")]


def least_movement(content: Content) -> Any:
    """Return the least amplitude of a movement some sixty metres long that the last pair of runs shows in nine of ten cases."""
    limits = content.tables.get("limits", pd.DataFrame())
    if not {"wavelength_m", "limit_90_displacement_m", "run_to"} <= set(limits.columns):
        return measure("noise", None)
    rows = limits[
        limits.wavelength_m.notna() & limits.limit_90_displacement_m.notna() & (limits.run_to.astype(str) == content.ids[-1])
    ]
    if rows.empty:
        return measure("noise", None)
    nearest = rows.wavelength_m.iloc[np.abs(np.log(rows.wavelength_m / _TYPICAL_WAVELENGTH_M)).to_numpy().argmin()]
    return measure("noise", rows[rows.wavelength_m == nearest].limit_90_displacement_m.max())
