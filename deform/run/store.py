"""Runs, stacks and tables on disk: netCDF-4 and Zarr, written whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import deform.vocabulary as vocabulary
from deform.errors import Fault, InputError
from deform.run import build, schema

_LEAST_SCANS = 5  # of a window of the wall
_INT32_FILL = np.int32(-(2**31))


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a place beside ``path`` to write to; it takes the name only when the block ends without error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    place = Path(name)
    place.unlink()
    try:
        yield place
        if path.is_dir() and place.is_dir():
            shutil.rmtree(path)
        else:
            place.chmod(0o644)
        os.replace(place, path)
    finally:
        shutil.rmtree(place, ignore_errors=True) if place.is_dir() else place.unlink(missing_ok=True)


def run_path(folder: Path, run: str) -> Path:
    """Return where an output folder holds a run: ``runs/<run>.zarr`` when only that is there, else ``runs/<run>.nc``."""
    found = (p for end in ("nc", "zarr") if (p := Path(folder) / "runs" / f"{run}.{end}").exists())
    return next(found, Path(folder) / "runs" / f"{run}.nc")


def engine(path: Path) -> str:
    """Return the engine by which xarray opens a run or a dataset."""
    return "zarr" if Path(path).suffix == ".zarr" else "netcdf4"


def _as_written(path: Path) -> dict[str, Any]:
    """How xarray opens what `write_run` wrote."""
    way = {"engine": engine(path), "decode_times": False}
    return way | {"consolidated": False} if Path(path).suffix == ".zarr" else way


def write_run(run: xr.DataTree, path: Path) -> Path:
    """Validate a run and write it: netCDF-4, or Zarr when the path ends in ``.zarr``."""
    schema.validate_run(run)
    path = Path(path)
    with atomic(path) as place:
        if path.suffix == ".zarr":
            run.to_zarr(place, mode="w", consolidated=False)
        else:
            encoding = {f"/{name}": _encoding(name, node.to_dataset()) for name, node in run.children.items()}
            run.to_netcdf(place, engine="netcdf4", encoding=encoding)
    return path


def read_run(
    path: Path, groups: Iterable[str] | None = None, variables: Mapping[str, Iterable[str]] | None = None
) -> xr.DataTree:
    """Read a run into memory, all groups or the named ones (those that exist), and close the file.

    Parameters
    ----------
    path : of the run.
    groups : names of the groups that are wanted, None for all.
    variables : of the groups that are named here these variables only, besides their coordinates; ``encoding["source"]`` of
        such a group is the path, by which `read_scans` reads a piece of a wall map.

    Raises
    ------
    InputError
        When the file is missing or cannot be opened; `NewerSchemaError` when it was written by a newer version.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(Fault(str(path), "", "no such file"))
    try:
        with xr.open_datatree(path, **_as_written(path)) as tree:
            schema.check_version(tree.attrs, str(path))
            wanted = [n for n in tree.children if groups is None or n in set(groups)]
            children = {n: xr.DataTree(_loaded(tree[n].to_dataset(), path, (variables or {}).get(n))) for n in wanted}
            return xr.DataTree(xr.Dataset(attrs=tree.attrs), children=children)
    except InputError:
        raise
    except (OSError, ValueError, RuntimeError, KeyError) as fault:
        raise InputError(
            Fault(str(path), "", f"cannot be opened as a run ({fault})", "it may be cut off: write it again")
        ) from fault


def _loaded(ds: xr.Dataset, path: Path, names: Iterable[str] | None) -> xr.Dataset:
    if names is None:
        return _clean(ds.load())
    part = _clean(ds[[name for name in names if name in ds]].load())
    part.encoding["source"] = str(path)
    return part


def read_scans(path: Path, scans: slice) -> xr.Dataset:
    """Return some scans of the group ``/caliper`` of a run; the file is opened for them and closed again."""
    try:
        with xr.open_dataset(path, group="caliper", **_as_written(path)) as wall:
            return wall.isel(scan=scans).load().drop_encoding()
    except (OSError, KeyError, ValueError) as fault:
        raise InputError(Fault(str(path), "caliper", f"cannot be read ({fault})", "it was there before: run again")) from fault


