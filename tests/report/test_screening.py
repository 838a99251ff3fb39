"""The screening page: many lines ranked in one list, and what could not be judged said for each."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from deform.change.screen import screen
from deform.options import ReportOptions
from deform.report import write_report, write_screening
from deform.run import store
from tests.report.browser import Browser
from tests.report.fabricate import write_folder


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Output folders of a line that moves, one that rests, one of listings, and one that is not there."""
    folder = tmp_path_factory.mktemp("lines")
    moving = write_folder(folder / "moving", line="moving", length_m=4000.0, step_m=1.0, caliper=False)
    quiet = write_folder(folder / "quiet", line="quiet & <still>", length_m=500.0, step_m=1.0, zones=False, dents=False)
    listing = write_folder(folder / "listing", line="listing", length_m=500.0, listing=True, zones=False)
    write_report(moving, options=ReportOptions(most_dent_cards=0))
    return [quiet, listing, moving, folder / "nowhere"]


def test_the_gravest_place_of_all_lines_stands_first_and_faults_are_named(lines: list[Path], browser: Browser) -> None:
    browser.open(write_screening(lines, lines[0].parent / "screening.html"))
    assert browser.run("document.querySelector('.lead').textContent") == "6 places changed on 2 lines of 3."
    rows = browser.run("[...document.querySelectorAll('#list tbody tr')].map(r => r.textContent)")
    assert "moving" in rows[0]
    assert "Z1, movement" in rows[0]
    assert browser.run("document.querySelectorAll('#list tbody svg.spark').length") >= 2
    said = browser.run("[...document.querySelectorAll('#lines tbody tr')].map(r => r.innerText).join('\\n')")
    assert "quiet & <still>" in said
    assert "movement: the runs hold no positions and no curvature" in said
    assert "made of a vendor listing" in said
    assert "1 without a judgement of movement" in browser.run("document.querySelector('.facts').textContent")
    assert "nowhere" in browser.run("document.querySelector('#lines').textContent")
    assert browser.errors == []
    assert browser.requests == []


def test_lines_are_counted_by_what_was_judged_and_not_by_words_in_their_sentences(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "line", line="line", length_m=500.0, step_m=1.0, zones=False, dents=False)
    survey = json.loads((folder / "survey.json").read_text())
    survey["missing"] = [{"output": "gis", "reason": "movement of the file system"}]
    (folder / "survey.json").write_text(json.dumps(survey))
    text = write_screening([folder], tmp_path / "screening.html").read_text(encoding="utf-8")
    assert "movement of the file system" in text
    assert "0 without a judgement of movement" in text


def test_the_page_keeps_the_order_of_the_screening_table(tmp_path: Path) -> None:
    folders = []
    for name, used in (("near", 0.9), ("far", 0.2)):
        folder = write_folder(tmp_path / name, line=name, length_m=4000.0, step_m=1.0, caliper=False)
        comparison = store.read_dataset(folder / "comparison.nc").assign_attrs(line=name)
        store.write_dataset(comparison, folder / "comparison.nc", "comparison")
        trends = pd.read_csv(folder / "tables" / "trends.csv").assign(limit_used=used, forecast_probability=used)
        trends.to_csv(folder / "tables" / "trends.csv", index=False)
        folders.append(folder)
    text = write_screening(folders[::-1], tmp_path / "screening.html").read_text(encoding="utf-8")
    table = screen(folders[::-1]).table
    order = [text.index(f">{row.line}</th><td>{row.subject},") for row in table.drop_duplicates(["line", "subject"]).itertuples()]
    assert order == sorted(order)
    assert list(table.line[:2]) == ["near", "near"]


def test_links_lead_to_the_reports_that_exist(lines: list[Path]) -> None:
    text = write_screening(lines, lines[0].parent / "screening.html").read_text(encoding="utf-8")
    assert 'href="moving/report/index.html"' in text
    assert "quiet/report" not in text


def test_no_line_at_all_still_gives_a_page(tmp_path: Path) -> None:
    assert "0 places" in write_screening([], tmp_path / "screening.html").read_text(encoding="utf-8")
