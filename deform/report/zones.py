"""The table of zones in, ranked rows for people out: severity, place, size with sigma, a headline, and the reasons apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from deform.options import ReportOptions
from deform.report.content import Content, records
from deform.report.quantities import measure
from deform.report.trends import headline, sure_rates
from deform.report.words import NOTHING, compass, percent, sentence


def zone_rows(content: Content, options: ReportOptions) -> list[dict[str, Any]]:
    """Return the zones ranked: by the rank of their trends where there is one, then by size against the attention values.

    ``severity`` is ``high`` when displacement or strain change reach their attention value, ``medium`` at half of it, else
    ``low``; replaced pipe is ``construction``.
    """
    trends, dents = content.tables["trends"], content.tables["dents"]
    ranks = trends.dropna(subset="rank").groupby("subject")["rank"].min().to_dict()
    rows = []
    for zone in records(content.tables["zones"]):
        own = trends[trends.subject == zone.zone_id]
        row = _row(zone, options) | _words(zone, own, content)
        inside = dents[dents.reference_chainage_m.between(zone.start_m, zone.end_m)]
        rows.append(row | {"dents": list(dict.fromkeys(inside.dent_id)), "rank_given": ranks.get(zone.zone_id)})
    rows.sort(key=lambda r: (r["kind"] == "reconfiguration", np.inf if r["rank_given"] is None else r["rank_given"], -r["size"]))
    return [row | {"rank": i + 1} for i, row in enumerate(rows)]


def moved(zones: list[dict]) -> list[dict]:
    """Return the zones in which the pipe moved or bent, without those in which it was replaced."""
    return [zone for zone in zones if zone["kind"] != "reconfiguration"]


def _row(zone: Any, options: ReportOptions) -> dict[str, Any]:
    shares = (zone.peak_strain_change / options.strain_attention, zone.peak_displacement_m / options.displacement_attention_m)
    size = max((abs(share) for share in shares if np.isfinite(share)), default=0.0)
    severity = "high" if size >= 1 else "medium" if size >= 0.5 else "low"
    return {
        "id": zone.zone_id,
        "kind": zone.kind,
        "start": float(zone.start_m),
        "end": float(zone.end_m),
        "first": measure("place", zone.start_m),
        "last": measure("place", zone.end_m),
        "place": f"{measure('place', zone.start_m).number} – {measure('place', zone.end_m)}",
        "length": measure("extent", zone.end_m - zone.start_m),
        "size": size,
        "severity": "construction" if zone.kind == "reconfiguration" else severity,
        "strain": measure("strain", zone.peak_strain_change, zone.peak_strain_change_sigma),
        "displacement": measure("displacement", zone.peak_displacement_m, zone.peak_displacement_sigma_m),
        "confidence": percent(zone.confidence),
        "confidence_value": zone.confidence,
    }


def _words(zone: Any, trends: pd.DataFrame, content: Content) -> dict[str, Any]:
    reasons = [sentence(part) for part in str(zone.reasons).split(";") if part.strip()]
    return {
        "direction": _direction(zone),
        "first_epoch": zone.first_epoch or NOTHING,
        "first_date": content.dates.get(zone.first_epoch, ""),
        "headline": headline(trends) or (reasons[0] if reasons else ""),
        "trends": sure_rates(trends),
        "reasons": reasons,
    }


def _direction(zone: Any) -> str:
    """Return where the pipe went: up or down at an almost vertical movement, else the azimuth with its word."""
    if not pd.isna(zone.direction_deg):
        return f"towards {compass(zone.direction_deg)}"
    up = getattr(zone, "peak_up_m", np.nan)
    return "" if pd.isna(up) or pd.isna(zone.peak_displacement_m) else "up" if up > 0 else "down"
