"""What is wrong with the files, the clocks or the header of a raw run is refused by name, or repaired by a rule and recorded."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from deform.readers.raw_folder import read_raw_folder
from tests.readers import tiny_run as tiny
from tests.readers.raw_faults import changed, refused, stamped

# ---- files -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("part", "file"), [("imu", "imu.nc"), ("odometer", "odometer.nc"), ("header", "run.toml")])
def test_a_missing_file_that_is_needed_is_named(raw_run, part, file):
    assert f"tiny/{file}: no such file" in refused(raw_run(**{part: None}))


@pytest.mark.parametrize("file", ["imu.nc", "odometer.nc", "caliper.nc"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_file_cut_off_is_named(raw_run, file, share):
    folder = raw_run()
    content = (folder / file).read_bytes()
    (folder / file).write_bytes(content[: int(share * len(content))])
    assert f"tiny/{file}: cannot be opened as netCDF" in refused(folder)


@pytest.mark.parametrize(
    ("part", "variable"),
    [
        ("imu", "time"),
        ("imu", "gyro_count"),
        ("imu", "accel_count"),
        ("odometer", "count"),
        ("caliper", "radius"),
        ("caliper", "arm_angle"),
    ],
)
def test_a_missing_variable_is_named(raw_run, part, variable):
    ds = getattr(tiny, part)().drop_vars(variable)
    assert f"tiny/{part}.nc: {variable}: is missing" in refused(raw_run(**{part: ds}))


@pytest.mark.parametrize(("part", "variable"), [("imu", "gyro_count"), ("odometer", "count"), ("caliper", "radius")])
def test_wrong_dims_are_named(raw_run, part, variable):
    ds = getattr(tiny, part)()
    ds[variable] = ds[variable].isel({ds[variable].dims[1]: 0}, drop=True)
    assert f"{variable}: has dims" in refused(raw_run(**{part: ds}))


def test_dims_in_another_order_are_turned(raw_run):
    raw = read_raw_folder(raw_run(imu=tiny.imu().transpose("axis", "sample"), caliper=tiny.caliper().transpose("arm", "scan")))
    assert raw.imu["gyro_count"].dims == ("sample", "axis")
    assert raw.arms["radius"].dims == ("scan", "arm")
    np.testing.assert_array_equal(raw.imu["accel_count"], tiny.imu()["accel_count"])


@pytest.mark.parametrize(
    ("part", "attribute"), [("imu", "gyro_pulse_rad"), ("imu", "accel_pulse_m_per_s"), ("odometer", "pulse_m")]
)
def test_a_missing_pulse_weight_is_named(raw_run, part, attribute):
    ds = getattr(tiny, part)()
    del ds.attrs[attribute]
    assert f"attribute {attribute}: is missing" in refused(raw_run(**{part: ds}))


def test_a_pulse_weight_may_stand_at_the_variable(raw_run):
    ds = tiny.imu()
    ds["gyro_count"].attrs["gyro_pulse_rad"] = ds.attrs.pop("gyro_pulse_rad")
    assert read_raw_folder(raw_run(imu=ds)).imu.attrs["gyro_pulse_rad"] == tiny.GYRO_PULSE


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, 12.0, "much"])
def test_a_pulse_weight_that_cannot_be_is_named(raw_run, value):
    assert "attribute pulse_m" in refused(raw_run(odometer=tiny.odometer().assign_attrs(pulse_m=value)))


@pytest.mark.parametrize(("part", "dim"), [("imu", "sample"), ("odometer", "sample"), ("caliper", "scan")])
def test_an_empty_recording_is_named(raw_run, part, dim):
    ds = getattr(tiny, part)().isel({dim: slice(0, 0)})
    assert "has no samples; the recording is empty" in refused(raw_run(**{part: ds}))


# ---- times -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["imu", "odometer", "caliper"])
def test_times_that_are_no_numbers_are_named(raw_run, part):
    told = refused(raw_run(**{part: stamped(getattr(tiny, part)(), 17, np.nan)}))
    assert f"tiny/{part}.nc: time: is not a number at 1 of" in told
    assert "first at sample 17" in told


@pytest.mark.parametrize("part", ["imu", "odometer", "caliper"])
@pytest.mark.parametrize("shift", [0.0, -0.7, 0.7, 500.0], ids=["double", "back", "forward", "far forward"])
def test_an_isolated_slip_of_the_clock_is_set_between_its_neighbours(raw_run, caplog, part, shift):
    ds = getattr(tiny, part)()
    true = ds["time"].values
    with caplog.at_level(logging.WARNING):
        raw = read_raw_folder(raw_run(**{part: stamped(ds, 100, true[99] + shift)}))
    time = {"imu": raw.imu, "odometer": raw.odometer, "caliper": raw.arms}[part]["time"].values
    np.testing.assert_allclose(time, true, atol=1e-9)
    assert len(raw.repairs) == 1
    assert "1 isolated slips of the clock" in raw.repairs[0]
    assert raw.repairs[0] in caplog.messages


@pytest.mark.parametrize(("at", "value"), [(0, 5.0), (-1, 1.0)], ids=["first", "last"])
def test_a_slip_at_an_end_of_the_recording_is_repaired(raw_run, at, value):
    ds = tiny.imu()
    raw = read_raw_folder(raw_run(imu=stamped(ds, at, value)))
    np.testing.assert_allclose(raw.imu["time"], ds["time"], atol=1e-9)


def test_a_clock_that_restarts_is_refused_with_its_place(raw_run):
    ds = tiny.imu()
    time = ds["time"].values.copy()
    time[1000:] -= 5.0
    told = refused(raw_run(imu=changed(ds, time=time)))
    assert "does not rise at 1 of 2000 samples: sample 1000 (20 then 15.02 s)" in told


def test_slips_that_touch_each_other_are_refused(raw_run):
    ds = tiny.imu()
    time = ds["time"].values.copy()
    time[100:103] = time[99]
    assert "does not rise at 3 of 2000 samples" in refused(raw_run(imu=changed(ds, time=time)))


def test_many_slips_are_refused(raw_run):
    ds = tiny.imu()
    time = ds["time"].values.copy()
    time[10:-10:20] = time[9:-11:20]
    assert "times must rise strictly" in refused(raw_run(imu=changed(ds, time=time)))


def test_a_gap_in_the_imu_is_kept_and_recorded(raw_run):
    ds = tiny.imu()
    keep = np.ones(2000, bool)
    keep[1200:1300] = False
    raw = read_raw_folder(raw_run(imu=ds.isel(sample=keep)))
    assert raw.imu.sizes["sample"] == 1900
    assert raw.repairs == ("tiny/imu.nc: time: gap of 2.02 s at t=24.000 s (usual step 0.02 s), kept",)


def test_recordings_on_two_clocks_are_refused(raw_run):
    ds = tiny.odometer()
    assert "both must be on one clock" in refused(raw_run(odometer=changed(ds, time=ds["time"].values + 1e4)))


def test_a_sampling_rate_that_the_stamps_deny_is_corrected(raw_run):
    raw = read_raw_folder(raw_run(header=tiny.HEADER.replace("rate_hz = 50.0", "rate_hz = 100.0")))
    assert raw.header.imu.rate_hz == pytest.approx(50.0)
    assert "the stamps of imu.nc say 50 Hz" in raw.repairs[0]


# ---- header ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("outside_diameter_m = 0.3239", "outside_diameter_m = 323.9", "[pipe] outside_diameter_m: is 323.9"),
        ("nominal_wall_m = 0.00635", "nominal_wall_m = 0.25", "[pipe] nominal_wall_m: is 0.25"),
        ("nominal_wall_m = 0.00635", "nominal_wall_m = 0.188", "that cannot be (is it in inch?)"),
        ("latitude_deg = 61.0", "latitude_deg = 161.0", "[launch] latitude_deg: is 161.0"),
        ('direction = "downstream"', 'direction = "north"', "[run] direction: is 'north'"),
        ("[0.0, -1.1, 0.0]", "[0.0, -1100.0, 0.0]", "[odometer] lever_arm_m"),
        ("[-0.6]", "[-600.0]", "[caliper] ring_offset_m"),
        ('id = "tiny"', "", "[run] id: is missing"),
        ("date = 2020-01-02", 'date = "soon"', "[run] date: is 'soon'"),
        ("rate_hz = 50.0", "rate_hz = 0", "[imu] rate_hz: is 0"),
        ("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[2, 0, 0], [0, 1, 0], [0, 0, 1]]", "is no rotation"),
        ("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "is left-handed"),
        ("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[1, 0, 0], [0, 1, 0]]", "[imu] sensor_to_body"),
        ("[imu]", "[imu", "is no TOML"),
    ],
)
def test_a_wrong_header_is_refused_by_key_and_value(raw_run, old, new, told):
    assert old in tiny.HEADER
    assert told in refused(raw_run(header=tiny.HEADER.replace(old, new)))


def test_a_mounting_with_printed_digits_is_orthonormalised(raw_run):
    c, s = np.round(np.cos(0.3), 3), np.round(np.sin(0.3), 3)
    raw = read_raw_folder(raw_run(header=tiny.HEADER.replace("[[1, 0, 0], [0, 1, 0]", f"[[{c}, {s}, 0], [{-s}, {c}, 0]")))
    matrix = raw.header.imu.mounting
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.arctan2(matrix[0, 1], matrix[0, 0]), 0.3, atol=1e-3)
    assert "the nearest rotation is used" in raw.repairs[0]


def test_unknown_keys_of_the_header_are_named_and_ignored(raw_run):
    header = tiny.HEADER.replace("[odometer]", "[odometer]\nweels = 3") + "[weather]\nrain = true\n"
    raw = read_raw_folder(raw_run(header=header))
    assert raw.repairs == (
        "tiny/run.toml: [odometer] weels: unknown key, ignored",
        "tiny/run.toml: weather: unknown key, ignored",
    )
