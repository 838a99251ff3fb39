"""The workbook: sheets in the wording of a pipe tally, units in the heads, filters, no formula from a label, and two readers."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from deform.report import write_report
from deform.run import store
from tests.report.fabricate import OD, write_folder

openpyxl = pytest.importorskip("openpyxl")
SHEETS = ["Summary", "Joints", "Zones", "Dents", "Trends", "Unmatched", "Features", "Limits", "Quality", "Parameters"]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_folder(tmp_path_factory.mktemp("workbook"), step_m=1.0, caliper=False)
    write_report(folder, ("xlsx",))
    return folder


def _sheet(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_excel(folder / "report" / "report.xlsx", sheet_name=name, header=1)


def test_every_sheet_has_a_frozen_head_and_a_filter(small: Path) -> None:
    book = openpyxl.load_workbook(small / "report" / "report.xlsx")
    assert book.sheetnames == SHEETS
    for name in SHEETS[1:]:
        assert book[name].freeze_panes == "B3"
        assert book[name].auto_filter.ref
        assert book[name]["A1"].value  # what the sheet shows


def test_dents_carry_units_and_the_clock_of_a_tally(small: Path) -> None:
    dents = _sheet(small, "Dents")
    assert dents["Orientation [h:mm]"].iloc[0] == "5:44"
    assert dents["Depth [mm]"].iloc[0] == 7.1
    assert dents["Depth [% OD]"].iloc[0] == round(100 * 0.0071 / OD, 1)


def test_the_tally_has_a_row_per_joint_with_lengths_changes_and_dents(small: Path) -> None:
    joints = _sheet(small, "Joints")
    table = store.read_table(small / "tables" / "joints.csv", "joints")
    assert list(joints["Joint number"]) == list(table.joint_id)
    assert (joints["Length change demo-2023 [mm]"] == 4.0).all()
    assert (joints["Length change ± 1σ demo-2023 [mm]"] == 10.0).all()
    assert set(joints.Dents.dropna()) == {"D01", "D02", "D03", "D05"}


def test_limits_and_quality_are_tables_and_not_sentences(small: Path) -> None:
    limits = _sheet(small, "Limits")
    floor = limits[limits["Length of movement [m]"].isna()]
    assert list(floor["Noise floor, 1σ"]) == [12.1, 20.4]
    assert list(floor["Unit of the floor"]) == ["mm", "µε"]
    axial = limits[limits.Component == "axial"].iloc[0]
    assert axial["Elongation found in half of all cases [mm]"] == 12.0
    assert axial["Its axial strain [µε]"] == 200.0
    quality = _sheet(small, "Quality")
    assert set(quality.What) == {"Warning", "Sensors", "Marker", "Stage"}
    assert quality[quality.What == "Marker"].Item.str.startswith("AGM").any()


def test_a_text_that_looks_like_a_formula_stays_text(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path / "copy")
    zones = store.read_table(tmp_path / "copy" / "tables" / "zones.csv", "zones")
    zones.loc[0, "reasons"] = "=1+1"
    store.write_table(zones, tmp_path / "copy" / "tables" / "zones.csv", "zones")
    book = openpyxl.load_workbook(write_report(tmp_path / "copy", ("xlsx",))["xlsx"])
    cells = [cell for row in book["Zones"].iter_rows() for cell in row if cell.value == "=1+1"]
    assert [cell.data_type for cell in cells] == ["s"]


@pytest.mark.parametrize(
    "what",
    [{"zones": False, "dents": False}, {"runs": ("only",)}, {"listing": True}],
    ids=["nothing found", "one run", "listings"],
)
def test_poorer_folders_keep_all_sheets(tmp_path: Path, what: dict) -> None:
    folder = write_folder(tmp_path, length_m=300.0, step_m=1.0, caliper=False, **what)
    assert openpyxl.load_workbook(write_report(folder, ("xlsx",))["xlsx"]).sheetnames == SHEETS


def test_libreoffice_opens_it_and_finds_every_sheet(small: Path, tmp_path: Path) -> None:
    office = shutil.which("soffice") or shutil.which("libreoffice")
    if office is None:
        pytest.skip("no LibreOffice on this machine: it is too heavy to be installed for this one test")
    profile = f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}"
    command = [
        office,
        profile,
        "--headless",
        "--convert-to",
        "ods",
        "--outdir",
        str(tmp_path),
        str(small / "report" / "report.xlsx"),
    ]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    assert "repair" not in (result.stdout + result.stderr).lower()
    sheets = pd.read_excel(tmp_path / "report.ods", sheet_name=None, header=1, engine="calamine")
    assert list(sheets) == SHEETS
    assert list(sheets["Dents"]["Orientation [h:mm]"][:2]) == list(_sheet(small, "Dents")["Orientation [h:mm]"][:2])
