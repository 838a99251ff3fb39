"""The table of noise floors and detection limits in, two tables for people out."""

from __future__ import annotations

from typing import Any

import pandas as pd

from deform.report.content import Content, records
from deform.report.quantities import Measure, measure

_NEEDED = {"run_from", "run_to", "quantity", "component", "noise_sigma", "wavelength_m"}
_NOISE_OF = {"displacement": "noise", "joint length": "noise", "ovality": "ovality noise"}


def floor_rows(content: Content) -> list[dict[str, Any]]:
    """Return the noise floor of each pair of runs: quantity, component, speeds for which it holds, one sigma."""
    table = _table(content)
    return [
        {
            "pair": f"{row.run_from} to {row.run_to}",
            "quantity": str(row.quantity),
            "component": _text(row.component),
            "speeds": _text(getattr(row, "speed_class", "")),
            "sigma": noise(str(row.quantity), row.noise_sigma),
        }
        for row in records(table[table.wavelength_m.isna()])
    ]


def detection_rows(content: Content) -> list[dict[str, Any]]:
    """Return the least amplitude of a movement, and the least elongation, that each pair of runs shows, by its length."""
    table = _table(content)
    return [
        {
            "pair": f"{row.run_from} to {row.run_to}",
            "component": _text(row.component),
            "wavelength": measure("wavelength", row.wavelength_m),
            "half": measure("noise", getattr(row, "limit_displacement_m", None)),
            "ninety": measure("noise", getattr(row, "limit_90_displacement_m", None)),
            "strain": measure("strain noise", getattr(row, "limit_strain_change", None)),
            "axial": measure("axial strain", getattr(row, "limit_axial_strain", None)),
            "elongation": measure("noise", getattr(row, "limit_elongation_m", None)),
            "decided": _text(getattr(row, "decided_by", "")),
        }
        for row in records(table[table.wavelength_m.notna()])
    ]


def noise(quantity: str, sigma: Any) -> Measure:
    """Return a noise floor in the unit that suits its quantity."""
    return measure(_NOISE_OF.get(quantity, "strain noise"), sigma)


def _table(content: Content) -> pd.DataFrame:
    table = content.tables.get("limits", pd.DataFrame())
    return table if set(table.columns) >= _NEEDED else pd.DataFrame(columns=sorted(_NEEDED))


def _text(value: Any) -> str:
    return "" if pd.isna(value) else str(value)
