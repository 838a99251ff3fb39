"""Figures: each from one dataset, with units and signs on the axes and styles that survive greyscale."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.options import ReportOptions
from deform.report import figures, line_figures
from deform.report.content import read_content
from deform.report.context import build_context
from deform.report.dent_views import dent_dataset
from deform.report.line_view import cut, line_dataset, trend_dataset
from deform.report.style import DASHES, EPOCHS, epoch_style
from deform.report.svg import png, themed_svg


@pytest.fixture(scope="module")
def line(surveyed: Path) -> xr.Dataset:
    ds = line_dataset(read_content(surveyed))
    assert ds is not None
    return ds


@pytest.fixture(scope="module")
def zones(surveyed: Path) -> list[dict]:
    return build_context(read_content(surveyed), ReportOptions())["zones"]


def _labels(figure) -> str:
    return " ".join(
        text for ax in figure.axes for text in (ax.get_xlabel(), ax.get_ylabel(), ax.get_title(), ax.get_title(loc="left"))
    )


def test_every_axis_of_a_line_figure_carries_a_unit_and_signed_ones_their_sign(line: xr.Dataset, zones: list[dict]) -> None:
    rows = [("displacement_lateral", "lateral (m)\n+ = right", 1.0), ("bending_strain", "strain (µε)", 1e6)]
    part = cut(line, 2655.0, 2785.0, 60.0)
    for figure in (
        line_figures.plan(line, zones),
        line_figures.strips(line, rows, zones),
        line_figures.zone_detail(part),
        line_figures.curvature_comparison(part, "vertical"),
        line_figures.navigation_panel(line, "demo-2019"),
    ):
        assert len(png(figure, 50)) > 3000
        for ax in figure.axes:
            assert not ax.get_ylabel() or "(" in ax.get_ylabel()
    assert "+ = sag" in _labels(line_figures.curvature_comparison(part, "vertical"))
    assert "+ = to the right" in _labels(line_figures.curvature_comparison(part, "horizontal"))


def test_the_plan_keeps_lengths_and_turns_the_line_to_the_right(line: xr.Dataset) -> None:
    along, across = line["along"].values, line["across"].values
    assert np.hypot(np.diff(along), np.diff(across)).sum() == pytest.approx(4000, rel=0.02)
    assert along[-1] > along[0]
    assert abs(across[-1] - across[0]) < 1.0


def test_the_difference_panel_shows_the_planted_change_of_curvature(line: xr.Dataset) -> None:
    figure = line_figures.curvature_comparison(cut(line, 857.0, 903.0, 30.0), "vertical")
    last = figure.axes[1].lines[-1]
    assert np.nanmax(last.get_ydata()) == pytest.approx(0.25 * 0.5 * (2 * np.pi / 46) ** 2, rel=0.15)


def test_the_trend_of_a_dent_has_its_values_and_the_limit_is_drawn(surveyed: Path) -> None:
    ds = trend_dataset(read_content(surveyed), "D02")
    assert ds is not None
    np.testing.assert_allclose(ds["value"].values, [7.8, 11.0, 14.6])
    assert ds["year"].values[0] == pytest.approx(2019.5, abs=0.01)
    assert len(png(line_figures.trend(ds), 60)) > 2000


def test_the_dent_card_shows_the_same_clock_and_depth_as_the_table(surveyed: Path) -> None:
    content = read_content(surveyed)
    dent = next(d for d in build_context(content, ReportOptions())["dents"] if d["id"] == "D02")
    window = dent_dataset(content, dent)
    assert window is not None
    assert list(window["run"].values) == ["demo-2019", "demo-2021", "demo-2023"]
    deepest = window["depth"].max(("distance", "clock")).values * 1000
    np.testing.assert_allclose(deepest, [7.8, 11.0, 14.6], atol=0.8)
    text = str(themed_svg(figures.dent_card(window)))
    assert "currentColor" in text
    assert "var(--epoch-0)" in text
    assert "<script" not in text
    assert "mm), + = inward" in text
    assert len(png(figures.cross_section(window), 60)) > 3000
    assert len(png(figures.unrolled_wall(window), 60)) > 3000


def test_the_section_says_by_how_much_its_residuals_are_scaled(surveyed: Path) -> None:
    content = read_content(surveyed)
    dent = next(d for d in build_context(content, ReportOptions())["dents"] if d["id"] == "D05")
    figure = figures.cross_section(dent_dataset(content, dent))
    assert "residuals × 8" in _labels(figure)


def test_detection_limits_are_drawn_from_the_table_or_not_at_all() -> None:
    limits = pd.DataFrame(
        {"run_from": "a", "run_to": "b", "component": "up", "wavelength_m": [20.0, 60.0], "limit_displacement_m": [0.01, 0.05]}
    )
    figure = line_figures.detection_limits(limits)
    assert figure is not None
    assert "(m)" in figure.axes[0].get_xlabel()
    assert line_figures.detection_limits(limits.drop(columns="wavelength_m")) is None


def test_epochs_differ_in_line_style_so_that_greyscale_prints_can_be_read() -> None:
    assert len(set(map(str, DASHES))) == len(EPOCHS) == len(DASHES)
    assert epoch_style(0)["linestyle"] != epoch_style(1)["linestyle"]
    light = [colorsys.rgb_to_hls(*(int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)))[1] for c in EPOCHS]
    assert max(light) < 0.75  # dark enough on white paper
