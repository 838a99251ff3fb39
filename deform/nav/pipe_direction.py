"""Attitude and path of the IMU in, the direction of the pipe under it (azimuth and pitch in the direction of travel) out."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.geometry.resample import robust_sigma
from deform.geometry.rotation import attitude_to_matrix

Floats = NDArray[Any]

_LEAST_SPEED = 0.1  # m/s; below it the direction of the velocity says nothing


def mounting_angles(trajectory: xr.Dataset) -> tuple[float, float, float]:
    """Return the pipe's constant direction in the body frame, azimuth and pitch, and the sigma of one sample (degree).

    Parameters
    ----------
    trajectory : group ``trajectory`` with the velocities.

    Notes
    -----
    On the long run the tool travels along the pipe: the median of the direction of the velocity in the body frame is the
    misalignment of the IMU, with the wobble of the tool averaged out. It rolls with the tool.
    """
    velocity = np.stack([trajectory[f"velocity_{c}"].values for c in ("east", "north", "up")], axis=-1)
    moving = np.linalg.norm(velocity, axis=1) > _LEAST_SPEED
    if moving.sum() < 10:
        return 0.0, 0.0, 0.0
    matrix = attitude_to_matrix(*(trajectory[a].values[moving] for a in ("azimuth", "pitch", "roll")))
    body = np.einsum("nji,nj->ni", matrix, velocity[moving])
    azimuth = np.degrees(np.arctan2(body[:, 0], body[:, 1]))
    pitch = np.degrees(np.arctan2(body[:, 2], np.hypot(body[:, 0], body[:, 1])))
    spread = np.hypot(robust_sigma(azimuth), robust_sigma(pitch)) / np.sqrt(2.0)
    return float(np.median(azimuth)), float(np.median(pitch)), float(spread)


def direction_of_travel(trajectory: xr.Dataset) -> tuple[Floats, Floats, Floats, Floats]:
    """Return azimuth and pitch of the pipe at each sample, looking in the direction of travel, and their sigmas (degree)."""
    azimuth, pitch, roll = (trajectory[a].values for a in ("azimuth", "pitch", "roll"))
    wobble = 0.0
    if "velocity_east" in trajectory:
        right, up, wobble = mounting_angles(trajectory)
        matrix = attitude_to_matrix(azimuth, pitch, roll)
        axis = np.array([np.sin(np.radians(right)), 1.0, np.sin(np.radians(up))])
        along = matrix @ (axis / np.linalg.norm(axis))
        azimuth = np.degrees(np.arctan2(along[:, 0], along[:, 1])) % 360.0
        pitch = np.degrees(np.arctan2(along[:, 2], np.hypot(along[:, 0], along[:, 1])))
    sigmas = [
        np.hypot(trajectory[f"{a}_sigma"].values if f"{a}_sigma" in trajectory else 0.0, np.full(azimuth.shape, wobble))
        for a in ("azimuth", "pitch")
    ]
    return azimuth, pitch, sigmas[0], sigmas[1]
