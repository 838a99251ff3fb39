"""Bending strain of circles: size, sign, tension side and sigma."""

from __future__ import annotations

import numpy as np
import pytest

from deform.options import StrainOptions
from deform.run import build, schema
from deform.strain.bending import add_bending, tension_clock

S = np.round(np.arange(0.0, 400.05, 0.1), 10)
DIAMETER = 0.5


def line(azimuth, pitch):
    return build.dataset("centreline", {"chainage": S, "azimuth": np.asarray(azimuth) % 360.0, "pitch": np.asarray(pitch)})


def test_bending_strain_is_the_outer_radius_over_the_radius_of_the_bend():
    bent = add_bending(line(np.degrees(S / 250.0), np.zeros(S.size)), outside_diameter=DIAMETER)
    inside = bent.isel(chainage=slice(50, -50))
    np.testing.assert_allclose(inside.bending_strain_horizontal, 0.25 / 250.0, rtol=1e-9)
    np.testing.assert_allclose(inside.bending_strain, 0.25 / 250.0, rtol=1e-9)
    np.testing.assert_allclose(inside.bending_strain_clock, 270.0)


@pytest.mark.parametrize(
    ("horizontal", "vertical", "clock"), [(0, 1, 180), (0, -1, 0), (1, 0, 270), (-1, 0, 90), (-1, -1, 45), (1, 1, 225)]
)
def test_tension_side_lies_opposite_to_the_centre_of_the_bend(horizontal, vertical, clock):
    assert tension_clock(horizontal, vertical) == pytest.approx(clock)


def test_gauge_length_is_written_beside_the_curvature():
    bent = add_bending(line(S * 0, S * 0), outside_diameter=DIAMETER, options=StrainOptions(gauge_length_m=3.0))
    assert bent.curvature_horizontal.attrs["gauge_length_m"] == 3.0
    assert bent.curvature_vertical.attrs["gauge_length_m"] == 3.0
    assert np.isnan(bent.curvature_horizontal.values[:15]).all()
    assert schema.dataset_faults("centreline", bent) == []


def test_centreline_without_direction_is_returned_as_it_came():
    bare = build.dataset("centreline", {"chainage": S})
    assert add_bending(bare, outside_diameter=DIAMETER) is bare


def test_hard_bends_do_not_raise_the_sigma_of_the_pipe_around_them():
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.02, S.size)
    bends = np.interp(S, [100.0, 103.0, 250.0, 252.0], [0.0, 30.0, 30.0, 75.0])
    plain = add_bending(line(noise, noise), outside_diameter=DIAMETER)
    bent = add_bending(line(bends + noise, noise), outside_diameter=DIAMETER)
    ratio = bent.curvature_horizontal_sigma / plain.curvature_horizontal_sigma
    assert float(ratio.max()) < 1.25
    assert float(plain.curvature_horizontal_sigma.mean()) == pytest.approx(np.radians(0.02) * np.sqrt(2) / 2.0, rel=0.15)
