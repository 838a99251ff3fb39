"""The content of an output folder in, a workbook in the wording of a pipe tally out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xlsxwriter

from deform.options import ReportOptions
from deform.report.content import Content
from deform.report.context import build_context
from deform.report.quality import flat, inputs, marker_rows
from deform.run import store
from deform.units import clock_text

Sheet = tuple[pd.DataFrame, str]
_FORMATS = {"m": "#,##0.000", "mm": "0.0", "µε": "#,##0", "%": "0.00", "°": "0.0", "h:mm": "@", "1": "0.000", "1/a": "0.0000"}
_WIDEST = 60


def write(content: Content, options: ReportOptions) -> Path:
    """Write ``report/report.xlsx`` and return its path."""
    path = content.folder / "report" / "report.xlsx"
    with store.atomic(path) as place:
        book = xlsxwriter.Workbook(place, {"nan_inf_to_errors": False, "strings_to_formulas": False, "strings_to_urls": False})
        book.set_properties({"title": options.title or f"{content.line}: deformation report", "comments": "made by deform"})
        styles = _styles(book)
        _write_summary(book.add_worksheet("Summary"), content, options, styles)
        for name, build in _SHEETS.items():
            _write_sheet(book.add_worksheet(name), *build(content), styles)
        book.close()
    return path


def joints(content: Content) -> Sheet:
    """Return the pipe tally: one row per joint, its length in every run, its weld, its dents."""
    table = content.tables["joints"]
    columns = {
        "Joint number": table.joint_id,
        "U/S girth weld": table.weld_id_start,
        "D/S girth weld": table.weld_id_end,
        "U/S weld chainage [m]": table.reference_chainage_m,
    }
    for run in content.ids:
        for key, title in (("length_m", "Joint length"), ("change_m", "Length change"), ("change_sigma_m", "Length change ± 1σ")):
            if f"{key}:{run}" in table:
                columns[f"{title} {run} [{'m' if key == 'length_m' else 'mm'}]"] = table[f"{key}:{run}"] * (
                    1 if key == "length_m" else 1000
                )
    dents = content.tables["dents"].groupby("joint_id").dent_id.agg(lambda ids: ", ".join(dict.fromkeys(ids)))
    columns |= {"Dents": table.joint_id.map(dents).fillna(""), "Begins": table.begins, "Ends": table.ends}
    return pd.DataFrame(
        columns
    ), "One row per physical joint. Lengths along the pipe; changes against the reference run, + = longer."


def zones(content: Content) -> Sheet:
    """Return the zones of change."""
    t = content.tables["zones"]
    frame = pd.DataFrame(
        {
            "Zone": t.zone_id,
            "Kind": t.kind,
            "Start chainage [m]": t.start_m,
            "End chainage [m]": t.end_m,
            "Length [m]": t.end_m - t.start_m,
            "First seen": t.first_epoch,
            "Peak strain change [µε]": t.peak_strain_change * 1e6,
            "Peak strain change ± 1σ [µε]": t.peak_strain_change_sigma * 1e6,
            "Peak displacement [m]": t.peak_displacement_m,
            "Peak displacement ± 1σ [m]": t.peak_displacement_sigma_m,
            "Direction of movement [°]": t.direction_deg,
            "Confidence [1]": t.confidence,
            "Reasons": t.reasons,
        }
    )
    return frame, "Chainage of the reference run. Direction: azimuth of the horizontal movement, clockwise from true north."


def dents(content: Content) -> Sheet:
    """Return the dents, one row per dent and run."""
    t, diameter = content.tables["dents"], content.outside_diameter
    clock = [clock_text(c) if np.isfinite(c) else "" for c in t.clock_deg.astype(float)]
    frame = pd.DataFrame(
        {
            "Dent": t.dent_id,
            "Run": t.run,
            "Status": t.status,
            "Chainage, reference run [m]": t.reference_chainage_m,
            "Chainage, this run [m]": t.run_chainage_m,
            "Joint number": t.joint_id,
            "Orientation [h:mm]": clock,
            "Depth [mm]": t.depth_m * 1000,
            "Depth ± 1σ [mm]": t.depth_sigma_m * 1000,
            "Depth of OD [%]": 100 * t.depth_m / diameter,
            "Length [mm]": t.length_m * 1000,
            "Width [mm]": t.width_m * 1000,
            "Depth change [mm]": t.depth_change_m * 1000,
            "Depth change ± 1σ [mm]": t.depth_change_sigma_m * 1000,
            "Maximum strain [%]": t.strain_max * 100,
            "Why": t.reason,
        }
    )
    return frame, "Orientation looking downstream, 12:00 at the top. Length and width: full extents at a tenth of the depth."


def trends(content: Content) -> Sheet:
    """Return rates and forecasts; strains in microstrain, lengths in millimetre."""
    t = content.tables["trends"].sort_values("rank", na_position="last")
    factor = np.where(t.kind.str.contains("strain"), 1e6, 1e3)
    frame = pd.DataFrame(
        {
            "Rank": t["rank"],
            "Zone or dent": t.subject,
            "Quantity": t.kind,
            "Unit": np.where(t.kind.str.contains("strain"), "µε", "mm"),
            "Runs": t.n_epochs,
            "Rate per year [1/a]": t.rate_per_year * factor,
            "Rate ± 1σ [1/a]": t.rate_sigma_per_year * factor,
            "Rate, low [1/a]": t.rate_low_per_year * factor,
            "Rate, high [1/a]": t.rate_high_per_year * factor,
            "Probability of interval [1]": t.interval_probability,
            "Last value [1]": t.last_value * factor,
            "Limit": t.limit_name,
            "Limit value [1]": t.limit_value * factor,
            "Forecast date": t.forecast_date,
            "Forecast probability [1]": t.forecast_probability,
            "Remark": t.remark,
        }
    )
    return frame, "Rates, values and limits in the unit of the column Unit."


def unmatched(content: Content) -> Sheet:
    """Return every weld that is not in all runs, with its reason."""
    t = content.tables["welds"]
    t = t[~t.status.isin(["matched", "shifted"])]
    frame = pd.DataFrame(
        {
            "Girth weld": t.weld_id,
            "Run": t.run,
            "Status": t.status,
            "Chainage, reference run [m]": t.reference_chainage_m,
            "Chainage, this run [m]": t.chainage_m,
            "Log distance [m]": t.log_distance_m,
            "Probability [1]": t.probability,
            "Reason": t.reason,
        }
    )
    return frame, "Welds that are missed, false, added or removed; all others are matched."


def quality_sheet(content: Content) -> Sheet:
    """Return warnings, what is missing, markers and stages in one list."""
    survey = content.survey
    rows = [("Warning", w.get("stage"), w.get("message")) for w in survey.get("warnings", [])]
    rows += [("Not there", m.get("output"), m.get("reason")) for m in survey.get("missing", [])]
    rows += [("Not there", what, why) for what, why in content.absent]
    rows += [
        (
            "Marker",
            f"{m['run']} {m['name']}",
            f"east / north / up before {m['before']} m, after {m['after']} m; used: {m['used']} {m['remark']}",
        )
        for m in marker_rows(content)
    ]
    rows += [
        ("Stage", s.get("name"), f"{s.get('seconds')} s, {s.get('peak_memory_mb')} MB, {s.get('status')}")
        for s in survey.get("stages", [])
    ]
    for name, frame in content.tables.items():
        if name not in ("zones", "dents", "trends", "joints", "welds"):
            rows += [
                (name.capitalize(), str(i + 1), "; ".join(f"{k} = {v}" for k, v in row.items()))
                for i, row in enumerate(frame.to_dict("records"))
            ]
    return pd.DataFrame(rows, columns=["What", "Where", "Said"]), "What limits the results."


def parameters(content: Content) -> Sheet:
    """Return versions, every option, and the hash of every input."""
    rows = [("version", "deform", str(content.survey.get("deform_version", "")))]
    rows += [("option", name, value) for name, value in flat(content.survey.get("options", {})) if name]
    rows += [("SHA-256", f"{run} {name}", digest) for run, name, digest in inputs(content)]
    return pd.DataFrame(rows, columns=["What", "Name", "Value"]), "Everything needed to make these results again."


_SHEETS: dict[str, Callable[[Content], Sheet]] = {
    "Joints": joints,
    "Zones": zones,
    "Dents": dents,
    "Trends": trends,
    "Unmatched": unmatched,
    "Quality": quality_sheet,
    "Parameters": parameters,
}


def _styles(book: Any) -> dict[str, Any]:
    styles = {unit: book.add_format({"num_format": code, "valign": "top"}) for unit, code in _FORMATS.items()}
    head = {"bold": True, "text_wrap": True, "valign": "top", "bg_color": "#E8EBEE", "bottom": 1}
    return styles | {
        "head": book.add_format(head),
        "text": book.add_format({"valign": "top"}),
        "wrap": book.add_format({"valign": "top", "text_wrap": True}),
        "title": book.add_format({"bold": True, "font_size": 16}),
        "bold": book.add_format({"bold": True, "valign": "top"}),
        "quiet": book.add_format({"italic": True, "font_color": "#5B626B"}),
    }


def _write_summary(sheet: Any, content: Content, options: ReportOptions, styles: dict[str, Any]) -> None:
    numbers = build_context(content, options)
    sheet.set_column(0, 0, 24)
    sheet.set_column(1, 9, 22)
    sheet.hide_gridlines(2)
    sheet.write_string(0, 0, numbers["title"], styles["title"])
    line = 2
    for sentence in [*numbers["verdict"], "", *numbers["limits_of_sources"]]:
        sheet.merge_range(line, 0, line, 9, sentence, styles["wrap"])
        line += 1
    line += 1
    head = ("run", "date", "source", "direction", "length", "diameter", "wall", "welds", "dents", "markers")
    for j, key in enumerate(head):
        sheet.write_string(line, j, key.capitalize(), styles["head"])
    for run in numbers["runs"]:
        line += 1
        for j, key in enumerate(("id", *head[1:])):
            sheet.write_string(
                line, j, str(run[key]) + (" (reference)" if key == "id" and run["is_reference"] else ""), styles["text"]
            )
    line += 2
    sheet.write_string(line, 0, f"Made {numbers['made']} by deform {numbers['version']}", styles["quiet"])
    sheet.set_landscape()
    sheet.fit_to_pages(1, 0)


def _write_sheet(sheet: Any, frame: pd.DataFrame, note: str, styles: dict[str, Any]) -> None:
    """Write a table below one line of note: filters, frozen head, a unit in each head, widths that fit."""
    sheet.write_string(0, 0, note, styles["quiet"])
    for j, title in enumerate(frame.columns):
        unit = title.rsplit("[", 1)[1].rstrip("]") if "[" in title else ""
        values = frame[title].tolist()
        style = styles.get(unit, styles["text"])
        sheet.write_string(1, j, title, styles["head"])
        longest = max((len(str(v)) for v in values[:500]), default=0) if not unit else 10
        wide = min(max(longest, max(len(word) for word in title.split()), 8) + 2, _WIDEST)
        sheet.set_column(j, j, wide)
        for i, value in enumerate(values):
            _write_cell(sheet, i + 2, j, value, style)
    sheet.freeze_panes(2, 1)
    if len(frame.columns):
        sheet.autofilter(1, 0, max(len(frame) + 1, 2), len(frame.columns) - 1)
    sheet.repeat_rows(1)
    sheet.set_landscape()
    sheet.fit_to_pages(1, 0)


def _write_cell(sheet: Any, row: int, column: int, value: Any, style: Any) -> None:
    if value is None or (not isinstance(value, str) and pd.isna(value)):
        sheet.write_blank(row, column, None, style)
    elif isinstance(value, str):
        sheet.write_string(row, column, value, style)
    else:
        sheet.write_number(row, column, float(value), style)
