"""The file ``imu.nc`` of a raw run in, its counts with pulse weights on rising times out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import xarray as xr

import deform.vocabulary as vocabulary
from deform.readers import clock, netcdf
from deform.readers.findings import Findings
from deform.run import stamps
from deform.run.raw import RunHeader

FILE = "imu.nc"
_GRAVITY = 9.81
_GRAVITY_RANGE = (0.8, 1.25)
_FASTEST_TURN_DEG_PER_S = 720.0
_EARTH_RATE_DEG_PER_H = 15.041
_PIECE = 1 << 15
_LIMITS = (2**15 - 1, 2**15, 2**23 - 1, 2**23, 2**31 - 1, 2**31)
_MOST_LOST = 0.01
_LARGEST_COUNT = 2.0**53  # whole numbers that a float holds exactly
_DIMS = ("sample", "axis")
_COUNTS = ("gyro_count", "accel_count")


def read_imu(path: Path, header: RunHeader | None, findings: Findings) -> xr.Dataset | None:
    """Return group ``imu`` of the vocabulary with attributes ``gyro_pulse_rad`` and ``accel_pulse_m_per_s``.

    Notes
    -----
    Samples whose counts are missing or saturated are taken out, which leaves a gap in time as a lost block does; gaps are
    recorded and kept.
    """
    ds = netcdf.open_packed(path, findings)
    if ds is None:
        return None
    with ds:
        wanted = {"time": ("sample",), "gyro_count": _DIMS, "accel_count": _DIMS}
        if not netcdf.has_variables(ds, wanted, FILE, findings):
            return None
        if ds.sizes["axis"] != 3:
            findings.fault(FILE, "axis", f"has size {ds.sizes['axis']}, wanted 3 (sensor x, y, z)")
            return None
        attrs = {
            "gyro_pulse_rad": netcdf.number(ds, "gyro_pulse_rad", ["gyro_count"], FILE, findings, least=1e-12, most=1e-2),
            "accel_pulse_m_per_s": netcdf.number(
                ds, "accel_pulse_m_per_s", ["accel_count"], FILE, findings, least=1e-10, most=1.0
            ),
        }
        fills = {name: netcdf.missing_value(ds, name) for name in wanted}
        with ThreadPoolExecutor(1) as unpacking:  # the next variable is unpacked while the one before is looked through
            coming = {n: unpacking.submit(netcdf.values, ds, n, wanted[n], FILE, findings) for n in (*_COUNTS, "time")}
            lost = {n: _lost(coming[n].result(), fills[n]) for n in _COUNTS}
            parts = {n: coming[n].result() for n in wanted}
        if any(v is None for v in parts.values()):
            return None
    return _checked(parts, lost, attrs, header, findings)  # type: ignore[arg-type]  # None was sent back above


def _checked(
    parts: dict[str, np.ndarray],
    lost: dict[str, np.ndarray | None],
    attrs: dict,
    header: RunHeader | None,
    findings: Findings,
) -> xr.Dataset | None:
    known = len(findings.faults)
    keep = _present(lost, parts["time"].size, findings)
    if keep is not None:
        parts = {name: part[keep] for name, part in parts.items()}
    time = clock.rising_time(parts["time"], FILE, findings)
    counts = {name: _whole(parts[name], name, findings) for name in _COUNTS}
    if len(findings.faults) > known or None in attrs.values() or time.size < 2:
        if time.size == 1:
            findings.fault(FILE, "time", "has one sample only; the recording is empty")
        return None
    over = _saturation(counts, time, findings)
    if over is not None:
        time, counts = time[~over], {name: count[~over] for name, count in counts.items()}
    clock.missing_samples(time, FILE, findings)
    _possible_force(counts["accel_count"], time, attrs["accel_pulse_m_per_s"], findings)
    _possible_rate(counts["gyro_count"], time, attrs["gyro_pulse_rad"], header, findings)
    variables = {n: (v.dims, {"time": time, **counts}[n], v.attrs) for n, v in vocabulary.group("imu").items()}
    return xr.Dataset(variables, attrs=attrs)  # not by `build`: the counts stay 32 bits wide, a 50 h run has 200 million


def measured_rate(imu: xr.Dataset) -> float:
    """Samples per second (Hz), from the median step."""
    return 1.0 / stamps.usual_step(imu["time"].values)


def _lost(part: np.ndarray | None, fill: float | int | None) -> np.ndarray | None:
    """Return the mask of samples of a variable whose counts are missing; None when none is."""
    if part is None:
        return None
    gone = np.zeros(0, bool)
    if part.dtype.kind == "f":
        gone = ~np.isfinite(part).all(axis=1)
    if fill is None and part.dtype == np.int32:
        fill = -(2**31) + 1  # netCDF's default
    if fill is not None and fill == fill and (part == fill).any():
        gone = (part == fill).any(axis=1) | (gone if gone.size else False)
    return gone if gone.any() else None


def _present(lost: dict[str, np.ndarray | None], n: int, findings: Findings) -> np.ndarray | None:
    """Return the mask of samples whose counts are all there, None when nothing is missing."""
    masks = [mask for mask in lost.values() if mask is not None]
    if not masks:
        return None
    gone = np.logical_or.reduce(masks)
    first, count = int(np.flatnonzero(gone)[0]), int(gone.sum())
    if count > _MOST_LOST * n:
        findings.fault(
            FILE, "gyro_count, accel_count", f"are missing at {count} of {n} samples, first at sample {first}; at most 1 % may be"
        )
        return None
    findings.repair(
        FILE, "gyro_count, accel_count", f"missing at {count} samples, first at sample {first}; these samples are left out"
    )
    return ~gone


def _whole(count: np.ndarray, name: str, findings: Findings) -> np.ndarray:
    if count.dtype.kind == "f":
        largest = float(np.abs(np.nan_to_num(count)).max(initial=0.0))
        if largest > _LARGEST_COUNT:
            findings.fault(FILE, name, f"reaches {largest:.4g} pulses in one sample; that cannot be")
            return np.zeros(count.shape, np.int64)
        if np.isfinite(count).all() and np.abs(count - np.round(count)).max(initial=0.0) > 1e-6:
            findings.fault(
                FILE, name, "holds fractions of a pulse; counts are whole numbers", "are these rates instead of counts?"
            )
            return np.zeros(count.shape, np.int64)
        count = np.round(np.nan_to_num(count))
    narrow = count.size == 0 or (count.min() >= -(2**31) and count.max() < 2**31)
    return np.ascontiguousarray(count, dtype=np.int32 if narrow else np.int64)


def _saturation(counts: dict[str, np.ndarray], time: np.ndarray, findings: Findings) -> np.ndarray | None:
    """Return the mask of samples at the end of a sensor's range, where nobody knows how far it turned; None without any."""
    over = np.zeros(0, bool)
    for name, count in counts.items():
        highest, lowest = _extremes(count)
        for axis in range(3):
            column = count[:, axis]
            peak = max(abs(int(highest[axis])), abs(int(lowest[axis])))
            if peak not in _LIMITS:
                continue
            at = np.flatnonzero((column == peak) | (column == -peak))
            rule = f"saturated at {peak} pulses in {at.size} samples, first at t={time[at[0]]:.3f} s"
            if at.size > _MOST_LOST * column.size:
                findings.fault(
                    FILE, f"{name}, axis {axis}", f"{rule}; at most 1 % may be", "the sensor was overloaded or is broken"
                )
                continue
            findings.repair(FILE, f"{name}, axis {axis}", f"{rule}; these samples are left out")
            over = over if over.size else np.zeros(len(column), bool)
            over[at] = True
    return over if over.size else None


