"""The page in a real browser: no error, no request, linked zoom, peaks, tables, 3-D, keyboard, narrow screens."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from deform.report import write_report
from tests.report.browser import Browser
from tests.report.fabricate import write_folder

BOX = "(e => { const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })"


def _until(browser: Browser, script: str, seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if browser.run(script):
            return True
        browser.wait(0.2)
    return False


@pytest.fixture
def page(browser: Browser, surveyed: Path) -> Browser:
    browser.open(surveyed / "report" / "index.html")
    assert _until(browser, "window.deformReady > 0")
    return browser


def test_the_page_opens_from_a_file_without_errors_or_requests(page: Browser) -> None:
    page.wait(0.5)
    assert page.errors == []
    assert page.requests == []


def test_a_drag_on_one_panel_zooms_all_panels_to_the_same_chainage(page: Browser) -> None:
    page.run("document.getElementById('strips').scrollIntoView()")
    page.wait(0.3)
    x, y, width, height = page.run(f"{BOX}(document.querySelector('#strips .nsewdrag'))")
    page.drag((x + 0.25 * width, y + 0.3 * height), (x + 0.5 * width, y + 0.3 * height))
    assert _until(page, "window.deformView[1] - window.deformView[0] < 1500")
    low, high = page.run("window.deformView")
    assert low == pytest.approx(1000, abs=60)
    assert high == pytest.approx(2000, abs=60)
    spans = page.run(
        "document.getElementById('strips').data.slice(0, -3).map(t => [t.yaxis, Math.min(...t.x), Math.max(...t.x)])"
    )
    assert len({axis for axis, *_ in spans}) >= 7
    assert all(start < low + 15 and end > high - 15 and start > low - 15 and end < high + 15 for _, start, end in spans)
    dark = page.run("document.getElementById('map').data[1].x.filter(v => v !== null).length")
    assert 0 < dark < page.run("document.getElementById('map').data[0].x.length") / 2


def test_a_spike_of_one_sample_is_visible_at_full_extent_and_after_zooming(page: Browser) -> None:
    lateral = "document.getElementById('strips').data.filter(t => t.yaxis === 'y5' && t.name === 'demo-2023')[0]"
    near = f"(t => Math.max(...t.y.filter((v, i) => Math.abs(t.x[i] - 1234.5) < 0.15)))({lateral})"
    assert page.run(near) == pytest.approx(0.4, abs=0.07)
    page.run("document.querySelector('[data-view=in]').click()")
    assert page.run(near) == pytest.approx(0.4, abs=0.07)


def test_a_click_on_a_column_head_sorts_the_table_and_a_word_filters_it(page: Browser) -> None:
    column = "[...document.querySelectorAll('#weld-table tbody tr')].map(r => parseFloat(r.cells[1].textContent))"
    button = "document.querySelectorAll('#weld-table th button')[1].click()"
    page.run(button)
    assert page.run(column) == sorted(page.run(column))
    page.run(button)
    falling = page.run(column)
    assert falling == sorted(falling, reverse=True)
    assert falling[0] > 3900
    page.run("(f => { f.value = 'removed'; f.dispatchEvent(new Event('input')); })(document.querySelector('#weld-table input'))")
    shown = page.run("[...document.querySelectorAll('#weld-table tbody tr')].map(r => r.textContent)")
    assert shown
    assert all("removed" in text for text in shown)


def test_the_dent_view_draws_and_the_zone_detail_opens(page: Browser) -> None:
    page.run("document.querySelector('button.three').click()")
    assert _until(page, "document.querySelector('.surface canvas') !== null")
    page.run("document.querySelector('#zone-details details').open = true")
    assert _until(page, "document.querySelectorAll('#zone-details .detail .trace').length > 7")
    assert page.errors == []


def test_keys_move_and_zoom_the_panels(page: Browser) -> None:
    page.run("document.getElementById('strips').focus()")
    page.key("+")
    assert _until(page, "window.deformView[1] - window.deformView[0] < 2100")
    before = page.run("window.deformView[0]")
    page.key("ArrowRight")
    assert _until(page, f"window.deformView[0] > {before} + 100")
    page.key("Home")
    assert _until(page, "window.deformView[1] - window.deformView[0] > 3900")


def test_a_page_in_the_dark_is_printed_in_the_light(page: Browser) -> None:
    page.run("document.documentElement.dataset.theme !== 'dark' && document.getElementById('theme').click()")
    page.run("window.dispatchEvent(new Event('beforeprint'))")
    assert page.run("document.documentElement.dataset.theme") == "light"
    page.run("window.dispatchEvent(new Event('afterprint'))")
    assert page.run("document.documentElement.dataset.theme") == "dark"
    page.run("document.getElementById('theme').click()")


def test_labels_with_html_are_shown_as_they_are(page: Browser) -> None:
    assert page.run("document.querySelector('#zones').textContent.includes('<script>alert(1)</script>')")
    assert page.run("document.querySelector('#quality').textContent.includes('V01 <b>&')")


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("dark", [False, True])
def test_nothing_runs_over_the_edge_of_the_window(browser: Browser, surveyed: Path, width: int, dark: bool) -> None:
    browser.open(surveyed / "report" / "index.html", width, 844, dark)
    assert _until(browser, "window.deformReady > 0")
    assert browser.run("document.documentElement.scrollWidth") <= width
    wide = "[...document.querySelectorAll('main > section > *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1)"
    assert browser.run(f"{wide}.length") == 0
    assert browser.run("document.documentElement.dataset.theme") == ("dark" if dark else "light")
    assert browser.errors == []


@pytest.mark.parametrize(
    "what",
    [
        {"zones": False, "dents": False},
        {"runs": ("łódź-2020",), "line": "Łódź <b>Süd</b> & Co"},
        {"caliper": False},
        {"listing": True},
    ],
    ids=["nothing found", "one run with letters of any script", "no caliper", "listings"],
)
def test_poorer_folders_make_a_page_without_errors(browser: Browser, tmp_path: Path, what: dict) -> None:
    write_folder(tmp_path, length_m=400.0, step_m=0.5, **what)
    browser.open(write_report(tmp_path)["html"])
    assert _until(browser, "window.deformReady > 0")
    assert browser.errors == []
    assert "undefined" not in browser.run("document.body.innerText")
