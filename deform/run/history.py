"""Provenance: what was done to a run, with which version and which input bytes."""

from __future__ import annotations

import datetime
import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_BLOCK = 1 << 20


def toolkit_version() -> str:
    """Version of the installed toolkit."""
    try:
        return version("deform-ili")
    except PackageNotFoundError:
        return "0+unknown"


@cache
def source_digest() -> str:
    """Digest over the toolkit's own source, so that results of another state of it are not taken over."""
    package = Path(__file__).parents[1]
    sources = sorted(p for end in ("py", "toml") for p in package.rglob(f"*.{end}"))
    return hashlib.sha256("".join(sha256(p) for p in sources).encode()).hexdigest()[:16]


def append(attrs: dict[str, Any], step: str) -> None:
    """Add one line to the attribute ``history``: time (UTC), toolkit and version, what was done."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    line = f"{now} deform {toolkit_version()}: {step}"
    attrs["history"] = f"{attrs['history']}\n{line}" if attrs.get("history") else line


def sha256(path: Path) -> str:
    """SHA-256 of a file as hexadecimal text."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(_BLOCK), b""):
            digest.update(block)
    return digest.hexdigest()