def read_wall(path: Path, chainage: float, half_length: float) -> xr.Dataset | None:
    """Return group ``/caliper`` of a run within ``half_length`` (m) of a chainage (m, this run's own).

    Only the scans of the window are read. None when the run has no wall map, or fewer than five scans there.

    Raises
    ------
    InputError
        When the file is missing, cannot be opened, or is damaged there.
    """
    try:
        with xr.open_dataset(path, group="caliper", **_as_written(path)) as wall:
            places = np.asarray(wall["chainage"].values, float)
            first, last = np.searchsorted(places, [chainage - half_length, chainage + half_length])
            return wall.isel(scan=slice(int(first), int(last))).load().drop_encoding() if last - first >= _LEAST_SCANS else None
    except (OSError, KeyError, ValueError, RuntimeError) as fault:
        if "caliper" not in read_run(path, ("caliper",), {"caliper": ()}).children:
            return None
        raise InputError(Fault(str(path), "caliper", f"cannot be read ({fault})", "it may be cut off: write it again")) from fault


def write_dataset(ds: xr.Dataset, path: Path, group: str) -> Path:
    """Check a dataset against its group and write it (netCDF-4), such as ``comparison.nc``."""
    faults = schema.dataset_faults(group, ds, Path(path).name)
    if faults:
        raise schema.SchemaError(faults)
    ds = ds.assign_attrs({"Conventions": "CF-1.11", "schema_version": vocabulary.schema_version()})
    with atomic(path) as place:
        ds.to_netcdf(place, engine="netcdf4", encoding=_encoding(group, ds))
    return Path(path)


def read_dataset(path: Path) -> xr.Dataset:
    """Read what `write_dataset` wrote."""
    if not Path(path).exists():
        raise InputError(Fault(str(path), "", "no such file"))
    with xr.open_dataset(path, engine="netcdf4", decode_times=False) as ds:
        schema.check_version(ds.attrs, str(path))
        return _clean(ds.load())


def write_table(frame: pd.DataFrame, path: Path, name: str) -> Path:
    """Write a table of the contract as CSV (``tables/<name>.csv``)."""
    with atomic(path) as place:
        build.table(name, frame).to_csv(place, index=False)
    return Path(path)


def read_table(path: Path, name: str) -> pd.DataFrame:
    """Read a table of the contract; text columns stay text."""
    if not Path(path).exists():
        raise InputError(Fault(str(path), "", "no such file"))
    text = {c.name: str for c in vocabulary.table(name).values() if c.type == "text"}
    return build.table(name, pd.read_csv(path, dtype=text, keep_default_na=True))


def write_json(content: Any, path: Path) -> Path:
    """Write JSON with indents; numbers that are not finite become null."""
    with atomic(path) as place:
        place.write_text(json.dumps(_plain(content), indent=1, ensure_ascii=False, allow_nan=False), encoding="utf-8")
    return Path(path)


def _encoding(group: str, ds: xr.Dataset) -> dict[str, dict[str, Any]]:
    known = vocabulary.group(group) if group in vocabulary.groups() else {}
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in ds.variables.items():
        if variable.dtype.kind not in "fiu" or not variable.ndim or not variable.size:
            continue
        encoding[str(name)] = {"zlib": True, "complevel": 1, "shuffle": True}
        step = known[str(name)].packed if name in known else None
        if step and np.nanmax(np.abs(variable.values), initial=0.0) < step * 2**31:
            encoding[str(name)] |= {"dtype": "int32", "scale_factor": step, "_FillValue": _INT32_FILL}
    return encoding


def _clean(ds: xr.Dataset) -> xr.Dataset:
    """Drop the encoding of the file, so that a run that was read can be written anew; text stays text."""
    ds = ds.drop_encoding()
    for name, variable in ds.variables.items():
        if variable.dtype.kind in "UT":
            ds[name] = variable.astype(object)
    return ds


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if value is None or isinstance(value, str | int | float | bool):
        return value
    return str(value)
