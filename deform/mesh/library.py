"""The name of a heavy library in, the library or a clear sentence out."""

from __future__ import annotations

import importlib
from typing import Any

from deform.errors import MissingExtraError


def library(name: str) -> Any:
    """Return an optional library, imported now.

    Raises
    ------
    MissingExtraError
        When it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingExtraError("a 3-D surface", "mesh") from None
