"""The file ``run.toml`` of a raw run in, its validated header out."""

from __future__ import annotations

import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from deform.readers.findings import Findings
from deform.run.raw import RunHeader

FILE = "run.toml"
_EXACT, _REPAIRABLE = 1e-6, 0.02
_MOST_WALL = 0.2  # of the outside diameter; 2-inch schedule 160 has 0.145
_LONGEST_LEVER_M = 30.0

_ADVICE = {
    "outside_diameter_m": "is it in millimetre or inch?",
    "nominal_wall_m": "is it in millimetre or inch?",
    "nominal_joint_m": "is it in feet?",
    "latitude_deg": "degree, north positive",
    "longitude_deg": "degree, east positive",
    "direction": "downstream, or upstream when the tool ran against the chainage of the line",
}


def read_header(path: Path, findings: Findings) -> RunHeader | None:
    """Return the header; None, and every fault noted, when it cannot be used."""
    content = _content(path, findings)
    if content is None:
        return None
    for key in _unknown(content, RunHeader):
        findings.repair(FILE, key, "unknown key, ignored")
    try:
        header = TypeAdapter(RunHeader).validate_python(content)
    except ValidationError as errors:
        for error in errors.errors():
            _note(error, findings)
        return None
    known = len(findings.faults)
    header = _mounted(header, findings)
    _check_pipe(header, findings)
    _check_levers(header, findings)
    return header if len(findings.faults) == known else None


def _content(path: Path, findings: Findings) -> dict[str, Any] | None:
    if not path.is_file():
        findings.fault(FILE, "", "no such file", "a raw run needs it")
        return None
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        findings.fault(FILE, "", f"is no TOML ({fault})")
        return None


def _note(error: Any, findings: Findings) -> None:
    path = [str(p) for p in error["loc"]]
    place = f"[{path[0]}] {'.'.join(path[1:])}".strip()
    if error["type"] == "missing":
        findings.fault(FILE, place, "is missing")
    else:
        findings.fault(FILE, place, f"is {error['input']!r}: {error['msg'].lower()}", _ADVICE.get(path[-1], ""))


def _unknown(content: dict[str, Any], kind: Any, prefix: str = "") -> list[str]:
    known = {f.name for f in fields(kind)}
    hints = get_type_hints(kind)
    found = []
    for key, value in content.items():
        if key not in known:
            found.append(f"{prefix}{key}")
        elif isinstance(value, dict):
            inner = next((t for t in (hints[key], *get_args(hints[key])) if is_dataclass(t)), None)
            found += _unknown(value, inner, f"[{key}] ") if inner else []
    return found


def _mounted(header: RunHeader, findings: Findings) -> RunHeader:
    """Hold sensor_to_body against a rotation; small departures (printed digits) are taken out."""
    matrix = header.imu.mounting
    place = "[imu] sensor_to_body"
    departure = float(np.abs(matrix @ matrix.T - np.eye(3)).max()) if np.isfinite(matrix).all() else np.inf
    if departure > _REPAIRABLE:
        findings.fault(
            FILE,
            place,
            f"is no rotation: M M' differs from 1 by {departure:.3g}",
            "rows are body x (right), y (forward), z (up) in sensor axes",
        )
    elif np.linalg.det(matrix) < 0:
        findings.fault(FILE, place, f"is left-handed (determinant {np.linalg.det(matrix):.3f})", "one axis has the wrong sign")
    elif departure > _EXACT:
        u, _, v = np.linalg.svd(matrix)
        turned = tuple(tuple(float(x) for x in row) for row in u @ v)
        findings.repair(FILE, place, f"differs from a rotation by {departure:.2g}; the nearest rotation is used")
        return replace(header, imu=replace(header.imu, sensor_to_body=turned))  # type: ignore[arg-type]  # 3 x 3 by construction
    return header


def _check_pipe(header: RunHeader, findings: Findings) -> None:
    wall, diameter = header.pipe.nominal_wall_m, header.pipe.outside_diameter_m
    if wall > _MOST_WALL * diameter:
        findings.fault(
            FILE,
            "[pipe] nominal_wall_m",
            f"is {wall:g} m in a pipe of {diameter:g} m outside diameter; that cannot be",
            "is it in inch?",
        )


def _check_levers(header: RunHeader, findings: Findings) -> None:
    lever = header.odometer.lever_arm_m
    if not np.isfinite(lever).all() or np.abs(lever).max() > _LONGEST_LEVER_M:
        findings.fault(FILE, "[odometer] lever_arm_m", f"is {list(lever)}; no tool is that long", "is it in millimetre?")
    if header.caliper is not None:
        rings = header.caliper.ring_offset_m
        if not rings or not np.isfinite(rings).all() or np.abs(rings).max() > _LONGEST_LEVER_M:
            findings.fault(FILE, "[caliper] ring_offset_m", f"is {list(rings)}; no tool is that long", "is it in millimetre?")
