"""The line as built: its joints, its bends, its place on the ellipsoid."""

from __future__ import annotations

import numpy as np
import pytest

from deform.geometry.earth import geodetic_to_local
from deform.options import RouteOptions
from deform.synthetic.route import lay


@pytest.fixture(scope="module")
def line():
    return lay(RouteOptions(length_m=3000.0), seed=2)


def _ecef_lengths(line):
    place = line.position(line.chainage)
    local = np.array(geodetic_to_local(*place, place[0][0], place[1][0], place[2][0]))
    return np.linalg.norm(np.diff(local, axis=1), axis=0)


def test_chainage_is_the_arc_length_of_the_centreline(line):
    chord, step = _ecef_lengths(line), np.diff(line.chainage)
    bend = np.hypot(*line.curvature(0.5 * (line.chainage[1:] + line.chainage[:-1])))
    assert np.abs(chord + step**3 * bend**2 / 24 - step).max() < 2e-7
    assert chord.sum() == pytest.approx(line.length, abs=2e-3)


def test_curvature_is_the_turning_of_the_tangent(line):
    where = np.arange(1.0, line.length - 1.0, 0.37)
    h = 1e-4
    horizontal, vertical = line.curvature(where)
    ahead, behind = line.at(where + h, 1)[:, 0], line.at(where - h, 1)[:, 0]
    pitch = line.at(where, 3)[:, 0]
    assert (ahead - behind) / (2 * h) * np.cos(pitch) == pytest.approx(horizontal, abs=2e-4)
    assert (line.at(where + h, 3)[:, 0] - line.at(where - h, 3)[:, 0]) / (2 * h) == pytest.approx(vertical, abs=2e-4)


def test_tangent_points_along_the_positions(line):
    where = np.arange(5.0, line.length - 5.0, 11.3)
    for s in where[::20]:
        place = line.position([s - 0.01, s + 0.01])
        east, north, up = (np.diff(x)[0] for x in geodetic_to_local(*place, *[x[0] for x in line.position([s])]))
        assert np.arctan2(east, north) == pytest.approx((line.at([s], 1)[0, 0] + np.pi) % (2 * np.pi) - np.pi, abs=2e-5)
        assert np.arctan2(up, np.hypot(east, north)) == pytest.approx(line.at([s], 3)[0, 0], abs=2e-5)


def test_joints_tile_the_line_and_bends_turn_by_what_they_say(line):
    joints = line.joints
    ends = joints.start_m + joints.length_m
    assert np.allclose(ends[:-1], joints.start_m[1:])
    assert ends.iloc[-1] == pytest.approx(line.length)
    assert (joints.length_m > 0.5).all()
    azimuth, pitch = (
        line.at(np.append(joints.start_m, line.length), 1)[:, 0],
        line.at(np.append(joints.start_m, line.length), 3)[:, 0],
    )
    turned = np.degrees(np.hypot(np.diff(azimuth) * np.cos(pitch[1:]), np.diff(pitch)))
    assert np.abs(turned - joints.bend_angle_deg).max() < 0.15
    assert np.abs(turned[joints.kind.isin(["straight", "pup", "valve"])]).max() < 1e-6


def test_induction_bends_have_five_diameters_and_elastic_ones_stay_elastic(line):
    curvature = np.hypot(*line.curvature(line.chainage))
    assert curvature.max() == pytest.approx(1 / (5 * line.outside_diameter), rel=0.01)
    joint = np.searchsorted(line.joints.start_m, line.chainage, side="right") - 1
    elastic = (line.joints.kind == "elastic").to_numpy()[joint]
    assert curvature[elastic].max() * 0.5 * line.outside_diameter < 1e-3
    assert {"straight", "elastic", "cold", "induction", "pup", "valve"} == set(line.joints.kind)


def test_crossings_have_the_heavy_wall(line):
    assert 4 <= ((line.joints.wall_m > 0.0085) & (line.joints.kind != "valve")).sum() <= 12


def test_reversed_line_is_the_same_pipe_seen_from_the_other_end(line):
    back = line.reversed()
    where = np.arange(2.0, line.length - 2.0, 7.7)
    assert np.allclose(back.position(line.length - where), line.position(where), atol=1e-9)
    here, there = line.curvature(where), back.curvature(line.length - where)
    assert there[0] == pytest.approx(-here[0], abs=1e-12)
    assert there[1] == pytest.approx(here[1], abs=1e-12)
    again = back.reversed().table
    again[:, 1] -= 2 * np.pi
    assert np.allclose(again, line.table, atol=1e-9)
    assert back.of_material([100.0]) == pytest.approx(line.length - line.of_material([100.0]))
    assert np.allclose(back.reversed().joints.bead_m[1:], line.joints.bead_m[1:])


def test_same_seed_lays_the_same_line_and_another_seed_another_one():
    options = RouteOptions(length_m=400.0)
    assert (lay(options, 5).table == lay(options, 5).table).all()
    assert lay(options, 6).length != lay(options, 5).length


def test_a_line_follows_the_vertices_of_a_real_route():
    vertices = tuple((-121.0 + 0.01 * k, 61.0 + 0.004 * np.sin(k)) for k in range(8))
    line = lay(RouteOptions(length_m=2500.0, vertices=vertices, azimuth_deg=50.0, induction_bends_deg=(), bend_fields=0))
    azimuth = np.degrees(line.table[:, 1])
    assert np.ptp(azimuth) > 40.0
    assert np.hypot(*line.curvature(line.chainage)).max() < 0.05


def test_a_line_takes_the_shape_of_a_real_pipeline(real):
    pyogrio = pytest.importorskip("pyogrio")
    frame = pyogrio.read_dataframe(real / "routes_eia" / "HGL_Pipelines_US_201606.shp").to_crs("EPSG:4326")
    parts = frame.geometry.explode().loc[lambda g: g.apply(lambda x: 40 < len(x.coords) < 400)]
    vertices = tuple((x, y) for x, y, *_ in parts.iloc[0].coords)
    line = lay(RouteOptions(length_m=5000.0, vertices=vertices, induction_bends_deg=(), bend_fields=0, crossings=0))
    assert line.length == pytest.approx(5000.0, abs=20.0)
    assert (np.hypot(*line.curvature(line.chainage)) < 0.1).all()
