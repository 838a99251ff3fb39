"""Known errors of the sensors, as a run's header gives them, are taken off the counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deform.errors import InputError
from deform.nav.compensation import STANDARD_GRAVITY, compensated_increments, compensation_table
from deform.readers.findings import Findings
from deform.readers.header import read_header
from deform.run.raw import Compensation, ImuHeader
from tests.readers.tiny_run import HEADER

HOUR = np.radians(1.0) / 3600.0
KNOWN = Compensation(
    gyro_drift_deg_per_h=(0.2, -0.4, 0.6),
    gyro_scale_ppm=(1000.0, 0.0, -1000.0),
    gyro_scale_asymmetry_ppm=(0.0, 2000.0, 0.0),
    mass_unbalance_spin_deg_per_h_per_g=(2.0, 0.0, 0.0),
    mass_unbalance_input_deg_per_h_per_g=(0.0, 0.0, 2.0),
    spin_axis=(1, 2, 0),
    accel_bias_ug=(100.0, 0.0, -100.0),
    accel_scale_ppm=(0.0, 1000.0, 0.0),
    accel_scale_asymmetry_ppm=(0.0, 0.0, 1000.0),
)


def test_compensation_takes_off_what_was_put_on():
    imu = ImuHeader(rate_hz=10.0, sensor_to_body=((0, -1, 0), (1, 0, 0), (0, 0, 1)), compensation=KNOWN)
    gyro, accel = np.array([[1000, -2000, 3000]], np.int32), np.array([[500, 600, -9000]], np.int32)
    found, force = compensated_increments(gyro, accel, 1e-6, 1e-4, [0.1], compensation_table(imu))
    a, g = np.array([0.05, 0.06, -0.9]), np.array([1e-3, -2e-3, 3e-3])
    micro_g = 1e-6 * STANDARD_GRAVITY
    f = a - np.array([100.0, 0.0, -100.0]) * micro_g * 0.1 - [0.0, 1e-3, 0.0] * a - [0.0, 0.0, 1e-3] * np.abs(a)
    w = g - np.array([0.2, -0.4, 0.6]) * HOUR * 0.1 - [1e-3, 0.0, -1e-3] * g - [0.0, 2e-3, 0.0] * np.abs(g)
    unbalance = 2.0 * HOUR / STANDARD_GRAVITY
    w -= [unbalance * f[0], 0.0, 0.0]  # along the spin axis: its own force
    w -= [0.0, 0.0, unbalance * f[0]]  # along the input axis: the force along the third gyro's spin axis, the first
    np.testing.assert_allclose(force[0], [-f[1], f[0], f[2]], atol=1e-15)
    np.testing.assert_allclose(found[0], [-w[1], w[0], w[2]], atol=1e-15)


def header_with(tmp_path, table):
    path = tmp_path / "run.toml"
    path.write_text(HEADER.replace("[odometer]", f"[imu.compensation]\n{table}\n[odometer]"), encoding="utf-8")
    findings = Findings("tiny")
    return read_header(path, findings), findings


def test_header_may_state_what_a_calibration_found(tmp_path):
    header, findings = header_with(tmp_path, "gyro_drift_deg_per_h = [0.1, -0.2, 0.3]\nspin_axis = [1, 2, 0]")
    assert header.imu.compensation == replace(Compensation(), gyro_drift_deg_per_h=(0.1, -0.2, 0.3), spin_axis=(1, 2, 0))
    assert not findings.repairs
    assert compensation_table(header.imu)[0] == pytest.approx(np.array([0.1, -0.2, 0.3]) * HOUR)


@pytest.mark.parametrize(("table", "told"), [("spin_axis = [1, 2, 3]", "spin_axis"), ("accel_bias_ug = [1, 2]", "accel_bias_ug"),
                                             ("gyro_scale_ppm = [nan, 0, 0]", "gyro_scale_ppm")])  # fmt: skip
def test_compensation_that_cannot_be_is_refused_by_its_key(tmp_path, table, told):
    _, findings = header_with(tmp_path, table)
    with pytest.raises(InputError, match=told):
        findings.raise_if()


def test_unknown_key_of_the_compensation_is_named_and_ignored(tmp_path):
    _, findings = header_with(tmp_path, "gyro_bias = [0, 0, 0]")
    assert any("gyro_bias" in repair for repair in findings.repairs)
