"""The package's sources in; compiled kernels of earlier sources dropped.

Numba keeps a compiled kernel for as long as the file that it stands in is unchanged. A kernel also holds what it took from other
files, constants and functions: changed there, it would go on computing with the old ones, unseen.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from pathlib import Path

_IMPORT = re.compile(r"^from (deform[\w.]*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
_STAMPS = "kernels.json"


def drop_outdated(package: Path) -> list[str]:
    """Delete compiled kernels whose sources, imported ones included, are others than those they were compiled from.

    Parameters
    ----------
    package : folder of the package; what its files were when this was last called stands in its ``__pycache__``.

    Returns
    -------
    Names of the files whose kernels were outdated. In a folder that cannot be written nothing is done: what is there was put
    there with its sources.

    Notes
    -----
    Files are read only when a time or a size among them has changed. A cache that ``NUMBA_CACHE_DIR`` puts elsewhere is left
    alone.
    """
    kept = package / "__pycache__" / _STAMPS
    now = {path.relative_to(package).as_posix(): path for path in sorted(package.rglob("*.py"))}
    seen = {name: [(at := path.stat()).st_mtime_ns, at.st_size] for name, path in now.items()}
    before = _read(kept)
    if before.get("seen") == seen:
        return []
    texts = {name: path.read_text(encoding="utf-8") for name, path in now.items()}
    digests = {name: _digest(name, texts) for name, text in texts.items() if "njit" in text}
    outdated = [name for name, digest in digests.items() if before.get("kernels", {}).get(name) != digest]
    with contextlib.suppress(OSError):
        for name in outdated:
            for compiled in (now[name].parent / "__pycache__").glob(f"{now[name].stem}.*.nb[ic]"):
                compiled.unlink(missing_ok=True)
        kept.parent.mkdir(exist_ok=True)
        beside = kept.with_suffix(f".{os.getpid()}")
        beside.write_text(json.dumps({"seen": seen, "kernels": digests}))
        beside.replace(kept)
    return outdated


def _read(kept: Path) -> dict:
    try:
        return json.loads(kept.read_text())
    except (OSError, ValueError):
        return {}


def _digest(name: str, texts: dict[str, str]) -> str:
    """Digest of a source and of all sources of the package that it imports, directly or not."""
    waiting, found = [name], set()
    while waiting:
        here = waiting.pop()
        if here in found:
            continue
        found.add(here)
        for room, several, one in _IMPORT.findall(texts[here]):
            folder = "/".join(room.split(".")[1:])
            members = [part.split(" as ")[0].strip() for part in (several or one).split(",")]
            candidates = [f"{folder}.py", *(f"{folder}/{part}.py".lstrip("/") for part in members)]
            waiting += [path for path in candidates if path in texts]
    return hashlib.blake2b("\0".join(texts[path] for path in sorted(found)).encode(), digest_size=16).hexdigest()
