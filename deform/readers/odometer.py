"""The file ``odometer.nc`` of a raw run in, cumulative counts of each wheel on rising times out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from deform.readers import clock, netcdf
from deform.readers.findings import Findings
from deform.run import build, stamps
from deform.run.raw import RunHeader

FILE = "odometer.nc"
_FASTEST_M_PER_S = 30.0
_COUNTERS = (2**16, 2**24, 2**31, 2**32)
_LARGEST_COUNT = 2.0**53  # whole numbers that a float holds exactly
_DIMS = ("sample", "wheel")


def read_odometer(path: Path, header: RunHeader | None, findings: Findings) -> xr.Dataset | None:
    """Return group ``odometer`` of the vocabulary with attribute ``pulse_m``.

    Notes
    -----
    A counter that overflows (16, 24, 31 or 32 bits) is unrolled; any other fall of a count is a fault.
    """
    ds = netcdf.open_packed(path, findings)
    if ds is None:
        return None
    with ds:
        wanted = {"time": ("sample",), "count": _DIMS}
        if not netcdf.has_variables(ds, wanted, FILE, findings):
            return None
        pulse = netcdf.number(ds, "pulse_m", ["count"], FILE, findings, least=1e-6, most=2.0)
        parts = {name: netcdf.values(ds, name, dims, FILE, findings) for name, dims in wanted.items()}
        fill = netcdf.missing_value(ds, "count")
    if pulse is None or parts["time"] is None or parts["count"] is None:
        return None
    if header is not None and parts["count"].shape[1] != header.odometer.wheels:
        rule = f"has {parts['count'].shape[1]} wheels, run.toml says {header.odometer.wheels}"
        findings.fault(FILE, "count", rule, "correct [odometer] wheels in run.toml")
    known = len(findings.faults)
    time = clock.rising_time(parts["time"], FILE, findings)
    if len(findings.faults) > known:
        return None
    count = _rising_counts(parts["count"], time, fill, findings)
    if len(findings.faults) > known:
        return None
    clock.missing_samples(time, FILE, findings, cumulative=True)
    _possible_speed(count, time, pulse, findings)
    return build.dataset("odometer", {"time": time, "count": count}, pulse_m=pulse)


def _rising_counts(count: np.ndarray, time: np.ndarray, fill: float | int | None, findings: Findings) -> np.ndarray:
    whole = np.empty(count.shape, np.int64)
    for wheel in range(count.shape[1]):
        column = _without_missing(count[:, wheel], fill, wheel, time, findings)
        if column is None:
            continue
        if column.size and float(np.abs(column.astype(float)).max()) > _LARGEST_COUNT:
            rule = f"reaches {float(np.abs(column.astype(float)).max()):.4g} pulses; that cannot be"
            findings.fault(FILE, f"count, wheel {wheel + 1}", rule)
            continue
        whole[:, wheel] = column
        falls = np.flatnonzero(np.diff(whole[:, wheel]) < 0)
        if falls.size and _unroll(whole[:, wheel], falls, wheel, time, findings):
            continue
        if falls.size:
            i = int(falls[0])
            more = f", and {falls.size - 1} times more" if falls.size > 1 else ""
            rule = (
                f"falls from {whole[i, wheel]} to {whole[i + 1, wheel]} at t={time[i + 1]:.3f} s{more}; counts must not decrease"
            )
            findings.fault(FILE, f"count, wheel {wheel + 1}", rule, "a counter that was reset or runs both ways cannot be used")
        elif time.size > 1 and whole[-1, wheel] == whole[0, wheel]:
            findings.repair(FILE, f"count, wheel {wheel + 1}", "does not count at all; kept")
    return whole


def _without_missing(
    column: np.ndarray, fill: float | int | None, wheel: int, time: np.ndarray, findings: Findings
) -> np.ndarray | None:
    """Return whole counts; missing ones are interpolated between the neighbours when at most 1 % are missing."""
    lost = ~np.isfinite(column) if column.dtype.kind == "f" else np.zeros(column.shape, bool)
    if fill is None and column.dtype == np.int64:
        fill = -(2**63) + 2  # netCDF's default
    if fill is not None and fill == fill:
        lost |= column == fill
    if not lost.any():
        return column
    place = f"count, wheel {wheel + 1}"
    rule = f"missing at {lost.sum()} of {lost.size} samples, first at t={time[np.flatnonzero(lost)[0]]:.3f} s"
    if lost.mean() > 0.01:
        findings.fault(FILE, place, f"{rule}; at most 1 % may be")
        return None
    findings.repair(FILE, place, f"{rule}; set between the neighbours")
    return np.round(np.interp(time, time[~lost], column[~lost].astype(float)))


def _unroll(column: np.ndarray, falls: np.ndarray, wheel: int, time: np.ndarray, findings: Findings) -> bool:
    """Unroll a counter in place when each fall is an overflow: nearly the whole span of a counter, and small beyond it."""
    for size in _COUNTERS:
        before, after = column[falls], column[falls + 1]
        if column.min() >= 0 and column.max() < size and (before > 0.99 * size).all() and (after < 0.01 * size).all():
            findings.repair(
                FILE,
                f"count, wheel {wheel + 1}",
                f"overflows at {size} {falls.size} times, first at t={time[falls[0] + 1]:.3f} s; unrolled",
            )
            steps = np.zeros(column.size, np.int64)
            steps[falls + 1] = size
            column += np.cumsum(steps)
            return True
    return False


def _possible_speed(count: np.ndarray, time: np.ndarray, pulse: float, findings: Findings) -> None:
    if time.size < 2:
        findings.fault(FILE, "time", "has one sample only; the recording is empty")
        return
    usual = stamps.usual_step(time)
    step = max(1, round(1.0 / max(usual, 1e-9)))
    travel = np.median(np.diff(count[::step], axis=0), axis=1) * pulse if count[::step].shape[0] > 1 else np.zeros(1)
    moving = travel[travel > 0]
    speed = float(np.median(moving) / (step * usual)) if moving.size else 0.0
    if speed > _FASTEST_M_PER_S:
        findings.fault(
            FILE, "count", f"gives a speed of {speed:.4g} m/s; no tool runs so fast", "attribute pulse_m may be in millimetre"
        )


def travelled(odometer: xr.Dataset) -> float:
    """Length of the run by the wheel that counted most (metre)."""
    count = odometer["count"].values
    return float((count[-1] - count[0]).max()) * odometer.attrs["pulse_m"] if count.size else 0.0
