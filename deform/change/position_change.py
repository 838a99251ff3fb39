"""Two runs at the same steel in, their displacement per component with sigma out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change.bridge import Bridges
from deform.change.datum import Datum
from deform.change.intervals import Stretch, merged
from deform.change.noise_floor import speed_noise
from deform.change.stack import POSITION, Layer
from deform.geometry.earth import enu_difference

Floats = NDArray[Any]
Axes = tuple[Floats, Floats, Floats]


def raw_difference(reference: Layer, other: Layer) -> Floats:
    """Return the place in a run minus the place in the reference run of the same steel: east, north, up (m), shape (n, 3).

    NaN where either run has no position. The datum of the two trajectories is still in it.
    """
    n = reference.run_chainage.size
    if not (reference.has(*POSITION) and other.has(*POSITION)):
        return np.full((n, 3), np.nan)
    places = [other.values[name] for name in POSITION] + [reference.values[name] for name in POSITION]
    return np.column_stack(enu_difference(*places))


def along_pipe(east_north_up: Floats, tangent: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the lateral part (level, positive to the right looking downstream) and the axial part (positive downstream).

    Parameters
    ----------
    east_north_up : (n, 3) displacement (m).
    tangent, right : (n, 3) axes of the reference pipe, see `stack.tangents`.
    """
    return np.einsum("ij,ij->i", east_north_up, right) / _level(right), np.einsum("ij,ij->i", east_north_up, tangent)


def along_pipe_sigma(sigma: Floats, tangent: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the sigma of the lateral and the axial part from those of east, north, up (n, 3), taken as independent."""
    lateral, axial = (np.sqrt(np.einsum("ij,ij,ij,ij->i", sigma, sigma, axis, axis)) for axis in (right, tangent))
    return lateral / _level(right), axial


def _level(right: Floats) -> Floats:
    """Length of the level axis across the pipe (n,), never zero."""
    return np.maximum(np.hypot(right[:, 0], right[:, 1]), 1e-9)


def displacement_on(
    datum: Datum, bridges: Bridges, noise: Noise, excluded: list[Stretch], axis: Floats, moved: Floats, axes: Axes
) -> tuple[Floats, Floats]:
    """Return the displacement east, north, up, lateral, axial (n, 5) on a datum, and its sigma.

    Parameters
    ----------
    datum : drift of the two runs on the scan axis.
    bridges : what bridges over stretches without datum are worth.
    noise : sigma about the datum.
    excluded : stretches that carry no datum; those of several runs may overlap, and are one bridge.
    axis, moved, axes : the reference chainage (n,), displacement there (n, 3), axes of the reference pipe.

    Notes
    -----
    On the datum pipe the sigma is the scatter about the datum. Where the pipe is no datum the variance of the bridge is added,
    and both are widened by what bridges over stable pipe of the same width miss beyond what they claim.
    """
    sigma = noise.east_north_up.copy()
    for start, end in merged(excluded):
        gone = slice(*np.searchsorted(axis, [start, end]))
        bridge = finer(axis[gone], bridges.place, datum.variance)
        sigma[gone] = np.sqrt(sigma[gone] ** 2 + bridge) * bridges.factor(end - start)
    lateral, axial = along_pipe(moved, axes[0], axes[1])
    across, along = along_pipe_sigma(sigma, axes[0], axes[1])
    return np.stack([*moved.T, lateral, axial]).T, np.stack([*sigma.T, across, along]).T


@dataclass(frozen=True)
class Noise:
    """Noise of a displacement about its datum.

    Attributes
    ----------
    east_north_up : (n, 3) sigma at each place (m).
    floors : by component along the pipe and speed class.
    """

    east_north_up: Floats
    floors: dict[str, dict[int, float]]


def noise_about_datum(moved: Floats, axes: Axes, speeds: tuple[Floats, Floats], stable: Floats) -> Noise:
    """Return the scatter of a displacement (n, 3) over stable pipe, by the speeds of both runs."""
    lateral, axial = along_pipe(moved, axes[0], axes[1])
    found = [speed_noise(values, *speeds, stable) for values in (lateral, moved[:, 2], axial)]
    names = ("lateral", "up", "axial")
    floors = {f"displacement {name}": part.floors for name, part in zip(names, found, strict=True)}
    across, up, along = (part.at(*speeds) for part in found)
    level = np.maximum(np.hypot(axes[0][:, 0], axes[0][:, 1]), 1e-9)
    sine2 = (axes[0][:, 0] / level) ** 2
    east = np.sqrt(along**2 * sine2 + across**2 * (1.0 - sine2))
    north = np.sqrt(along**2 * (1.0 - sine2) + across**2 * sine2)
    return Noise(np.column_stack([east, north, up]), floors)


def finer(axis: Floats, place: Floats, values: Floats) -> Floats:
    """Return values of the scan axis on the reference chainage, column by column."""
    return np.column_stack([np.interp(axis, place, column) for column in values.T])
