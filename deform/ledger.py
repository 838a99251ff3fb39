"""The ledger of a survey: what each stage did, took and warned of, kept in `survey.json` so that a stopped job resumes."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deform.run import history, store

_log = logging.getLogger(__name__)
Progress = Callable[[str, float, str], None]
"""Called with (stage, fraction done, state); state is ``running``, ``done``, ``resumed``, ``failed``."""


def silent(stage: str, fraction: float, state: str) -> None:
    """Show no progress."""


@dataclass
class StageRecord:
    """One stage: its key (what it depends on), its files, what it took."""

    name: str
    key: str
    status: str = "done"
    seconds: float = 0.0
    peak_memory_mb: float = 0.0
    outputs: dict[str, int] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    detail: dict[str, Any] = field(default_factory=dict)


class Ledger:
    """Stages of one output folder.

    A stage whose key is unchanged and whose files are all there, with the size they had, is not run again.
    """

    def __init__(self, folder: Path, progress: Progress = silent, resume: bool = True):
        self.folder, self.progress = Path(folder), progress
        self.header: dict[str, Any] = {}
        self.stages: dict[str, StageRecord] = {}
        self.missing: dict[str, str] = {}
        self._before = self._read() if resume else {}

    def done(self, name: str, key: str) -> bool:
        """True when an earlier run left this stage complete; it is taken over."""
        record = self._before.get(name)
        if record is None or record.key != key or record.status == "failed":
            return False
        for file, size in record.outputs.items():
            path = self.folder / file
            if not path.exists() or (path.is_file() and path.stat().st_size != size):
                return False
        record.status = "resumed"
        self.stages[name] = record
        self.progress(name, 1.0, "resumed")
        return True

    @contextlib.contextmanager
    def stage(self, name: str, key: str) -> Iterator[StageRecord]:
        """Time a stage, gather its warnings, and write the ledger when it ends, well or not."""
        record = self.stages[name] = StageRecord(name, key)
        gathered = _Gather(record.warnings)
        logger = logging.getLogger("deform")
        logger.addHandler(gathered)
        _reset_peak()
        started = time.perf_counter()
        self.progress(name, 0.0, "running")
        try:
            yield record
        except BaseException:
            record.status = "failed"
            raise
        finally:
            logger.removeHandler(gathered)
            record.seconds = round(time.perf_counter() - started, 3)
            record.peak_memory_mb = round(_peak_mb(), 1)
            self.progress(name, 1.0, record.status)
            self.write()

    def ticker(self, name: str) -> Callable[[float], None]:
        """Progress of one stage, for the rooms."""
        return lambda fraction: self.progress(name, min(max(float(fraction), 0.0), 1.0), "running")

    def outputs(self, record: StageRecord, paths: Iterable[Path]) -> None:
        """Note the files that a stage wrote."""
        for path in paths:
            record.outputs[str(Path(path).relative_to(self.folder))] = Path(path).stat().st_size if Path(path).is_file() else 0

    def write(self) -> Path:
        """Write `survey.json`."""
        warnings = [{"stage": s.name, "message": w} for s in self.stages.values() for w in s.warnings]
        content = {
            **self.header,
            "deform_version": history.toolkit_version(),
            "python": platform.python_version(),
            "stages": [vars(s) for s in self.stages.values()],
            "warnings": warnings,
            "missing": [{"output": output, "reason": reason} for output, reason in self.missing.items()],
        }
        return store.write_json(content, self.folder / "survey.json")

    def _read(self) -> dict[str, StageRecord]:
        try:
            content = json.loads((self.folder / "survey.json").read_text(encoding="utf-8"))
            return {s["name"]: StageRecord(**s) for s in content.get("stages", [])}
        except (OSError, ValueError, TypeError, KeyError):
            return {}  # no ledger, or one that was cut off: nothing is taken over


def key_of(*parts: Any) -> str:
    """Key of a stage: a hash over everything that it depends on, the toolkit's own source included."""
    text = json.dumps([history.toolkit_version(), history.source_digest(), *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class _Gather(logging.Handler):
    """Keeps warnings; the same sentence once."""

    def __init__(self, into: list[str]):
        super().__init__(logging.WARNING)
        self.into = into

    def emit(self, record: logging.LogRecord) -> None:
        message = record.getMessage()
        if message not in self.into:
            self.into.append(message)


def _reset_peak() -> None:
    with contextlib.suppress(OSError):  # only Linux can; elsewhere the peak is that of the process so far
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    except OSError:
        _log.debug("no /proc here; peak memory is that of the process so far")
    try:
        import resource
    except ImportError:  # Windows has none
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0 * 1024.0) if sys.platform == "darwin" else peak / 1024.0
