"""A raw run folder is read as it stands, or refused with every fault named."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.readers.raw_folder import read_raw_folder
from deform.readers.reader import read_source
from deform.run.raw import RawRun
from tests.readers import tiny_run as tiny


def test_a_sound_run_is_read_without_a_repair(raw_run):
    raw = read_raw_folder(raw_run())
    assert raw.repairs == ()
    assert raw.id == "tiny"
    assert raw.imu.sizes == {"sample": 2000, "axis": 3}
    assert raw.imu["gyro_count"].dtype == np.int32
    assert raw.imu.attrs == {"gyro_pulse_rad": tiny.GYRO_PULSE, "accel_pulse_m_per_s": tiny.ACCEL_PULSE}
    assert raw.odometer.attrs["pulse_m"] == tiny.PULSE_M
    np.testing.assert_array_equal(raw.odometer["count"], tiny.odometer()["count"])
    np.testing.assert_array_equal(raw.weld_events["time"], [12.5, 17.5, 25.0])
    assert list(raw.passages["kind"].values) == ["launcher", "agm", "receiver"]
    assert set(raw.hashes) == {"run.toml", "imu.nc", "odometer.nc", "caliper.nc", "welds.csv", "markers.csv"}


def test_arms_stay_packed_on_disk_and_are_read_in_blocks(raw_run):
    arms = read_raw_folder(raw_run()).arms
    assert arms["radius"].dtype == np.uint16
    assert not arms["radius"].variable._in_memory
    block = arms["radius"][10:20].values * arms["radius"].attrs["scale_factor"] + arms["radius"].attrs["add_offset"]
    np.testing.assert_allclose(block, tiny.INNER_RADIUS, atol=5e-5)
    assert not arms["radius"].variable._in_memory, "a block that was read must not be kept"


def test_caliper_welds_and_markers_may_be_absent(raw_run):
    header = tiny.HEADER.split("[caliper]")[0]
    raw = read_raw_folder(raw_run(caliper=None, welds=None, markers=None, header=header))
    assert raw.arms is None
    assert raw.weld_events is None
    assert raw.passages is None
    assert raw.repairs == ()


def test_two_rings_are_read_with_their_offsets(raw_run):
    caliper = tiny.caliper()
    caliper = caliper.drop_vars("radius").assign(radius=caliper["radius"].expand_dims(ring=2).transpose("scan", "ring", "arm"))
    header = tiny.HEADER.replace("[-0.6]", "[-0.6, -0.9]")
    raw = read_raw_folder(raw_run(caliper=caliper, header=header))
    assert raw.arms["radius"].dims == ("scan", "ring", "arm")
    assert raw.header.caliper.ring_offset_m == (-0.6, -0.9)


def test_all_faults_of_all_files_are_raised_together(raw_run):
    odometer = tiny.odometer()
    odometer["count"][500:, 1] = 7
    header = tiny.HEADER.replace('direction = "downstream"', 'direction = "forward"').replace("wheels = 2", "wheels = 0")
    markers = tiny.markers()
    markers[1][1] = "cairn"
    with pytest.raises(InputError) as caught:
        read_raw_folder(raw_run(imu=None, odometer=odometer, header=header, markers=markers))
    told = str(caught.value)
    assert len(caught.value.faults) == 5, told
    for part in ("direction", "wheels", "imu.nc: no such file", "count, wheel 2: falls from", "'cairn'"):
        assert part in told


def test_survey_names_and_dates_a_run(raw_run):
    raw = read_source(raw_run(), run_id="A", date="2021-03-04")
    assert isinstance(raw, RawRun)
    assert (raw.id, raw.header.run.date.isoformat()) == ("A", "2021-03-04")
    assert any("2021-03-04" in repair for repair in raw.repairs)


def test_demonstration_runs_are_read_without_a_repair(demo):
    for name in ("demo-2019", "demo-2021", "demo-2023"):
        raw = read_source(demo / name)
        assert raw.repairs == ()
        assert raw.arms.sizes["arm"] == 24
        assert raw.passages.sizes["marker"] == 6
        assert raw.weld_events.sizes["event"] > 300


def test_an_unheard_marker_has_no_time(demo):
    raw = read_source(demo / "demo-2021")
    time = raw.passages["time"].values
    assert np.isnan(time[list(raw.passages["name"].values).index("AGM02")])
    assert np.isfinite(time).sum() == 5
