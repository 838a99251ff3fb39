"""What is wrong with counts, wheels and arms of a raw run is refused by name, or repaired by a rule and recorded."""

from __future__ import annotations

import numpy as np
import pytest

from deform.readers.raw_folder import read_raw_folder
from tests.readers import tiny_run as tiny
from tests.readers.raw_faults import changed, refused

# ---- inertial counts -------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(("part", "name"), [("imu", "gyro_count"), ("imu", "accel_count"), ("odometer", "count")])
def test_counts_beyond_every_counter_are_refused(raw_run, part, name):
    ds = getattr(tiny, part)()
    values = ds[name].values.astype(float)
    values[-1, 0] = 1e300
    assert "pulses" in refused(raw_run(**{part: changed(ds, **{name: values})}))


# ---- odometer --------------------------------------------------------------------------------------------


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


# ---- caliper ---------------------------------------------------------------------------------------------


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
