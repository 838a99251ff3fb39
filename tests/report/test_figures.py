"""Figures: each from one dataset, with units and signs on the axes and styles that survive greyscale."""

from __future__ import annotations

import colorsys
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from deform.options import ReportOptions
from deform.palette import CHANGE, DEPTH, paint
from deform.report import figures, gallery, line_figures, trend_figures
from deform.report.content import Content, read_content
from deform.report.dent_views import dent_dataset
from deform.report.dents import dent_rows
from deform.report.line_view import line_dataset, run_dataset
from deform.report.style import DASHES, EPOCHS, SEVERITY, epoch_style
from deform.report.svg import literal, png, themed_svg
from deform.report.trend_view import limit_dataset, trend_dataset
from deform.report.zones import zone_rows
from tests.report.fabricate import write_folder


@pytest.fixture(scope="module")
def content(surveyed: Path) -> Content:
    return read_content(surveyed)


@pytest.fixture(scope="module")
def line(content: Content) -> xr.Dataset:
    return line_dataset(content)


def _texts(figure: Figure) -> list[str]:
    return [
        text
        for ax in figure.axes
        for text in (ax.get_xlabel(), ax.get_ylabel(), *(ax.get_title(loc=w) for w in ("left", "center")))
    ]


def test_every_plate_draws_from_its_datasets_alone_with_units_on_its_axes(content: Content) -> None:
    given = gallery.Given(content, zone_rows(content, ReportOptions()), dent_rows(content))
    seen = set()
    for plate in gallery.PLATES:
        for name, ds in list(plate.datasets(given))[:1]:
            assert isinstance(ds, xr.Dataset)
            figure = plate.figure(ds)
            assert len(png(figure, 50)) > 1500
            for ax in figure.axes:
                assert not ax.get_ylabel() or "(" in ax.get_ylabel(), (plate.caption, ax.get_ylabel())
            seen.add(plate.section)
            assert "{" not in plate.caption.format(name)
    assert seen == {"line", "zone", "trend", "welds", "run", "quality"}


def test_signs_stand_on_the_axes_that_have_one(line: xr.Dataset, content: Content) -> None:
    part = line_dataset(content, window=(2655.0, 2785.0), margin=60.0)
    said = " ".join(_texts(line_figures.changes(line)) + _texts(line_figures.curvature_comparison(part)))
    for sign in ("+ = right", "+ = up", "+ = bend to right", "+ = sag", "+ = to the right"):
        assert sign in said
    assert "+ = longer" in " ".join(_texts(line_figures.joint_changes(line)))
    assert "+ = inward" in " ".join(_texts(figures.dent_card(_window(content, "D02"))))


def test_thinning_keeps_the_spike_of_one_sample_and_the_length_of_the_line(line: xr.Dataset) -> None:
    lateral = line["displacement_lateral"].sel(run="demo-2023")
    near = lateral.sel(chainage=slice(1230, 1239))
    assert line.sizes["chainage"] == 2400
    assert float(near.max()) == pytest.approx(0.4, abs=0.07)
    assert np.ptp(line["chainage"].values) == pytest.approx(4000, abs=0.2)


def test_a_stretch_of_the_line_comes_at_full_rate(content: Content) -> None:
    part = line_dataset(content, window=(2655.0, 2785.0), margin=60.0)
    assert float(part["chainage"].diff("chainage").max()) == pytest.approx(0.2)
    assert (part.attrs["start_m"], part.attrs["end_m"]) == (2655.0, 2785.0)
    assert float(part["chainage"][0]) == pytest.approx(2595.0, abs=0.21)


def test_the_plan_keeps_lengths_and_turns_the_line_to_the_right(line: xr.Dataset) -> None:
    along, across = line["along"].values, line["across"].values
    assert np.hypot(np.diff(along), np.diff(across)).sum() == pytest.approx(4000, rel=0.02)
    assert along[-1] > along[0]
    assert abs(across[-1] - across[0]) < 1.0


def test_the_difference_panel_shows_the_planted_change_of_curvature(content: Content) -> None:
    figure = line_figures.curvature_comparison(line_dataset(content, window=(857.0, 903.0), margin=30.0))
    last = figure.axes[1].lines[-1]  # per kilometre
    assert np.nanmax(last.get_ydata()) == pytest.approx(1000 * 0.25 * 0.5 * (2 * np.pi / 46) ** 2, rel=0.15)


@pytest.mark.parametrize("medium", ["wide", "narrow", "print"])
def test_the_strip_names_every_zone_and_shows_the_size_of_the_changes(line: xr.Dataset, medium: str) -> None:
    figure = line_figures.line_strip(line, medium)
    assert {"Z1", "Z2", "Z3"} <= {text.get_text() for text in figure.axes[0].texts}
    top = max(np.nanmax(curve.get_ydata()) for curve in figure.axes[1].lines)
    assert top == pytest.approx(0.8, abs=0.1)


