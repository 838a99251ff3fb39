"""Gyros against accelerometers in motion: coarse gyros may drift as their maker says, good ones may not."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.nav.aiding import travel_aid
from deform.nav.alignment import Alignment
from deform.nav.profile import Profile
from deform.nav.sanity import check_motion
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.run.raw import ImuHeader
from tests.nav.ideal import ideal_run


@pytest.mark.parametrize("stated_deg_per_h", [10.0, 0.01])
def test_a_vertical_that_drifts_is_refused_of_good_gyros_only(stated_deg_per_h):
    run = ideal_run(900.0, rate=50.0, rest=100.0, substeps=1, gyro_bias=np.radians(20.0) / 3600.0, turn_deg=5.0)
    profile = Profile.through(run.counts.time, run.distance)
    epochs = preintegrate(run.counts, profile, epoch_bounds(run.counts.time, 1.0))
    speed = np.gradient(run.distance, run.counts.time)
    travel = travel_aid(epochs, speed, np.full(speed.size, 2e-3), speed < 1e-6)
    aligned = Alignment(run.attitudes[0], 0.0, np.zeros(3), "static", (0.0, 100.0))
    arguments = run.counts, profile, epochs, travel, aligned, ImuHeader(rate_hz=50.0, gyro_bias_deg_per_h=stated_deg_per_h)
    if stated_deg_per_h > 1.0:
        check_motion(*arguments)
    else:
        with pytest.raises(InputError, match="disagree on the vertical"):
            check_motion(*arguments)
