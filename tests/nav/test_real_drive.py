"""A recorded drive, a car as a very large pig: position between marks every 2 km and heading of the standstill."""

from __future__ import annotations

import numpy as np
import pytest

from deform.nav.navigate import navigate
from deform.options import NavigationOptions
from tests.nav.kingston import REST_S, at_reference, drive, errors, heading_at_rest, reference_sigma, wrapped


@pytest.fixture(scope="module")
def run(real):
    return drive(real / "kingston2008")


@pytest.fixture(scope="module")
def found(run):
    return navigate(run.raw, NavigationOptions(error_model="odometer"))  # learns no noise: a tenth of the time of the full model


def test_drive_lies_within_ten_metres_between_marks(run, found):
    off, _ = errors(found, run)
    assert np.sqrt(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2)) < 5.0
    assert np.sqrt(np.mean(off[:, 2] ** 2)) < 3.0
    assert found.markers["used"].values.all()


def test_smoothed_heading_of_the_standstill_is_that_of_the_later_drive_led_back(run, found):
    _, back, scatter = heading_at_rest(run)
    assert scatter < 0.3
    rest = run.time < REST_S
    assert abs(wrapped(at_reference(found, run, "azimuth")[rest].mean() - back)) < 1.0


def test_errors_are_no_larger_than_both_sigmas_say(run, found):
    """The reference rests on fixes of metres: what it and the path state together must hold their difference."""
    off, own = errors(found, run)
    assert np.mean(np.abs(off) < 1.96 * np.hypot(own, reference_sigma(run))) > 0.9
