"""Validation of a run against the vocabulary: all faults at once, each with group, variable, rule and value."""

from __future__ import annotations

import numpy as np
import xarray as xr

import deform.vocabulary as vocabulary
from deform.errors import Fault, NewerSchemaError, SchemaError

RUN_GROUPS = ("centreline", "welds", "caliper", "dents", "markers", "features")
_RISING = {"centreline": "chainage", "welds": "chainage", "caliper": "chainage"}
_KINDS = {"float": "fiu", "int": "iu", "bool": "bui", "text": "OUST"}


def validate_run(run: xr.DataTree) -> None:
    """Check a whole run.

    Raises
    ------
    NewerSchemaError
        When the file was written by a newer version.
    SchemaError
        With every fault found.
    """
    name = str(run.attrs.get("id", "run"))
    check_version(run.attrs, name)
    faults = [Fault(name, key, "is missing at the root") for key in ("id", "date", "source") if not run.attrs.get(key)]
    faults += [
        Fault(name, str(dim), "is a dimension of the root; the root holds attributes only") for dim in run.to_dataset().sizes
    ]
    for group, node in run.children.items():
        if group in RUN_GROUPS:
            faults += dataset_faults(group, node.to_dataset(), name)
    if faults:
        raise SchemaError(faults)


def check_version(attrs: dict, where: str) -> None:
    """Raise `NewerSchemaError` when a file says a schema version above ours."""
    version = int(attrs.get("schema_version", 0))
    if version > vocabulary.schema_version():
        rule = f"has schema version {version}, this toolkit reads up to {vocabulary.schema_version()}"
        raise NewerSchemaError(Fault(where, "schema_version", rule, "install a newer deform-ili"))


def dataset_faults(group: str, ds: xr.Dataset, where: str = "") -> list[Fault]:
    """Return every departure of a dataset from its group of the vocabulary; variables unknown to it are free."""
    known = vocabulary.group(group)
    place = f"{where}/{group}" if where else f"/{group}"
    faults = [Fault(place, v.name, "is missing") for v in known.values() if v.required and v.name not in ds.variables]
    for name, variable in ds.variables.items():
        if name in known:
            faults += _variable_faults(known[str(name)], variable, place)
    rising = _RISING.get(group)
    if rising in ds.variables:
        faults += _rising_faults(str(rising), np.asarray(ds[rising].values, float), place)
    return faults


def _variable_faults(described: vocabulary.Variable, variable: xr.Variable, place: str) -> list[Fault]:
    faults = []
    if variable.dims != described.dims:
        faults.append(Fault(place, described.name, f"has dims {variable.dims}, wanted {described.dims}"))
    if described.units is not None and variable.attrs.get("units") != described.units:
        faults.append(Fault(place, described.name, f"has units {variable.attrs.get('units')!r}, wanted {described.units!r}"))
    if variable.dtype.kind not in _KINDS[described.type]:
        faults.append(Fault(place, described.name, f"has type {variable.dtype}, wanted {described.type}"))
    elif described.range is not None and variable.size:
        values = np.asarray(variable.values, float)
        low, high = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else (np.nan, np.nan)
        if low < described.range[0] or high > described.range[1]:
            faults.append(
                Fault(
                    place,
                    described.name,
                    f"runs from {low:.6g} to {high:.6g}, wanted {described.range[0]} to {described.range[1]}",
                )
            )
    return faults


def _rising_faults(name: str, values: np.ndarray, place: str) -> list[Fault]:
    if not np.isfinite(values).all():
        return [Fault(place, name, f"is not finite at {int(np.flatnonzero(~np.isfinite(values))[0])}; an axis must be finite")]
    back = np.flatnonzero(np.diff(values) <= 0)
    if not back.size:
        return []
    i = int(back[0])
    return [Fault(place, name, f"goes from {values[i]:.6g} to {values[i + 1]:.6g} at {i + 1}; it must rise")]
