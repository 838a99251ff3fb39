"""Numbers for people: one table of quantities rules page, print, workbook and map, and nothing is rounded anywhere else."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from deform.errors import OptionError
from deform.options import ReportOptions
from deform.report import write_report
from deform.report.content import read_content
from deform.report.context import build_context
from deform.report.findings import joined_welds
from deform.report.quality import frame_rows
from deform.report.quantities import QUANTITIES, column, heading, measure
from deform.report.words import compass, count, month, number, percent, sentence
from deform.run import store
from tests.report.fabricate import write_folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_folder(tmp_path_factory.mktemp("numbers"), step_m=1.0)
    write_report(folder, ("html", "xlsx"), ReportOptions(most_dent_cards=0))
    return folder


def test_numbers_carry_signs_thin_spaces_and_a_dash_for_nothing() -> None:
    assert number(1234.5, 1, "m") == "1\u202f234.5\u00a0m"
    assert number(-0.5, 1) == "\u22120.5"
    assert number(np.nan) == number(None) == "–"


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert number(-0.004, 2, sign=True) == "0.00"
    assert str(measure("dent depth change", -1.5e-5, 3e-4)) == "0.0 ± 0.3\u00a0mm"


def test_a_measure_prints_value_sigma_and_unit_and_is_false_when_unknown() -> None:
    assert str(measure("strain", 1.45e-4, 2e-5)) == "145 ± 20\u00a0µε"
    assert str(measure("displacement", 0.8)) == "0.80\u00a0m"
    assert str(measure("strain", None, 2e-5)) == "–"
    assert not measure("strain", np.nan)
    assert measure("displacement", 0.0, 0.01)  # zero is known


def test_a_quantity_that_is_not_in_the_table_is_refused_with_the_known_ones() -> None:
    with pytest.raises(OptionError, match="dent depth"):
        measure("dent deepness", 1.0)


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_workbook_cell_is_formatted_with_the_decimals_of_the_text(name: str) -> None:
    of = QUANTITIES[name]
    value = 1.23456789 / of.factor
    decimals = len(of.excel.partition(".")[2])
    assert decimals == of.decimals
    shown = measure(name, value).number.replace("\u202f", "").lstrip("+")
    assert float(shown) == pytest.approx(column(name, [value])[0], abs=1e-12)


def test_a_probability_is_never_certain_and_never_impossible() -> None:
    assert percent(1.0) == "> 99.9\u00a0%"
    assert percent(0.0) == "< 0.1\u00a0%"
    assert percent(0.42) == "42\u00a0%"
    assert percent(np.nan) == "–"


def test_words_of_directions_dates_and_counts() -> None:
    assert compass(260.9) == "261° (west)"
    assert compass(-1.0) == "359° (north)"
    assert month("2024-11-17") == "Nov\u00a02024"
    assert month("") == "–"
    assert count(1, "stretch", "stretches") == "1 stretch"
    assert sentence("moved; ") == "Moved"


def test_places_in_further_tables_keep_their_centimetres_and_sigmas_their_digits() -> None:
    frame = pd.DataFrame({"start_m": [0.0, 17384.2], "noise_sigma_m": [0.004, 0.0137], "evidence_nats": [12.3456, 17384.2]})
    assert frame_rows("stretches", frame)["rows"] == [
        ["0.00", "0.004", "12.35"],
        ["17\u202f384.20", "0.0137", "17\u202f384"],
    ]


def test_the_deepest_dent_is_named_with_the_depth_that_was_compared(small: Path, tmp_path: Path) -> None:
    """D02 stood deepest, but was re-rounded, then not measured; another, deeper one, was cut out."""
    shutil.copytree(small, tmp_path / "copy")
    table = store.read_table(small / "tables" / "dents.csv", "dents")
    table.loc[(table.dent_id == "D02") & (table.run == "demo-2019"), "depth_m"] = 0.0300
    table.loc[(table.dent_id == "D02") & (table.run == "demo-2021"), "depth_m"] = 0.0140
    table.loc[(table.dent_id == "D02") & (table.run == "demo-2023"), ["depth_m", "status"]] = [np.nan, "unmeasured"]
    gone = table.dent_id == "D01"
    table.loc[gone, "depth_m"] = 0.0200
    table.loc[gone & (table.run == "demo-2023"), ["depth_m", "status"]] = [np.nan, "removed"]
    store.write_table(table, tmp_path / "copy" / "tables" / "dents.csv", "dents")
    numbers = build_context(read_content(tmp_path / "copy"), ReportOptions())
    assert "the deepest is D02, 14.0 ± 0.4\u00a0mm (4.3\u00a0% OD) in demo-2021." in " ".join(numbers["verdict"])
    last = numbers["dents"][-1]
    assert (last["id"], last["status"], str(last["depth"])) == ("D01", "removed", "20.0 ± 0.4\u00a0mm")


def test_a_false_weld_is_not_counted_among_the_known(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path / "copy")
    table = store.read_table(small / "tables" / "welds.csv", "welds")
    known = joined_welds(read_content(small))
    false = table.iloc[[0]].assign(weld_id="W99999", status="false")
    store.write_table(pd.concat([table, false]), tmp_path / "copy" / "tables" / "welds.csv", "welds")
    assert joined_welds(read_content(tmp_path / "copy")) == known


def test_page_workbook_and_map_show_the_same_numbers_of_a_zone(small: Path) -> None:
    zone = build_context(read_content(small), ReportOptions())["zones"][0]
    assert str(zone["displacement"]) == "0.81 ± 0.08\u00a0m"
    row = re.search(r'<tbody id="zone-Z1">.*?</tr>', (small / "report" / "index.html").read_text(encoding="utf-8"), re.S)
    assert row is not None
    assert re.search(r">0\.81<i>± 0\.08</i>", row[0])
    sheet = pd.read_excel(small / "report" / "report.xlsx", sheet_name="Zones", header=1).set_index("Zone").loc["Z1"]
    assert sheet[heading("Peak displacement", "displacement")] == 0.81
    assert sheet[heading("Peak displacement ± 1σ", "displacement")] == 0.08
    assert sheet[heading("Peak strain change", "strain")] == round(zone["strain"].value * 1e6)
    geopandas = pytest.importorskip("geopandas")
    layer = geopandas.read_file(write_report(small, ("gpkg",))["gpkg"], layer="zones").set_index("id").loc["Z1"]
    assert layer.displacement_m == 0.81
    assert layer.strain_change_microstrain == round(zone["strain"].value * 1e6)


def test_page_workbook_and_map_show_the_same_numbers_of_a_dent(small: Path) -> None:
    dent = next(d for d in build_context(read_content(small), ReportOptions())["dents"] if d["id"] == "D02")
    assert str(dent["depth"]) == "14.6 ± 0.4\u00a0mm"
    sheet = pd.read_excel(small / "report" / "report.xlsx", sheet_name="Dents", header=1)
    last = sheet[(sheet.Dent == "D02") & (sheet.Run == "demo-2023")].iloc[0]
    assert last[heading("Depth", "dent depth")] == 14.6
    assert last[heading("Depth", "dent depth share")] == 4.5
    geopandas = pytest.importorskip("geopandas")
    layer = geopandas.read_file(write_report(small, ("gpkg",))["gpkg"], layer="dents")
    point = layer[(layer.id == "D02") & (layer.run == "demo-2023")].iloc[0]
    assert (point.depth_mm, point.depth_percent_of_od, point.strain_percent) == (14.6, 4.5, 1.2)
    assert point.clock == dent["clock"]


def test_the_verdict_names_movement_rate_joints_and_the_grown_dent(small: Path) -> None:
    numbers = build_context(read_content(small), ReportOptions())
    said = " ".join(numbers["verdict"])
    assert "2 zones moved or bent" in said
    assert "0.81 ± 0.08" in said
    assert "Z1 goes on: displacement +200 ± 10\u00a0mm/a, reaches 1.00\u00a0m about Jul\u00a02024" in said
    assert "1 grown (D02), 1 new (D05)" in said
    assert "Joint lengths: 0 of" in said
    assert [z["id"] for z in numbers["zones"]] == ["Z1", "Z2", "Z3"]
    assert [z["severity"] for z in numbers["zones"]] == ["high", "medium", "construction"]


def test_joints_beyond_the_threshold_are_counted_against_chance(small: Path, tmp_path: Path) -> None:
    write_folder(tmp_path, length_m=1500.0, step_m=1.0, caliper=False)
    joints = store.read_table(tmp_path / "tables" / "joints.csv", "joints")
    joints.loc[7, "change_m:demo-2023"] = 0.05
    store.write_table(joints, tmp_path / "tables" / "joints.csv", "joints")
    said = " ".join(build_context(read_content(tmp_path), ReportOptions())["verdict"])
    assert re.search(r"Joint lengths: 1 of \d+ joints differ from demo-2019 by more than 3 sigma in demo-2023", said)
    assert "Largest: +50.0 ± 10.0\u00a0mm in J00008" in said


def test_the_smallest_movement_that_could_be_seen_stands_beside_the_findings(small: Path) -> None:
    facts = {f["name"]: f["value"] for f in build_context(read_content(small), ReportOptions())["facts"]}
    assert facts["smallest movement seen"] == "38.8\u00a0mm"  # nine of ten, near sixty metres, the worse component


def test_a_headline_is_one_line_and_reservations_come_before_rates(small: Path) -> None:
    numbers = build_context(read_content(small), ReportOptions())
    dent = next(d for d in numbers["dents"] if d["id"] == "D02")
    assert dent["headline"] == "Three epochs only"  # the rate carries a reservation, so it is not announced
    assert all(";" not in row["headline"] for row in (*numbers["zones"], *numbers["dents"]))
