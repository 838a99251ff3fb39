"""Output folders of many surveys in, one ranked table of what changed over all of them out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from deform.errors import InputError
from deform.run import store

_COLUMNS = {
    "rank": "Int64",
    "line": "str",
    "subject": "str",
    "what": "str",
    "kind": "str",
    "start_m": "float",
    "end_m": "float",
    "first_epoch": "str",
    "confidence": "float",
    "last_value": "float",
    "rate_per_year": "float",
    "rate_sigma_per_year": "float",
    "limit_used": "float",
    "forecast_date": "str",
    "forecast_probability": "float",
    "remark": "str",
}


@dataclass(frozen=True)
class Screening:
    """What changed over many lines.

    Attributes
    ----------
    table : one row per zone or dent and quantity, the most urgent first.
    lines : one row per line: runs, zones, dents that grew, the least movement that could have been seen (m), and the folder.
    unread : (folder, fault) of those that could not be read.
    """

    table: pd.DataFrame
    lines: pd.DataFrame
    unread: tuple[tuple[str, str], ...]


def screen(folders: Iterable[Path | str]) -> Screening:
    """Rank what changed in many surveys by urgency.

    Parameters
    ----------
    folders : output folders of surveys (``survey.toml`` → ``out``), each with ``tables/`` and ``comparison.nc``.

    Returns
    -------
    Screening
        Ranked by the probability that a limit is reached within the horizon, then by the part of the limit that is used up, then
        by the rate against its sigma. A folder that cannot be read is named and left out; it stops nothing.
    """
    rows, lines, unread = [], [], []
    for folder in map(Path, folders):
        try:
            found, line = _one(folder)
        except InputError as fault:
            unread.append((str(folder), str(fault)))
            continue
        rows += found
        lines.append(line)
    table = pd.DataFrame(rows, columns=list(_COLUMNS))
    if len(table):
        significance = np.abs(table["rate_per_year"]) / table["rate_sigma_per_year"].where(table["rate_sigma_per_year"] > 0)
        keys = pd.DataFrame(
            {
                "a": table["forecast_probability"].fillna(0).round(3),
                "b": table["limit_used"].fillna(0),
                "c": significance.fillna(0),
            }
        )
        table = table.loc[keys.sort_values(["a", "b", "c"], ascending=False, kind="stable").index].reset_index(drop=True)
        table["rank"] = np.arange(1, len(table) + 1)
    return Screening(table, pd.DataFrame(lines), tuple(unread))


def _one(folder: Path) -> tuple[list[dict], dict]:
    zones = store.read_table(folder / "tables" / "zones.csv", "zones").set_index("zone_id")
    trends = store.read_table(folder / "tables" / "trends.csv", "trends")
    dents = store.read_table(folder / "tables" / "dents.csv", "dents")
    comparison = store.read_dataset(folder / "comparison.nc")
    name = str(comparison.attrs.get("line") or (folder.parent.name if folder.name == "out" else folder.name))
    moved = zones[zones["kind"].isin(["movement", "bending"])]
    rows = [_row(name, trend, zones, dents) for trend in trends.to_dict("records")]
    rows += [
        _without_trend(name, str(zone_id), zone) for zone_id, zone in moved.iterrows() if zone_id not in set(trends["subject"])
    ]
    line = {
        "line": name,
        "runs": ", ".join(str(e) for e in comparison["epoch"].values),
        "zones": len(moved),
        "reconfigurations": int((zones["kind"] == "reconfiguration").sum()),
        "dents_grown": int(dents.loc[dents["status"] == "grown", "dent_id"].nunique()),
        "least_movement_seen_m": _least_seen(folder),
        "folder": str(folder),
    }
    return rows, line


def _row(line: str, trend: dict, zones: pd.DataFrame, dents: pd.DataFrame) -> dict:
    subject = str(trend["subject"])
    row = {key: trend.get(key) for key in _COLUMNS if key in trend} | {"line": line, "what": "dent"}
    if subject in zones.index:
        zone = zones.loc[subject]
        row |= {"what": zone["kind"], "start_m": zone["start_m"], "end_m": zone["end_m"]}
        row |= {"first_epoch": zone["first_epoch"], "confidence": zone["confidence"]}
    elif (dents["dent_id"] == subject).any():
        own = dents[dents["dent_id"] == subject]
        place = float(own["reference_chainage_m"].median())
        grown = own.loc[own["status"].isin(["grown", "rerounded"]), "run"]
        row |= {"start_m": place, "end_m": place, "first_epoch": grown.iloc[0] if len(grown) else ""}
    return row


def _without_trend(line: str, zone_id: str, zone: pd.Series) -> dict:
    """A zone whose runs carry no rate, such as two runs of one day."""
    keys = ("start_m", "end_m", "first_epoch", "confidence")
    row = {"line": line, "subject": zone_id, "what": zone["kind"], "kind": "displacement", **{key: zone[key] for key in keys}}
    return row | {"last_value": zone["peak_displacement_m"], "remark": "the runs carry no rate"}


def _least_seen(folder: Path) -> float:
    """Least movement over sixty metres or the next wavelength that would have been found, the worse component; NaN when
    unknown.
    """
    path = folder / "tables" / "limits.csv"
    if not path.exists():
        return float("nan")
    limits = store.read_table(path, "limits")
    limits = limits[limits["limit_displacement_m"].notna()]
    if not len(limits):
        return float("nan")
    near = limits.loc[(np.log(limits["wavelength_m"] / 60.0)).abs().sort_values().index, "wavelength_m"].iloc[0]
    return float(limits.loc[limits["wavelength_m"] == near, "limit_displacement_m"].max())
