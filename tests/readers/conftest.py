"""Fixtures of the readers' tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.readers.tiny_run import write_raw


@pytest.fixture
def raw_run(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a tiny raw run, some parts of it replaced."""

    def write(within: str = ".", **parts) -> Path:
        return write_raw(tmp_path / within / "tiny", **parts)

    return write
