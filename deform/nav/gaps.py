"""Epochs with gaps of the inertial unit and the states at their ends in; epochs that turn over the gaps as these do out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deform.geometry.rotation import matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav import _kernels as k
from deform.nav._kernels_state import MATRIX
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]

BOW_TURN = np.radians(2.0) ** 2  # rad² per m: by how much a pipe without a bend strays from its direction and back


def turned_as(epochs: Epochs, states: Floats, sigma: Floats) -> Epochs:
    """Return the epochs with the turn over each gap that the attitudes of smoothed states have.

    Parameters
    ----------
    states : (bound, STATE_COLUMNS) about which everything is to be linear.
    sigma : (bound, n) their standard deviations.

    Notes
    -----
    A gap may hide a bend of any angle: as variance of the turn it counts `_kernels.LOST_TURN`, whatever is found. How far the path
    bows in it is seen by the turn that is found: a kink of angle a anywhere in a gap of travel s leaves its path uncertain by
    a s / sqrt(12), and a pipe that goes on as it came hardly bends in between (`BOW_TURN`). What was expected of the turn is kept
    beside that which is found (`GAP_EXPECTED`), so that the data are not counted twice.
    """
    gaps = np.flatnonzero(epochs.gap > 0)
    table = epochs.table.copy()
    for i in gaps:
        row, (before, after) = table[i], states[i : i + 2, MATRIX : MATRIX + 9].reshape(2, 3, 3)
        old, new = row[k.TURN : k.TURN + 9].reshape(3, 3).copy(), before.T @ after
        expected = rotation_vector_to_matrix(row[k.GAP_EXPECTED : k.GAP_EXPECTED + 3]) @ old
        row[k.GAP_EXPECTED : k.GAP_EXPECTED + 3] = matrix_to_rotation_vector(expected @ new.T)
        row[k.TURN : k.TURN + 9] = new.ravel()
        way, arcs = row[k.GAP_TRAVEL], [(np.eye(3) + R) * k.arc_stretch(R[1, 1]) for R in (old, new)]
        row[k.ATTITUDE_TRAVEL : k.ATTITUDE_TRAVEL + 9] += 0.5 * way * (arcs[1] - arcs[0]).ravel()
        row[k.ATTITUDE_TIME : k.ATTITUDE_TIME + 9] += 0.5 * row[k.GAP] * (new - old).ravel()
        found = np.arccos(np.clip(new[1, 1], -1.0, 1.0)) ** 2 + np.sum(sigma[i + 1, 6:9] ** 2)
        row[k.GAP_BOW] = min(BOW_TURN * abs(way) + found, row[k.GAP_TURN])
    return Epochs(epochs.bounds, epochs.time, table)
