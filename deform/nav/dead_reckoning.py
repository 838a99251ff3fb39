"""Epochs of counts and odometer, and a first attitude in; the path by gyros and odometer alone out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.nav import _kernels_reckoning
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
FORWARD = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Reckoning:
    """A path by dead reckoning.

    Parameters
    ----------
    places : (epoch + 1, 3) latitude, longitude (radian), height (m).
    attitudes : (epoch + 1, 3, 3) body to east, north, up.
    steps : (epoch, 3) east, north, up of each epoch's travel (m).
    """

    places: Floats
    attitudes: Floats
    steps: Floats


def dead_reckon(epochs: Epochs, place: Floats, attitude: Floats, mounting=FORWARD, scale: float = 1.0) -> Reckoning:
    """Return the path by gyros and odometer: the distance of each sample laid along the attitude of that moment.

    Parameters
    ----------
    place : latitude, longitude (radian), height (m) at the first bound.
    attitude : matrix (3, 3) at the first bound.
    mounting : direction of travel in body axes.
    scale : true over measured distance.

    References
    ----------
    CN103727938A, step 2; Porter (1990), section 5 (gyro and odometer only).
    """
    n = len(epochs.table)
    places, attitudes, steps = np.empty((n + 1, 3)), np.empty((n + 1, 3, 3)), np.empty((n, 3))
    direction = np.asarray(mounting, float)
    _kernels_reckoning.reckon(epochs.table, np.asarray(place, float), attitude, direction, scale, places, attitudes, steps)
    return Reckoning(places, attitudes, steps)
