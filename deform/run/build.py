"""Arrays in, datasets and tables of the vocabulary out: dims, units and long names are looked up, never typed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import deform.vocabulary as vocabulary
from deform.errors import SchemaError
from deform.run import history

_DTYPES = {"float": float, "int": np.int64, "bool": bool}


def dataset(group: str, values: Mapping[str, Any], **attrs: Any) -> xr.Dataset:
    """Return a dataset of a vocabulary group.

    Parameters
    ----------
    group : name of the group in `vocabulary.toml`.
    values : arrays by variable name; a variable named like its own dimension becomes the coordinate.
    **attrs : attributes of the dataset.

    Raises
    ------
    SchemaError
        When a name is not in the vocabulary, or a shape does not fit the dims.

    Examples
    --------
    >>> dataset("welds", {"chainage": [1.0, 13.2], "probability": [1.0, 1.0]}).sizes["weld"]
    2
    """
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    sizes: dict[str, int] = {}
    for name, value in values.items():
        described = vocabulary.variable(group, name)
        array = _typed(value, described.type)
        if array.ndim != len(described.dims):
            raise SchemaError(f"/{group}: {name} has {array.ndim} dims, wanted {described.dims}")
        for dim, size in zip(described.dims, array.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise SchemaError(f"/{group}: {name} has {size} along {dim!r}, the other variables have {sizes[dim]}")
        target = coordinates if described.dims == (name,) else variables
        target[name] = (described.dims, array, described.attrs)
    return xr.Dataset(variables, coords=coordinates, attrs=attrs)


def add(target: xr.Dataset, group: str, values: Mapping[str, Any]) -> xr.Dataset:
    """Return the dataset with further variables of its group."""
    return target.assign(dataset(group, values).variables)


def run_tree(attrs: Mapping[str, Any], **groups: xr.Dataset | None) -> xr.DataTree:
    """Return a run: root attributes, and one group per given dataset; ``None`` is left out."""
    root = xr.Dataset(attrs={"Conventions": "CF-1.11", "schema_version": vocabulary.schema_version(), **attrs})
    history.append(root.attrs, "run built")
    children = {name: xr.DataTree(ds) for name, ds in groups.items() if ds is not None}
    return xr.DataTree(root, children=children)


def table(name: str, values: Mapping[str, Any] | pd.DataFrame) -> pd.DataFrame:
    """Return a table of the contract: known columns first and in order, absent ones empty, further ones behind."""
    columns = vocabulary.table(name)
    frame = pd.DataFrame(values)
    for column in columns.values():
        if column.name not in frame:
            frame[column.name] = None
        if column.type == "float":
            frame[column.name] = pd.to_numeric(frame[column.name]).astype(float)
        elif column.type == "int":
            frame[column.name] = pd.to_numeric(frame[column.name]).astype("Int64")
        else:
            frame[column.name] = frame[column.name].astype(object).where(frame[column.name].notna(), "").astype(str)
    return frame[[*columns, *(c for c in frame if c not in columns)]].reset_index(drop=True)


def _typed(value: Any, kind: str) -> np.ndarray:
    if kind == "text":
        return np.asarray(["" if v is None else str(v) for v in np.asarray(value, dtype=object).ravel()], dtype=object)
    return np.asarray(value, dtype=_DTYPES[kind])
