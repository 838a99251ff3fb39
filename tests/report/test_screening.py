"""The screening page: many lines ranked in one list, and what could not be judged said for each."""

from __future__ import annotations

from pathlib import Path

from deform.options import ReportOptions
from deform.report import write_report, write_screening
from tests.report.browser import Browser
from tests.report.fabricate import write_folder


def _lines(folder: Path) -> list[Path]:
    moving = write_folder(folder / "moving", line="moving", length_m=4000.0, step_m=1.0, caliper=False)
    quiet = write_folder(folder / "quiet", line="quiet & <still>", length_m=500.0, step_m=1.0, zones=False, dents=False)
    listing = write_folder(folder / "listing", line="listing", length_m=500.0, listing=True, zones=False)
    write_report(moving, options=ReportOptions(most_dent_cards=0))
    return [quiet, listing, moving, folder / "nowhere"]


def test_the_gravest_place_of_all_lines_stands_first_and_faults_are_named(tmp_path: Path, browser: Browser) -> None:
    page = write_screening(_lines(tmp_path), tmp_path / "screening.html")
    browser.open(page)
    first = browser.run("document.querySelector('#list tbody tr').textContent")
    assert "moving" in first
    assert "Z1, movement" in first
    assert browser.run("document.querySelectorAll('#list tbody svg').length") >= 2
    said = browser.run("document.querySelector('#lines').textContent")
    assert "quiet & <still>: 0 zones" in said
    assert "made of a vendor listing" in said
    assert "nowhere" in said
    assert browser.errors == []
    assert browser.requests == []


def test_links_lead_to_the_reports_that_exist(tmp_path: Path) -> None:
    text = write_screening(_lines(tmp_path), tmp_path / "screening.html").read_text(encoding="utf-8")
    assert 'href="moving/report/index.html"' in text
    assert "quiet/report" not in text


def test_no_line_at_all_still_gives_a_page(tmp_path: Path) -> None:
    assert "0 places" in write_screening([], tmp_path / "screening.html").read_text(encoding="utf-8")
