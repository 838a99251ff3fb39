"""Alignment, launch and marks in; state and variances at the first bound out."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deform.geometry import earth
from deform.geometry.rotation import rotation_vector_to_matrix
from deform.nav import _kernels_state as kernels
from deform.nav.aiding import MarkAid
from deform.nav.alignment import Alignment
from deform.nav.dead_reckoning import dead_reckon
from deform.nav.error_model import ErrorModel
from deform.nav.filter import Start
from deform.nav.strapdown import Epochs
from deform.run.raw import RawRun

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

LAUNCH_SIGMA_M = 2.0
UNKNOWN_AZIMUTH_RAD = math.radians(4.0)
FAR_M, FAR_SHARE = 20.0, 0.05  # a launch off by more than this, and this share of the way to a mark, is wrong


def first_state(
    raw: RawRun, epochs: Epochs, marks: MarkAid, aligned: Alignment, model: ErrorModel, speed: float
) -> tuple[Start, Alignment]:
    """Return state and variances at the first bound, and the alignment with an azimuth from the marks where gyros give none.

    Notes
    -----
    The alignment comes from data that the filter takes in again: its sigma is widened tenfold, so that it counts once.
    """
    launch = raw.header.launch
    place = np.array([math.radians(launch.latitude_deg), math.radians(launch.longitude_deg), launch.height_m])
    reckoned = dead_reckon(epochs, place, aligned.attitude)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(reckoned.steps, axis=0)])[marks.epoch]
    apart = earth.enu_difference(*_degrees(marks.place), *_degrees(reckoned.places[marks.epoch]))
    points = path + np.column_stack(apart).reshape(-1, 3)  # where the path's own east and north hold
    if aligned.sigma[2] > UNKNOWN_AZIMUTH_RAD:
        aligned, path = _azimuth_from_marks(aligned, path, points)
    shift, sigma = _launch_shift(path, points, aligned.sigma[2])
    if np.any(shift):
        log.warning(
            "launch of %s: the markers put it %.1f m east, %.1f m north, %.1f m up of what run.toml says; not used",
            raw.id,
            *shift,
        )
        latitude, longitude, height = earth.enu_shift(np.degrees(place[0]), np.degrees(place[1]), place[2], *shift)
        place = np.array([np.radians(latitude), np.radians(longitude), height], float)
    state = np.zeros(kernels.STATE_COLUMNS)
    state[:3], state[3:6], state[6:15] = place, aligned.attitude[:, 1] * speed, aligned.attitude.ravel()
    nine = [sigma**2] * 3, [0.01**2 + (0.05 * speed) ** 2] * 3, np.minimum(10.0 * aligned.sigma, [0.2, 0.2, 1.0]) ** 2
    covariance = model.first_covariance()
    covariance[:9, :9] = np.diag(np.concatenate(nine))
    return Start(state, covariance), aligned


def _degrees(place: Floats) -> tuple[Floats, Floats, Floats]:
    return np.degrees(place[:, 0]), np.degrees(place[:, 1]), place[:, 2]


def _launch_shift(path: Floats, points: Floats, azimuth_sigma: float) -> tuple[Floats, float]:
    """Shift (east, north, up) of the launch that the marks want, zero when it is as good as they can tell, and its sigma."""
    if not len(points):
        return np.zeros(3), LAUNCH_SIGMA_M
    wanted = points - path
    doubt = FAR_M + (FAR_SHARE + min(3.0 * azimuth_sigma, 1.0)) * np.linalg.norm(path, axis=1)
    middle = np.median(wanted, axis=0)
    agree = np.linalg.norm(wanted - middle, axis=1) < 2.0 * doubt
    if not agree.any() or agree.sum() < 0.5 * len(points):
        return np.zeros(3), LAUNCH_SIGMA_M
    first = np.flatnonzero(agree)[np.argmin(doubt[agree])]
    if np.linalg.norm(wanted[first]) < doubt[first] and np.linalg.norm(middle) < np.median(doubt):
        return np.zeros(3), LAUNCH_SIGMA_M
    return wanted[first], float(doubt[first])


def _azimuth_from_marks(aligned: Alignment, path: Floats, points: Floats) -> tuple[Alignment, Floats]:
    """Turn the first attitude about the vertical so that the dead-reckoned path runs through the marks."""
    if len(points) < 2:
        return aligned, path
    a, b = path[:, :2] - path[:, :2].mean(axis=0), points[:, :2] - points[:, :2].mean(axis=0)
    if np.linalg.norm(a, axis=1).max() < 100.0:
        return aligned, path
    turn = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    matrix = rotation_vector_to_matrix([0.0, 0.0, turn])
    rest = np.linalg.norm(a @ matrix[:2, :2].T - b, axis=1)
    sigma = max(float(np.median(rest / np.maximum(np.linalg.norm(a, axis=1), 1.0))), math.radians(1.0))
    log.info("gyros are too coarse for an azimuth: turned by %.1f degree onto the line of the markers", math.degrees(turn))
    widened = np.array([aligned.sigma[0], aligned.sigma[1], min(sigma, 0.1)])
    return replace(
        aligned, attitude=matrix @ aligned.attitude, sigma=widened, method=f"{aligned.method}, azimuth from markers"
    ), path @ matrix.T
