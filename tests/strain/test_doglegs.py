"""Bends and deflections at welds on a line that is known, listed with sign, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from deform.run import build
from deform.strain.bending import add_bending
from deform.strain.doglegs import doglegs, jumps
from tests.naive import change as naive

S = np.round(np.arange(0.0, 500.05, 0.1), 10)
DIAMETER = 0.3239
SIGMA = 0.004


def line(azimuth, pitch, seed=0):
    rng = np.random.default_rng(seed)
    noise = [gaussian_filter1d(rng.normal(size=S.size), 5.0) for _ in range(2)]
    noise = [n * SIGMA / np.std(n[20:] - n[:-20]) for n in noise]
    made = build.dataset("centreline", {"chainage": S, "azimuth": (azimuth + noise[0]) % 360.0, "pitch": pitch + noise[1]})
    for name in ("azimuth", "pitch"):
        made[name].attrs |= {"turn_lag_m": [0.1, 2.0, 50.0], "turn_sigma_deg": [SIGMA, SIGMA, SIGMA]}
    return add_bending(made, outside_diameter=DIAMETER)


def welds(*places):
    return build.dataset("welds", {"chainage": list(places), "probability": np.ones(len(places))})


def test_bend_is_listed_once_with_angle_radius_and_sign():
    radius = 5 * DIAMETER
    arc = np.radians(45.0) * radius
    table = doglegs(
        line(-45.0 * np.clip((S - 200.0) / arc, 0, 1), 0 * S), outside_diameter=DIAMETER, welds=welds(200.0, 200.0 + arc)
    )
    assert list(table.kind) == ["bend"]
    row = table.iloc[0]
    assert row.angle_horizontal_deg == pytest.approx(-45.0, abs=0.05)
    assert abs(row.angle_vertical_deg) < 0.05
    assert row.clock_deg == pytest.approx(90.0, abs=0.2)
    assert row.start_m < 200.0 + arc < row.end_m + 2.0


def test_dogleg_at_a_weld_is_separated_from_elastic_bending():
    elastic = 2.0 * np.sin(S / 60.0)
    table = doglegs(
        line(elastic + 0.15 * (S > 120.05), 0.0 * S),
        outside_diameter=DIAMETER,
        welds=welds(*np.arange(12.05, 490.0, 12.0)),
    )
    assert list(table.kind) == ["weld"]
    assert table.start_m[0] == pytest.approx(120.05)
    assert table.angle_horizontal_deg[0] == pytest.approx(0.15, abs=4 * table.angle_sigma_deg[0])
    assert table.clock_deg[0] == pytest.approx(270.0, abs=25.0)


def test_sag_at_a_tee_has_its_tension_below():
    features = build.dataset("features", {"chainage": [250.05], "kind": ["tee"]})
    table = doglegs(line(0 * S, 0.2 * (S > 250.05)), outside_diameter=DIAMETER, features=features, welds=welds(250.3))
    assert list(table.kind) == ["tee"]
    assert table.angle_vertical_deg[0] == pytest.approx(0.2, abs=0.04)
    assert table.clock_deg[0] == pytest.approx(180.0, abs=12.0)


def test_noise_alone_gives_no_dogleg():
    listed = [
        len(doglegs(line(0 * S, 0 * S, seed), outside_diameter=DIAMETER, welds=welds(*np.arange(10.0, 490.0, 12.0))))
        for seed in range(5)
    ]
    assert sum(listed) <= 1


def test_centreline_without_curvature_gives_an_empty_table():
    assert len(doglegs(build.dataset("centreline", {"chainage": S}), outside_diameter=DIAMETER)) == 0


def test_jumps_in_blocks_equal_straight_lines_fitted_weld_by_weld():
    rng = np.random.default_rng(2)
    s = np.cumsum(rng.uniform(0.05, 0.25, 60_000))
    azimuth, pitch = (359.0 + np.cumsum(rng.normal(0, 0.05, s.size))) % 360.0, rng.normal(0, 1.0, s.size)
    pitch[30_000] = np.nan
    places = np.sort(np.concatenate([rng.uniform(0.0, s[-1], 2500), [0.5, s[30_000] + 1.0, s[-1] - 0.5]]))
    got = np.column_stack(jumps(s, azimuth, pitch, places))
    some = np.unique(np.concatenate([np.arange(0, places.size, 50), [0, places.size - 1], np.flatnonzero(np.isnan(got[:, 0]))]))
    want = np.array([naive.jump(s, azimuth, pitch, place) for place in places[some]])
    np.testing.assert_allclose(got[some], want, rtol=0, atol=1e-9)
    assert 3 <= np.isnan(got[:, 0]).sum() < 10  # at both ends, and about the value that is not known
