"""Surveys of simulated lines, unlike the demonstration, against their truth: ``python -m benchmarks.surveys [LINE ...]``."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from deform.survey import run_survey, write_demo

HERE = Path(__file__).resolve().parent
LINES = HERE / "lines"
CHECKS = HERE.parents[1] / "shared" / "checks"
OVALITY_RMS = 1e-3  # of the outside diameter
FORMATS = '\nformats = ["html"]\n'


def judged(name: str, folder: Path) -> list[dict]:
    """Simulate a line into a folder, run its survey, return the judge's findings that have a bar or are short."""
    survey = write_demo(folder, options_file=LINES / f"{name}.toml")
    survey.write_text(survey.read_text(encoding="utf-8").rstrip() + FORMATS, encoding="utf-8")
    out = run_survey(survey)
    command = [sys.executable, "judge.py", str(out), str(folder / "truth"), "--raw", str(folder), "--bars", "bars_demo.toml"]
    result = subprocess.run([*command, "--json", str(folder / "judged.json")], cwd=CHECKS, capture_output=True, text=True)
    if result.returncode not in (0, 1):
        raise RuntimeError(result.stderr)
    findings = json.loads((folder / "judged.json").read_text(encoding="utf-8"))["findings"]
    return findings + [f for file in sorted((out / "runs").glob("*.nc")) for f in ovality(file, folder / "truth" / file.stem)]


def ovality(file: Path, truth: Path) -> list[dict]:
    """Errors of the ovality along a run, which the judge does not look at; none for a run without a caliper."""
    with xr.open_dataset(file, group="centreline", decode_times=False) as ds:
        if "ovality" not in ds:
            return []
        time, value, sigma = (ds[n].values for n in ("time", "ovality", "ovality_sigma"))
    with xr.open_dataset(truth / "truth.nc", decode_times=False) as t:
        place = np.interp(time, t["time"].values, t["chainage"].values)
        error = value - np.interp(place, t["grid_chainage"].values, t["ovality"].values)
    known = np.isfinite(error)
    rms, held = float(np.sqrt(np.mean(error[known] ** 2))), float(np.mean(np.abs(error[known]) < 1.96 * sigma[known]))
    common = {"section": "ovality", "scope": file.stem, "note": f"{held:.1%} within 1.96 sigma"}
    return [common | {"metric": "rms", "value": rms, "bar": OVALITY_RMS, "result": "ok" if rms <= OVALITY_RMS else "SHORT"}]


def main() -> None:
    if not CHECKS.is_dir():
        raise ImportError(f"{CHECKS.name} with judge.py beside the checkout is absent")
    names = sys.argv[1:] or sorted(p.stem for p in LINES.glob("*.toml"))
    for name in names:
        with tempfile.TemporaryDirectory() as place:
            start = time.process_time()
            findings = judged(name, Path(place))
        barred = [f for f in findings if f["result"] in ("ok", "SHORT")]
        short = [f for f in barred if f["result"] == "SHORT" and f["section"] != "reports"]
        took = time.process_time() - start
        print(f"{name}: {len(barred) - len(short)} of {len(barred)} bars of the demonstration met, {took:.0f} s")
        for f in [*short, *(f for f in barred if f["section"] == "ovality" and f not in short)]:
            print(f"  {f['section']:11s} {f['scope']:18s} {f['metric']:40s} {f['value']!s:22.22s} bar {f['bar']} {f['note']}")


if __name__ == "__main__":
    main()
