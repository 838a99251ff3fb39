"""What a reader meets in an input: faults are gathered to be raised together, repairs are logged and kept in words."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

from deform.errors import Fault, InputError

logger = logging.getLogger(__name__)


@dataclass
class Findings:
    """Faults and repairs of one input.

    Parameters
    ----------
    where : name of the input as the user knows it, such as ``demo-2019``.
    """

    where: str
    faults: list[Fault] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)

    def fault(self, file: str, name: str, rule: str, advice: str = "") -> None:
        """Note that ``name`` in ``file`` breaks a rule."""
        self.faults.append(Fault(self.place(file), name, rule, advice))

    def repair(self, file: str, name: str, what: str) -> None:
        """Note and log what was repaired, or what stands out and was kept."""
        text = str(Fault(self.place(file), name, what))
        self.repairs.append(text)
        logger.warning(text)

    def place(self, file: str) -> str:
        """Return ``where/file``."""
        return f"{self.where}/{file}" if file else self.where

    def raise_if(self) -> None:
        """Raise `InputError` with all faults, when there are any."""
        if self.faults:
            raise InputError(self.faults)
