"""The file ``caliper.nc`` of a raw run in, the arms opened lazily and packed out, with what the reader knows of their units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from pydantic import ValidationError

from deform.readers import clock, netcdf
from deform.readers.findings import Findings
from deform.run.raw import CaliperHeader, RunHeader

FILE = "caliper.nc"
_UNITS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "inch": 0.0254}
_POSSIBLE = (0.6, 1.25)  # median radius over inner radius: room for an off-centre tool and for a wall that differs
_SAMPLES = 24
_SCANS = 256


def read_arms(path: Path, header: RunHeader | None, findings: Findings) -> tuple[xr.Dataset | None, RunHeader | None]:
    """Return the arms as `RawRun.arms` describes them, and the header, whose caliper table may come from the file.

    Notes
    -----
    Without a file the arms are None. The radius stays packed on disk. A unit other than metre is repaired in the attributes
    ``scale_factor`` and ``add_offset``.
    """
    if not path.exists():
        if header is not None and header.caliper is not None:
            findings.repair(FILE, "", "run.toml has a caliper, but there is no such file; ovality and dents will be absent")
        return None, header
    ds = netcdf.open_packed(path, findings)
    if ds is None:
        return None, header
    known = len(findings.faults)
    dims = ("scan", "ring", "arm") if "ring" in ds.sizes else ("scan", "arm")
    if not netcdf.has_variables(ds, {"time": ("scan",), "radius": dims, "arm_angle": ("arm",)}, FILE, findings):
        return None, header
    time = netcdf.values(ds, "time", ("scan",), FILE, findings)
    angle = netcdf.values(ds, "arm_angle", ("arm",), FILE, findings)
    if time is None or angle is None:
        return None, header
    time = clock.rising_time(time, FILE, findings)
    angle = _radian(angle, ds["arm_angle"].attrs.get("units"), findings)
    header = _caliper_header(ds, header, findings)
    if len(findings.faults) > known:
        return None, header
    radius = ds["radius"].transpose(*dims)
    radius.attrs = _packing(radius, header, findings)
    if len(findings.faults) > known:
        return None, header
    arms = xr.Dataset({"radius": radius, "arm_angle": ("arm", angle, {"units": "radian"})}, attrs=dict(ds.attrs))
    arms["time"] = ("scan", time, {"units": "s"})
    arms.set_close(ds.close)
    return arms, header


def _radian(angle: np.ndarray, units: str | None, findings: Findings) -> np.ndarray:
    angle = np.asarray(angle, float)
    if not np.isfinite(angle).all():
        findings.fault(
            FILE,
            "arm_angle",
            f"is not a number for arm {int(np.flatnonzero(~np.isfinite(angle))[0]) + 1}; every arm needs its angle",
        )
        return angle
    degrees = str(units or "").lower().startswith("deg")
    if degrees or np.abs(angle).max(initial=0.0) > 4 * np.pi:
        findings.repair(FILE, "arm_angle", f"runs to {angle.max():.4g}, it is in degree; turned into radian")
        angle = np.radians(angle)
    turned = np.sort(np.mod(angle, 2 * np.pi))
    if turned.size > 1 and np.diff(np.append(turned, turned[0] + 2 * np.pi)).min() < 1e-4:
        findings.fault(FILE, "arm_angle", "is the same for two arms; every arm has its own place")
    return angle


def _caliper_header(ds: xr.Dataset, header: RunHeader | None, findings: Findings) -> RunHeader | None:
    """Hold the header's table ``[caliper]`` against the file; take it from the file when run.toml has none."""
    if header is None:
        return None
    arms, rings = ds.sizes["arm"], ds.sizes.get("ring", 1)
    if header.caliper is None:
        offset = ds.attrs.get("ring_offset_m", ds["radius"].attrs.get("ring_offset_m", 0.0))
        try:
            caliper = CaliperHeader(arms=arms, ring_offset_m=tuple(float(x) for x in np.asarray(offset, float).ravel()))
        except (ValidationError, ValueError) as fault:
            findings.fault(
                FILE, "ring_offset_m", f"cannot be used ({str(fault).splitlines()[0]})", "add a table [caliper] to run.toml"
            )
            return header
        findings.repair(
            "run.toml", "[caliper]", f"is missing; {arms} arms, ring_offset_m {list(caliper.ring_offset_m)} taken from {FILE}"
        )
        header = replace(header, caliper=caliper)
    if header.caliper is not None and header.caliper.arms != arms:
        findings.fault(FILE, "arm", f"has {arms} arms, run.toml says {header.caliper.arms}", "correct [caliper] arms in run.toml")
    if header.caliper is not None and len(header.caliper.ring_offset_m) != rings:
        rule = f"has {rings} rings, run.toml gives {len(header.caliper.ring_offset_m)} ring_offset_m"
        findings.fault(FILE, "ring", rule, "one offset for each ring")
    return header


