"""A column map in TOML in (a path, or the name of a shipped one), the validated description of a vendor's listing out."""

from __future__ import annotations

import difflib
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from deform.errors import Fault, InputError
from deform.readers import cells

MAPS = "maps"

FIELDS = {
    "distance": "length",
    "distance_end": "length",
    "joint_length": "length",
    "wall": "length",
    "elevation": "length",
    "weld_distance": "length",
    "dent_depth": "length",
    "depth": "length",
    "length": "length",
    "width": "length",
    "easting": "length",
    "northing": "length",
    "latitude": "place",
    "longitude": "place",
    "clock": "clock",
    "seam_clock": "clock",
    "bend_angle": "angle",
    "joint": "text",
    "event": "text",
    "comment": "text",
    "name": "text",
    "direction": "text",
}
RELATIVE = {
    "% OD": ("dent_depth", 0.01),
    "fraction OD": ("dent_depth", 1.0),
    "% wall": ("depth", 0.01),
    "fraction wall": ("depth", 1.0),
}
FeatureKind = Literal[
    "valve",
    "tee",
    "tap",
    "bend",
    "wall_change",
    "sleeve",
    "flange",
    "support",
    "casing",
    "marker",
    "wrinkle",
    "metal_loss",
    "other",
]
Kind = Literal["weld", "seam", "dent", FeatureKind]
Capture = Literal["angle", "direction", "depth", "length", "width", "wall", "name", "clock"]
_CAPTURED_LENGTHS = ("depth", "length", "width", "wall")


def _listed(value):
    return [value] if isinstance(value, str) else value


def _pattern(text: str) -> str:
    try:
        re.compile(text)
    except re.error as fault:
        raise ValueError(f"{text!r} is no regular expression ({fault})") from None
    return text


