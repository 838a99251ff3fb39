"""The house holds: layers, cheap imports, no way back through the package root."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("matplotlib", "plotly", "open3d", "dask", "geopandas", "pyogrio", "weasyprint", "statsmodels", "trimesh")


def _lint_imports(folder: Path) -> subprocess.CompletedProcess:
    program = Path(sys.executable).with_name("lint-imports")
    command = [str(program), "--no-cache", "--config", "pyproject.toml"]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, env={"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"}
    )


def _copy(to: Path) -> Path:
    shutil.copytree(ROOT / "deform", to / "deform", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", to)
    return to


def test_rooms_call_downwards_only():
    result = _lint_imports(ROOT)
    assert result.returncode == 0, result.stdout


def test_layer_guard_bites_when_a_room_calls_up_or_sideways(tmp_path):
    folder = _copy(tmp_path)
    astray = {
        "geometry": "import deform.run.raw",
        "nav": "import deform.caliper.measure",
        "run": "import deform.nav.navigate",
        "correlate": "import deform.change.compare",
    }
    for room, line in astray.items():
        (folder / "deform" / room / "astray.py").write_text(f'"""Astray."""\n{line}\n')
    result = _lint_imports(folder)
    assert result.returncode != 0
    for room in astray:
        assert f"deform.{room}.astray" in result.stdout


def test_every_room_stands_in_the_layers():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
    named = {name.strip().split(".")[1] for layer in layers for name in layer.split("|")}
    there = {p.stem for p in (ROOT / "deform").iterdir() if (p / "__init__.py").exists() or p.suffix == ".py"}
    assert there - {"__init__"} == named


def test_package_root_is_not_imported_inside_the_package():
    back = re.compile(r"^\s*(import deform\s*$|from deform import )", re.M)
    found = [str(p.relative_to(ROOT)) for p in (ROOT / "deform").rglob("*.py") if back.search(p.read_text())]
    assert found == []


def _imported(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in result.stdout.split()}


def test_import_of_the_package_loads_no_heavy_library():
    assert _imported("import deform").isdisjoint({*HEAVY, "numpy", "xarray", "pandas", "numba"})


def test_import_of_a_room_loads_no_drawing_or_surface_library():
    rooms = (
        "nav.navigate",
        "caliper.measure",
        "correlate.weld_matching",
        "change.compare",
        "readers.reader",
        "survey",
        "report",
        "mesh",
    )
    heavy = f"loaded = set({HEAVY!r}) & {{name.split('.')[0] for name in sys.modules}}"
    code = "".join(f"import deform.{room}\n{heavy}\nassert not loaded, ({room!r}, loaded)\n" for room in rooms)
    result = subprocess.run([sys.executable, "-c", f"import sys\n{code}"], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_help_of_the_command_line_loads_no_science():
    code = "import sys; sys.argv=['deform','--help']\nfrom deform.cli import app\ntry: app()\nexcept SystemExit: pass\n"
    code += "print('MODULES', ' '.join(sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in result.stdout.split("MODULES")[1].split()}
    assert loaded.isdisjoint({*HEAVY, "numpy", "xarray", "pandas", "numba", "scipy"})


def test_public_names_can_be_loaded():
    import deform

    for name in deform.__all__:
        assert getattr(deform, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = deform.nothing
