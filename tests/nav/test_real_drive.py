"""A recorded drive, a car as a very large pig: position between marks every 2 km and heading of the standstill."""

from __future__ import annotations

import numpy as np
import pytest

from deform.nav.navigate import navigate
from tests.nav.kingston import REST_S, at_reference, drive, errors, heading_at_rest, reference_error, wrapped


@pytest.fixture(scope="module")
def run(real):
    return drive(real / "kingston2008")


@pytest.fixture(scope="module")
def found(run):
    return navigate(run.raw)


def test_drive_lies_within_ten_metres_between_marks(run, found):
    off, _ = errors(found, run)
    assert np.sqrt(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2)) < 5.0
    assert np.sqrt(np.mean(off[:, 2] ** 2)) < 3.0
    assert found.markers["used"].values.all()


def test_smoothed_heading_of_the_standstill_is_that_of_the_later_drive_led_back(run, found):
    _, back, scatter = heading_at_rest(run)
    assert scatter < 0.1
    rest = run.time < REST_S
    heading, sigma = (at_reference(found, run, name)[rest].mean() for name in ("azimuth", "azimuth_sigma"))
    assert abs(wrapped(heading - back)) < min(1.0, 3.0 * np.hypot(sigma, scatter))


def test_errors_are_no_larger_than_both_sigmas_say(run, found):
    """The reference errs by a metre itself: what it and the path state together must hold their difference."""
    off, own = errors(found, run)
    inside = np.mean(np.abs(off) < 1.96 * np.hypot(own, reference_error(run)[0]), axis=0)
    assert inside.min() > 0.9
    assert not found.diagnostics.attrs["remarks"]


def test_lever_and_lean_of_the_car_are_told(found):
    """The velocity of the reference, regressed on turn and force, gives 0.82 m and -6e-3 rad per m/s² to the side."""
    told = found.diagnostics
    assert 0.4 < float(told["lever"]) < 1.2
    assert -0.6 < float(told["lean_right"]) < -0.1
    assert 0.0 < float(told["lever_sigma"]) < 0.2
