"""The content of an output folder in, the tables of a workbook out: frames with heads, and the quantity of every column."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from deform.report.content import Content
from deform.report.dents import told_status
from deform.report.limits import noise
from deform.report.quality import flat, inputs, marker_rows, sensor_rows
from deform.report.quantities import OF_TREND, column, heading, measure
from deform.units import clock_text


@dataclass
class Sheet:
    """One sheet: its name, a note above the table, the table, what each column holds, and which columns carry coloured words.

    ``kinds`` gives for a column the name of its quantity, or ``text``, ``wrap``, ``count``, ``clock``.
    """

    name: str
    note: str
    frame: pd.DataFrame = field(default_factory=pd.DataFrame)
    kinds: dict[str, str] = field(default_factory=dict)
    coloured: tuple[str, ...] = ()

    def add(self, title: str, values: Iterable[Any], kind: str = "text") -> None:
        """Add a column of text, counts or clock positions."""
        self.frame[title] = pd.Series(list(values), dtype=object)
        self.kinds[title] = kind

    def measured(self, title: str, quantity: str, values: Iterable[Any]) -> None:
        """Add a column of a quantity (SI); its unit is put into the head, its values are those that page and PDF show."""
        head = heading(title, quantity)
        self.frame[head] = column(quantity, values)
        self.kinds[head] = quantity


def build(content: Content, numbers: dict[str, Any]) -> list[Sheet]:
    """Return all sheets after the summary."""
    return [make(content, numbers) for make in _SHEETS]


def joints(content: Content, _: dict[str, Any]) -> Sheet:
    """Return the pipe tally: one row per joint, its length in every run, its welds, wall and dents."""
    t = content.tables["joints"]
    sheet = Sheet("Joints", "One row per physical joint. Lengths along the pipe; changes against the reference run, + = longer.")
    sheet.add("Joint number", t.joint_id)
    sheet.add("U/S girth weld", t.weld_id_start)
    sheet.add("D/S girth weld", t.weld_id_end)
    sheet.measured("U/S weld chainage", "chainage", t.reference_chainage_m)
    _add_vendor_numbers(sheet, content, t)
    for run in content.ids:
        if f"length_m:{run}" in t:
            sheet.measured(f"Joint length {run}", "joint length", t[f"length_m:{run}"])
        if f"change_m:{run}" in t:
            sheet.measured(f"Length change {run}", "joint length change", t[f"change_m:{run}"])
            sheet.measured(f"Length change ± 1σ {run}", "joint length change", t[f"change_sigma_m:{run}"])
    dents = content.tables["dents"].groupby("joint_id").dent_id.agg(lambda ids: ", ".join(dict.fromkeys(ids)))
    sheet.add("Dents", [dents.get(joint, "") for joint in t.joint_id])
    sheet.add("Begins", t.begins)
    sheet.add("Ends", t.ends)
    return sheet


def _add_vendor_numbers(sheet: Sheet, content: Content, joints: pd.DataFrame) -> None:
    """Add the number that a vendor gave the joint, and its wall, for every run whose list of welds has them."""
    welds = content.tables["welds"]
    for run in content.ids:
        ds = content.group(run, "welds")
        own = welds[(welds.run == run) & welds["index"].notna()].drop_duplicates("weld_id")
        if ds is None or own.empty:
            continue
        place = dict(zip(own.weld_id, own["index"].astype(int), strict=True))
        index = [place.get(weld, -1) for weld in joints.weld_id_start]
        if "label" in ds and any(str(v) for v in ds["label"].values):
            labels = ds["label"].values.astype(str)
            sheet.add(f"Vendor's number {run}", [labels[i] if 0 <= i < labels.size else "" for i in index])
        if "wall_thickness" in ds:
            walls = ds["wall_thickness"].values
            sheet.measured(f"Wall {run}", "wall", [walls[i] if 0 <= i < walls.size else np.nan for i in index])


def zones(content: Content, numbers: dict[str, Any]) -> Sheet:
    """Return the zones of change, ranked as on the page."""
    rows = numbers["zones"]
    sheet = Sheet("Zones", "Chainage of the reference run. Peaks with one standard deviation.", coloured=("Severity",))
    sheet.add("Zone", [z["id"] for z in rows])
    sheet.add("Rank", [z["rank"] for z in rows], "count")
    sheet.add("Kind", [z["kind"] for z in rows])
    sheet.add("Severity", [z["severity"] for z in rows])
    sheet.measured("Start chainage", "place", [z["start"] for z in rows])
    sheet.measured("End chainage", "place", [z["end"] for z in rows])
    sheet.measured("Length", "extent", [z["length"].value for z in rows])
    sheet.add("First seen", [z["first_epoch"] for z in rows])
    for title, key in (("Peak displacement", "displacement"), ("Peak strain change", "strain")):
        sheet.measured(title, key, [z[key].value for z in rows])
        sheet.measured(f"{title} ± 1σ", key, [z[key].sigma for z in rows])
    sheet.add("Direction of movement", [z["direction"] for z in rows])
    sheet.measured("Confidence", "probability", [z["confidence_value"] for z in rows])
    sheet.add("How it goes on", [z["headline"] for z in rows], "wrap")
    sheet.add("Reasons", ["; ".join(z["reasons"]) for z in rows], "wrap")
    return sheet


def dents(content: Content, _: dict[str, Any]) -> Sheet:
    """Return the dents, one row per dent and run."""
    t, diameter = content.tables["dents"], content.outside_diameter
    note = "Orientation looking downstream, 12:00 at the top. Length and width: full extents at a tenth of the depth."
    sheet = Sheet("Dents", note, coloured=("Status",))
    sheet.add("Dent", t.dent_id)
    sheet.add("Run", t.run)
    sheet.add("Status", told_status(t))
    sheet.measured("Chainage, reference run", "chainage", t.reference_chainage_m)
    sheet.measured("Chainage, this run", "chainage", t.run_chainage_m)
    sheet.add("Joint number", t.joint_id)
    sheet.add("Orientation [h:mm]", [clock_text(c) if np.isfinite(c) else "" for c in t.clock_deg.astype(float)], "clock")
    sheet.measured("Depth", "dent depth", t.depth_m)
    sheet.measured("Depth ± 1σ", "dent depth", t.depth_sigma_m)
    sheet.measured("Depth", "dent depth share", t.depth_m.astype(float) / diameter)
    sheet.measured("Length", "dent size", t.length_m)
    sheet.measured("Width", "dent size", t.width_m)
    sheet.measured("Depth change", "dent depth change", t.depth_change_m)
    sheet.measured("Depth change ± 1σ", "dent depth change", t.depth_change_sigma_m)
    sheet.measured("Maximum strain", "dent strain", t.strain_max)
    sheet.add("Why", t.reason, "wrap")
    return sheet


def trends(content: Content, _: dict[str, Any]) -> Sheet:
    """Return rates and forecasts, each in the unit of its quantity, which a column names."""
    t = content.tables["trends"].sort_values("rank", na_position="last")
    sheet = Sheet("Trends", "Rates are per year; rates, values and limits are in the unit of the column Unit.")
    kinds = [OF_TREND.get(str(kind), "displacement") for kind in t.kind]
    sheet.add("Rank", t["rank"], "count")
    sheet.add("Zone or dent", t.subject)
    sheet.add("Quantity", t.kind)
    sheet.add("Unit", [_rate_unit(kind) for kind in kinds])
    sheet.add("Runs", t.n_epochs, "count")
    for title, name in (
        ("Rate per year", "rate_per_year"),
        ("Rate ± 1σ", "rate_sigma_per_year"),
        ("Rate, low", "rate_low_per_year"),
        ("Rate, high", "rate_high_per_year"),
    ):
        sheet.add(title, [column(f"{kind} rate", [v])[0] for kind, v in zip(kinds, t[name], strict=True)], "dent depth rate")
    sheet.measured("Probability of interval", "probability", t.interval_probability)
    for title, name in (("Last value", "last_value"), ("Limit value", "limit_value")):
        sheet.add(title, [_in_rate_unit(kind, v) for kind, v in zip(kinds, t[name], strict=True)], "dent depth rate")
    sheet.add("Limit", t.limit_name, "wrap")
    sheet.add("Forecast date", t.forecast_date)
    sheet.measured("Forecast probability", "probability", t.forecast_probability)
    sheet.add("Remark", t.remark, "wrap")
    return sheet


def _rate_unit(kind: str) -> str:
    return measure(f"{kind} rate", 0).unit.removesuffix("/a")


def _in_rate_unit(kind: str, value: float) -> float:
    """Return a value in the unit of its rate, rounded to the decimals that its own unit shows."""
    own, rate = measure(kind, value).quantity, measure(f"{kind} rate", value).quantity
    return float(column(kind, [value])[0]) / own.factor * rate.factor


def unmatched(content: Content, _: dict[str, Any]) -> Sheet:
    """Return every weld that is not in all runs, with its reason."""
    t = content.tables["welds"]
    t = t[~t.status.isin(["matched", "shifted"])]
    sheet = Sheet("Unmatched", "Welds that are missed, false, added or removed; all others are matched.", coloured=("Status",))
    sheet.add("Girth weld", t.weld_id)
    sheet.add("Run", t.run)
    sheet.add("Status", t.status)
    sheet.measured("Chainage, reference run", "chainage", t.reference_chainage_m)
    sheet.measured("Chainage, this run", "chainage", t.chainage_m)
    sheet.measured("Log distance", "chainage", t.log_distance_m)
    sheet.measured("Probability", "probability", t.probability)
    sheet.add("Reason", t.reason, "wrap")
    return sheet


def features(content: Content, numbers: dict[str, Any]) -> Sheet:
    """Return every feature of every run."""
    rows = numbers["features"]["rows"]
    sheet = Sheet("Features", "Chainage of the run itself. Orientation looking downstream, 12:00 at the top.")
    for i, title in enumerate(
        ("Run", "Start chainage", "End chainage", "Feature", "Orientation [h:mm]", "Size", "Comment", "Label")
    ):
        values = [row[i] for row in rows]
        if "chainage" in title:
            sheet.measured(title, "chainage", values)
        else:
            sheet.add(title, [v or "" for v in values], "clock" if "Orientation" in title else "text")
    return sheet


def limits(content: Content, _: dict[str, Any]) -> Sheet:
    """Return noise floors and detection limits, one row each."""
    t = content.tables.get("limits", pd.DataFrame())
    sheet = Sheet(
        "Limits", "Noise floors (no length of movement) and the least movement or elongation that is found. Speeds: of both runs."
    )
    if not {"run_from", "quantity", "noise_sigma", "wavelength_m"} <= set(t.columns):
        return sheet
    floors = [noise(str(q), v) if pd.isna(w) else None for q, v, w in zip(t.quantity, t.noise_sigma, t.wavelength_m, strict=True)]
    sheet.add("Run from", t.run_from.astype(str))
    sheet.add("Run to", t.run_to.astype(str))
    for title, name in (("Quantity", "quantity"), ("Component", "component"), ("Speeds", "speed_class")):
        sheet.add(title, t.get(name, pd.Series("", t.index)).fillna("").astype(str))
    sheet.add(
        "Noise floor, 1σ",
        [None if f is None else round(f.value * f.quantity.factor, f.quantity.decimals) for f in floors],
        "ovality noise",
    )
    sheet.add("Unit of the floor", ["" if f is None else f.unit for f in floors])
    sheet.measured("Length of movement", "wavelength", t.wavelength_m)
    for title, quantity, name in (
        ("Found in half of all cases", "noise", "limit_displacement_m"),
        ("Found in nine of ten", "noise", "limit_90_displacement_m"),
        ("Its strain change", "strain noise", "limit_strain_change"),
        ("Its axial strain", "axial strain", "limit_axial_strain"),
        ("Elongation found in half of all cases", "noise", "limit_elongation_m"),
    ):
        if name in t:
            sheet.measured(title, quantity, t[name])
    sheet.add("Decided by", t.get("decided_by", pd.Series("", t.index)).fillna("").astype(str))
    return sheet


def quality_sheet(content: Content, _: dict[str, Any]) -> Sheet:
    """Return warnings, what is missing, what the sensors gave, markers and stages in one list."""
    survey = content.survey
    rows = [("Warning", str(w.get("stage", "")), "", str(w.get("message", ""))) for w in survey.get("warnings", [])]
    rows += [("Not there", "", str(m.get("output", "")), str(m.get("reason", ""))) for m in survey.get("missing", [])]
    rows += [("Not there", "", what, why) for what, why in content.absent]
    rows += [("Sensors", row["run"], name, text) for row in sensor_rows(content) for name, text in row["entries"]]
    for m in marker_rows(content):
        before, after = (" / ".join(v.number for v in m[key]) for key in ("before", "after"))
        said = f"east / north / up before {before} m, after {after} m; used: {m['used']} {m['remark']}".strip()
        rows.append(("Marker", m["run"], m["name"], said))
    for s in survey.get("stages", []):
        used = f"{measure('seconds', s.get('seconds'))}, {measure('memory', s.get('peak_memory_mb'))}, {s.get('status')}"
        rows.append(("Stage", "", str(s.get("name")), used))
    sheet = Sheet("Quality", "What limits the results.")
    for i, title in enumerate(("What", "Run or stage", "Item", "Said")):
        sheet.add(title, [row[i] for row in rows], "wrap" if title == "Said" else "text")
    return sheet


def parameters(content: Content, _: dict[str, Any]) -> Sheet:
    """Return versions, every option, and the hash of every input."""
    rows = [("version", "deform", str(content.survey.get("deform_version", "")))]
    rows += [("option", name, value) for name, value in flat(content.survey.get("options", {})) if name]
    rows += [("SHA-256", f"{run} {name}", digest) for run, name, digest in inputs(content)]
    sheet = Sheet("Parameters", "Everything needed to make these results again.")
    for i, title in enumerate(("What", "Name", "Value")):
        sheet.add(title, [row[i] for row in rows])
    return sheet


_SHEETS: tuple[Callable[[Content, dict[str, Any]], Sheet], ...] = (
    joints,
    zones,
    dents,
    trends,
    unmatched,
    features,
    limits,
    quality_sheet,
    parameters,
)
