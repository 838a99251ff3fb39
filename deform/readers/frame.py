"""Columns of equal length by name: numbers as float arrays in SI, words as object arrays of text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Frame:
    """A table in memory, small and plain.

    Attributes
    ----------
    size : number of rows.
    columns : arrays of shape (size,) by name.
    """

    size: int
    columns: dict[str, np.ndarray] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return self.size

    def put(self, columns: Mapping[str, np.ndarray]) -> Frame:
        """Return the frame with further columns, or with others in place of those of the same name."""
        return Frame(self.size, {**self.columns, **columns})

    def take(self, rows: np.ndarray) -> Frame:
        """Return some rows, by mask or by index; arrays are copied."""
        rows = np.asarray(rows)
        size = int(rows.sum()) if rows.dtype == bool else rows.size
        return Frame(size, {name: column[rows] for name, column in self.columns.items()})

    def sorted_by(self, name: str) -> Frame:
        """Return the rows in rising order of a column; rows that are equal keep their order."""
        return self.take(np.argsort(self.columns[name], kind="stable"))
