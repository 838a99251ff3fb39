"""The independent judge of `../shared/checks`, called as a user would: an output folder in, its findings out."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path


def judge(shared: Path, out: Path, *, truth: Path | None = None, raw: Path | None = None, bars: bool = True) -> list[dict]:
    """Findings of every section for an output folder; truth defaults to the demonstration data."""
    truth = truth or shared / "data" / "demo" / "truth"
    raw = raw or shared / "data" / "demo"
    command = ["judge.py", str(out), str(truth), "--raw", str(raw)]
    return _run(shared, out, command + (["--bars", "bars_demo.toml"] if bars else []))


def judge_tally(shared: Path, out: Path) -> list[dict]:
    """Findings for the two vendor listings."""
    return _run(shared, out, ["judge_tally.py", str(out), "key_ili_two_runs.toml"])


def short(findings: list[dict], section: str) -> list[str]:
    """The bars of a section that are missed, as sentences."""
    return [
        f"{f['scope']} {f['metric']} = {f['value']}, bar {f['bar']} {f['note']}"
        for f in findings
        if f["section"] == section and f["result"] == "SHORT"
    ]


def values(findings: list[dict], section: str, metric: str) -> dict[str, float]:
    """One metric by scope."""
    return {f["scope"]: f["value"] for f in findings if f["section"] == section and f["metric"] == metric}


def _run(shared: Path, out: Path, command: list[str]) -> list[dict]:
    found = out / "judged.json"
    checks = shared / "checks"
    result = subprocess.run([sys.executable, *command, "--json", str(found)], cwd=checks, capture_output=True, text=True)
    assert result.returncode in (0, 1), result.stderr
    return json.loads(found.read_text())["findings"]
