"""What the navigation of each run found in, tables of alignment, drifts and biases out (Porter 1990, tables 4-1 to 4-5)."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from deform.report.content import Content
from deform.report.quantities import Measure, measure

_AXES = ("right", "forward", "up")
_SCALARS = (
    # variable, title, quantity
    ("odometer_scale", "scale", "odometer scale"),
    ("mounting_azimuth", "mounting azimuth", "attitude"),
    ("mounting_pitch", "mounting pitch", "attitude"),
    ("delay", "delay", "delay"),
)
Table = dict[str, Any]


def alignment_tables(content: Content) -> list[Table]:
    """Return the tables as title, note, columns and rows (run, cells); none where no run was navigated."""
    found = {run: ds for run in content.ids if (ds := content.group(run, "navigation")) is not None}
    tables = [
        _by_axis(
            found, "gyro_bias", "gyro drift", "Gyro drift", "Porter's table 4-1: about the body's axes, at the end of the run."
        ),
        _by_axis(
            found,
            "accel_bias",
            "accelerometer bias",
            "Accelerometer bias",
            "Porter's table 4-2: along the body's axes, at the end of the run.",
        ),
        _first_alignment(found),
        _filter(found),
        _fine_alignment(content, found),
    ]
    return [table for table in tables if table["rows"]]


def _by_axis(found: dict[str, xr.Dataset], name: str, of: str, title: str, note: str) -> Table:
    rows = [(run, [measure(of, v, s) for v, s in zip(*_last(ds, name), strict=True)]) for run, ds in found.items() if name in ds]
    return {"title": title, "note": note, "columns": [f"{axis} ({measure(of, 0).unit})" for axis in _AXES], "rows": rows}


def _last(ds: xr.Dataset, name: str, epoch: int = -1) -> tuple[np.ndarray, np.ndarray]:
    """Return value and sigma at one epoch (the last), one entry per axis where there are axes."""
    n = 3 if "axis" in ds[name].dims else 1
    value = np.asarray(ds[name].values, float).reshape(-1, n)[epoch]
    sigma = np.full(n, np.nan)
    if f"{name}_sigma" in ds:
        sigma = np.asarray(ds[f"{name}_sigma"].values, float).reshape(-1, n)[epoch]
    return value, sigma


def _scalar(ds: xr.Dataset, name: str, of: str, epoch: int = -1) -> Measure:
    if name not in ds:
        return measure(of, None)
    value, sigma = _last(ds, name, epoch)
    return measure(of, value[0], sigma[0])


def _first_alignment(found: dict[str, xr.Dataset]) -> Table:
    names = [f"alignment_{angle}" for angle in ("azimuth", "pitch", "roll")]
    rows = [(run, [_scalar(ds, name, "attitude") for name in names]) for run, ds in found.items() if names[0] in ds]
    methods = dict.fromkeys(str(ds.attrs["alignment_method"]) for ds in found.values() if "alignment_method" in ds.attrs)
    note = "Porter's table 4-3: attitude of the body before the run, with its sigma."
    if methods:
        note += f" Method: {', '.join(methods)}."
    return {"title": "First alignment", "note": note, "columns": ["azimuth (°)", "pitch (°)", "roll (°)"], "rows": rows}


def _filter(found: dict[str, xr.Dataset]) -> Table:
    """Return the sigma of the filter's states at the first and at the last epoch, and the scalars that it found."""
    names = [entry for entry in _SCALARS if any(entry[0] in ds for ds in found.values())]
    rows = [(run, [_scalar(ds, name, of) for name, _, of in names]) for run, ds in found.items()] if names else []
    models = dict.fromkeys(str(ds.attrs["error_model"]) for ds in found.values() if "error_model" in ds.attrs)
    note = "In place of Porter's table 4-4, which lists what his filter was told: what this one found, at the end of the run."
    if models:
        note += f" Error model: {', '.join(models)}; its noise densities are learned from the run and not stored."
    return {
        "title": "Odometer and mounting",
        "note": note,
        "columns": [f"{title} ({measure(of, 0).unit})" for _, title, of in names],
        "rows": rows,
    }


def _fine_alignment(content: Content, found: dict[str, xr.Dataset]) -> Table:
    """Return the azimuth at the start of the pipe by the first alignment and after smoothing, where the tool lay there."""
    rows = []
    for run, ds in found.items():
        line = content.group(run, "centreline")
        if line is None or "azimuth" not in line or "alignment_azimuth" not in ds:
            continue
        upstream = str(content.run(run).attrs.get("direction")) == "upstream"
        at = -1 if upstream else 0
        first, mounting = (_scalar(ds, name, "attitude") for name in ("alignment_azimuth", "mounting_azimuth"))
        sigma = line["azimuth_sigma"].values[at] if "azimuth_sigma" in line else np.nan
        found_azimuth = (first.value + np.nan_to_num(mounting.value) + 180.0 * upstream) % 360
        after = float(line["azimuth"].values[at]) % 360
        change = (after - found_azimuth + 180) % 360 - 180
        spread = float(np.hypot(first.sigma, np.nan_to_num(mounting.sigma)))
        rows.append(
            (run, [measure("attitude", found_azimuth, spread), measure("attitude", after, sigma), measure("attitude", change)])
        )
    note = (
        "Porter's table 4-5: azimuth of the pipe at the trap, by the first alignment with the mounting, and after smoothing over "
        "all odometer and marker data. They agree within the sigma of the first, if the alignment was honest."
    )
    columns = ["first alignment (°)", "smoothed (°)", "change (°)"]
    return {"title": "Fine alignment", "note": note, "columns": columns, "rows": rows}
