"""What is wrong with weld events and markers of a raw run is refused by name, or repaired by a rule and recorded."""

from __future__ import annotations

import numpy as np
import pytest

from deform.readers.raw_folder import read_raw_folder
from tests.readers import tiny_run as tiny
from tests.readers.raw_faults import refused

# ---- weld events -----------------------------------------------------------------------------------------


def test_weld_events_are_sorted_and_once(raw_run):
    raw = read_raw_folder(raw_run(welds=[["17.5", "0.8"], ["12.5", "1.0"], ["17.5", "0.8"], ["25.0", ""], ["", "1.0"]]))
    np.testing.assert_array_equal(raw.weld_events["time"], [12.5, 17.5, 25.0])
    np.testing.assert_array_equal(raw.weld_events["amplitude"], [1.0, 0.8, np.nan])
    assert [word for r in raw.repairs for word in ("empty", "not in order", "twice") if word in r] == [
        "empty",
        "not in order",
        "twice",
    ]


def test_weld_events_outside_the_recording_are_left_out(raw_run):
    raw = read_raw_folder(raw_run(welds=[["12.5", "1"], ["17.5", "1"], ["4000", "1"]]))
    assert raw.weld_events.sizes["event"] == 2
    assert "1 of 3 events lie outside the recording" in raw.repairs[0]


def test_weld_events_of_another_clock_are_refused(raw_run):
    assert "3 of 3 events lie outside" in refused(raw_run(welds=[["12500", "1"], ["17500", "1"], ["25000", "1"]]))


def test_a_weld_event_that_is_no_number_is_named_by_its_line(raw_run):
    assert "welds.csv: time_s, line 3: is '17,5', wanted a number" in refused(raw_run(welds=[["12.5", "1"], ['"17,5"', "1"]]))


def test_a_missing_column_is_named(raw_run):
    folder = raw_run()
    tiny.write_csv(folder / "welds.csv", ["t", "amplitude"], tiny.WELDS)
    assert "welds.csv: time_s: column missing; the file holds t, amplitude" in refused(folder)


def test_a_weld_file_without_events_gives_none(raw_run):
    raw = read_raw_folder(raw_run(welds=[]))
    assert raw.weld_events is None
    assert "holds no weld event" in raw.repairs[0]


# ---- markers ---------------------------------------------------------------------------------------------


def markers_with(row: int, column: str, value) -> list[list]:
    rows = tiny.markers()
    rows[row][tiny.MARKER_HEADER.index(column)] = value
    return rows


@pytest.mark.parametrize(
    ("column", "value", "told"),
    [
        ("kind", "cairn", "kind, line 3: is 'cairn', none of launcher, receiver, agm, valve"),
        ("latitude_deg", 91.0, "latitude_deg, line 3: is 91"),
        ("latitude_deg", "", "latitude_deg, line 3: is empty"),
        ("longitude_deg", -400.0, "longitude_deg, line 3: is -400"),
        ("height_m", 1e5, "height_m, line 3: is 100000"),
        ("time_s", "late", "time_s, line 3: is 'late', wanted a number"),
        ("sigma_horizontal_m", -0.3, "sigma_horizontal_m, line 3: is -0.3 m"),
    ],
)
def test_a_wrong_marker_is_refused_by_line_and_value(raw_run, column, value, told):
    assert told in refused(raw_run(markers=markers_with(1, column, value)))


@pytest.mark.parametrize(
    ("column", "value", "told"),
    [
        ("name", "", "called 'marker 2'"),
        ("name", "LAUNCHER", "called 'LAUNCHER (2)'"),
        ("sigma_horizontal_m", "", "is empty; 1 m is taken"),
        ("sigma_vertical_m", 0, "is 0 m; 0.001 m is taken"),
        ("time_s", 500.0, "taken as not heard"),
        ("time_s", 5.0, "is not after LAUNCHER"),
        ("latitude_deg", 61.1, "11.1 km from the launch, the tool ran 0.0 km; kept"),
    ],
)
def test_a_doubtful_marker_is_repaired_and_recorded(raw_run, column, value, told):
    raw = read_raw_folder(raw_run(markers=markers_with(1, column, value)))
    assert raw.passages.sizes["marker"] == 3
    assert len(raw.repairs) == 1
    assert told in raw.repairs[0]


def test_a_marker_on_another_continent_is_left_out(raw_run):
    raw = read_raw_folder(raw_run(markers=markers_with(1, "longitude_deg", 121.0)))
    assert list(raw.passages["name"].values) == ["LAUNCHER", "RECEIVER"]
    assert "left out" in raw.repairs[0]


def test_a_launch_on_another_continent_is_refused(raw_run):
    told = refused(raw_run(header=tiny.HEADER.replace("longitude_deg = -121.0", "longitude_deg = 121.0")))
    assert "3 of 3 markers lie far from the launch" in told
    assert "[launch] of run.toml" in told


def test_an_empty_row_of_markers_is_no_marker(raw_run):
    rows = tiny.markers()
    raw = read_raw_folder(raw_run(markers=[rows[0], [""] * 8, *rows[1:]]))
    assert raw.passages.sizes["marker"] == 3
    assert raw.repairs == ()


def test_an_empty_time_is_a_passage_not_heard(raw_run):
    raw = read_raw_folder(raw_run(markers=markers_with(1, "time_s", "")))
    np.testing.assert_array_equal(np.isfinite(raw.passages["time"]), [True, False, True])
    assert raw.repairs == ()