def _packing(radius: xr.DataArray, header: RunHeader | None, findings: Findings) -> dict:
    """Return attributes ``scale_factor``, ``add_offset`` (in metre) and ``_FillValue``; hold the radius against the pipe."""
    attrs = {str(k): v for k, v in radius.attrs.items() if k not in ("missing_value",)}
    scale, offset = float(attrs.get("scale_factor", 1.0)), float(attrs.get("add_offset", 0.0))
    fill = attrs.get("_FillValue", radius.attrs.get("missing_value"))
    if fill is None:
        fill = np.nan if radius.dtype.kind == "f" else np.iinfo(radius.dtype).max
    unit = _UNITS.get(str(attrs.get("units", "m")).lower())
    if unit is None:
        findings.fault(FILE, "radius", f"has units {attrs.get('units')!r}; known are {', '.join(_UNITS)}")
        return attrs
    if not np.isfinite([scale, offset]).all() or scale <= 0:
        findings.fault(
            FILE, "radius", f"has scale_factor {scale:g}, add_offset {offset:g}; both must be finite, the scale positive"
        )
        return attrs
    median = _median(radius, scale, offset, fill, findings)
    if median is not None and header is not None:
        unit = _true_unit(median, unit, header, findings)
    return attrs | {
        "units": "m",
        "scale_factor": scale * unit,
        "add_offset": offset * unit,
        "_FillValue": np.asarray(fill, radius.dtype)[()],
    }


def _median(radius: xr.DataArray, scale: float, offset: float, fill: float | int, findings: Findings) -> float | None:
    """Median of some blocks of scans spread over the run, in the file's unit."""
    n = radius.sizes["scan"]
    found = []
    try:
        for start in np.unique(np.linspace(0, max(n - _SCANS, 0), _SAMPLES).astype(int)):
            block = radius.isel(scan=slice(int(start), int(start) + _SCANS)).values
            found.append(block[(block != fill) & np.isfinite(block)].astype(float))
    except (OSError, RuntimeError, ValueError, IndexError) as fault:
        findings.fault(FILE, "radius", f"cannot be read ({fault})", "the file may be damaged: copy it anew from the tool")
        return None
    values = np.concatenate(found)
    if not values.size:
        findings.fault(
            FILE,
            "radius",
            "holds no value in any scan that was tried; all arms are missing",
            "remove the file to run without a caliper",
        )
        return None
    return float(np.median(values)) * scale + offset


def _true_unit(median: float, unit: float, header: RunHeader, findings: Findings) -> float:
    inner = header.pipe.outside_diameter_m / 2 - header.pipe.nominal_wall_m
    fits = {
        name: factor
        for name, factor in (("m", 1.0), ("mm", 1e-3), ("in", 0.0254), ("cm", 1e-2))
        if _fits(median * factor / inner)
    }
    if _fits(median * unit / inner):
        if unit != 1.0:
            findings.repair(FILE, "radius", f"is in another unit than metre (median {median:.4g}); rescaled by {unit:g}")
        return unit
    rule = f"has median {median:.4g}, the pipe an inner radius of {inner:.4g} m"
    if len(fits) == 1:
        name, factor = next(iter(fits.items()))
        findings.repair(FILE, "radius", f"{rule}: it is in {name}; rescaled by {factor:g}")
        return factor
    advice = "is it a diameter?" if _fits(median * unit / inner / 2) else "is outside_diameter_m that of this pipe?"
    findings.fault(FILE, "radius", rule, advice)
    return unit


def _fits(ratio: float) -> bool:
    return _POSSIBLE[0] < ratio < _POSSIBLE[1]
