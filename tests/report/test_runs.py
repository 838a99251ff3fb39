"""Every run by itself: inventory, geometry, bends, and the tables of its alignment after Porter 1990."""

from __future__ import annotations

from pathlib import Path

import pytest

from deform.report import write_report
from deform.report.alignment import alignment_tables
from deform.report.content import Content, read_content
from deform.report.runs import largest, run_reports
from tests.report.fabricate import write_folder


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> Content:
    return read_content(write_folder(tmp_path_factory.mktemp("runs"), step_m=1.0))


def test_the_inventory_counts_welds_joints_dents_and_every_kind_of_feature(content: Content) -> None:
    rows = {what: (n, remark) for what, n, remark in run_reports(content)[2]["inventory"]}
    welds = content.group("demo-2023", "welds")
    assert welds is not None
    assert rows["girth welds"][0] == str(int((welds["probability"] > 0.5).sum()))
    assert rows["dents"] == ("4", "deepest 14.6\u00a0mm (4.5\u00a0% OD) at 1\u202f392.36\u00a0m")
    assert rows["bend"] == ("2", "largest 90.00\u00a0° at 2\u202f210.0\u00a0m")
    assert rows["metal loss"] == ("1", "deepest 31\u00a0% of the wall at 2\u202f400.0\u00a0m")
    assert rows["valve"] == ("1", "at 1\u202f180.0 m")


def test_the_largest_strain_outside_bends_is_told_apart_from_that_in_them(content: Content) -> None:
    outside = largest(content, "demo-2019", "bending_strain", "strain")
    inside = largest(content, "demo-2019", "bending_strain", "strain", bends=True)
    assert outside is not None
    assert inside is not None
    assert inside[0].value > 10 * 0.0012  # 88 degree over four metres
    assert 2200 < inside[1].value < 2220 or 3040 < inside[1].value < 3060
    assert outside[0].value < inside[0].value
    assert not 2207 < outside[1].value < 2217


def test_bends_carry_both_components_radius_and_the_clock_of_their_tension(content: Content) -> None:
    bends = run_reports(content)[0]["bends"]
    assert [str(b["place"]) for b in bends] == ["600.0\u00a0m", "2\u202f210.0\u00a0m", "3\u202f050.0\u00a0m"]
    assert str(bends[2]["right"]) == "\u221288.00\u00a0°"
    assert bends[0]["clock"] == "3:00"


def test_the_tables_of_the_alignment_hold_every_run_with_sigma(content: Content) -> None:
    tables = {table["title"]: table for table in alignment_tables(content)}
    assert list(tables) == ["Gyro drift", "Accelerometer bias", "First alignment", "Odometer and mounting", "Fine alignment"]
    drift = dict(tables["Gyro drift"]["rows"])
    assert [str(cell) for cell in drift["demo-2021"]] == [
        f"+0.0{v}10 ± 0.0050\u00a0°/h" for v in (1, 2, 3)
    ]  # the last epoch, not the first
    assert str(dict(tables["Accelerometer bias"]["rows"])["demo-2019"][0]) == "+20.0 ± 5.0\u00a0µg"
    azimuth, pitch, roll = dict(tables["First alignment"]["rows"])["demo-2019"]
    assert (azimuth.value, pitch.value, roll.value) == (134.95, 0.5, -3.0)


def test_the_fine_alignment_compares_azimuths_of_the_pipe_at_the_trap(content: Content) -> None:
    table = next(t for t in alignment_tables(content) if t["title"] == "Fine alignment")
    first, after, change = dict(table["rows"])["demo-2019"]
    assert first.value == pytest.approx(134.95 + 0.1)  # body and mounting
    assert after.value == pytest.approx(135.0)
    assert change.value == pytest.approx(-0.05)


def test_a_listing_has_an_inventory_and_says_that_it_has_no_geometry(tmp_path: Path) -> None:
    text = write_report(write_folder(tmp_path, length_m=500.0, listing=True))["html"].read_text(encoding="utf-8")
    assert "No centreline: a listing without coordinates has no geometry of its own." in text
    assert "girth welds" in text
    assert "Alignment, drifts and biases" not in text


def test_slips_and_repairs_of_a_run_stand_on_the_quality_page(content: Content, tmp_path: Path) -> None:
    folder = write_folder(tmp_path, length_m=500.0, step_m=1.0, caliper=False)
    text = write_report(folder)["html"].read_text(encoding="utf-8")
    assert "2 slips repaired, 0.41 m of wheel travel lost in them; odometer wheel 2: 3 slips filled" in text
    assert "no caliper" in text
