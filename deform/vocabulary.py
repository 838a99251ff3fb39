"""The vocabulary: every dataset variable and table column as described once in `vocabulary.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

from deform.errors import SchemaError


@dataclass(frozen=True)
class Variable:
    """One variable of a dataset."""

    group: str
    name: str
    dims: tuple[str, ...]
    long_name: str
    units: str | None = None
    positive: str | None = None
    range: tuple[float, float] | None = None
    type: str = "float"
    required: bool = False
    packed: float | None = None
    sigma_of: str | None = None

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes as written into files (CF names)."""
        attrs = {"units": self.units, "long_name": self.long_name, "positive_direction": self.positive}
        return {k: v for k, v in attrs.items() if v is not None}


@dataclass(frozen=True)
class Column:
    """One column of a table; its unit stands in the suffix of its name."""

    table: str
    name: str
    long_name: str
    type: str = "float"
    range: tuple[float, float] | None = None
    words: tuple[str, ...] | None = None


@cache
def _content() -> dict[str, Any]:
    return tomllib.loads(files("deform").joinpath("vocabulary.toml").read_text(encoding="utf-8"))


def schema_version() -> int:
    """Version of the layout of stored files."""
    return int(_content()["schema_version"])


@cache
def group(name: str) -> dict[str, Variable]:
    """Return the variables of a group by name, the sigma partners among them.

    Raises
    ------
    SchemaError
        When the vocabulary has no such group.
    """
    try:
        entries = _content()["group"][name]
    except KeyError:
        raise SchemaError(f"vocabulary.toml: no group {name!r}; there are {', '.join(_content()['group'])}") from None
    variables: dict[str, Variable] = {}
    for key, entry in entries.items():
        options: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items() if k != "sigma"}
        variable = Variable(group=name, name=key, **options)
        variables[key] = variable
        if entry.get("sigma"):
            variables[f"{key}_sigma"] = _partner(variable)
    return variables


def groups() -> tuple[str, ...]:
    """Names of all groups."""
    return tuple(_content()["group"])


def variable(group_name: str, name: str) -> Variable:
    """Return one variable of a group.

    Raises
    ------
    SchemaError
        When the group does not know the variable.
    """
    known = group(group_name)
    if name not in known:
        rule = f"group {group_name!r} has no variable {name!r}; describe it in vocabulary.toml, known are {', '.join(known)}"
        raise SchemaError(rule)
    return known[name]


@cache
def table(name: str) -> dict[str, Column]:
    """Return the columns of a table by name, in the order of the contract."""
    try:
        entries = _content()["table"][name]
    except KeyError:
        raise SchemaError(f"vocabulary.toml: no table {name!r}; there are {', '.join(_content()['table'])}") from None
    columns: dict[str, Column] = {}
    for key, entry in entries.items():
        options: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()}
        columns[key] = Column(table=name, name=key, **options)
    return columns


def tables() -> tuple[str, ...]:
    """Names of all tables."""
    return tuple(_content()["table"])


def _partner(variable: Variable) -> Variable:
    return replace(
        variable,
        name=f"{variable.name}_sigma",
        long_name=f"standard deviation of: {variable.long_name}",
        positive=None,
        range=(0.0, float("inf")),
        required=False,
        sigma_of=variable.name,
    )
