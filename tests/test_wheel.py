"""What a user installs: the wheel holds the templates and the data files, and the demo runs from it."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def test_wheel_holds_templates_vocabulary_and_column_maps_and_no_tests(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for template in (ROOT / "reports" / "templates").rglob("*"):
        if template.is_file():
            assert f"deform/report/templates/{template.relative_to(ROOT / 'reports' / 'templates').as_posix()}" in names
    assert "deform/vocabulary.toml" in names
    assert "deform/readers/maps/rosen.toml" in names
    assert not [n for n in names if n.startswith(("tests/", "benchmarks/"))]


def test_demo_runs_from_the_installed_wheel(wheel, tmp_path):
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(site), str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    environment = {**os.environ, "PYTHONPATH": str(site)}
    where = "import deform, pathlib; print(pathlib.Path(deform.__file__).parent)"
    place = subprocess.run(
        [sys.executable, "-c", where], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert Path(place.stdout.strip()) == site / "deform"
    command = [sys.executable, "-m", "deform.cli", "demo", "here", "--json", "--workers", "1"]
    result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-2000:]
    page = tmp_path / "here" / "out" / "report" / "index.html"
    assert page.stat().st_size > 5000
    assert str(page.relative_to(tmp_path)) in result.stdout
