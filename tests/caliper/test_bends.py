"""Bends of made trajectories: single ones, and pairs that turn to opposite sides."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from deform.caliper.bends import bends

DIAMETER = 0.5
RADIUS = 5 * DIAMETER


def trajectory(turns, apart, noise_deg=0.01, length=120.0):
    """A tool along pipe with arcs of the given turns (degree to the right), ``apart`` metre of straight pipe between them."""
    time = np.arange(0.0, length, 0.02)
    azimuth, start, spans = np.full(time.size, 30.0), 50.0, []
    for turn in turns:
        arc = np.radians(abs(turn)) * RADIUS
        azimuth += turn * np.clip((time - start) / arc, 0.0, 1.0)
        spans.append((start, start + arc))
        start += arc + apart
    wander = np.cumsum(np.random.default_rng(2).normal(0.0, noise_deg / 10.0, (2, time.size)), axis=1)
    values = {"chainage": time, "azimuth": azimuth + wander[0], "pitch": wander[1]}
    return xr.Dataset({n: ("time", v) for n, v in values.items()}), spans


@pytest.mark.parametrize("apart", [DIAMETER, 4.0, 30.0])
def test_bends_to_opposite_sides_are_two_bends(apart):
    """At a distance of one diameter their turns cancel in the sum: none was found."""
    tool, spans = trajectory((30.0, -30.0), apart)
    found = bends(tool, DIAMETER)
    assert [r["direction"] for r in found] == ["right", "left"]
    assert [r["value"] for r in found] == pytest.approx([30.0, 30.0], abs=0.5)
    assert [r["chainage"] for r in found] == pytest.approx([a for a, _ in spans], abs=0.15)
    assert [r["chainage_end"] for r in found] == pytest.approx([b for _, b in spans], abs=0.15)
    assert [r["radius"] for r in found] == pytest.approx([RADIUS, RADIUS], rel=0.08)


def test_a_chain_of_bends_longer_than_any_bend_is_its_bends():
    found = bends(trajectory((30.0, -30.0) * 20, DIAMETER, length=180.0)[0], DIAMETER)
    assert [r["direction"] for r in found] == ["right", "left"] * 20


def test_a_bend_with_the_swing_of_the_tool_at_its_ends_is_one_bend():
    """A tool that swings out by a degree before and behind a bend makes no bends of its own, and adds less than it swings."""
    tool, _ = trajectory((30.0,), 0.0)
    arc = np.radians(30.0) * RADIUS
    place = tool.chainage.values
    swing = sum(np.exp(-0.5 * ((place - at) / 0.3) ** 2) for at in (49.0, 51.0 + arc))
    tool["azimuth"] = tool["azimuth"] - swing * np.where(place < 50.0, 1.0, -1.0)
    found = bends(tool, DIAMETER)
    assert [r["direction"] for r in found] == ["right"]
    assert found[0]["value"] == pytest.approx(30.0, abs=1.0)
