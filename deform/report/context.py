"""The content of an output folder in, words and formatted numbers for people out; templates do no arithmetic."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.options import ReportOptions
from deform.report.content import Content, records
from deform.report.features import feature_rows
from deform.report.words import NOTHING, compass, microstrain, number, percent, with_sigma
from deform.run.history import toolkit_version
from deform.units import clock_text

_DENT_WORDS = {
    "grown": "grown",
    "new": "new",
    "rerounded": "re-rounded",
    "removed": "removed",
    "copied": "copied forward by the vendor, so not measured anew",
    "unmeasured": "not measured",
}


def build_context(content: Content, options: ReportOptions) -> dict[str, Any]:
    """Return everything that the templates of a report show, as text and plain lists."""
    zones = zone_rows(content, options)
    dents = dent_rows(content)
    return {
        "title": options.title or f"{content.line}: deformation report",
        "line": content.line,
        "made": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "version": str(content.survey.get("deform_version") or toolkit_version()),
        "reference": content.reference,
        "verdict": verdict(content, zones, dents),
        "limits_of_sources": what_is_missing(content),
        "facts": facts(content, zones, dents),
        "runs": run_rows(content),
        "zones": zones,
        "dents": dents,
        "trends": trend_rows(content),
        "features": feature_rows(content),
        "limit_names": list(dict.fromkeys(n for n in content.tables["trends"].limit_name if n)),
        "compared": content.compares_movement,
        "options": options,
        "strain_attention": microstrain(options.strain_attention),
        "displacement_attention": number(options.displacement_attention_m, 2, "m"),
    }


def run_rows(content: Content) -> list[dict[str, Any]]:
    """Return one row per run: who, when, of what, how long, how many welds and dents."""
    rows = []
    for run in content.runs:
        name, attrs = str(run.attrs["id"]), run.attrs
        length = [float(run[g].to_dataset()["chainage"].values[-1]) for g in ("centreline", "welds") if _size(run, g)]
        source = str(attrs.get("source", ""))
        rows.append(
            {
                "id": name,
                "date": str(attrs.get("date", "")),
                "source": {"raw": "raw data", "listing": "vendor listing"}.get(source, source),
                "direction": str(attrs.get("direction", "")),
                "length": number(length[0] / 1000, 3, "km") if length else NOTHING,
                "diameter": number(_mm(attrs.get("outside_diameter_m")), 1, "mm"),
                "wall": number(_mm(attrs.get("nominal_wall_m")), 2, "mm"),
                "is_reference": name == content.reference,
                **{g: NOTHING if _size(run, g) is None else str(_size(run, g)) for g in ("welds", "dents", "markers")},
            }
        )
    return rows


def _size(run: xr.DataTree, group: str) -> int | None:
    return int(next(iter(run[group].to_dataset().sizes.values()), 0)) if group in run.children else None


def zone_rows(content: Content, options: ReportOptions) -> list[dict[str, Any]]:
    """Return the zones ranked: by the rank of the trends where there is one, then by size against the attention values."""
    table, trends = content.tables["zones"], content.tables["trends"]
    ranks = trends.dropna(subset="rank").groupby("subject")["rank"].min().to_dict()
    rows = []
    for zone in records(table):
        shares = (zone.peak_strain_change / options.strain_attention, zone.peak_displacement_m / options.displacement_attention_m)
        size = max((abs(share) for share in shares if np.isfinite(share)), default=0.0)
        moved = zone.kind != "reconfiguration"
        rows.append(
            {
                "id": zone.zone_id,
                "kind": zone.kind,
                "start": float(zone.start_m),
                "end": float(zone.end_m),
                "place": f"{number(zone.start_m, 1)} – {number(zone.end_m, 1, 'm')}",
                "length": number(zone.end_m - zone.start_m, 1, "m"),
                "size": size,
                "severity": ("high" if size >= 1 else "medium" if size >= 0.5 else "low") if moved else "construction",
                "first_epoch": zone.first_epoch or NOTHING,
                "first_date": content.dates.get(zone.first_epoch, ""),
                "strain": microstrain(zone.peak_strain_change, zone.peak_strain_change_sigma),
                "strain_value": zone.peak_strain_change,
                "displacement": with_sigma(zone.peak_displacement_m, zone.peak_displacement_sigma_m, 2, "m"),
                "displacement_value": zone.peak_displacement_m,
                "direction": compass(zone.direction_deg),
                "confidence": NOTHING if pd.isna(zone.confidence) else percent(zone.confidence),
                "confidence_value": zone.confidence,
                "reasons": zone.reasons,
                "trend": trend_sentence(trends[trends.subject == zone.zone_id]),
                "sure_trend": trend_sentence(trends[trends.subject == zone.zone_id], sure=True),
                "rank_given": ranks.get(zone.zone_id),
            }
        )
    rows.sort(key=lambda r: (r["kind"] == "reconfiguration", np.inf if r["rank_given"] is None else r["rank_given"], -r["size"]))
    return [row | {"rank": i + 1} for i, row in enumerate(rows)]


def trend_sentence(rows: pd.DataFrame, *, sure: bool = False) -> str:
    """Return the trends of one zone or dent in words; with ``sure`` only the rates that carry no reservation."""
    parts = []
    for row in records(rows.drop_duplicates("kind")):
        if pd.isna(row.rate_per_year) or (sure and row.remark):
            continue
        text = f"{row.kind} {rate(row.kind, row.rate_per_year, row.rate_sigma_per_year)}"
        if row.remark:
            text = f"{row.kind}: {row.remark}"
        elif row.forecast_date and not pd.isna(row.forecast_probability) and row.forecast_probability >= 0.5:
            likely = percent(row.forecast_probability)
            text += f", {quantity(row.kind, row.limit_value)} about {str(row.forecast_date)[:7]} ({likely})"
        parts.append(text)
    return "; ".join(parts)


def quantity(kind: str, value: Any) -> str:
    """Return the value of a trend in the unit that suits its kind."""
    if "strain" in str(kind):
        return microstrain(value)
    return number(_mm(value), 1, "mm") if "dent" in str(kind) else number(value, 2, "m")


def rate(kind: str, value: Any, sigma: Any = None) -> str:
    """Return a rate per year in the unit that suits its kind."""
    if "strain" in str(kind):
        return microstrain(value, sigma, sign=True) + "/a"
    scaled = [None if v is None or pd.isna(v) else 1000 * float(v) for v in (value, sigma)]
    return with_sigma(scaled[0], scaled[1], 1 if "dent" in str(kind) else 0, "mm/a", sign=True)


def trend_rows(content: Content) -> list[dict[str, str]]:
    """Return the table of trends for people."""
    rows = []
    for row in records(content.tables["trends"].sort_values("rank", na_position="last")):
        low_high = " to ".join(rate(row.kind, v) for v in (row.rate_low_per_year, row.rate_high_per_year))
        rows.append(
            {
                "rank": NOTHING if pd.isna(row.rank) else str(int(row.rank)),
                "subject": row.subject,
                "kind": row.kind,
                "epochs": NOTHING if pd.isna(row.n_epochs) else str(int(row.n_epochs)),
                "rate": rate(row.kind, row.rate_per_year, row.rate_sigma_per_year),
                "rate_value": row.rate_per_year,
                "interval": low_high if not pd.isna(row.rate_low_per_year) else NOTHING,
                "last": quantity(row.kind, row.last_value),
                "limit": quantity(row.kind, row.limit_value),
                "limit_name": row.limit_name,
                "forecast": row.forecast_date or "not within the horizon",
                "probability": "" if pd.isna(row.forecast_probability) else f"probability {percent(row.forecast_probability)}",
                "remark": row.remark,
            }
        )
    return rows


def dent_rows(content: Content) -> list[dict[str, Any]]:
    """Return one entry per dent with its sizes in every run; grown and new dents first, then by depth."""
    order = {name: i for i, name in enumerate(content.ids)}
    diameter, trends = content.outside_diameter, dict(list(content.tables["trends"].groupby("subject")))
    groups: dict[str, list[Any]] = {}
    for row in sorted(records(content.tables["dents"]), key=lambda r: order.get(r.run, -1)):
        groups.setdefault(str(row.dent_id), []).append(row)
    rows = []
    for dent_id, group in groups.items():
        last = group[-1]
        epochs = [_dent_epoch(row, diameter) for row in group]
        depth = max((float(row.depth_m) for row in group if np.isfinite(row.depth_m)), default=np.nan)
        rows.append(
            {
                "id": dent_id,
                "status": str(last.status),
                "statuses": ", ".join(e["status"] for e in epochs),
                "chainage": float(last.reference_chainage_m),
                "place": number(last.reference_chainage_m, 2, "m"),
                "joint": last.joint_id or NOTHING,
                "clock": NOTHING if pd.isna(last.clock_deg) else clock_text(float(last.clock_deg)),
                "clock_deg": last.clock_deg,
                "depth_value": depth,
                "depth": epochs[-1]["depth"],
                "depth_share": epochs[-1]["depth_share"],
                "strain": NOTHING if pd.isna(last.strain_max) else f"{100 * last.strain_max:.2f} %",
                "strain_value": last.strain_max,
                "size": f"{number(_mm(last.length_m), 0)} × {number(_mm(last.width_m), 0, 'mm')}",
                "change": epochs[-1]["change"],
                "change_value": last.depth_change_m,
                "reason": last.reason,
                "epochs": epochs,
                "trend": trend_sentence(trends[dent_id]) if dent_id in trends else "",
                "sure_trend": trend_sentence(trends[dent_id], sure=True) if dent_id in trends else "",
            }
        )
    urgency = {"grown": 0, "new": 1, "rerounded": 2}
    rows.sort(key=lambda r: (urgency.get(r["status"], 3), -(r["depth_value"] if np.isfinite(r["depth_value"]) else -1)))
    return rows


def _mm(value: Any) -> float | None:
    return None if value is None or pd.isna(value) else 1000 * float(value)


def _dent_epoch(row: Any, diameter: float) -> dict[str, Any]:
    share = row.depth_m / diameter if diameter > 0 and not pd.isna(row.depth_m) else None
    return {
        "run": row.run,
        "status": row.status,
        "chainage": float(row.run_chainage_m),
        "clock_deg": float(row.clock_deg) if not pd.isna(row.clock_deg) else np.nan,
        "length_value": row.length_m if not pd.isna(row.length_m) else np.nan,
        "clock": NOTHING if pd.isna(row.clock_deg) else clock_text(float(row.clock_deg)),
        "depth_value": row.depth_m,
        "depth": with_sigma(_mm(row.depth_m), _mm(row.depth_sigma_m), 1, "mm"),
        "depth_share": NOTHING if share is None else f"{100 * share:.1f} % OD",
        "length": number(_mm(row.length_m), 0, "mm"),
        "width": number(_mm(row.width_m), 0, "mm"),
        "change": with_sigma(_mm(row.depth_change_m), _mm(row.depth_change_sigma_m), 1, "mm", sign=True),
        "reason": row.reason,
    }


def verdict(content: Content, zones: list[dict], dents: list[dict]) -> list[str]:
    """Return the findings of the survey, one sentence each, the gravest first."""
    if len(content.runs) == 1:
        alone = f"One run ({content.ids[0]}): what the pipe is like today. Change needs a second run."
        return [alone, *_extremes(content), *_dent_verdict(dents, 1)]
    span = f"between {content.runs[0].attrs.get('date')} and {content.runs[-1].attrs.get('date')}"
    moved = [z for z in zones if z["kind"] != "reconfiguration"]
    said = []
    if moved:
        said.append(f"{_count(len(moved), 'zone')} moved or bent significantly {span}.")
        said += _peaks(moved)
        said += [f"{z['id']} goes on: {z['sure_trend']}." for z in moved[:3] if z["sure_trend"]]
    elif content.compares_movement:
        said.append(f"No zone moved or bent significantly {span}; the detection limits say what could have been seen.")
    else:
        said.append(f"The runs {span} were compared joint by joint and dent by dent; movement cannot be judged from them.")
    replaced = [z for z in zones if z["kind"] == "reconfiguration"]
    if replaced:
        were = "was" if len(replaced) == 1 else "were"
        said.append(f"{_count(len(replaced), 'stretch', 'stretches')} of pipe {were} replaced or re-routed.")
    return said + _dent_verdict(dents, len(content.runs))


def _extremes(content: Content) -> list[str]:
    """Return where the bending strain and the ovality of a single run are largest."""
    ds, said = content.group(content.ids[0], "centreline"), []
    for name, title, show in (
        ("bending_strain", "bending strain", microstrain),
        ("ovality", "ovality", lambda v: f"{100 * v:.2f} %"),
    ):
        if ds is None or name not in ds or not np.isfinite(ds[name].values).any():
            continue
        i = int(np.nanargmax(ds[name].values))
        said.append(
            f"Largest {title}: {show(float(ds[name].values[i]))} at {number(ds['chainage'].values[i], 1, 'm')}, bends included."
        )
    return said


def _peaks(moved: list[dict]) -> list[str]:
    said = []
    for key, name in (("displacement", "displacement"), ("strain", "change of bending strain")):
        measured = [z for z in moved if not pd.isna(z[f"{key}_value"])]
        if not measured:
            continue
        peak = max(measured, key=lambda z: abs(z[f"{key}_value"]))
        direction = f", towards {peak['direction']}" if key == "displacement" and peak["direction"] != NOTHING else ""
        said.append(f"Largest {name}: {peak[key]} in {peak['id']} at {peak['place']}{direction}.")
    return said


def _dent_verdict(dents: list[dict], n_runs: int) -> list[str]:
    if not dents:
        return []
    sized = [d for d in dents if np.isfinite(d["depth_value"])]
    deepest = max(sized, key=lambda d: d["depth_value"], default=None)
    deep = f"; the deepest is {deepest['id']}, {deepest['depth']} ({deepest['depth_share']})" if deepest else ""
    said = [f"{_count(len(dents), 'dent')}{deep}."]
    if n_runs > 1:
        changes = []
        for word, text in _DENT_WORDS.items():
            ids = [d["id"] for d in dents if d["status"] == word]
            if ids:
                changes.append(f"{len(ids)} {text}" + (f" ({', '.join(ids)})" if len(ids) <= 4 else ""))
        said.append(f"Of the dents {', '.join(changes)}." if changes else "No dent changed significantly.")
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
    if len(content.runs) == 1:
        said.append("One run alone shows shape and strain as they are; whether they change cannot be said.")
    if "centreline" in content.run(content.reference).children:
        said.append("An inertial unit sees bending, not axial strain; the change of joint length is the only axial cue.")
    return said


def facts(content: Content, zones: list[dict], dents: list[dict]) -> list[dict[str, str]]:
    """Return the key numbers of the first screen."""
    welds = content.tables["welds"]
    matched = welds[welds.status.isin(["matched", "shifted"])]
    joined = int((matched.groupby("weld_id").run.nunique() == len(content.runs)).sum()) if len(content.runs) > 1 else 0
    moved = [z for z in zones if z["kind"] != "reconfiguration"]
    rows = [
        (
            "runs",
            str(len(content.runs)),
            " – ".join(dict.fromkeys([content.dates[content.ids[0]], content.dates[content.ids[-1]]])),
        ),
        ("zones of change", _moved_count(content, moved), f"{len(zones) - len(moved)} replaced or re-routed"),
        ("dents", str(len(dents)), f"{sum(d['status'] in ('grown', 'new') for d in dents)} grown or new"),
    ]
    if len(content.runs) > 1:
        rows.append(("welds in all runs", number(joined, 0), f"of {number(welds.weld_id.nunique(), 0)} known"))
    return [{"name": n, "value": v, "note": t} for n, v, t in rows]


def _moved_count(content: Content, moved: list[dict]) -> str:
    return str(len(moved)) if moved or content.compares_movement else NOTHING


def _count(n: int, one: str, many: str = "") -> str:
    return f"{n} {one if n == 1 else many or one + 's'}"
