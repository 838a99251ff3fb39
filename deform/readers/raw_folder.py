"""A raw run folder in (``formats/raw-run.md``), a `RawRun` out; all faults are raised together, all repairs are recorded."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import xarray as xr

from deform.readers import clock, netcdf
from deform.readers.arms import FILE as CALIPER
from deform.readers.arms import read_arms
from deform.readers.events import FILE as WELDS
from deform.readers.events import read_weld_events
from deform.readers.findings import Findings
from deform.readers.header import FILE as HEADER
from deform.readers.header import read_header
from deform.readers.imu import FILE as IMU
from deform.readers.imu import measured_rate, read_imu
from deform.readers.markers import FILE as MARKERS
from deform.readers.markers import read_passages
from deform.readers.odometer import FILE as ODOMETER
from deform.readers.odometer import read_odometer, travelled
from deform.readers.reader import Request, Scan
from deform.run import history
from deform.run.raw import RawRun, RunHeader

logger = logging.getLogger(__name__)

FILES = (HEADER, IMU, ODOMETER, CALIPER, WELDS, MARKERS)
_RATE_TOLERANCE = 0.01


class RawFolderReader:
    """The raw run folder."""

    name = "raw_folder"
    description = "raw run folder (run.toml, imu.nc, odometer.nc, caliper.nc, welds.csv, markers.csv)"

    def recognise(self, request: Request) -> str:
        """Return an empty text for a folder with at least one of the files a raw run needs."""
        if not request.path.is_dir():
            return "not a folder"
        if not any((request.path / name).is_file() for name in (HEADER, IMU, ODOMETER)):
            return f"the folder holds none of {HEADER}, {IMU}, {ODOMETER}"
        return ""

    def scan(self, request: Request) -> Scan:
        """Return the header and the size and span of each recording."""
        findings = Findings(request.path.name)
        header = read_header(request.path / HEADER, findings)
        summary: dict = {"files": {n: (request.path / n).stat().st_size for n in FILES if (request.path / n).is_file()}}
        if header is not None:
            summary |= {"id": header.id, "line": header.run.line, "date": str(header.run.date), "direction": header.run.direction}
            summary |= {"outside_diameter_m": header.pipe.outside_diameter_m, "nominal_wall_m": header.pipe.nominal_wall_m}
        for name in (IMU, ODOMETER, CALIPER):
            if (request.path / name).is_file():
                summary[name] = _extent(request.path / name, findings)
        return Scan(self.name, request.path, summary, (*findings.repairs, *map(str, findings.faults)))

    def read(self, request: Request) -> RawRun:
        """Return the raw run.

        Raises
        ------
        InputError
            With every fault of every file.
        """
        return read_raw_folder(request.path, request)


def read_raw_folder(folder: Path, request: Request | None = None) -> RawRun:
    """Read a raw run folder.

    Parameters
    ----------
    folder : the folder; ``run.toml``, ``imu.nc`` and ``odometer.nc`` must be there, the others may be absent.
    request : a run id or date in it takes the place of the header's.

    Returns
    -------
    The raw run; ``arms`` stays on disk, packed.

    Raises
    ------
    InputError
        With every fault of every file.
    """
    folder = Path(folder)
    findings = Findings(folder.name or str(folder))
    header = read_header(folder / HEADER, findings)
    imu = read_imu(folder / IMU, header, findings)
    odometer = read_odometer(folder / ODOMETER, header, findings)
    arms, header = read_arms(folder / CALIPER, header, findings)
    span = (float(imu["time"][0]), float(imu["time"][-1])) if imu is not None else None
    if imu is not None:
        header = _checked_rate(header, imu, findings)
        for other, name in ((odometer, ODOMETER), (arms, CALIPER)):
            if other is not None:
                clock.same_span(other["time"].values, imu["time"].values, name, IMU, findings)
    weld_events = read_weld_events(folder / WELDS, span, findings)
    passages = read_passages(folder / MARKERS, header, span, travelled(odometer) if odometer is not None else 1e7, findings)
    if findings.faults and arms is not None:
        arms.close()
    findings.raise_if()
    if header is None or imu is None or odometer is None:  # each of them notes a fault when it is absent
        raise AssertionError(f"{folder}: a part is missing without a fault")
    hashes = {name: history.sha256(folder / name) for name in FILES if (folder / name).is_file()}
    header = _named(header, request, findings)
    return RawRun(header, imu, odometer, arms, weld_events, passages, folder, hashes, tuple(findings.repairs))


def _checked_rate(header: RunHeader | None, imu: xr.Dataset, findings: Findings) -> RunHeader | None:
    if header is None:
        return None
    rate = measured_rate(imu)
    if abs(rate / header.imu.rate_hz - 1) > _RATE_TOLERANCE:
        findings.repair(
            HEADER, "[imu] rate_hz", f"is {header.imu.rate_hz:g} Hz, the stamps of {IMU} say {rate:.6g} Hz; the stamps are taken"
        )
        return replace(header, imu=replace(header.imu, rate_hz=rate))
    return header


def _named(header: RunHeader, request: Request | None, findings: Findings) -> RunHeader:
    identity = header.run
    if request is not None and request.run_id and request.run_id != identity.id:
        identity = replace(identity, id=request.run_id)
    if request is not None and request.date and request.date != identity.date:
        findings.repair(HEADER, "[run] date", f"is {identity.date}, the survey says {request.date}; the survey's is taken")
        identity = replace(identity, date=request.date)
    return replace(header, run=identity)


def _extent(path: Path, findings: Findings) -> dict:
    ds = netcdf.open_packed(path, findings)
    if ds is None:
        return {}
    with ds:
        extent: dict = {str(k): int(v) for k, v in ds.sizes.items()}
        if "time" in ds.variables and ds["time"].ndim == 1 and ds["time"].size:
            extent |= {"from_s": float(ds["time"][0]), "to_s": float(ds["time"][-1])}
        return extent
