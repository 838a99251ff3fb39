"""The output folders of many lines in, one page that ranks what moves over all of them out."""

from __future__ import annotations

import datetime
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from deform.errors import DeformError
from deform.options import ReportOptions
from deform.report.content import Content, read_content
from deform.report.context import build_context
from deform.report.line_view import trend_dataset
from deform.report.templates import render
from deform.run import store
from deform.run.history import toolkit_version

_SEVERITY = {"high": 0, "medium": 1, "low": 2, "construction": 3}
_WIDTH, _HEIGHT = 96, 26


def write_screening(folders: Iterable[Path | str], target: Path | str, options: ReportOptions | None = None) -> Path:
    """Write the screening page of many lines and return its path.

    Parameters
    ----------
    folders : output folders of surveys; one that cannot be read is named on the page with its fault.
    target : path of the page, such as ``screening.html``; reports of the lines are linked relative to it.
    options : the attention values that rank the zones.
    """
    target, options = Path(target), options or ReportOptions()
    lines, unread, items = [], [], []
    for folder in (Path(f) for f in folders):
        try:
            content = read_content(folder)
        except DeformError as fault:
            unread.append((str(folder), str(fault)))
            continue
        numbers = build_context(content, options)
        link = _link(folder, target)
        lines.append(_line(content, numbers, link))
        items += _items(content, numbers, link)
    items.sort(key=lambda item: (_SEVERITY[item["severity"]], -item["size"]))
    page = render(
        "screening.html",
        items=[item | {"rank": i + 1} for i, item in enumerate(items)],
        lines=lines,
        unread=unread,
        made=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=toolkit_version(),
    )
    with store.atomic(target) as place:
        place.write_text(page, encoding="utf-8")
    return target


def _link(folder: Path, target: Path) -> str:
    page = folder / "report" / "index.html"
    return os.path.relpath(page, target.parent) if page.exists() else ""


def _line(content: Content, numbers: dict[str, Any], link: str) -> dict[str, Any]:
    """Return one line of the table of lines: its verdict and what could not be judged."""
    missing = [f"{m.get('output')}: {m.get('reason')}" for m in content.survey.get("missing", [])]
    unjudged = numbers["limits_of_sources"] + missing + [f"{what}: {why}" for what, why in content.absent]
    runs = ", ".join(f"{run} ({content.dates[run]})" for run in content.ids)
    moved = sum(z["kind"] != "reconfiguration" for z in numbers["zones"])
    return {"line": content.line, "link": link, "runs": runs, "verdict": numbers["verdict"], "zones": moved, "unjudged": unjudged}


def _items(content: Content, numbers: dict[str, Any], link: str) -> list[dict[str, Any]]:
    """Return the zones that moved, and the dents that grew or are new, of one line."""
    common = {"line": content.line, "link": link}
    found = []
    for zone in numbers["zones"]:
        if zone["kind"] != "reconfiguration":
            said = {
                "what": f"{zone['id']}, {zone['kind']}",
                "place": zone["place"],
                "severity": zone["severity"],
                "size": zone["size"],
            }
            found.append(
                common
                | said
                | {
                    "value": f"{zone['displacement']}; {zone['strain']}",
                    "trend": zone["trend"],
                    "spark": _spark(content, zone["id"]),
                }
            )
    for dent in numbers["dents"]:
        if dent["status"] in ("grown", "new"):
            said = {"what": f"{dent['id']}, dent {dent['status']}", "place": dent["place"], "severity": "medium", "size": 0.5}
            found.append(
                common
                | said
                | {
                    "value": f"{dent['depth']} ({dent['depth_share']})",
                    "trend": dent["trend"],
                    "spark": _spark(content, dent["id"]),
                }
            )
    return found


def _spark(content: Content, subject: str) -> Markup:
    """Return the values over the years as a small inline SVG; empty when fewer than two runs carry one."""
    ds = trend_dataset(content, subject)
    if ds is None:
        return Markup("")
    years, values = ds["year"].values, np.abs(ds["value"].values)
    x = 4 + (years - years[0]) / max(years[-1] - years[0], 1e-9) * (_WIDTH - 8)
    y = _HEIGHT - 4 - values / max(values.max(), 1e-12) * (_HEIGHT - 8)
    path = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    dots = "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.5" fill="currentColor"/>' for a, b in zip(x, y, strict=True))
    said = [f"{run}: {value:.3g} {ds.attrs['unit']}" for run, value in zip(ds["run"].values, values, strict=True)]
    label = escape(", ".join(said))
    shape = f'<path d="{path}" fill="none" stroke="currentColor" stroke-width="1.5"/>{dots}'
    frame = f'viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}" role="img"'
    return Markup(f"<svg {frame}><title>{label}</title>{shape}</svg>")
