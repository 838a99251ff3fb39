"""The earth against closed forms, boule, pyproj and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deform.geometry import _kernels_earth as kernels
from deform.geometry import earth

LATITUDE = st.floats(-89.0, 89.0)
LONGITUDE = st.floats(-180.0, 180.0)
HEIGHT = st.floats(-400.0, 9000.0)
NEAR = st.floats(-50_000.0, 50_000.0)


@pytest.mark.parametrize("height", [0.0, 1000.0, 9000.0])
def test_gravity_is_the_closed_form_to_a_micrometre_per_second_squared(height):
    boule = pytest.importorskip("boule")
    latitude = np.linspace(-90, 90, 73)
    closed = boule.WGS84.normal_gravity((np.zeros_like(latitude), latitude, np.full_like(latitude, height)), si_units=True)
    assert np.abs(earth.gravity(latitude, height) - closed).max() < 2e-6


def test_gravity_falls_with_height_and_grows_towards_the_poles():
    assert earth.gravity(45.0, 1000.0) < earth.gravity(45.0, 0.0)
    assert (np.diff(earth.gravity(np.linspace(0, 90, 50))) > 0).all()


def test_meridian_radius_is_the_arc_of_a_degree():
    pyproj = pytest.importorskip("pyproj")
    arc = pyproj.Geod(ellps="WGS84").inv(10.0, 60.995, 10.0, 61.005)[2]
    assert arc / np.radians(0.01) == pytest.approx(float(earth.radii(61.0)[0]), rel=1e-8)


def test_radii_meet_at_the_pole():
    meridian, normal = earth.radii([90.0, -90.0])
    assert meridian == pytest.approx(normal, rel=1e-14)


@given(LATITUDE, LONGITUDE, HEIGHT)
def test_earth_centred_coordinates_are_those_of_proj(latitude, longitude, height):
    pyproj = pytest.importorskip("pyproj")
    transform = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978")
    ours = kernels.geodetic_to_ecef(np.radians(latitude), np.radians(longitude), height)
    assert np.allclose(ours, transform.transform(latitude, longitude, height), atol=2e-8, rtol=0)
    back = kernels.ecef_to_geodetic(*ours)
    assert abs(np.degrees(back[0]) - latitude) < 1e-12
    assert abs(back[2] - height) < 1e-8


@given(LATITUDE, LONGITUDE, HEIGHT, NEAR, NEAR, st.floats(-500, 500))
def test_local_frame_there_and_back_is_where_it_began(latitude, longitude, height, east, north, up):
    place = earth.local_to_geodetic(east, north, up, latitude, longitude, height)
    back = earth.geodetic_to_local(*place, latitude, longitude, height)
    assert np.allclose(np.ravel(back), [east, north, up], atol=1e-7)


@given(LATITUDE, LONGITUDE, HEIGHT)
def test_local_frame_keeps_distances_in_space(latitude, longitude, height):
    points = np.array([[latitude, longitude, height], [latitude + 0.01, longitude + 0.02, height + 7.0]])
    ecef = np.array([kernels.geodetic_to_ecef(np.radians(p[0]), np.radians(p[1]), p[2]) for p in points])
    local = np.array(earth.geodetic_to_local(*points.T, latitude - 0.01, longitude, height)).T
    assert np.linalg.norm(np.diff(local, axis=0)) == pytest.approx(np.linalg.norm(np.diff(ecef, axis=0)), abs=1e-7)


@given(LATITUDE, LONGITUDE, HEIGHT, st.floats(-20, 20), st.floats(-20, 20), st.floats(-20, 20))
def test_small_difference_is_the_local_frame_and_undone_by_the_shift(latitude, longitude, height, east, north, up):
    there = earth.enu_shift(latitude, longitude, height, east, north, up)
    assert np.allclose(earth.enu_difference(*there, latitude, longitude, height), [east, north, up], atol=1e-6)
    tolerance = 1e-6 + 1.5 * 800.0 / 6.3e6 * max(1.0, abs(np.tan(np.radians(latitude)))) + 0.02 * (abs(latitude) > 85)
    assert np.allclose(np.ravel(earth.geodetic_to_local(*there, latitude, longitude, height)), [east, north, up], atol=tolerance)


def test_small_difference_turns_its_sign_when_the_points_are_swapped_and_crosses_the_date_line():
    a, b = (61.0, 179.9999, 20.0), (61.0001, -179.9999, 25.0)
    there, back = np.array(earth.enu_difference(*b, *a)), np.array(earth.enu_difference(*a, *b))
    assert there == pytest.approx(-back, abs=1e-7)
    assert 0 < there[0] < 20


@given(LATITUDE, HEIGHT, st.floats(-10, 10), st.floats(-10, 10))
def test_transport_rate_is_the_turning_of_the_level_frame_along_the_way(latitude, height, ve, vn):
    dt = 0.5
    meridian, normal = earth.radii(latitude)
    rates = earth.transport_rate(latitude, height, ve, vn)
    change_latitude = vn / (meridian + height)
    change_longitude = ve / ((normal + height) * np.cos(np.radians(latitude)))
    assert rates[0] == pytest.approx(-change_latitude, abs=1e-15)
    assert np.hypot(rates[1], rates[2]) == pytest.approx(abs(change_longitude), abs=1e-15 * dt)


@given(LATITUDE, HEIGHT, st.floats(-10, 10), st.floats(-10, 10))
def test_kernels_say_the_same_as_the_public_functions(latitude, height, ve, vn):
    phi = np.radians(latitude)
    assert kernels.radii(phi) == pytest.approx(earth.radii(latitude), rel=1e-15)
    assert kernels.gravity(phi, height) == pytest.approx(earth.gravity(latitude, height), rel=1e-15)
    assert kernels.earth_rate(phi) == pytest.approx(earth.earth_rate(latitude), abs=1e-20)
    assert kernels.transport_rate(phi, height, ve, vn) == pytest.approx(earth.transport_rate(latitude, height, ve, vn), abs=1e-18)


def test_a_path_of_small_steps_keeps_its_metre_far_from_its_begin():
    north = np.linspace(61.0, 62.8, 4001)  # 200 km
    longitude = np.where(north > 62.7, 0.02 * (north - 62.7) / 0.1, 0.0)  # then 1 km to the east
    path = earth.enu_path(north, longitude, np.zeros(north.size))
    geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    legs = geod.inv(longitude[:-1], north[:-1], longitude[1:], north[1:])[2]
    assert np.linalg.norm(np.diff(path, axis=0), axis=1) == pytest.approx(legs, rel=1e-6)
    east = geod.inv(0.0, 62.75, 0.02, 62.75)[2]
    assert path[-1, 0] == pytest.approx(east, rel=1e-4)
    assert earth.enu_difference(62.8, 0.02, 0.0, 61.0, 0.0, 0.0)[0] > 1.02 * east  # what a difference from the first makes of it
