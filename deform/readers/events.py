"""Text files of a raw run in (``welds.csv``, ``markers.csv``): rows of numbers and words; weld events on the tool's clock out."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import xarray as xr

from deform.readers.findings import Findings
from deform.run import build

FILE = "welds.csv"


def read_rows(
    path: Path, required: tuple[str, ...], optional: tuple[str, ...], findings: Findings
) -> list[tuple[int, dict[str, str]]] | None:
    """Return rows (line number, text by column) of a CSV file of the raw run; None when columns are missing (faults noted)."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error) as fault:
        findings.fault(path.name, "", f"is no CSV text in UTF-8 ({fault})")
        return None
    head = [h.strip() for h in lines[0]] if lines else []
    missing = [name for name in required if name not in head]
    if missing:
        findings.fault(path.name, ", ".join(missing), f"column missing; the file holds {', '.join(head) or 'nothing'}")
        return None
    for name in head:
        if name not in required + optional:
            findings.repair(path.name, name or "(column without name)", "unknown column, ignored")
    rows = [(n, {h: c.strip() for h, c in zip(head, line, strict=False)}) for n, line in enumerate(lines[1:], 2)]
    return [(n, row) for n, row in rows if any(row.values())]


def parse_number(text: str, file: str, place: str, findings: Findings) -> float:
    """Return a number; NaN for an empty cell, NaN and a fault for anything else."""
    if not text or text.lower() == "nan":
        return float("nan")
    try:
        return float(text)
    except ValueError:
        findings.fault(file, place, f"is {text!r}, wanted a number", "decimals with a point")
        return float("nan")


def read_weld_events(path: Path, span: tuple[float, float] | None, findings: Findings) -> xr.Dataset | None:
    """Return group ``weld_events``, sorted, within ``span`` (second); None when there is no file or no event in it.

    Notes
    -----
    Unsorted events are sorted, repeated ones and those without time or outside the recording are left out, each recorded.
    When more than half stand outside the recording the file is on another clock: a fault.
    """
    if not path.exists():
        return None
    rows = read_rows(path, ("time_s",), ("amplitude",), findings)
    if rows is None:
        return None
    known = len(findings.faults)
    time = np.array([parse_number(row.get("time_s", ""), FILE, f"time_s, line {n}", findings) for n, row in rows])
    amplitude = np.array([parse_number(row.get("amplitude", ""), FILE, f"amplitude, line {n}", findings) for n, row in rows])
    if len(findings.faults) > known:
        return None
    keep = _inside(time, span, findings)
    if len(findings.faults) > known:
        return None
    if not keep.any():
        findings.repair(FILE, "", "holds no weld event; the detector gives nothing to this run")
        return None
    time, amplitude = _sorted(time[keep], amplitude[keep], findings)
    values = {"time": time} | ({"amplitude": amplitude} if np.isfinite(amplitude).any() else {})
    return build.dataset("weld_events", values)


def _inside(time: np.ndarray, span: tuple[float, float] | None, findings: Findings) -> np.ndarray:
    keep = np.isfinite(time)
    if not keep.all():
        findings.repair(FILE, "time_s", f"empty in {np.count_nonzero(~keep)} rows, left out")
    if span is None:
        return keep
    outside = keep & ((time < span[0]) | (time > span[1]))
    if outside.any():
        rule = f"{np.count_nonzero(outside)} of {time.size} events lie outside the recording"
        rule += f" ({span[0]:.1f} to {span[1]:.1f} s), first {time[outside][0]:.3f} s"
        if np.count_nonzero(outside) > 0.5 * np.count_nonzero(keep):
            findings.fault(FILE, "time_s", rule, "is it of another run, or in another unit?")
        else:
            findings.repair(FILE, "time_s", f"{rule}; left out")
    return keep & ~outside


def _sorted(time: np.ndarray, amplitude: np.ndarray, findings: Findings) -> tuple[np.ndarray, np.ndarray]:
    if (np.diff(time) < 0).any():
        i = int(np.flatnonzero(np.diff(time) < 0)[0])
        findings.repair(FILE, "time_s", f"not in order (first {time[i]:.3f} then {time[i + 1]:.3f} s); sorted")
        order = np.argsort(time, kind="stable")
        time, amplitude = time[order], amplitude[order]
    twice = np.append(False, np.diff(time) <= 0)
    if twice.any():
        findings.repair(
            FILE, "time_s", f"{twice.sum()} events stand there twice, first {time[twice][0]:.3f} s; one of each is kept"
        )
    return time[~twice], amplitude[~twice]
