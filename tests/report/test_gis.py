"""Maps as files: layers with their system, numbers with their units, a KML that others read, and no map without coordinates."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from deform.errors import InputError, OptionError
from deform.options import ReportOptions
from deform.report import write_report
from tests.report.fabricate import write_folder

KML = "{http://www.opengis.net/kml/2.2}"
pyogrio = pytest.importorskip("pyogrio")
geopandas = pytest.importorskip("geopandas")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("gis"), step_m=1.0, caliper=False)


def test_the_geopackage_reads_back_with_every_layer_and_its_system(small: Path) -> None:
    path = write_report(small, ("gpkg",))["gpkg"]
    layers = dict(pyogrio.list_layers(path))
    runs = ("demo-2019", "demo-2021", "demo-2023")
    assert set(layers) == {*(f"centreline_{run}" for run in runs), "zones", "dents", "welds", "markers"}
    assert layers["zones"] == "LineString Z"
    assert all(geopandas.read_file(path, layer=layer).crs.to_epsg() == 4979 for layer in layers)
    zones = geopandas.read_file(path, layer="zones")
    assert list(zones.id) == ["Z1", "Z2", "Z3"]
    assert zones.displacement_m.dtype.kind == "f"  # numbers that can be filtered, not text


def test_a_chosen_system_puts_the_layers_in_metres(small: Path) -> None:
    path = write_report(small, ("gpkg",), ReportOptions(crs="utm"))["gpkg"]
    line = geopandas.read_file(path, layer="centreline_demo-2019")
    assert line.crs.to_epsg() == 32610
    assert line.length.iloc[0] == pytest.approx(4000, rel=0.01)
    dents = geopandas.read_file(path, layer="dents")
    assert dents.distance(line.geometry.iloc[0]).max() < 2.0
    with pytest.raises(OptionError, match="not a coordinate system"):
        write_report(small, ("gpkg",), ReportOptions(crs="EPSG:banana"))


def test_the_kml_is_escaped_and_in_the_order_that_its_schema_asks(small: Path) -> None:
    write_report(small, ("gpkg",))
    root = ElementTree.parse(small / "gis" / "demo.kml").getroot()
    assert root.tag == f"{KML}kml"
    order = ["name", "description", "styleUrl", "LineString", "Point"]
    for mark in root.iter(f"{KML}Placemark"):
        tags = [child.tag.removeprefix(KML) for child in mark]
        assert tags == sorted(tags, key=order.index)
        assert len(set(tags)) == len(tags)
    styles = {f"#{s.get('id')}" for s in root.iter(f"{KML}Style")}
    assert {e.text for e in root.iter(f"{KML}styleUrl")} <= styles
    names = [e.text for e in root.iter(f"{KML}name")]
    assert "V01 <b>&" in names
    assert "AGM02 Łódź" in names
    first = next(root.iter(f"{KML}coordinates")).text
    longitude, latitude, _ = (float(v) for v in (first or "").split()[0].split(","))
    assert longitude == pytest.approx(-121.28, abs=0.01)
    assert latitude == pytest.approx(61.04, abs=0.01)


def test_gdal_reads_the_kml_folder_by_folder(small: Path) -> None:
    path = small / "gis" / "demo.kml"
    write_report(small, ("gpkg",))
    if not {"KML", "LIBKML"} & set(pyogrio.list_drivers()):
        pytest.skip("this GDAL reads no KML")
    found = {name: len(geopandas.read_file(path, layer=name)) for name, _ in pyogrio.list_layers(path)}
    assert found == {"Centreline": 1, "Zones": 3, "Dents": 4, "Markers": 5}  # of a dent only the last run, for the field


def test_control_characters_of_a_name_do_not_break_the_kml(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, length_m=300.0, step_m=1.0, line="Łódź \x07 & <Süd>", zones=False, dents=False)
    write_report(folder, ("gpkg",))
    path = next((folder / "gis").glob("*.kml"))
    assert ElementTree.parse(path).getroot().find(f"{KML}Document/{KML}name").text == "Łódź  & <Süd>"


def test_listings_without_coordinates_give_no_map_and_say_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run has coordinates"):
        write_report(write_folder(tmp_path, length_m=300.0, listing=True), ("gpkg",))
