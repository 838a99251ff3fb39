"""Each thing that can be wrong with a raw run is refused by name, or repaired by a documented rule and recorded."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from deform.errors import InputError
from deform.readers.raw_folder import read_raw_folder
from tests.readers import tiny_run as tiny


def refused(folder) -> str:
    """Return what the reader says, which must be an InputError."""
    with pytest.raises(InputError) as caught:
        read_raw_folder(folder)
    assert all(f.where.startswith("tiny") for f in caught.value.faults)
    return str(caught.value)


def changed(ds, **variables):
    """Return the dataset with the values of some variables replaced."""
    return ds.assign({name: (ds[name].dims, values, ds[name].attrs) for name, values in variables.items()})


def stamped(ds, at, value):
    """Return the dataset with one time stamp replaced."""
    time = ds["time"].values.copy()
    time[at] = value
    return changed(ds, time=time)


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


# ---- times ------------------------------------------------------------------------------------------------


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


# ---- inertial counts -----------------------------------------------------------------------------------------


def test_saturated_counts_are_left_out_and_recorded(raw_run):
    ds = tiny.imu()
    count = ds["gyro_count"].values.copy()
    count[700:705, 1] = 2**15 - 1
    raw = read_raw_folder(raw_run(imu=changed(ds, gyro_count=count)))
    told = (
        "tiny/imu.nc: gyro_count, axis 1: saturated at 32767 pulses in 5 samples, first at t=14.020 s; these samples are left out"
    )
    assert raw.repairs[0] == told
    assert "samples missing: 5 at t=14.000 s; bridged" in raw.repairs[1]
    assert raw.imu.sizes["sample"] == 1995


def test_single_samples_that_are_missing_are_recorded_and_a_late_stamp_is_none(raw_run):
    ds = tiny.imu()
    keep = np.ones(2000, bool)
    keep[[900, 1300]] = False
    time = ds["time"].values.copy()
    time[1600] += 0.012  # stamped late, nothing lost
    raw = read_raw_folder(raw_run(imu=changed(ds, time=time).isel(sample=keep)))
    assert raw.repairs == ("tiny/imu.nc: time: samples missing: 2 at 2 places, first at t=18.000 s; bridged",)


def test_a_sensor_that_is_saturated_for_long_is_refused(raw_run):
    ds = tiny.imu()
    count = ds["gyro_count"].values.copy()
    count[700:, 1] = -(2**15)
    assert "gyro_count, axis 1: saturated at 32768 pulses in 1300 samples" in refused(raw_run(imu=changed(ds, gyro_count=count)))


def test_missing_counts_leave_a_gap(raw_run):
    ds = tiny.imu()
    count = ds["accel_count"].values.copy()
    count[500:510] = -(2**31) + 1
    raw = read_raw_folder(raw_run(imu=changed(ds, accel_count=count)))
    assert raw.imu.sizes["sample"] == 1990
    assert "missing at 10 samples, first at sample 500" in raw.repairs[0]
    assert "gap of 0.22 s" in raw.repairs[1]


def test_counts_that_are_missing_too_often_are_refused(raw_run):
    ds = tiny.imu()
    count = ds["accel_count"].values.astype(float)
    count[500:600, 2] = np.nan
    assert "missing at 100 of 2000 samples" in refused(raw_run(imu=changed(ds, accel_count=count)))


def test_rates_in_place_of_counts_are_refused(raw_run):
    ds = tiny.imu()
    told = refused(raw_run(imu=changed(ds, gyro_count=ds["gyro_count"].values + 0.25)))
    assert "holds fractions of a pulse" in told


@pytest.mark.parametrize("factor", [1000.0, 1 / 9.81, 0.3048], ids=["mm/s", "g", "ft/s"])
def test_an_accelerometer_pulse_in_another_unit_is_refused(raw_run, factor):
    ds = tiny.imu().assign_attrs(accel_pulse_m_per_s=tiny.ACCEL_PULSE * factor)
    told = refused(raw_run(imu=ds))
    assert "a tool in a pipe feels gravity" in told or "attribute accel_pulse_m_per_s" in told


def test_a_gyro_pulse_that_denies_the_earths_turn_is_recorded(raw_run):
    header = tiny.HEADER.replace("static_s = 10.0", "static_s = 80.0")
    n = int(100 * tiny.RATE)
    time = (np.arange(n) + 1) / tiny.RATE
    counts = np.diff(np.round(np.outer(np.append(0, time), [0, 176.0, 319.0])), axis=0).astype(np.int32)
    force = np.tile(np.array([0, 0, 9820], np.int32), (n, 1))
    ds = tiny.imu().isel(sample=slice(0, 0))
    ds = ds.drop_vars(list(ds)).assign(
        time=("sample", time), gyro_count=(("sample", "axis"), counts), accel_count=(("sample", "axis"), force)
    )
    good = read_raw_folder(raw_run(imu=ds, header=header))
    assert not any("earth" in r for r in good.repairs)
    wrong = read_raw_folder(raw_run("other", imu=ds.assign_attrs(gyro_pulse_rad=np.degrees(tiny.GYRO_PULSE)), header=header))
    assert any("degree/h while the tool stands, the earth at 15.041" in r for r in wrong.repairs)


# ---- odometer ---------------------------------------------------------------------------------------------


def test_a_count_that_falls_is_named_with_wheel_time_and_values(raw_run):
    ds = tiny.odometer()
    count = ds["count"].values.copy()
    count[400:, 1] -= 900
    told = refused(raw_run(odometer=changed(ds, count=count)))
    assert (
        f"tiny/odometer.nc: count, wheel 2: falls from {count[399, 1]} to {count[400, 1]} at t=20.000 s; counts must not decrease"
        in told
    )


@pytest.mark.parametrize("bits", [16, 24, 32])
def test_a_counter_that_overflows_is_unrolled(raw_run, bits):
    ds = tiny.odometer()
    true = ds["count"].values + 2**bits - 1000
    raw = read_raw_folder(raw_run(odometer=changed(ds, count=true % 2**bits)))
    np.testing.assert_array_equal(raw.odometer["count"], true)
    assert len(raw.repairs) == 2
    assert "overflows" in raw.repairs[0]


def test_a_dead_wheel_is_recorded(raw_run):
    ds = tiny.odometer()
    count = ds["count"].values.copy()
    count[:, 0] = 5
    raw = read_raw_folder(raw_run(odometer=changed(ds, count=count)))
    assert raw.repairs == ("tiny/odometer.nc: count, wheel 1: does not count at all; kept",)


def test_missing_counts_of_a_wheel_are_set_between_their_neighbours(raw_run):
    ds = tiny.odometer()
    count = ds["count"].values.astype(float)
    count[401, 0] = np.nan
    raw = read_raw_folder(raw_run(odometer=changed(ds, count=count)))
    assert abs(int(raw.odometer["count"][401, 0]) - int(ds["count"][401, 0])) <= 1
    assert "missing at 1 of 801 samples" in raw.repairs[0]


def test_a_pulse_in_millimetre_gives_a_speed_that_cannot_be(raw_run):
    assert "no tool runs so fast" in refused(raw_run(odometer=tiny.odometer().assign_attrs(pulse_m=1.9)))


def test_wheels_of_header_and_file_must_agree(raw_run):
    told = refused(raw_run(header=tiny.HEADER.replace("wheels = 2", "wheels = 3")))
    assert "has 2 wheels, run.toml says 3" in told


# ---- caliper -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("in", 1 / 0.0254), ("cm", 1e2)])
@pytest.mark.parametrize("stated", [True, False])
def test_a_radius_in_another_unit_is_rescaled(raw_run, unit, factor, stated):
    ds = tiny.caliper()
    ds["radius"].attrs.update(scale_factor=1e-4 * factor, units=unit if stated else "m")
    raw = read_raw_folder(raw_run(caliper=ds))
    assert raw.arms["radius"].attrs["scale_factor"] == pytest.approx(1e-4)
    assert raw.arms["radius"].attrs["units"] == "m"
    assert len(raw.repairs) == 1
    assert "rescaled" in raw.repairs[0]


def test_a_diameter_in_place_of_a_radius_is_refused(raw_run):
    ds = tiny.caliper()
    ds["radius"].attrs["scale_factor"] = 2e-4
    assert "is it a diameter?" in refused(raw_run(caliper=ds))


def test_a_radius_of_another_pipe_is_refused(raw_run):
    told = refused(raw_run(header=tiny.HEADER.replace("0.3239", "0.6096")))
    assert "radius: has median 0.1556, the pipe an inner radius of 0.2984 m" in told


def test_arm_angles_in_degree_are_turned(raw_run):
    ds = tiny.caliper()
    ds["arm_angle"] = ("arm", np.degrees(ds["arm_angle"].values))
    raw = read_raw_folder(raw_run(caliper=ds))
    np.testing.assert_allclose(raw.arms["arm_angle"], np.arange(6) * np.pi / 3)
    assert "it is in degree" in raw.repairs[0]


@pytest.mark.parametrize(("value", "told"), [(np.nan, "is not a number for arm 3"), (0.0, "is the same for two arms")])
def test_arm_angles_that_cannot_be_are_named(raw_run, value, told):
    ds = tiny.caliper()
    ds["arm_angle"][2] = value
    assert told in refused(raw_run(caliper=ds))


def test_arms_of_header_and_file_must_agree(raw_run):
    told = refused(raw_run(header=tiny.HEADER.replace("arms = 6", "arms = 8")))
    assert "has 6 arms, run.toml says 8" in told


def test_each_ring_needs_its_offset(raw_run):
    told = refused(raw_run(header=tiny.HEADER.replace("[-0.6]", "[-0.6, -0.8]")))
    assert "has 1 rings, run.toml gives 2 ring_offset_m" in told


def test_a_caliper_without_a_header_is_described_by_its_file(raw_run):
    ds = tiny.caliper().assign_attrs(ring_offset_m=-0.45)
    raw = read_raw_folder(raw_run(caliper=ds, header=tiny.HEADER.split("[caliper]")[0]))
    assert raw.header.caliper.arms == 6
    assert raw.header.caliper.ring_offset_m == (-0.45,)
    assert "taken from caliper.nc" in raw.repairs[0]


def test_a_caliper_that_gave_nothing_is_refused(raw_run):
    ds = tiny.caliper()
    told = refused(raw_run(caliper=changed(ds, radius=np.full_like(ds["radius"].values, 65535))))
    assert "all arms are missing" in told


# ---- header ------------------------------------------------------------------------------------------------


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


# ---- weld events --------------------------------------------------------------------------------------------


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


# ---- markers -------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(("part", "name"), [("imu", "gyro_count"), ("imu", "accel_count"), ("odometer", "count")])
def test_counts_beyond_every_counter_are_refused(raw_run, part, name):
    ds = getattr(tiny, part)()
    values = ds[name].values.astype(float)
    values[-1, 0] = 1e300
    assert "pulses" in refused(raw_run(**{part: changed(ds, **{name: values})}))
