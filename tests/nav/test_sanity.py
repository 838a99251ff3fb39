"""What motion shows of the mounting, on made epochs; coarse gyros may drift as their maker says, good ones may not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deform.errors import InputError
from deform.geometry.earth import earth_rate
from deform.nav import _kernels
from deform.nav.aiding import travel_aid
from deform.nav.alignment import Alignment
from deform.nav.profile import Profile
from deform.nav.sanity import check_motion, gravity_error_deg
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.run.raw import ImuHeader
from tests.nav.ideal import ideal_run

EPOCHS, DURATION = 3600, 0.5


@pytest.mark.parametrize("latitude_deg", [0.0, -33.0, 61.0])
def test_a_vertical_that_turns_with_the_earth_is_no_contradiction(latitude_deg):
    """A tool that keeps its attitude for half an hour: its gyros feel the Earth, its accelerometers the vertical."""
    attitude = Rotation.from_euler("zxy", [40.0, 5.0, 130.0], degrees=True).as_matrix()  # body to east, north, up
    up, earth = attitude[2], attitude.T @ earth_rate(latitude_deg)
    table = np.zeros((EPOCHS, _kernels.COLUMNS))
    table[:, :9] = Rotation.from_rotvec(earth * DURATION).as_matrix().ravel()
    table[:, _kernels.DURATION] = DURATION
    table[:, _kernels.VELOCITY : _kernels.VELOCITY + 3] = 9.81 * DURATION * up
    assert gravity_error_deg(table, up, earth) < 0.01
    middle = np.degrees(earth_rate(latitude_deg)[1]) * EPOCHS * DURATION / 2
    assert gravity_error_deg(table, up, np.zeros(3)) == pytest.approx(middle, rel=0.02)  # what was taken for a fault
    mirrored = up * np.array([1.0, 1.0, -1.0])
    assert gravity_error_deg(table, mirrored, earth) > 30.0


@pytest.mark.parametrize("stated_deg_per_h", [10.0, 0.01])
def test_a_vertical_that_drifts_is_refused_of_good_gyros_only(stated_deg_per_h):
    run = ideal_run(900.0, rate=50.0, rest=100.0, substeps=1, gyro_bias=np.radians(20.0) / 3600.0, turn_deg=5.0)
    profile = Profile.through(run.counts.time, run.distance)
    epochs = preintegrate(run.counts, profile, epoch_bounds(run.counts.time, 1.0))
    speed = np.gradient(run.distance, run.counts.time)
    travel = travel_aid(epochs, speed, np.full(speed.size, 2e-3), speed < 1e-6)
    aligned = Alignment(run.attitudes[0], 0.0, np.zeros(3), "static", (0.0, 100.0))
    imu = ImuHeader(rate_hz=50.0, gyro_bias_deg_per_h=stated_deg_per_h)
    header = SimpleNamespace(imu=imu, launch=SimpleNamespace(latitude_deg=61.0))
    arguments = run.counts, profile, epochs, travel, aligned, header
    if stated_deg_per_h > 1.0:
        check_motion(*arguments)
    else:
        with pytest.raises(InputError, match="disagree on the vertical"):
            check_motion(*arguments)
