"""Output folders and pages that several tests read; a browser where there is one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from deform.report import write_report
from tests.report.browser import Browser, chromium
from tests.report.fabricate import write_folder


@pytest.fixture(scope="session")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An output folder of three epochs over 4 km, with its page; a spike of 0.4 m is planted at 1234.5 m."""
    folder = write_folder(tmp_path_factory.mktemp("surveyed"), spike=0.4, step_m=0.2)
    write_report(folder)
    return folder


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if chromium() is None:
        pytest.skip("no Chromium on this machine: the page is not tested in a real browser")
    with Browser(tmp_path_factory.mktemp("profile")) as running:
        yield running
