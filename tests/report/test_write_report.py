"""The documents as files: complete, self-contained, escaped, readable by others, and honest about what is absent."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from deform.errors import InputError, OptionError
from deform.options import ReportOptions
from deform.report import write_report
from deform.report.content import read_content, wall_window
from deform.report.context import build_context
from deform.report.series import pack, thinned, unpack
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
    assert text.count('<details class="card" id="dent-') == 2
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


def test_a_folder_that_cannot_be_written_is_named_before_any_work(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)  # root may write everywhere
    with pytest.raises(InputError, match="cannot be written to") as caught:
        write_report(small, ("html",))
    assert str(small) in str(caught.value)


def test_one_run_is_described_as_it_is_and_no_change_is_claimed(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, runs=("only",), length_m=800.0, step_m=0.5)
    said = " ".join(build_context(read_content(folder), ReportOptions())["verdict"])
    assert "Change needs a second run" in said
    assert "Largest bending strain outside bends" in said
    assert "grown" not in said
    text = write_report(folder)["html"].read_text(encoding="utf-8")
    assert "One run alone shows shape and strain as they are" in text
    assert 'id="zones"' not in text
    assert text.index('id="runs"') < text.index('id="line"')  # the inventory is what one run has to say


def test_a_comparison_without_movement_is_not_called_stable(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, length_m=500.0, step_m=1.0, zones=False)
    ds = store.read_dataset(folder / "comparison.nc")
    store.write_dataset(ds[["run_chainage"]], folder / "comparison.nc", "comparison")
    said = " ".join(build_context(read_content(folder), ReportOptions())["verdict"])
    assert "Movement cannot be judged" in said
    assert "No zone" not in said


def test_a_dent_measured_once_is_not_called_stable(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path / "copy")
    table = store.read_table(small / "tables" / "dents.csv", "dents")
    once = table[table.dent_id == "D01"].iloc[:1].assign(status="stable", depth_change_m=np.nan)
    store.write_table(once, tmp_path / "copy" / "tables" / "dents.csv", "dents")
    dents = build_context(read_content(tmp_path / "copy"), ReportOptions())["dents"]
    assert [dent["status"] for dent in dents] == ["first measured"]


def test_progress_rises_to_one(small: Path) -> None:
    seen: list[float] = []
    write_report(small, ("xlsx",), progress=seen.append)
    assert seen[-1] == 1.0
