"""The table of trends in, rates, forecasts and one-line headlines for people out."""

from __future__ import annotations

from typing import Any

import pandas as pd

from deform.report.content import Content, records
from deform.report.quantities import OF_TREND, Measure, measure
from deform.report.words import NOTHING, month, percent, sentence

_LIKELY = 0.5


def trend_rows(content: Content) -> list[dict[str, Any]]:
    """Return the trends for people, by rank."""
    horizon = content.survey.get("options", {}).get("trend", {}).get("horizon_years")
    within = f"within {horizon:g} years" if isinstance(horizon, int | float) else "within the horizon"
    return [_row(row, within) for row in records(content.tables["trends"].sort_values("rank", na_position="last"))]


def _row(row: Any, within: str) -> dict[str, Any]:
    ends = [rate(row.kind, v) for v in (row.rate_low_per_year, row.rate_high_per_year)]
    return {
        "rank": NOTHING if pd.isna(row.rank) else str(int(row.rank)),
        "subject": row.subject,
        "kind": row.kind,
        "epochs": NOTHING if pd.isna(row.n_epochs) else str(int(row.n_epochs)),
        "rate": rate(row.kind, row.rate_per_year, row.rate_sigma_per_year),
        "interval": f"{ends[0].number} to {ends[1].number}" if all(ends) else NOTHING,
        "certainty": percent(row.interval_probability),
        "last": value(row.kind, row.last_value),
        "limit": value(row.kind, row.limit_value),
        "limit_name": row.limit_name,
        "forecast": month(row.forecast_date) if row.forecast_date else "no forecast",
        "probability": "" if pd.isna(row.forecast_probability) else f"{percent(row.forecast_probability)} {within}",
        "remark": sentence(row.remark),
    }


def value(kind: str, size: Any, sigma: Any = None) -> Measure:
    """Return a value of a trend in the unit that suits its kind."""
    return measure(OF_TREND.get(str(kind), "displacement"), size, sigma)


def rate(kind: str, per_year: Any, sigma: Any = None) -> Measure:
    """Return a rate per year in the unit that suits its kind."""
    return measure(f"{OF_TREND.get(str(kind), 'displacement')} rate", per_year, sigma)


def sure_rates(trends: pd.DataFrame) -> list[str]:
    """Return the rates of one zone or dent that carry no reservation, with the limit they lead to where that is likely."""
    found = []
    for row in records(trends.drop_duplicates("kind")):
        if pd.isna(row.rate_per_year) or row.remark:
            continue
        text = f"{row.kind} {rate(row.kind, row.rate_per_year, row.rate_sigma_per_year)}"
        if row.forecast_date and not pd.isna(row.forecast_probability) and row.forecast_probability >= _LIKELY:
            text += f", reaches {value(row.kind, row.limit_value)} about {month(row.forecast_date)}"
        found.append(text)
    return found


def headline(trends: pd.DataFrame) -> str:
    """Return one line on how a zone or dent goes on: its first sure rate, else why there is none; empty without a trend."""
    sure = sure_rates(trends)
    if sure:
        return sentence(sure[0])
    said = [row.remark for row in records(trends) if row.remark]
    return sentence(said[0].split(";")[0]) if said else ""
