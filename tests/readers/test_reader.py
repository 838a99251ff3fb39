"""Which reader knows what: each format by its own reader, and no format by another one."""

from __future__ import annotations

import datetime
import json
import shutil

import numpy as np
import pytest
import xarray as xr

from deform.errors import InputError, UnknownFormatError
from deform.readers.reader import Request, read_source, readers, recognise, scan
from deform.run import build, store
from tests.readers import small_listing as small

SHIPPED = {
    "rosen": ["J. no.", "J. len [ft]", "t [in]", "log dist. [ft]", "event", "comment"],
    "baker-hughes": ["J. no.", "J. len [ft]", "Wt [in]", "Log Dist. [ft]", "Event Description", "Comments"],
    "infotech": ["DistOd", "TypeObject", "ObjectName", "Object_Code_T", "OrientTD", "Comments"],
}


def listing_in_the_header_of(name: str) -> str:
    weld = {"rosen": "Girth Weld", "baker-hughes": "GirthWeld", "infotech": "Шов"}[name]
    rows = []
    for i in range(4):
        feet = 40.0 * i
        row = [str(10 * i), "40.0", "0.344", str(feet), weld, ""]
        rows.append(row if name != "infotech" else [str(int(feet * 304.8)), "0", "", weld, "", ""])
    mark = ";" if name == "infotech" else ","
    return "\n".join(mark.join(r) for r in [SHIPPED[name], *rows])


@pytest.fixture
def sources(tmp_path, raw_run):
    """Return one source of each format, and the reader that must know it."""
    found = {"raw_folder": (raw_run(), "raw_folder")}
    for name in SHIPPED:
        (tmp_path / f"{name}.csv").write_text(listing_in_the_header_of(name), encoding="utf-8")
        found[name] = (tmp_path / f"{name}.csv", "tally")
    run = read_source(small.write(tmp_path), small.write_map(tmp_path), date=datetime.date(2015, 5, 1))
    found["run"] = (store.write_run(run, tmp_path / "run.nc"), "stored")
    values = {"epoch": ["a", "b"], "chainage": [0.0, 0.1], "run_chainage": np.zeros((2, 2))}
    comparison = build.dataset("comparison", values, reference="a")
    found["comparison"] = (store.write_dataset(comparison, tmp_path / "comparison.nc", "comparison"), "stored")
    return found


@pytest.fixture
def strangers(tmp_path):
    """Return files and folders of no format."""
    (tmp_path / "empty folder").mkdir()
    (tmp_path / "notes.txt").write_text("the pig was late\nand wet\n", encoding="utf-8")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    (tmp_path / "nothing.csv").write_text("", encoding="utf-8")
    (tmp_path / "control.csv").write_text("name,latitude_deg,longitude_deg,height_m\nA,61,-121,3\n", encoding="utf-8")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    (tmp_path / "broken.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    xr.Dataset({"x": ("t", [1.0])}).to_netcdf(tmp_path / "weather.nc")
    names = ("empty folder", "notes.txt", "other.csv", "nothing.csv", "control.csv", "picture.png", "broken.nc", "weather.nc")
    return [tmp_path / name for name in names]


def test_each_format_is_known_by_its_own_reader_and_by_no_other(sources):
    for name, (path, wanted) in sources.items():
        answers = {n: reader.recognise(Request(path)) for n, reader in readers().items()}
        assert [n for n, refusal in answers.items() if not refusal] == [wanted], (name, answers)
        assert recognise(path).name == wanted


def test_a_shipped_map_is_found_by_the_header_of_the_listing(sources):
    for name in SHIPPED:
        run = read_source(sources[name][0], date="2015-05-01")
        assert run.attrs["column_map"] == name
        assert run["welds"].sizes["weld"] == 4
        np.testing.assert_allclose(run["welds"]["chainage"], 12.192 * np.arange(4), atol=1e-3)


def test_a_stranger_is_refused_with_what_was_tried_and_why(strangers):
    for path in strangers:
        for reader in readers().values():
            assert reader.recognise(Request(path)), (path, reader.name)
        with pytest.raises(UnknownFormatError) as caught:
            read_source(path)
        told = str(caught.value)
        assert path.name in told
        for name in ("raw_folder: ", "stored: ", "tally: "):
            assert name in told, told


def test_a_refusal_says_which_columns_a_shipped_map_misses(strangers):
    with pytest.raises(UnknownFormatError, match=r"rosen lacks 'log dist\. \[ft\]', 'event'"):
        read_source(strangers[2])


def test_a_missing_path_is_an_input_error(tmp_path):
    for call in (read_source, scan, recognise):
        with pytest.raises(InputError, match="no such file or folder"):
            call(tmp_path / "nowhere")


def test_a_date_that_is_none_is_named(tmp_path):
    with pytest.raises(InputError, match=r"is 'May 2015'; wanted an ISO date"):
        read_source(small.write(tmp_path), small.write_map(tmp_path), date="May 2015")


def test_every_source_has_a_summary_that_is_json(sources):
    for path, _ in sources.values():
        found = scan(path)
        assert json.loads(json.dumps(found.summary)) == found.summary
    assert scan(sources["raw_folder"][0]).summary["imu.nc"] == {"sample": 2000, "axis": 3, "from_s": 0.02, "to_s": 40.0}
    assert scan(sources["rosen"][0]).summary["kinds"] == {"weld": 4}
    assert scan(sources["run"][0]).summary["groups"]["welds"]["weld"] == 4
    assert scan(sources["comparison"][0]).summary["epochs"] == ["a", "b"]


def test_a_broken_raw_folder_still_has_a_summary_that_says_so(raw_run):
    folder = raw_run(odometer=None)
    (folder / "imu.nc").write_bytes(b"no")
    found = scan(folder)
    assert found.summary["id"] == "tiny"
    assert any("imu.nc: cannot be opened" in r for r in found.remarks)


def test_a_stored_run_is_read_back_under_another_name(sources):
    run = read_source(sources["run"][0], run_id="again", date="2016-01-01")
    assert (run.attrs["id"], run.attrs["date"]) == ("again", "2016-01-01")
    with pytest.raises(InputError, match="is a comparison, not a run"):
        read_source(sources["comparison"][0])


def test_a_reader_that_cannot_be_loaded_does_not_stop_the_others(monkeypatch, sources):
    from importlib.metadata import EntryPoint

    import deform.readers.reader as reader

    foreign = EntryPoint("foreign", "no_such_package.module:Reader", reader.GROUP)
    monkeypatch.setattr(reader, "entry_points", lambda group: [foreign])
    readers.cache_clear()
    try:
        assert set(readers()) == {"raw_folder", "stored", "tally"}
    finally:
        readers.cache_clear()


def test_readers_are_declared_as_entry_points():
    from importlib.metadata import entry_points

    declared = {e.name: e.value for e in entry_points(group="deform.readers")}
    assert declared["raw_folder"] == "deform.readers.raw_folder:RawFolderReader"
    assert declared["tally"] == "deform.readers.tally:TallyReader"


def test_a_raw_folder_is_known_by_any_file_that_it_needs(raw_run):
    folder = raw_run()
    for name in ("run.toml", "imu.nc"):
        shutil.move(folder / name, folder / f"{name}.away")
        assert recognise(folder).name == "raw_folder"
