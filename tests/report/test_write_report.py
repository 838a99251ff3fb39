"""The documents as files: complete, self-contained, escaped, readable by others, and honest about what is absent."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from deform.errors import InputError, OptionError
from deform.options import ReportOptions
from deform.report import write_report
from deform.report.content import read_content, wall_window
from deform.report.context import build_context
from deform.report.series import pack, thinned, unpack
from deform.report.words import microstrain, number, percent, with_sigma
from deform.run import store
from tests.report.fabricate import OD, WALL, write_folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("small"), length_m=4000.0, step_m=1.0)


def test_the_page_loads_nothing_and_stays_below_thirty_megabytes(surveyed: Path) -> None:
    page = surveyed / "report" / "index.html"
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 30e6
    assert not re.search(r"<(script|img|link|iframe)[^>]*\s(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert text.count("plotly.js v") == 1
    assert "default-src 'none'" in text


def test_labels_cannot_become_markup(surveyed: Path) -> None:
    text = (surveyed / "report" / "index.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert "V01 <b>" not in text


def test_the_verdict_names_the_largest_movement_and_the_grown_dent(surveyed: Path) -> None:
    numbers = build_context(read_content(surveyed), ReportOptions())
    said = " ".join(numbers["verdict"])
    assert "2 zones moved or bent" in said
    assert "0.81 ± 0.08" in said
    assert "1 grown (D02), 1 new (D05)" in said
    assert [z["id"] for z in numbers["zones"]] == ["Z1", "Z2", "Z3"]


def test_a_curve_survives_packing_within_half_a_step() -> None:
    x = np.arange(0, 500, 0.1)
    y = np.sin(x / 30)
    y[100:140] = np.nan
    at, back = unpack(pack(x, y, x.size))
    np.testing.assert_allclose(at, x, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(y))
    assert np.nanmax(np.abs(back - y)) <= 0.51 * (np.nanmax(y) - np.nanmin(y)) / 65534


@pytest.mark.parametrize("seed", range(5))
def test_thinning_keeps_every_planted_spike_and_every_gap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.arange(1_000_00) * 0.1
    y = rng.normal(0, 0.01, x.size)
    spikes = rng.choice(x.size // 100, 20, replace=False) * 100 + 50
    y[spikes] += 0.4 * rng.choice([-1, 1], 20)
    y[50_000:50_010] = np.nan
    keep = thinned(x, y, 5000)
    assert keep.size < 5100
    assert set(spikes[np.isfinite(y[spikes])]) <= set(keep)
    assert np.isnan(y[keep]).any()


def test_numbers_for_people_carry_units_signs_and_dashes_for_nothing() -> None:
    assert number(1234.5, 1, "m") == "1\u202f234.5\u00a0m"
    assert number(-0.5, 1) == "\u22120.5"
    assert number(np.nan) == "–"
    assert with_sigma(0.8, 0.08, 2, "m") == "0.80 ± 0.08\u00a0m"
    assert microstrain(1.45e-4, 2e-5) == "145 ± 20\u00a0µε"
    assert percent(1.0) == "> 99.9 %"


def test_the_workbook_has_its_sheets_units_filters_and_clock(small: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.load_workbook(write_report(small, ("xlsx",))["xlsx"])
    assert book.sheetnames == ["Summary", "Joints", "Zones", "Dents", "Trends", "Unmatched", "Quality", "Parameters"]
    for name in book.sheetnames[1:]:
        assert book[name].freeze_panes == "B3"
        assert book[name].auto_filter.ref
    dents = pd.read_excel(small / "report" / "report.xlsx", sheet_name="Dents", header=1)
    assert dents["Orientation [h:mm]"].iloc[0] == "5:44"
    assert dents["Depth [mm]"].iloc[0] == pytest.approx(7.1)
    assert dents["Depth of OD [%]"].iloc[0] == pytest.approx(100 * 0.0071 / OD)


def test_a_text_that_looks_like_a_formula_stays_text(small: Path, tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    shutil.copytree(small, tmp_path / "copy")
    zones = store.read_table(tmp_path / "copy" / "tables" / "zones.csv", "zones")
    zones.loc[0, "reasons"] = "=1+1"
    store.write_table(zones, tmp_path / "copy" / "tables" / "zones.csv", "zones")
    book = openpyxl.load_workbook(write_report(tmp_path / "copy", ("xlsx",))["xlsx"])
    assert any(cell.value == "=1+1" and cell.data_type == "s" for row in book["Zones"].iter_rows() for cell in row)


def test_the_geopackage_reads_back_with_every_layer_and_the_chosen_system(small: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    geopandas = pytest.importorskip("geopandas")
    path = write_report(small, ("gpkg",))["gpkg"]
    layers = {name for name, _ in pyogrio.list_layers(path)}
    assert {
        "centreline_demo-2019",
        "centreline_demo-2021",
        "centreline_demo-2023",
        "zones",
        "dents",
        "welds",
        "markers",
    } <= layers
    path = write_report(small, ("gpkg",), ReportOptions(crs="utm"))["gpkg"]
    line = geopandas.read_file(path, layer="centreline_demo-2019")
    assert line.crs.to_epsg() == 32610
    assert line.length.iloc[0] == pytest.approx(4000, rel=0.01)
    dents = geopandas.read_file(path, layer="dents")
    assert dents.distance(line.geometry.iloc[0]).max() < 2.0
    with pytest.raises(OptionError, match="not a coordinate system"):
        write_report(small, ("gpkg",), ReportOptions(crs="EPSG:banana"))


def test_the_kml_is_well_formed_and_escaped(small: Path) -> None:
    pytest.importorskip("geopandas")
    write_report(small, ("gpkg",))
    root = ElementTree.parse(small / "gis" / "demo.kml").getroot()
    names = [e.text for e in root.iter("{http://www.opengis.net/kml/2.2}name")]
    assert "V01 <b>&" in names
    first = next(root.iter("{http://www.opengis.net/kml/2.2}coordinates")).text
    longitude, latitude, _ = (float(v) for v in (first or "").split()[0].split(","))
    assert longitude == pytest.approx(-121.28, abs=0.01)
    assert latitude == pytest.approx(61.04, abs=0.01)


def test_the_printed_report_is_complete(tmp_path: Path) -> None:
    pytest.importorskip("weasyprint")
    folder = write_folder(tmp_path, length_m=1000.0, step_m=0.5, caliper=False)
    pdf = write_report(folder, ("pdf",))["pdf"].read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert b"%%EOF" in pdf[-2048:]


def test_a_window_of_the_wall_holds_only_its_scans(surveyed: Path) -> None:
    window = wall_window(read_content(surveyed), "demo-2019", 1391.8, 0.3)
    assert window is not None
    assert abs(window["chainage"].values - 1391.8).max() <= 0.3
    assert window["radius"].values.min() == pytest.approx(OD / 2 - WALL - 0.0078, abs=0.001)
    assert wall_window(read_content(surveyed), "demo-2019", 700.0, 0.3) is None


def test_thousands_of_dents_are_listed_and_a_few_are_drawn(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path / "copy")
    table = store.read_table(tmp_path / "copy" / "tables" / "dents.csv", "dents")
    copies = [table.assign(dent_id=table.dent_id + f"-{i}", run_chainage_m=table.run_chainage_m + 0.5) for i in range(300)]
    many = pd.concat(copies)
    store.write_table(many, tmp_path / "copy" / "tables" / "dents.csv", "dents")
    page = write_report(tmp_path / "copy", options=ReportOptions(most_dent_cards=2))["html"]
    assert page.stat().st_size < 30e6
    text = page.read_text(encoding="utf-8")
    assert text.count('<article class="card"') == 2
    assert "1198 further dents" in text


def test_an_absent_or_broken_table_is_named_on_the_page(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path / "copy")
    (tmp_path / "copy" / "tables" / "trends.csv").unlink()
    (tmp_path / "copy" / "survey.json").write_text("{broken")
    (tmp_path / "copy" / "comparison.nc").write_bytes(b"nothing")
    text = write_report(tmp_path / "copy", options=ReportOptions(most_dent_cards=0))["html"].read_text(encoding="utf-8")
    for name in ("tables/trends.csv", "survey.json", "comparison.nc"):
        assert f"<code>{name}</code>" in text


def test_a_listing_says_what_it_cannot_tell(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, length_m=500.0, listing=True)
    text = write_report(folder)["html"].read_text(encoding="utf-8")
    assert "made of a vendor listing" in text
    assert "no curvature, bending strain or movement" in text
    assert "copied forward by the vendor" in text


def test_a_folder_without_runs_or_rights_is_refused_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no readable run"):
        write_report(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        write_report(tmp_path / "nowhere")
    with pytest.raises(OptionError, match="docx"):
        write_report(tmp_path, ("docx",))
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        write_report(tmp_path)


def test_one_run_is_described_as_it_is_and_no_change_is_claimed(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, runs=("only",), length_m=800.0, step_m=0.5)
    said = " ".join(build_context(read_content(folder), ReportOptions())["verdict"])
    assert "Change needs a second run" in said
    assert "Largest bending strain" in said
    assert "grown" not in said
    text = write_report(folder)["html"].read_text(encoding="utf-8")
    assert "One run: no change can be formed." in text


def test_a_comparison_without_movement_is_not_called_stable(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, length_m=500.0, step_m=1.0, zones=False)
    ds = store.read_dataset(folder / "comparison.nc")
    store.write_dataset(ds[["run_chainage"]], folder / "comparison.nc", "comparison")
    said = " ".join(build_context(read_content(folder), ReportOptions())["verdict"])
    assert "movement cannot be judged" in said
    assert "No zone" not in said


def test_progress_rises_to_one(small: Path) -> None:
    seen: list[float] = []
    write_report(small, ("xlsx",), progress=seen.append)
    assert seen[-1] == 1.0
