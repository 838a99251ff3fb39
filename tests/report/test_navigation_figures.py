"""Figures of the navigation: each from one dataset, every axis with its unit, what they show being what the data hold."""

from __future__ import annotations

import numpy as np
import pytest

from deform.nav.raw_view import raw_dataset, rest_dataset
from deform.readers.reader import read_source
from deform.report import navigation_figures as figures
from deform.report.svg import png
from deform.run import build

TIME = np.arange(0.0, 600.0)


@pytest.fixture(scope="module")
def raw(demo):
    return read_source(demo / "demo-2019")


@pytest.fixture(scope="module")
def diagnostics():
    random = np.random.default_rng(1)
    three = np.ones((TIME.size, 3))
    values = {f"innovation_{axis}": random.standard_normal(TIME.size) for axis in ("along", "right", "up")}
    values |= {"gyro_bias": 0.01 * three, "gyro_bias_sigma": 0.002 * three, "odometer_scale": np.full(TIME.size, 2e-4)}
    values |= {"accel_bias": 1e-4 * three, "accel_bias_sigma": 1e-5 * three, "odometer_scale_sigma": np.full(TIME.size, 1e-4)}
    return build.dataset("navigation", {"time": TIME, **values})


def drawn(figure):
    """The figure, of which every named axis has its unit."""
    assert len(png(figure, 50)) > 3000
    assert all("(" in ax.get_ylabel() for ax in figure.axes)
    return figure


@pytest.mark.demo
def test_raw_panel_keeps_the_extremes_of_every_sensor(raw):
    ds = raw_dataset(raw, 300)
    step = float(np.median(np.diff(raw.imu["time"].values)))
    fastest = raw.imu["gyro_count"].values.max(axis=0) * np.degrees(raw.imu.attrs["gyro_pulse_rad"]) / step
    assert np.allclose(ds["gyro_rate"].max("time"), fastest)
    assert np.linalg.norm(ds["specific_force"].values[10]) == pytest.approx(9.82, abs=0.05)
    lines = drawn(figures.raw_panel(ds)).axes
    assert len(lines) == 7
    assert np.nanmax(lines[6].lines[0].get_ydata()) < 3.0


@pytest.mark.demo
def test_free_navigation_of_the_rest_grows_as_gyro_bias_says(raw):
    """A gyro bias b turns the level by b t, so velocity grows as g b t² / 2."""
    ds = rest_dataset(raw)
    assert ds["time"].values[-1] == pytest.approx(raw.header.launch.static_s, abs=5.0)
    level = np.abs(ds["velocity_error"].values[:, :2])
    bias = np.radians(raw.header.imu.gyro_bias_deg_per_h) / 3600
    assert level.max() < 4.0 * 0.5 * 9.8 * bias * ds["time"].values[-1] ** 2
    assert level[0].max() == 0.0
    assert len(drawn(figures.rest_errors(ds)).axes) == 2


def test_residuals_at_marks_show_the_gross_mark_as_not_used():
    n, off = 5, np.array([0.1, -0.2, 20.0, 0.3, 0.0])
    values = {f"misclosure_{axis}_{when}": off for axis in ("east", "north", "up") for when in ("before", "after")}
    sigma = {name: np.full(n, 0.3) for name in ("sigma_horizontal", "sigma_vertical")}
    names = {"name": [f"M{i}" for i in range(n)], "kind": ["agm"] * n, "time": np.arange(n) * 60.0}
    ds = build.dataset("markers", {**names, **sigma, **values, "used": np.arange(n) != 2, "remark": [""] * n})
    figure = drawn(figures.mark_residuals(ds))
    crossed = next(line for line in figure.axes[0].lines if line.get_label() == "not used")
    assert list(crossed.get_xdata()) == [2]
    assert figure.axes[0].get_ylim()[1] < 1.0  # the gross mark does not flatten the others


def test_innovations_say_their_share_within_the_band(diagnostics):
    figure = drawn(figures.innovations(diagnostics))
    shares = [float(ax.texts[0].get_text().split("%")[0]) for ax in figure.axes]
    assert shares == pytest.approx([95.0] * 3, abs=3.0)


def test_biases_are_shown_in_the_units_of_their_labels(diagnostics):
    figure = drawn(figures.biases(diagnostics))
    heights = [ax.lines[0].get_ydata()[0] for ax in figure.axes]
    assert heights == pytest.approx([0.01, 1e-4 / 9.80665 * 1e6, 200.0])
