"""Surveyed points are read in any spelling and reference system, or refused with their fault."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.readers.control import read_control
from deform.readers.control_check import datum_remark
from deform.run import build
from deform.run.schema import dataset_faults


@pytest.fixture
def points(tmp_path):
    """Return a function that writes a table and reads it as control points."""

    def read(text: str, crs=None, **options):
        path = tmp_path / "control.csv"
        path.write_text(text, encoding="utf-8")
        return read_control(path, crs, **options)

    return read


PLAIN = """name,latitude_deg,longitude_deg,height_m,sigma_horizontal_m,sigma_vertical_m
A,61.04,-121.28,236.5,0.02,0.03
B,61.05,-121.29,230,0.02,0.03
"""


def test_the_plain_table_is_read(points):
    control = points(PLAIN)
    assert dataset_faults("control", control) == []
    assert list(control["name"].values) == ["A", "B"]
    np.testing.assert_allclose(control["latitude"], [61.04, 61.05])
    np.testing.assert_allclose(control["sigma_vertical"], 0.03)
    assert control.attrs["repairs"] == ""


@pytest.mark.parametrize(
    "header",
    [
        "Point ID,Lat,Long,Elevation (m),Horizontal Sigma [m],vertical_sigma",
        "id;LATITUDE;LONGITUDE;Height [m];sigma_h;sigma_v",
        "Pt\tlat_deg\tlon_deg\tZ\tHRMS\tVRMS",
    ],
)
def test_other_spellings_give_the_same_points(points, header):
    mark = next(m for m in ";\t," if m in header)
    rows = [line.replace(",", mark) for line in PLAIN.splitlines()[1:]]
    same, plain = points("\n".join([header, *rows])), points(PLAIN)
    for name in plain.variables:
        np.testing.assert_array_equal(same[name], plain[name])


def test_feet_kilometres_and_degrees_minutes_seconds_are_turned_into_si(points):
    control = points('name,lat,lon,Height [ft],KP (km)\nA,"61°02\'24""N","121 16 48 W",1000,1.5\n')
    assert float(control["latitude"][0]) == pytest.approx(61.04)
    assert float(control["longitude"][0]) == pytest.approx(-121.28)
    assert float(control["height"][0]) == pytest.approx(304.8)
    assert float(control["chainage"][0]) == 1500.0


@pytest.mark.parametrize("stated", ["in the file", "by the caller"])
def test_eastings_and_northings_are_turned_by_their_reference_system(points, stated):
    from pyproj import Transformer

    east, north = Transformer.from_crs("EPSG:4326", "EPSG:32610", always_xy=True).transform([-121.28, -121.29], [61.04, 61.05])
    rows = [f"{n},{e:.4f},{m:.4f},236" for n, e, m in zip("AB", east, north, strict=True)]
    text = "\n".join(["name,Easting [m],Northing [m],h", *rows])
    control = points(f"# crs = EPSG:32610\n{text}") if stated == "in the file" else points(text, "EPSG:32610")
    np.testing.assert_allclose(control["latitude"], [61.04, 61.05], atol=1e-9)
    np.testing.assert_allclose(control["longitude"], [-121.28, -121.29], atol=1e-9)
    np.testing.assert_allclose(control["height"], 236.0, atol=1e-6)
    assert control.attrs["crs"] == "EPSG:32610"


def test_geocentric_shift_of_an_old_datum_is_applied(points):
    control = points(PLAIN, "EPSG:4267")  # NAD27, Canada: tens of metres from WGS84
    metres = (float(control["longitude"][0]) + 121.28) * 111_320 * np.cos(np.radians(61.04))
    assert 50 < abs(metres) < 150


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("name,x_coord,height_m\nA,1,2\n", "no columns latitude and longitude, nor easting and northing"),
        ("name,latitude,longitude\nA,61,-121\n", "height: no column height"),
        ("name,easting,northing,height\nA,500000,6770000,3\n", "have no reference system"),
        ("name,latitude,longitude,height\nA,161,-121,3\n", "latitude, line 2: is 161"),
        ("name,latitude,longitude,height\nA,61,-121,1e6\n", "height, line 2: is 1e+06"),
        ("name,latitude,longitude,height\nA,here,-121,3\n", "latitude, line 2: is 'here', wanted a number"),
        ("name,latitude,longitude,height,sigma_horizontal_m\nA,61,-121,3,-1\n", "sigma_horizontal, line 2: is -1 m"),
        ("name,latitude,longitude,height [furlong]\nA,61,-121,3\n", "unit 'furlong'"),
        ("name,latitude,longitude,height\nA,61,-121,3\nB,61,121,3\n", "km apart; they are of one pipeline"),
        ("name,latitude,longitude,height\nA,,,\n", "holds no point with coordinates"),
        ("", "is empty"),
    ],
)
def test_a_wrong_table_is_refused(points, text, told):
    with pytest.raises(InputError) as caught:
        points(text)
    assert told in str(caught.value)
    assert "control.csv" in str(caught.value)


def test_an_unknown_reference_system_is_named(points):
    with pytest.raises(InputError, match="'EPSG:99' is no reference system"):
        points(PLAIN, "EPSG:99")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_control(tmp_path / "control.csv")


def test_points_of_one_name_and_rows_without_a_place_are_recorded(points):
    control = points(PLAIN + "B,61.06,-121.3,231,0.02,0.03\nC,,,,,\n")
    assert list(control["name"].values) == ["A", "B", "B (2)"]
    assert "1 of 4 rows have no full coordinates, first line 5" in control.attrs["repairs"]


def markers_and_control(shift_deg, wrong=0.0, n=5):
    """Passages of a run, and control points of their names that lie a shift north of them; the first one another bit off."""
    latitude, longitude = 61.0 + 0.01 * np.arange(n), -121.0 + 0.005 * np.arange(n)
    names = [f"M{k}" for k in range(n)]
    sigma = {"height": np.full(n, 230.0), "sigma_horizontal": np.full(n, 0.3), "sigma_vertical": np.full(n, 0.3)}
    passages = build.dataset(
        "passages",
        {"name": names, "kind": ["agm"] * n, "time": np.arange(n) * 1.0, "latitude": latitude, "longitude": longitude, **sigma},
    )
    there = latitude + shift_deg
    there[0] += wrong
    return passages, build.dataset("control", {"name": names, "latitude": there, "longitude": longitude, **sigma})


def test_offset_that_all_control_points_share_is_named_as_another_datum():
    passages, control = markers_and_control(1e-3)
    remark = datum_remark(control, passages, "r2019")
    assert remark.startswith("r2019: the control points lie 0 m east and 111 m north")
    assert "datum" in remark


@pytest.mark.parametrize(("shift", "wrong"), [(0.0, 0.0), (2e-5, 0.0), (0.0, 1e-3)])
def test_small_offsets_and_one_wrong_point_are_no_datum(shift, wrong):
    passages, control = markers_and_control(shift, wrong)
    assert datum_remark(control, passages, "r2019") == ""


def test_datum_is_not_judged_from_two_points_or_none():
    passages, control = markers_and_control(1e-3, n=2)
    assert datum_remark(control, passages, "r") == ""
    assert datum_remark(None, passages, "r") == ""
