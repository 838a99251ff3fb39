"""`survey.toml` in, a validated `Survey` out: which runs, which outputs, which options."""

from __future__ import annotations

import datetime
import tomllib
from dataclasses import dataclass as plain_dataclass
from dataclasses import field as plain_field
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from deform.errors import Fault, InputError
from deform.options import Options, option_faults, options_from

_STRICT = ConfigDict(extra="forbid")
Format = Literal["html", "pdf", "xlsx", "gpkg", "ply", "glb", "stl"]
REPORT_FORMATS: tuple[Format, ...] = ("html", "pdf", "xlsx", "gpkg")
SURFACE_FORMATS: tuple[Format, ...] = ("ply", "glb", "stl")


@dataclass(frozen=True, config=_STRICT)
class LineEntry:
    """Table ``[line]``; the outside diameter is for listings, which seldom say it."""

    name: str
    reference: str | None = None
    outside_diameter_m: float | None = Field(default=None, gt=0.02, lt=3.0)


@dataclass(frozen=True, config=_STRICT)
class RunEntry:
    """One of ``[[runs]]``: a raw run folder, or a vendor listing with its column map."""

    raw: str | None = None
    tally: str | None = None
    columns: str | None = None
    id: str | None = None
    date: datetime.date | None = None


@dataclass(frozen=True, config=_STRICT)
class ControlEntry:
    """Table ``[control]``: surveyed points, and their reference system where the file does not say it."""

    points: str | None = None
    crs: str | None = None


@dataclass(frozen=True, config=_STRICT)
class PipeBookEntry:
    """Table ``[pipe_book]``: a listing of the joints as laid with its column map, and a CSV of straight stretches along it."""

    joints: str | None = None
    columns: str | None = None
    straights: str | None = None


_Entry = TypeVar("_Entry", RunEntry, PipeBookEntry)


@dataclass(frozen=True, config=_STRICT)
class MatchEntry:
    """Table ``[match]``: a CSV of pairs that a person locked or forbade."""

    locks: str | None = None


@dataclass(frozen=True, config=_STRICT)
class OutputEntry:
    """Table ``[outputs]``."""

    folder: str = "out"
    formats: tuple[Format, ...] = (*REPORT_FORMATS, *SURFACE_FORMATS)


@dataclass(frozen=True, config=_STRICT)
class _Content:
    line: LineEntry
    runs: tuple[RunEntry, ...]
    control: ControlEntry = Field(default_factory=ControlEntry)
    pipe_book: PipeBookEntry = Field(default_factory=PipeBookEntry)
    match: MatchEntry = Field(default_factory=MatchEntry)
    outputs: OutputEntry = Field(default_factory=OutputEntry)


@plain_dataclass(frozen=True)
class Survey:
    """A survey with every path resolved.

    Attributes
    ----------
    line : name of the line.
    reference : id of the run whose chainage is the axis; None = the earliest.
    outside_diameter_m : of the listings that do not say it themselves.
    runs : the entries in the order of the file, paths resolved.
    control, locks : files, or None; control_crs is the reference system of the points.
    pipe_book : listing of the joints as laid, its column map, straight stretches along it; paths, or None.
    folder : output folder.
    formats : what is written for people.
    options : options of all stages.
    """

    line: str
    runs: tuple[RunEntry, ...]
    folder: Path
    reference: str | None = None
    outside_diameter_m: float | None = None
    control: Path | None = None
    control_crs: str | None = None
    locks: Path | None = None
    pipe_book: PipeBookEntry = plain_field(default_factory=PipeBookEntry)
    formats: tuple[str, ...] = (*REPORT_FORMATS, *SURFACE_FORMATS)
    options: Options = plain_field(default_factory=Options)


def read_survey(path: Path) -> Survey:
    """Read and check a survey file; paths in it are relative to it.

    Raises
    ------
    InputError
        With every fault: unknown keys, wrong types, runs without a source, missing files.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(Fault(str(path), "", "no such file"))
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise InputError(Fault(path.name, "", f"is no TOML: {fault}")) from None
    options = options_from(content.pop("options", {}), f"{path.name} [options]")
    try:
        parsed = _Content(**content)
    except (ValidationError, TypeError) as fault:
        raise InputError(option_faults(fault, path.name, _Content)) from None
    return _resolved(parsed, path, options)


def _resolved(content: _Content, path: Path, options: Options) -> Survey:
    folder = path.parent
    faults = [] if content.runs else [Fault(path.name, "runs", "no run is given; add [[runs]] with raw or tally")]
    runs = []
    for number, entry in enumerate(content.runs, 1):
        faults += _entry_faults(entry, f"{path.name} [[runs]] {number}", folder)
        runs.append(_with_paths(entry, folder))
    book = content.pipe_book
    files = {"points": content.control.points, "locks": content.match.locks, "joints": book.joints, "straights": book.straights}
    if book.straights and not book.joints:
        faults.append(Fault(path.name, "pipe_book", "straights stand along a pipe book; give its joints too"))
    absent = {key: file for key, file in files.items() if file and not (folder / file).is_file()}
    faults += [Fault(path.name, key, f"{file}: no such file") for key, file in absent.items()]
    if faults:
        raise InputError(faults)
    return Survey(
        line=content.line.name,
        runs=tuple(runs),
        folder=folder / content.outputs.folder,
        reference=content.line.reference,
        outside_diameter_m=content.line.outside_diameter_m,
        control=folder / content.control.points if content.control.points else None,
        control_crs=content.control.crs,
        locks=folder / content.match.locks if content.match.locks else None,
        pipe_book=_with_paths(book, folder),
        formats=tuple(content.outputs.formats),
        options=options,
    )


def _entry_faults(entry: RunEntry, where: str, folder: Path) -> list[Fault]:
    faults: list[Fault] = []
    if (entry.raw is None) == (entry.tally is None):
        faults.append(Fault(where, "raw, tally", "exactly one of them must be given"))
    if entry.raw is not None and not (folder / entry.raw).is_dir():
        faults.append(Fault(where, "raw", f"{entry.raw}: no such folder"))
    if entry.tally is not None and not (folder / entry.tally).is_file():
        faults.append(Fault(where, "tally", f"{entry.tally}: no such file"))
    if entry.tally is not None:
        absent = [key for key in ("columns", "id", "date") if not getattr(entry, key)]
        faults += [Fault(where, key, "is missing; a listing does not say it") for key in absent]
    return faults


def _with_paths(entry: _Entry, folder: Path) -> _Entry:
    """Paths made whole; `columns` stays a name when no such file is there (a map that is shipped)."""
    names = ("raw", "tally", "joints", "straights")
    changes: dict[str, Any] = {k: str(folder / v) for k in names if (v := getattr(entry, k, None)) is not None}
    if entry.columns and (folder / entry.columns).is_file():
        changes["columns"] = str(folder / entry.columns)
    return replace(entry, **changes)