Texts = Annotated[tuple[str, ...], BeforeValidator(_listed)]
Pattern = Annotated[str, AfterValidator(_pattern)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Column(_Strict):
    """Where a field stands: its header (one or several spellings), unit, format.

    ``unit`` is one of lengths (``ft``, ``0.1 mm``, ...), ``% OD`` for the depth of dents, ``% wall`` for that of metal loss;
    ``format`` is one of the clock formats, or ``station`` for a distance such as ``123+45.6``.
    """

    header: Texts
    unit: str = ""
    format: str = ""
    required: bool = False


class FileOptions(_Strict):
    """How the file is written; what is absent is found out."""

    delimiter: str = ""
    encoding: str = ""
    decimal: Literal[".", ","] = "."
    sheet: str | int = 0
    rows_below_header: Annotated[int, Field(ge=0)] = 0


class Joints(_Strict):
    """Whether the number and the length in a weld's row are those of the joint that begins or of the one that ends there."""

    number: Literal["begins", "ends"] = "begins"
    length: Literal["begins", "ends"] = "begins"


class PipeOptions(_Strict):
    """What the listing does not say of its pipe (metre)."""

    outside_diameter_m: Annotated[float, Field(gt=0.02, lt=3)] | None = None
    nominal_wall_m: Annotated[float, Field(gt=0, lt=0.2)] | None = None
    line: str = ""


class Coordinates(_Strict):
    """What the coordinates are: reference system when not WGS84, standard deviations, longest stretch to bridge."""

    crs: str = ""
    sigma_horizontal_m: Annotated[float, Field(gt=0)] | None = None
    sigma_vertical_m: Annotated[float, Field(gt=0)] | None = None
    longest_gap_m: Annotated[float, Field(gt=0)] = 100.0


class RowRule(_Strict):
    """Which rows are of a kind. All tests that are given must hold; the first rule that fits a row decides.

    ``event`` holds whole cells (case and spacing do not matter), ``event_pattern`` and ``comment_pattern`` regular expressions
    that must be found, ``capture`` one for the comment whose named groups give values and which decides nothing. ``columns``
    are fields that stand where they stand in rows of this kind only.
    """

    kind: Kind
    event: Texts = ()
    event_pattern: Pattern = ""
    comment_pattern: Pattern = ""
    capture: Pattern = ""
    units: dict[str, str] = Field(default_factory=dict)
    words: dict[str, str] = Field(default_factory=dict)
    part: Literal["point", "start", "end"] = "point"
    pair: str = ""
    seam: str = ""
    columns: dict[str, tuple[Column, ...]] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _columns_in_full(cls, content):
        return _in_full(content)

    @model_validator(mode="after")
    def _tests_something(self):
        if not (self.event or self.event_pattern or self.comment_pattern):
            raise ValueError("has none of event, event_pattern, comment_pattern: it would take every row")
        groups = set(re.compile(self.capture).groupindex)
        if groups - set(get_args(Capture)):
            raise ValueError(f"capture names {sorted(groups - set(get_args(Capture)))}; known are {', '.join(get_args(Capture))}")
        for name, unit in self.units.items():
            wrong = _wrong_capture(name, unit)
            if wrong:
                raise ValueError(wrong)
        absent = [g for g in groups if g in _CAPTURED_LENGTHS and g not in self.units]
        if absent:
            raise ValueError(f"units are missing for the captured {', '.join(absent)}")
        return self


class ColumnMap(_Strict):
    """A vendor's listing described: file, columns, rows."""

    name: str
    title: str = ""
    file: FileOptions = FileOptions()
    pipe: PipeOptions = PipeOptions()
    joints: Joints = Joints()
    coordinates: Coordinates = Coordinates()
    columns: dict[str, tuple[Column, ...]]
    rows: tuple[RowRule, ...]

    @model_validator(mode="before")
    @classmethod
    def _columns_in_full(cls, content):
        return _in_full(content)

    @model_validator(mode="after")
    def _columns_make_sense(self):
        wrong = [f"{name}: is missing; a listing has it" for name in ("distance", "event") if name not in self.columns]
        for columns in (self.columns, *(rule.columns for rule in self.rows)):
            wrong += _wrong_columns(columns)
        if not any(rule.kind == "weld" for rule in self.rows):
            wrong.append("rows: no rule of kind 'weld'; without girth welds runs cannot be matched")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self


def _in_full(content):
    """Write the short forms of a column (a header, several spellings, alternatives) as a list of tables."""
    if not (isinstance(content, dict) and isinstance(content.get("columns"), dict)):
        return content
    full = {}
    for name, entry in content["columns"].items():
        entries = entry if isinstance(entry, list) and not all(isinstance(e, str) for e in entry) else [entry]
        full[name] = [{"header": e} if isinstance(e, str | list) else e for e in entries]
    return {**content, "columns": full}


def _wrong_columns(columns: dict[str, tuple[Column, ...]]) -> list[str]:
    wrong = [f"{name}: unknown field; known are {', '.join(FIELDS)}" for name in columns if name not in FIELDS]
    return wrong + [
        f"{name}: {text}"
        for name, several in columns.items()
        for column in several
        if name in FIELDS and (text := _wrong_column(name, column))
    ]


def _wrong_capture(name: str, unit: str) -> str:
    if name not in _CAPTURED_LENGTHS:
        return f"unit of {name!r}: only {', '.join(_CAPTURED_LENGTHS)} have one"
    if unit in RELATIVE:
        return "" if name == "depth" else f"unit {unit!r} is for a depth only"
    return cells.check_unit(unit, "length")


def _wrong_column(name: str, column: Column) -> str:
    kind = FIELDS.get(name, "")
    if not column.header or not all(h.strip() for h in column.header):
        return "has no header"
    if kind == "length":
        if column.unit in RELATIVE:
            return "" if RELATIVE[column.unit][0] == name else f"unit {column.unit!r} is for {RELATIVE[column.unit][0]} only"
        if not column.unit:
            return "has no unit"
        if column.format not in ("", "station"):
            return f"format {column.format!r} is unknown; known is station"
        return cells.check_unit(column.unit, "length")
    if kind == "clock" and column.format not in cells.CLOCK_FORMATS:
        return f"format {column.format!r} is none of {', '.join(cells.CLOCK_FORMATS)}"
    if column.unit and kind != "angle":
        return f"takes no unit, not {column.unit!r}"
    return ""


def shipped() -> dict[str, ColumnMap]:
    """Return the column maps that are part of the package, by name."""
    folder = files("deform.readers").joinpath(MAPS)
    found = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return {name.removesuffix(".toml"): _parsed(folder.joinpath(name).read_text(encoding="utf-8"), name) for name in found}


def column_map(source: str | Path) -> ColumnMap:
    """Return a column map from a path, or a shipped one by name (``rosen`` or ``rosen.toml``).

    Raises
    ------
    InputError
        When there is none, or with every departure from the rules of a column map.
    """
    path = Path(source)
    if path.is_file():
        try:
            return _parsed(path.read_text(encoding="utf-8-sig"), str(path))
        except UnicodeDecodeError as fault:
            raise InputError(Fault(str(path), "", f"is no TOML in UTF-8 ({fault})")) from None
    known = shipped()
    name = path.name.removesuffix(".toml")
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, 1)
    advice = f"did you mean {near[0]!r}?" if near else "docs/listings.md tells how to write one"
    raise InputError(
        Fault(str(source), "columns", f"no such file, and no shipped column map of this name ({', '.join(known)})", advice)
    )


def _parsed(text: str, where: str) -> ColumnMap:
    try:
        return ColumnMap.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as fault:
        raise InputError(Fault(where, "", f"is no TOML ({fault})")) from None
    except ValidationError as errors:
        raise InputError([Fault(where, ".".join(map(str, e["loc"])), _said(e)) for e in errors.errors()]) from None


def _said(error) -> str:
    text = error["msg"].removeprefix("Value error, ")
    return text if error["type"] in ("value_error", "missing") else f"{text}, not {error['input']!r}"
