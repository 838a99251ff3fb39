"""Fixtures of all tests: where the shared data are, when they are there."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


def _folder(*parts: str) -> Path:
    path = SHARED.joinpath(*parts)
    if not path.is_dir():
        pytest.skip(f"no {'/'.join(parts) or 'shared'} beside the checkout: the shared data are not here")
    return path


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of what the work rests on, beside the checkout."""
    return _folder()


@pytest.fixture(scope="session")
def demo() -> Path:
    """Three simulated raw runs with truth."""
    return _folder("data", "demo")


@pytest.fixture(scope="session")
def real() -> Path:
    """Real recorded data."""
    return _folder("data", "real")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long groups first, so that with two workers none of them is left for the end."""
    long = ("tests/test_wheel.py", "tests/test_survey.py")
    items.sort(key=lambda item: next((i for i, name in enumerate(long) if item.nodeid.startswith(name)), len(long)))