def _extremes(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest and least count of each axis, in pieces that stay in the processor's cache."""
    pieces = [count[k : k + _PIECE] for k in range(0, len(count), _PIECE)]
    highest, lowest = (np.array([[of(p[:, axis]) for axis in range(3)] for p in pieces]) for of in (np.max, np.min))
    return highest.max(axis=0), lowest.min(axis=0)


def _blocks(count: np.ndarray, time: np.ndarray, pulse: float) -> np.ndarray:
    """Mean vectors over about a second, shape (m, 3), in the unit of the pulse per second; at most some 10 000 of them."""
    per_block = max(1, round(1.0 / max(stamps.usual_step(time), 1e-6)))
    n = time.size // per_block
    if n < 2:
        return (count.sum(axis=0, dtype=float) * pulse / max(time[-1] - time[0], 1e-9))[None]
    chosen = np.unique(np.linspace(1, n - 1, min(n - 1, 10_000)).astype(int))
    sums = np.stack([count[k * per_block : (k + 1) * per_block].sum(axis=0, dtype=float) for k in chosen])
    spans = time[(chosen + 1) * per_block - 1] - time[chosen * per_block - 1]
    return sums * pulse / spans[:, None]


def _possible_force(count: np.ndarray, time: np.ndarray, pulse: float, findings: Findings) -> None:
    force = float(np.median(np.linalg.norm(_blocks(count, time, pulse), axis=1)))
    if not _GRAVITY_RANGE[0] < force / _GRAVITY < _GRAVITY_RANGE[1]:
        rule = f"gives a median specific force of {force:.4g} m/s²; a tool in a pipe feels gravity, about 9.81 m/s²"
        findings.fault(FILE, "accel_count", rule, "attribute accel_pulse_m_per_s may be in another unit, or an axis is dead")


def _possible_rate(count: np.ndarray, time: np.ndarray, pulse: float, header: RunHeader | None, findings: Findings) -> None:
    rates = np.degrees(_blocks(count, time, pulse))
    rate = float(np.median(np.linalg.norm(rates, axis=1)))
    if rate > _FASTEST_TURN_DEG_PER_S:
        findings.fault(
            FILE,
            "gyro_count",
            f"gives a median rate of {rate:.4g} degree/s; no tool turns so fast",
            "attribute gyro_pulse_rad may be in degree or arc second",
        )
        return
    if header is None or header.launch.static_s < 60 or header.imu.gyro_bias_deg_per_h > 1.0:
        return
    first, last = np.searchsorted(time, time[0] + np.array([5.0, header.launch.static_s - 5.0]))
    if last - first < 100:
        return
    span = time[last - 1] - time[first]
    earth = float(np.linalg.norm(np.degrees(count[first + 1 : last].sum(axis=0, dtype=float) * pulse / span))) * 3600.0
    if not 0.2 < earth / _EARTH_RATE_DEG_PER_H < 5.0:
        text = f"turns at {earth:.4g} degree/h while the tool stands, the earth at {_EARTH_RATE_DEG_PER_H}"
        findings.repair(FILE, "gyro_count", f"{text}; kept, check gyro_pulse_rad and static_s")
