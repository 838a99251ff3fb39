"""What motion shows of the mounting, on epochs made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deform.geometry.earth import earth_rate
from deform.nav import _kernels
from deform.nav.sanity import gravity_error_deg

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
