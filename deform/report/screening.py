"""The output folders of many lines in, one page that ranks what changes over all of them out."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from deform.change.screen import screen
from deform.errors import DeformError
from deform.options import ReportOptions
from deform.report.content import Content, read_content
from deform.report.context import made
from deform.report.dents import dent_rows
from deform.report.findings import least_movement, verdict, what_is_missing
from deform.report.quantities import measure
from deform.report.sparkline import sparkline
from deform.report.templates import render
from deform.report.trend_view import trend_dataset
from deform.report.words import NOTHING, count, number
from deform.report.zones import moved, zone_rows
from deform.run import store
from deform.run.history import toolkit_version

_log = logging.getLogger(__name__)
Entry = dict[str, Any]


def write_screening(folders: Iterable[Path | str], target: Path | str, options: ReportOptions | None = None) -> Path:
    """Write the screening page of many lines and return its path.

    The places stand in the order of `deform.change.screen.screen`, so page and ``screening.csv`` agree; each has one row.

    Parameters
    ----------
    folders : output folders of surveys; one that cannot be read is named on the page with its fault.
    target : path of the page, such as ``screening.html``; reports of the lines are linked relative to it.
    options : the attention values that name the severity of the zones.
    """
    target, options = Path(target), options or ReportOptions()
    wanted = [Path(f) for f in folders]
    lines: list[Entry] = []
    entries: list[Entry] = []
    unread: list[tuple[str, str]] = []
    for folder in wanted:
        try:
            content = read_content(folder)
        except DeformError as fault:
            unread.append((str(folder), str(fault)))
            continue
        places = _places(content, options)
        lines.append(_line(content, places, options, _link(folder, target)))
        entries += [place | {"line": content.line, "link": lines[-1]["link"], "folder": str(folder)} for place in places]
    items = _ranked(entries, wanted)
    page = render(
        "screening.html",
        title=f"Screening of {count(len(lines), 'line')}",
        line="Screening",
        items=items,
        lines=lines,
        unread=unread,
        verdict=_verdict(items, lines, unread),
        facts=_facts(items, lines),
        made=made(),
        version=toolkit_version(),
        strain_attention=measure("strain", options.strain_attention),
        displacement_attention=measure("displacement", options.displacement_attention_m),
    )
    with store.atomic(target) as place:
        place.write_text(page, encoding="utf-8")
    return target


def _places(content: Content, options: ReportOptions) -> list[Entry]:
    """Return the zones that moved, and the dents that grew or are new, of one line."""
    found = []
    for zone in moved(zone_rows(content, options)):
        value = ", ".join(str(v) for v in (zone["displacement"], zone["strain"]) if v)
        said = {"of": "zone", "subject": zone["id"], "what": f"{zone['id']}, {zone['kind']}", "value": value}
        said["severity"] = zone["severity"]
        found.append(said | {"place": zone["first"], "headline": zone["headline"], "spark": _spark(content, zone["id"])})
    for dent in dent_rows(content):
        if dent["status"] in ("grown", "new"):
            value = f"{dent['depth']} ({dent['depth_share']})" if dent["depth_share"] else str(dent["depth"])
            said = {"of": "dent", "subject": dent["id"], "what": f"{dent['id']}, dent {dent['status']}", "value": value}
            said["severity"] = "medium"
            found.append(said | {"place": dent["place"], "headline": dent["headline"], "spark": _spark(content, dent["id"])})
    return found


def _ranked(entries: list[Entry], folders: list[Path]) -> list[Entry]:
    """Return the places in the order of the screening table; those without a rate come last, the severest first."""
    names: dict[str, str] = {}
    order: dict[tuple[str, str], tuple[int, float]] = {}
    try:
        found = screen(folders)
        names = dict(zip(found.lines["folder"], found.lines["line"], strict=True)) if len(found.lines) else {}
        for row in found.table.to_dict("records"):
            order.setdefault((str(row["line"]), str(row["subject"])), (len(order), float(row["limit_used"])))
    except (DeformError, OSError, ValueError, KeyError) as fault:  # a broken table costs the ranks, not the page
        _log.warning("places are ranked by severity alone: %s", fault)
    severity = {"high": 0, "medium": 1, "low": 2}
    keys = [order.get((str(names.get(e["folder"], e["line"])), str(e["subject"])), (len(order), np.nan)) for e in entries]
    ranked = sorted(zip(keys, entries, strict=True), key=lambda pair: (pair[0][0], severity.get(pair[1]["severity"], 3)))
    return [
        entry | {"rank": i + 1, "used": NOTHING if pd.isna(used) else number(100 * float(used), 0, "%")}
        for i, ((_, used), entry) in enumerate(ranked)
    ]


def _link(folder: Path, target: Path) -> str:
    page = folder / "report" / "index.html"
    return Path(os.path.relpath(page, target.parent)).as_posix() if page.exists() else ""


def _line(content: Content, places: list[Entry], options: ReportOptions, link: str) -> Entry:
    """Return one row of the table of lines: its runs, counts, the smallest movement seen, and what could not be judged."""
    zones = zone_rows(content, options)
    missing = [f"{m.get('output')}: {m.get('reason')}" for m in content.survey.get("missing", [])]
    blind = not content.compares_movement and len(content.runs) > 1
    why = ["movement: the runs hold no positions and no curvature"] if blind else []
    return {
        "line": content.line,
        "link": link,
        "runs": ", ".join(f"{run} ({content.dates[run]})" if content.dates[run] else run for run in content.ids),
        "verdict": verdict(content, zones, dent_rows(content)),
        "zones": len(moved(zones)),
        "dents": sum(place["of"] == "dent" for place in places),
        "judged": content.compares_movement,
        "least": least_movement(content),
        "unjudged": why + what_is_missing(content) + missing + [f"{what}: {reason}" for what, reason in content.absent],
    }


def _spark(content: Content, subject: str) -> Markup:
    return sparkline(trend_dataset(content, subject))


def _verdict(items: list[Entry], lines: list[Entry], unread: list[tuple[str, str]]) -> list[str]:
    if not lines:
        return ["No line could be read."] if unread else ["No line was given: 0 places."]
    changed = {item["line"] for item in items}
    said = [f"{count(len(items), 'place')} changed on {count(len(changed), 'line')} of {len(lines)}."]
    if items:
        first = items[0]
        said.append(f"First: {first['what']} of {first['line']} at {first['place']}: {first['headline']}.")
    still = [line["line"] for line in lines if line["line"] not in changed]
    if still:
        said.append(f"Nothing significant on {', '.join(still[:6])}{' and others' if len(still) > 6 else ''}.")
    if unread:
        said.append(f"{count(len(unread), 'folder')} could not be read.")
    return said


def _facts(items: list[Entry], lines: list[Entry]) -> list[Entry]:
    high = sum(item["severity"] == "high" for item in items)
    blind = sum(not line["judged"] for line in lines)
    return [
        {"name": "lines", "value": number(len(lines), 0), "note": f"{blind} without a judgement of movement"},
        {"name": "places", "value": number(len(items), 0), "note": f"{high} of high severity"},
    ]
