"""Exceptions of the toolkit: every fault of an input is named with its file, its field, the rule and the value."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One departure of an input from a rule.

    Parameters
    ----------
    where : file, run or group, such as ``demo-2019/odometer.nc``.
    field : variable, column or key, such as ``count, wheel 2``.
    rule : what must hold, or what is wrong, with the value: ``falls from 91 to 17 at t=812.4 s; counts must not decrease``.
    advice : what to do about it; may be empty.
    """

    where: str
    field: str
    rule: str
    advice: str = ""

    def __str__(self) -> str:
        place = f"{self.where}: {self.field}" if self.field else self.where
        return f"{place}: {self.rule}" + (f" ({self.advice})" if self.advice else "")


class DeformError(Exception):
    """Root of all errors that this package raises on purpose."""


class InputError(DeformError, ValueError):
    """The data break one or more rules; ``faults`` holds them all."""

    def __init__(self, faults: Iterable[Fault] | Fault | str):
        if isinstance(faults, str):
            faults = Fault("", "", faults)
        self.faults = [faults] if isinstance(faults, Fault) else list(faults)
        super().__init__("\n".join(str(f).removeprefix(": ") for f in self.faults))


class SchemaError(InputError):
    """A run does not follow `vocabulary.toml`."""


class UnknownFormatError(InputError):
    """No reader recognises a file."""


class NewerSchemaError(InputError):
    """A file was written by a newer version of the toolkit."""


class WrongLineError(InputError):
    """Runs that should be of one line are of different lines."""


class OptionError(InputError):
    """An option is unknown or has a value that cannot be."""


class MissingExtraError(DeformError, ImportError):
    """An optional dependency group is needed and not installed."""

    def __init__(self, feature: str, extra: str):
        self.feature, self.extra = feature, extra
        super().__init__(f'{feature} needs the extra "{extra}": pip install "deform-ili[{extra}]"')
