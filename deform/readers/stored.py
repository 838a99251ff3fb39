"""A file that this toolkit wrote (``runs/<id>.nc``, ``comparison.nc``) in, the run or a summary out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from deform.errors import Fault, InputError
from deform.readers.reader import Request, Scan
from deform.run import schema, store

_SUFFIXES = (".nc", ".zarr")
_GROUPS = {*schema.RUN_GROUPS}
_COMPARISON = {"epoch", "chainage", "run_chainage"}


class StoredReader:
    """Our own runs and comparisons."""

    name = "stored"
    description = "run or comparison that this toolkit wrote (netCDF-4, Zarr)"

    def recognise(self, request: Request) -> str:
        """Return an empty text for a netCDF or Zarr file with our groups, or with the variables of a comparison."""
        kind, why = _kind(request.path)
        return "" if kind else why

    def scan(self, request: Request) -> Scan:
        """Return attributes, groups with their sizes, and the spans of a run, or the epochs of a comparison."""
        kind, why = _kind(request.path)
        if kind == "run":
            return Scan("stored run", request.path, _run_summary(store.read_run(request.path)))
        if kind == "comparison":
            return Scan("comparison", request.path, _comparison_summary(store.read_dataset(request.path)))
        raise InputError(Fault(str(request.path), "", why))

    def read(self, request: Request) -> xr.DataTree:
        """Return the run.

        Raises
        ------
        InputError
            For a comparison, which is no run.
        """
        if _kind(request.path)[0] != "run":
            raise InputError(
                Fault(str(request.path), "", "is a comparison, not a run", "name a raw run folder, a listing or runs/<id>.nc")
            )
        run = store.read_run(request.path)
        if request.run_id:
            run.attrs["id"] = request.run_id
        if request.date:
            run.attrs["date"] = request.date.isoformat()
        return run


def _kind(path: Path) -> tuple[str, str]:
    """Return ``run``, ``comparison`` or an empty text, and then why."""
    if path.suffix not in _SUFFIXES:
        return "", f"the name does not end in {' or '.join(_SUFFIXES)}"
    engine = "zarr" if path.suffix == ".zarr" else "netcdf4"
    try:
        with xr.open_datatree(path, engine=engine, decode_times=False) as tree:
            groups, names = set(tree.children), set(map(str, tree.to_dataset().variables))
    except Exception as fault:  # whatever a strange file does to the libraries below, it is not ours
        return "", f"cannot be opened ({type(fault).__name__}: {' '.join(str(fault).split())[:100]})"
    if groups & _GROUPS:
        return "run", ""
    if names >= _COMPARISON:
        return "comparison", ""
    return "", f"holds neither a group of a run ({', '.join(schema.RUN_GROUPS)}) nor a comparison"


def _run_summary(run: xr.DataTree) -> dict[str, Any]:
    attrs: dict[str, Any] = {
        k: _plain(run.attrs[k])
        for k in ("id", "date", "line", "direction", "source", "outside_diameter_m", "schema_version")
        if k in run.attrs
    }
    groups = {}
    for name, node in run.children.items():
        ds = node.to_dataset()
        entry: dict[str, Any] = {str(k): int(v) for k, v in ds.sizes.items()}
        if "chainage" in ds.variables and ds["chainage"].size:
            entry |= {"from_m": float(np.nanmin(ds["chainage"])), "to_m": float(np.nanmax(ds["chainage"]))}
        groups[name] = entry | {"variables": [str(v) for v in ds.variables]}
    return {**attrs, "groups": groups}


def _comparison_summary(ds: xr.Dataset) -> dict[str, Any]:
    chainage = ds["chainage"].values
    span = {"from_m": float(chainage[0]), "to_m": float(chainage[-1])} if chainage.size else {}
    return {
        "reference": str(ds.attrs.get("reference", "")),
        "epochs": [str(e) for e in ds["epoch"].values],
        **span,
        "variables": [str(v) for v in ds.data_vars],
    }


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
