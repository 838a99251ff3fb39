"""Compiled kernels are dropped when anything they were compiled from has changed, and only then."""

from __future__ import annotations

import pytest

from deform.kernel_cache import drop_outdated

SOURCES = {
    "nav/_kernels_state.py": "WIDTH = 3\n",
    "nav/_kernels.py": "from numba import njit\nfrom deform.nav._kernels_state import WIDTH\n",
    "nav/_kernels_filter.py": "from numba import njit\nfrom deform.nav import (\n    _kernels as moves,\n)\n",
    "nav/_kernels_long.py": "from numba import njit\nfrom deform.nav._kernels_filter import (\n    forward,\n    backward,\n)\n",
    "geometry/_kernels_earth.py": "from numba import njit\n",
    "nav/filter.py": "from deform.nav import _kernels_filter\n",
}


@pytest.fixture
def package(tmp_path):
    """A package whose kernels are compiled, looked at once."""
    for name, text in SOURCES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    drop_outdated(tmp_path)
    for name, text in SOURCES.items():
        if "njit" in text:
            path = tmp_path / name
            cache = path.parent / "__pycache__"
            cache.mkdir(exist_ok=True)
            for end in ("nbi", "1.nbc"):
                (cache / f"{path.stem}.forward-12.py311.{end}").write_bytes(b"compiled")
    return tmp_path


def compiled(package):
    return {path.name.split(".")[0] for path in package.rglob("*.nb[ic]")}


EVERYTHING = {"_kernels", "_kernels_filter", "_kernels_long", "_kernels_earth"}


def test_nothing_changed_keeps_everything(package):
    assert drop_outdated(package) == []
    assert compiled(package) == EVERYTHING


def test_a_constant_that_is_imported_through_two_files_takes_all_that_hold_it_along(package):
    (package / "nav/_kernels_state.py").write_text("WIDTH = 4\n")
    assert set(drop_outdated(package)) == {"nav/_kernels.py", "nav/_kernels_filter.py", "nav/_kernels_long.py"}
    assert compiled(package) == {"_kernels_earth"}
    assert drop_outdated(package) == []


def test_a_file_that_no_kernel_imports_drops_nothing(package):
    (package / "nav/filter.py").write_text("from deform.nav import _kernels_filter as kernels\n")
    assert drop_outdated(package) == []
    assert compiled(package) == EVERYTHING


def test_another_time_with_the_same_text_drops_nothing(package):
    path = package / "nav/_kernels_state.py"
    path.write_text(path.read_text())
    assert drop_outdated(package) == []
    assert compiled(package) == EVERYTHING


def test_kernels_of_unknown_sources_are_dropped(package):
    (package / "__pycache__" / "kernels.json").unlink()
    drop_outdated(package)
    assert compiled(package) == set()


def test_a_stamp_that_was_cut_off_counts_as_none(package):
    (package / "__pycache__" / "kernels.json").write_text('{"seen": {"nav')
    drop_outdated(package)
    assert compiled(package) == set()
    assert drop_outdated(package) == []
