"""The page in a real browser: no error, no request, linked zoom, peaks, tables, 3-D, keyboard, narrow screens."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from deform.report import write_report
from tests.report.browser import Browser
from tests.report.fabricate import write_folder

BOX = "(e => { const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })"


def _until(browser: Browser, script: str, seconds: float = 90.0) -> bool:
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


def test_the_legend_draws_every_run_as_its_curves_are_drawn(page: Browser) -> None:
    legend = page.run("[...document.querySelectorAll('#epochs path')].map(p => p.getAttribute('stroke-dasharray'))")
    traces = page.run("document.getElementById('strips').data.filter(t => t.mode === 'lines' && t.name).map(t => t.line.dash)")
    assert [dash.replace("none", "solid") for dash in legend] == list(dict.fromkeys(traces))
    assert page.run("new Set(Panels.DASH).size") == 8


def test_a_drag_on_one_panel_zooms_all_panels_to_the_same_chainage(page: Browser) -> None:
    page.run("document.getElementById('strips').scrollIntoView({ behavior: 'instant' })")
    page.wait(0.3)
    x, y, width, height = page.run(f"{BOX}(document.querySelector('#strips .nsewdrag'))")
    page.drag((x + 0.25 * width, y + 0.3 * height), (x + 0.5 * width, y + 0.3 * height))
    assert _until(page, "window.deformView[1] - window.deformView[0] < 1500")
    low, high = page.run("window.deformView")
    assert low == pytest.approx(1000, abs=60)
    assert high == pytest.approx(2000, abs=60)
    lines = "document.getElementById('strips').data.filter(t => t.mode === 'lines')"
    spans = page.run(f"{lines}.map(t => [t.yaxis, Math.min(...t.x), Math.max(...t.x)])")
    assert len({axis for axis, *_ in spans}) == 8
    assert all(start < low + 15 and end > high - 15 and start > low - 15 and end < high + 15 for _, start, end in spans)
    dark = page.run("document.getElementById('map').data[1].x.filter(v => v !== null).length")
    assert 0 < dark < page.run("document.getElementById('map').data[0].x.length") / 2
    shares = []  # the plan follows, on one scale both ways: what the panels show fills it along one of its axes
    for axis in ("x", "y"):
        shown = page.run(f"document.getElementById('map').layout.{axis}axis.range")
        reach = page.run(
            f"(m => [Math.min(...m), Math.max(...m)])(document.getElementById('map').data[1].{axis}.filter(v => v !== null))"
        )
        assert shown[0] <= reach[0] < reach[1] <= shown[1]
        shares.append((reach[1] - reach[0]) / (shown[1] - shown[0]))
    assert max(shares) > 2 / 3


def _trace(key: str, run: str) -> str:
    """Script of the curve of a run in a panel."""
    panel = f"JSON.parse(document.getElementById('data').textContent).panels.findIndex(p => p.key === '{key}')"
    chosen = f"t => t.yaxis === 'y' + (k ? k + 1 : '') && t.name === '{run}'"
    return f"(k => document.getElementById('strips').data.find({chosen}))({panel})"


def test_a_spike_of_one_sample_is_visible_at_full_extent_and_after_zooming(page: Browser) -> None:
    lateral = _trace("displacement_lateral", "demo-2023")
    near = f"(t => Math.max(...t.y.filter((v, i) => Math.abs(t.x[i] - 1234.5) < 0.15)))({lateral})"
    assert page.run(near) == pytest.approx(0.4, abs=0.07)
    page.run("document.querySelector('[data-view=in]').click()")
    assert page.run(near) == pytest.approx(0.4, abs=0.07)


def test_bends_are_cut_off_and_marked_until_the_full_scale_is_asked_for(page: Browser) -> None:
    axis = f"document.getElementById('strips')._fullLayout['yaxis' + {_trace('bending_strain', 'demo-2019')}.yaxis.slice(1)]"
    marks = "document.getElementById('strips').data.filter(t => t.marker && [].concat(t.marker.symbol)[0] === 'triangle-up')"
    biggest = page.run(f"Math.max(...{_trace('bending_strain', 'demo-2019')}.y)")
    assert page.run(f"{axis}.range[1]") < biggest / 3
    told = page.run(f"Math.max(...{marks}.flatMap(t => t.text).filter(Number.isFinite))")
    assert told == pytest.approx(biggest, rel=0.01)  # the mark knows the value
    page.run("document.getElementById('full').click()")
    assert _until(page, f"{axis}.range[1] > {biggest}")
    page.run("document.getElementById('full').click()")


def test_a_run_can_be_hidden_in_all_panels_at_once(page: Browser) -> None:
    button = "[...document.querySelectorAll('#epochs button')].find(b => b.textContent.includes('demo-2021'))"
    shown = "document.getElementById('strips').data.filter(t => t.name === 'demo-2021' && t.visible !== false).length"
    assert page.run(shown) > 3
    page.run(f"{button}.click()")
    assert _until(page, f"{shown} === 0")
    assert page.run(f"{button}.getAttribute('aria-pressed')") == "false"
    page.run(f"{button}.click()")


def test_a_click_on_a_column_head_sorts_the_table_and_a_word_filters_it(page: Browser) -> None:
    rows = "[...document.querySelectorAll('#weld-table tbody tr')]"
    column = f"{rows}.map(r => parseFloat(r.cells[1].textContent.replace(/\u202f/g, '')))"
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
    assert page.errors == []


def test_details_of_a_zone_open_on_demand_and_by_its_address(page: Browser) -> None:
    assert page.run("document.getElementById('more-Z1').hidden")
    page.run("document.querySelector('#zone-Z1 button.open').click()")
    assert _until(page, "document.querySelectorAll('#more-Z1 .detail .trace').length > 7")
    assert page.run("document.querySelector('#zone-Z1 button.open').getAttribute('aria-expanded')") == "true"
    assert "Displacement to the right over 9 sigma" in page.run("document.getElementById('more-Z1').innerText")
    page.run("location.hash = '#zone-Z2'")
    assert _until(page, "!document.getElementById('more-Z2').hidden")
    page.run("location.hash = '#dent-D01'")
    assert _until(page, "document.getElementById('dent-D01').open")
    page.run("location.hash = ''")


def test_a_table_is_filtered_by_the_values_of_a_column(page: Browser) -> None:
    select = "[...document.querySelectorAll('#weld-table select')].find(s => s.getAttribute('aria-label').includes('demo-2021'))"
    page.run(f"(s => {{ s.value = 'missed'; s.dispatchEvent(new Event('change')); }})({select})")
    shown = page.run("[...document.querySelectorAll('#weld-table tbody tr')].map(r => r.textContent)")
    assert shown
    assert all("the detector did not fire" in text for text in shown)


def test_a_row_moves_with_its_details_when_the_zones_are_sorted(page: Browser) -> None:
    place = "[...document.querySelectorAll('#zones th')].find(t => t.textContent.startsWith('place')).querySelector('button')"
    page.run(f"{place}.click()")
    order = page.run("[...document.querySelectorAll('#zones table.items > tbody')].map(b => [b.id, b.querySelector('.more').id])")
    assert order == [["zone-Z2", "more-Z2"], ["zone-Z1", "more-Z1"], ["zone-Z3", "more-Z3"]]


def test_verdict_strip_and_ranked_zones_stand_on_the_first_screen(browser: Browser, surveyed: Path) -> None:
    browser.open(surveyed / "report" / "index.html", 1280, 900)
    assert _until(browser, "window.deformReady > 0")
    low = "(s => Math.round(document.querySelector(s).getBoundingClientRect().bottom))"
    assert browser.run(f"{low}('.lead')") < 250
    assert browser.run(f"{low}('.strip.wide svg')") < 720
    assert browser.run(f"{low}('#zone-Z1 tr.main')") < 900
    assert browser.run("document.querySelectorAll('#zone-Z1 svg.spark circle').length") == 3
    assert browser.run("getComputedStyle(document.querySelector('.strip.narrow')).display") == "none"


def test_print_opens_what_is_closed_and_closes_it_again(page: Browser) -> None:
    closed = page.run("document.querySelectorAll('details:not([open])').length")
    assert closed > 0
    page.run("window.dispatchEvent(new Event('beforeprint'))")
    assert page.run("document.querySelectorAll('details:not([open])').length") == 0
    page.run("window.dispatchEvent(new Event('afterprint'))")
    assert page.run("document.querySelectorAll('details:not([open])').length") == closed


def test_the_section_in_view_is_marked_in_the_navigation(page: Browser) -> None:
    page.run("document.documentElement.style.scrollBehavior = 'auto'; document.getElementById('dents').scrollIntoView()")
    assert _until(page, "document.querySelector('.top nav a[aria-current=true]').hash === '#dents'")
    assert page.run("document.querySelector('.top').getBoundingClientRect().top") == 0  # it stays


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
    assert page.run("document.querySelector('#features').textContent.includes('cold bend <b>8</b> degree')")
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
