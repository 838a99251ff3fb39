"""Figures of the caliper: each from one dataset, every axis with its unit, and the numbers on them those of the data."""

from __future__ import annotations

import numpy as np
import pytest

from deform.report import caliper_figures as figures
from deform.report.svg import png
from deform.run import build

OD, RADIUS = 0.3239, 0.1556


@pytest.fixture(scope="module")
def wall():
    place, clock = np.arange(40.0, 60.0, 0.02), np.arange(72) * 5.0
    turn = np.radians((clock - 200.0 + 180) % 360 - 180) * 0.5 * OD
    dent = 0.008 * np.exp(-np.log(10) * (((place[:, None] - 50.0) / 0.2) ** 2 + (turn[None, :] / 0.1) ** 2))
    oval = 6e-4 * np.cos(2 * np.radians(clock - 30.0))
    noise = np.random.default_rng(1).normal(0, 1e-4, dent.shape)
    values = {"chainage": place, "clock": clock, "radius": RADIUS + oval - dent + noise}
    return build.dataset("caliper", {**values, "reference_radius": np.full(place.size, RADIUS)})


@pytest.fixture(scope="module")
def dents():
    sizes = {"depth": [0.008], "depth_sigma": [2e-4], "length": [0.4], "width": [0.2]}
    return build.dataset("dents", {"chainage": [50.0], "clock": [200.0], **sizes})


def labels(figure):
    return [t for ax in figure.axes for t in (ax.get_xlabel(), ax.get_ylabel())]


def test_every_axis_carries_its_unit_and_every_figure_draws(wall, dents):
    welds = build.dataset(
        "welds", {"chainage": [0.0, 12.2, 24.4], "probability": [1.0] * 3, "joint_length": [12.2, 12.2, np.nan]}
    )
    drawn = (
        figures.section_residuals(wall, 50.0),
        figures.unrolled_wall(wall, 45.0, 55.0, {"weld": np.array([48.0])}),
        figures.dent_profiles(figures.profile_dataset(wall, dents, 0, OD)),
        figures.joint_lengths(welds.assign_attrs(nominal_joint_m=12.2)),
    )
    for figure in drawn:
        assert len(png(figure, 50)) > 3000
    for text in (t for figure in drawn for t in labels(figure) if t):
        assert "(" in text or text == "joints"


def test_the_section_says_the_ovality_of_the_undented_pipe(wall):
    texts = " ".join(t.get_text() for ax in figures.section_residuals(wall, 55.0).axes for t in ax.texts)
    ovality = float(texts.split("ovality ")[1].split(" ")[0])
    assert ovality == pytest.approx(100 * 4 * 6e-4 / (2 * RADIUS), abs=0.08)


def test_profiles_reach_the_depth_and_their_band_holds_the_truth(wall, dents):
    window = figures.profile_dataset(wall, dents, 0, OD)
    truth = 0.008 * np.exp(-np.log(10) * (window.distance.values / 0.2) ** 2)
    off = (window.profile_along.values - truth) / window.profile_along_sigma.values
    assert window.profile_along.values.max() == pytest.approx(0.008, abs=3e-4)
    assert np.mean(np.abs(off) < 1.96) > 0.9
    assert window.profile_around.values[np.argmin(np.abs(window.arc.values))] == pytest.approx(0.008, abs=5e-4)