def test_the_strip_of_one_run_shows_its_profile_and_that_of_listings_their_joints(tmp_path: Path) -> None:
    one = line_dataset(read_content(write_folder(tmp_path / "one", runs=("only",), length_m=400.0, step_m=0.5)))
    assert any("height" in text for text in _texts(line_figures.line_strip(one)))
    listed = line_dataset(read_content(write_folder(tmp_path / "listed", length_m=400.0, listing=True)))
    assert any("joint length" in text for text in _texts(line_figures.line_strip(listed)))


def test_bends_do_not_flatten_the_strain_and_what_is_cut_off_is_said(line: xr.Dataset) -> None:
    figure = line_figures.profile_and_strain(line)
    strain = next(ax for ax in figure.axes if "bending strain" in ax.get_ylabel())
    biggest = 1e6 * float(line["bending_strain"].max())
    assert strain.get_ylim()[1] < biggest / 4
    assert any("off the scale" in text.get_text() and f"{biggest:,.0f}" in text.get_text() for text in strain.texts)


def test_the_navigation_of_a_run_stands_on_its_own_chainage(content: Content) -> None:
    ds = run_dataset(content, "demo-2021")
    assert ds is not None
    figure = line_figures.navigation_panel(ds)
    assert "chainage of demo-2021" in " ".join(_texts(figure))
    assert {"height (m)", "azimuth (°)", "speed (m/s)"} <= {ax.get_ylabel() for ax in figure.axes}


def test_the_trend_of_a_dent_has_its_values_and_the_limit_is_drawn(content: Content) -> None:
    ds = trend_dataset(content, "D02")
    assert ds is not None
    np.testing.assert_allclose(ds["value"].values, [7.8, 11.0, 14.6])
    assert ds["year"].values[0] == pytest.approx(2019.5, abs=0.01)
    figure = trend_figures.trend(ds)
    assert any("limit 19.4 mm" in text.get_text() for text in figure.axes[0].texts)
    assert not any(curve.get_linestyle() == "--" for curve in figure.axes[0].lines)  # a remark forbids to draw the rate ahead
    steady = trend_figures.trend(ds.assign_attrs(remark=""))
    assert any(curve.get_linestyle() == "--" for curve in steady.axes[0].lines)


def test_detection_limits_are_drawn_from_the_table_or_not_at_all(content: Content) -> None:
    ds = limit_dataset(content)
    assert ds is not None
    assert ds.sizes["row"] == 6
    figure = trend_figures.detection_limits(ds)
    assert "(m)" in figure.axes[0].get_xlabel()
    assert len(figure.axes[0].lines) == 4  # two components, each at one half and at nine tenths
    bare = Content(content.folder, "", {}, content.runs, None, {"limits": content.tables["limits"].drop(columns="wavelength_m")})
    assert limit_dataset(bare) is None


def _window(content: Content, name: str) -> xr.Dataset:
    window = dent_dataset(content, next(d for d in dent_rows(content) if d["id"] == name))
    assert window is not None
    return window


def test_the_dent_card_shows_the_same_clock_and_depth_as_the_table(content: Content) -> None:
    window = _window(content, "D02")
    assert list(window["run"].values) == ["demo-2019", "demo-2021", "demo-2023"]
    deepest = window["depth"].max(("distance", "clock")).values * 1000
    np.testing.assert_allclose(deepest, [7.8, 11.0, 14.6], atol=0.8)
    text = str(themed_svg(figures.dent_card(window), "a dent & its <wall>"))
    assert "currentColor" in text
    assert "var(--epoch-0)" in text
    assert "<script" not in text
    assert "mm), + = inward" in text
    assert 'role="img" aria-label="a dent &amp; its &lt;wall&gt;"' in text
    assert "var(--" not in str(literal(themed_svg(figures.dent_card(window))))


def test_the_section_says_by_how_much_its_residuals_are_scaled(content: Content) -> None:
    assert "residuals × 8" in " ".join(_texts(figures.dent_card(_window(content, "D05"))))


def test_epochs_differ_in_line_style_so_that_greyscale_prints_can_be_read() -> None:
    assert len(set(map(str, DASHES))) == len(EPOCHS) == len(DASHES)
    assert epoch_style(0)["linestyle"] != epoch_style(1)["linestyle"]
    assert max(_light(c) for c in (*EPOCHS, *SEVERITY.values())) < 0.75  # dark enough on white paper


def test_the_depth_of_a_dent_darkens_steadily_and_no_change_is_white() -> None:
    grey = paint(np.linspace(1 / 6, 1, 40), DEPTH) @ [0.299, 0.587, 0.114]
    assert (np.diff(grey) < 0).all()
    assert paint(np.array([0.5]), CHANGE).min() > 0.95
    assert paint(np.array([np.nan]))[0] == pytest.approx(np.full(3, 178 / 255))


def _light(colour: str) -> float:
    return colorsys.rgb_to_hls(*(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)))[1]


def test_numbers_that_a_picture_says_are_not_cut_with_its_coordinates() -> None:
    figure = Figure()
    figure.text(0.1, 0.1, "± 0.0041 m")
    text = str(themed_svg(figure))
    assert "0.0041" in text
    assert not re.search(r"[\" ]-?\d+\.\d{3,}", re.sub(r">[^<]*<", "><", text))
