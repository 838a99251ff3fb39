"""Porter's study of data rate, quantization and commutativity, held against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError, OptionError
from deform.options import RouteOptions, SimulateOptions, ToolOptions
from deform.synthetic import study
from deform.synthetic.imu import ARCSECOND
from deform.synthetic.simulate import ride


def test_turning_about_a_fixed_axis_knows_no_error_of_rate():
    fine = np.tile([1e-4, -2e-4, 3e-4], (4096, 1))
    for rate in study.RATES_HZ:
        assert np.abs(study.attitude_errors(fine, rate)).max() < 1e-12


def test_coning_drift_is_the_closed_form():
    size, f, rate = np.radians(1.0), 2.0, 16.0
    t = np.arange(int(20 * study.FINE_HZ) + 1) / study.FINE_HZ
    angle = size * np.stack([np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t), 0 * t], axis=1)
    drift = study.attitude_errors(np.diff(angle, axis=0), rate)[-1, 2] / 20.0
    w, h = 2 * np.pi * f, 1 / rate
    missed = 0.5 * size**2 * w * (1 - np.sin(w * h) / (w * h))
    assert drift == pytest.approx(-missed, rel=0.02)


def test_error_falls_with_the_square_of_the_rate():
    table = study.data_rate(study.shaken_rates(30.0), (16.0, 32.0, 64.0))
    ratio = table.final_arcsec.to_numpy()[:-1] / table.final_arcsec.to_numpy()[1:]
    assert ratio == pytest.approx([4.0, 4.0], rel=0.3)


def test_coning_term_takes_most_of_the_error_away_and_the_orders_are_worse():
    table = study.commutativity(study.shaken_rates(30.0), 32.0).set_index("method").rms_arcsec
    assert table["coning"] < 0.1 * table["savage"]
    orders = table[["xyz", "yzx", "zxy"]]
    assert (orders >= 0.9 * table["savage"]).all()


def test_in_the_pipe_sixteen_hertz_keep_the_error_below_a_pulse():
    tool = ToolOptions(static_start_s=10.0, stops=0)
    options = SimulateOptions(route=RouteOptions(length_m=400.0, crossings=0, induction_bends_deg=()), tool=tool)
    fine = study.ridden_rates(ride(options).motion, 20.0, 60.0)
    table = study.data_rate(fine, (16.0, 64.0)).set_index("rate_hz")
    assert table.max_arcsec[16.0] < study.PORTER_PULSE_RAD / ARCSECOND
    pulses = study.quantization(fine, (16.0, 64.0, 256.0)).rms_pulses
    assert (pulses < 3.0).all()
    assert pulses.max() < 3.0 * pulses.min()  # no rate is much better, as Porter found


def test_unknown_formula_and_odd_rate_are_refused():
    with pytest.raises(OptionError, match="savage"):
        study.attitude_errors(np.zeros((8, 3)), 16.0, method="euler")
    with pytest.raises(InputError, match="divide"):
        study.attitude_errors(np.zeros((8, 3)), 15.0)
