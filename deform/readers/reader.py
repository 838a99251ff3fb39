"""The contract of the readers and the way in: a path comes in, a raw run or a run goes out, whichever reader knows the format."""

from __future__ import annotations

import datetime
import logging
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Protocol

import xarray as xr

from deform.errors import Fault, InputError, UnknownFormatError
from deform.run.raw import RawRun

logger = logging.getLogger(__name__)

GROUP = "deform.readers"
_BUILT_IN = {
    "raw_folder": "deform.readers.raw_folder:RawFolderReader",
    "stored": "deform.readers.stored:StoredReader",
    "tally": "deform.readers.tally:TallyReader",
}


@dataclass(frozen=True)
class Request:
    """What is to be read, and what the user knows about it.

    Attributes
    ----------
    path : raw run folder, listing, or stored run.
    columns : column map of a listing: path of a TOML file, or the name of a shipped map; None finds the shipped map that fits.
    run_id : name of the run; None takes the one of the source.
    date : date of the run; a listing does not know its own.
    outside_diameter_m : outside diameter (metre), for a listing whose column map does not say it.
    line : name of the line, for a listing.
    """

    path: Path
    columns: str | Path | None = None
    run_id: str | None = None
    date: datetime.date | None = None
    outside_diameter_m: float | None = None
    line: str | None = None


@dataclass(frozen=True)
class Scan:
    """Summary of a source without reading all of it: for people, and as JSON."""

    format: str
    path: Path
    summary: dict[str, Any]
    remarks: tuple[str, ...] = field(default_factory=tuple)


class Reader(Protocol):
    """One format.

    Attributes
    ----------
    name : short name, the one of the entry point.
    description : what the format is, in a few words.
    """

    name: str
    description: str

    def recognise(self, request: Request) -> str:
        """Return an empty text when the source is of this format, else why it is not; never raises on strange input."""

    def scan(self, request: Request) -> Scan:
        """Return a summary."""

    def read(self, request: Request) -> RawRun | xr.DataTree:
        """Return what the source holds; `InputError` with all faults when it breaks the rules of its format."""


@cache
def readers() -> dict[str, Reader]:
    """Return the readers by name: those of the package, and those that other packages declare in group ``deform.readers``."""
    found: dict[str, Reader] = {}
    declared = {e.name: e for e in entry_points(group=GROUP)}
    for name, place in _BUILT_IN.items():
        if name not in declared:
            module, _, attribute = place.partition(":")
            found[name] = getattr(import_module(module), attribute)()
    for name, entry in declared.items():
        try:
            found[name] = entry.load()()
        except Exception as fault:  # a foreign package may break in any way; the others still work
            logger.warning("reader %s (%s) cannot be loaded: %s", name, entry.value, fault)
    return dict(sorted(found.items()))


def recognise(path: Path | str, columns: str | Path | None = None) -> Reader:
    """Return the reader that knows a source.

    Raises
    ------
    UnknownFormatError
        When no reader does; it says what was tried and why each refused.
    InputError
        When there is no such file or folder.
    """
    return _reader_of(Request(Path(path), columns))


def read_source(
    path: Path | str,
    columns: str | Path | None = None,
    run_id: str | None = None,
    date: datetime.date | str | None = None,
    *,
    outside_diameter_m: float | None = None,
    line: str | None = None,
) -> RawRun | xr.DataTree:
    """Read one run from a raw run folder, a vendor's listing or a stored run.

    Parameters
    ----------
    path : folder or file.
    columns : column map of a listing, a path or the name of a shipped map (``rosen``); None finds the shipped map that fits.
    run_id : name of the run, in place of the source's own; a listing without takes the file's stem.
    date : date of the run (ISO text or date), in place of the source's own; a listing needs it.
    outside_diameter_m, line : of a listing, when its column map does not say them.

    Returns
    -------
    A `RawRun` (raw folder) or a run `DataTree` (listing, stored run).

    Raises
    ------
    UnknownFormatError
        When no reader knows the format.
    InputError
        With every fault found in the source.
    """
    request = Request(Path(path), columns, run_id, _date(date), outside_diameter_m, line)
    return _reader_of(request).read(request)


def scan(path: Path | str, columns: str | Path | None = None) -> Scan:
    """Return the summary of a source (for ``deform info``): format, sizes, spans; errors as in `recognise`."""
    request = Request(Path(path), columns)
    return _reader_of(request).scan(request)


def _reader_of(request: Request) -> Reader:
    if not request.path.exists():
        raise InputError(Fault(str(request.path), "", "no such file or folder"))
    refusals = {}
    for name, reader in readers().items():
        refusals[name] = reader.recognise(request)
        if not refusals[name]:
            return reader
    tried = "; ".join(f"{name}: {why}" for name, why in refusals.items())
    raise UnknownFormatError(Fault(str(request.path), "", f"no reader knows this format. Tried {tried}"))


def _date(date: datetime.date | str | None) -> datetime.date | None:
    if isinstance(date, datetime.datetime):
        return date.date()
    if date is None or isinstance(date, datetime.date):
        return date
    try:
        return datetime.date.fromisoformat(str(date))
    except ValueError:
        raise InputError(Fault("", "date", f"is {date!r}; wanted an ISO date such as 2015-05-01")) from None
