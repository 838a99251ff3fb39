"""A netCDF file of a raw run in, its variables checked for names, dims and attributes out; values stay as stored."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from deform.readers.findings import Findings


def open_packed(path: Path, findings: Findings) -> xr.Dataset | None:
    """Open a file lazily, values as stored; None and a fault when it cannot be opened."""
    if not path.is_file():
        findings.fault(path.name, "", "no such file", "a raw run needs it")
        return None
    try:
        return xr.open_dataset(path, engine="netcdf4", mask_and_scale=False, decode_times=False, decode_coords=False, cache=False)
    except (OSError, ValueError, RuntimeError, KeyError, AttributeError, IndexError, TypeError) as fault:
        findings.fault(
            path.name, "", f"cannot be opened as netCDF ({_short(fault)})", "it may be cut off: copy it anew from the tool"
        )
        return None


def has_variables(ds: xr.Dataset, wanted: dict[str, tuple[str, ...]], file: str, findings: Findings) -> bool:
    """Check that variables exist, are numbers, and have the wanted dims in any order."""
    good = True
    for name, dims in wanted.items():
        if name not in ds.variables:
            findings.fault(file, name, f"is missing; the file holds {', '.join(map(str, ds.variables)) or 'nothing'}")
            good = False
        elif set(ds[name].dims) != set(dims):
            findings.fault(file, name, f"has dims {tuple(ds[name].dims)}, wanted {dims}")
            good = False
        elif ds[name].dtype.kind not in "iuf":
            findings.fault(file, name, f"has type {ds[name].dtype}, wanted numbers")
            good = False
    return good


def values(ds: xr.Dataset, name: str, dims: tuple[str, ...], file: str, findings: Findings) -> np.ndarray | None:
    """Read a variable whole, dims in the wanted order; None and a fault when the file breaks off."""
    try:
        return np.ascontiguousarray(ds[name].transpose(*dims).values)
    except (OSError, RuntimeError, ValueError, IndexError) as fault:
        findings.fault(file, name, f"cannot be read ({_short(fault)})", "the file may be damaged: copy it anew from the tool")
        return None


def missing_value(ds: xr.Dataset, name: str) -> float | int | None:
    """Return the stored value that stands for a missing one, None when the file states none."""
    attrs = ds[name].attrs
    value = attrs.get("_FillValue", attrs.get("missing_value"))
    return None if value is None else np.asarray(value).ravel()[0]


def number(
    ds: xr.Dataset, name: str, carriers: Iterable[str], file: str, findings: Findings, *, least: float, most: float
) -> float | None:
    """Return a numeric attribute of the file, or of one of the variables ``carriers``; a fault when it is absent or cannot be.

    A pulse weight, for example, must lie in ``least .. most``, both in the unit of its name.
    """
    found: Any = ds.attrs.get(name)
    for carrier in carriers:
        found = ds[carrier].attrs.get(name) if found is None and carrier in ds.variables else found
    if found is None:
        findings.fault(file, f"attribute {name}", "is missing", "the counts mean nothing without it")
        return None
    try:
        value = float(np.asarray(found).ravel()[0])
    except (TypeError, ValueError, IndexError):
        findings.fault(file, f"attribute {name}", f"is {found!r}, wanted a number")
        return None
    if not least <= value <= most:
        findings.fault(file, f"attribute {name}", f"is {value:g}; it must lie in {least:g} .. {most:g}", "is it in another unit?")
        return None
    return value


def _short(fault: BaseException) -> str:
    text = " ".join(str(fault).split())
    return f"{type(fault).__name__}: {text[:160]}"
