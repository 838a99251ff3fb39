"""Epochs with gaps of the inertial unit and the states at their ends in; epochs that turn over the gaps as these do out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.geometry.rotation import matrix_to_rotation_vector, rotation_vector_to_matrix
from deform.nav import _kernels as k
from deform.nav._kernels_arc import arc_stretch
from deform.nav._kernels_state import MATRIX
from deform.nav.strapdown import Epochs
from deform.run.stamps import usual_step

Floats = NDArray[np.float64]

BOW_TURN = np.radians(2.0) ** 2  # rad² per m: by how much a pipe without a bend strays from its direction and back
LOST_STEPS, LEAST_UNSEEN_M = 2.5, 0.5  # of the trajectory's samples, and way between two of them, that hide pipe
BESIDE_M = 10.0  # way on both sides of such a stretch that tells how the tool lay in it
TOLD_RAD, TOLD_SIGMA = np.radians(3.0), 2.0  # turn over a gap that is told: of a bend, not of a field joint


def remarks(epochs: Epochs) -> list[str]:
    """Return in words where a gap hides a bend: epochs that turn over the gaps as the smoothed path does are wanted."""
    said = []
    for i in np.flatnonzero(epochs.table[:, k.GAP_TURN] > TOLD_RAD**2):
        row, begin = epochs.table[i], epochs.time[i]
        turn, way = float(np.arccos(np.clip(row[k.TURN + 4], -1.0, 1.0))), abs(row[k.GAP_TRAVEL])
        if turn > TOLD_RAD and turn > TOLD_SIGMA * np.sqrt(BOW_TURN * way):
            said.append(
                f"{row[k.GAP]:.1f} s of the inertial unit are lost between t={begin:.1f} s and {epochs.time[i + 1]:.1f} s: "
                f"the pipe turns there by {np.degrees(turn):.0f} degree within {way:.1f} m, by a bend whose place and radius are "
                "not known"
            )
    return said


@dataclass(frozen=True)
class Unseen:
    """Stretches of pipe that no sample of the inertial unit lies in.

    Parameters
    ----------
    behind : (stretch,) index of the sample behind each.
    ends : (stretch, 2) where they begin and end (m along the pipe, in the direction of travel).
    turn : (stretch,) variance of the turn of the pipe per metre in them (radian²), of the worse of azimuth and pitch.
    """

    behind: NDArray[np.int64]
    ends: Floats
    turn: Floats

    @classmethod
    def of(cls, time: Floats, travel: Floats, azimuth: Floats, pitch: Floats) -> Unseen:
        """Return the stretches between samples of an advancing tool, with the directions (radian, unwrapped) at their ends."""
        step = usual_step(time) if time.size > 1 else np.inf
        behind = np.flatnonzero((np.diff(time) > LOST_STEPS * step) & (np.diff(travel) > LEAST_UNSEEN_M)) + 1
        ends = np.column_stack([travel[behind - 1], travel[behind]])
        turn = np.hypot((azimuth[behind] - azimuth[behind - 1]) * np.cos(pitch[behind]), pitch[behind] - pitch[behind - 1])
        return cls(behind, ends, BOW_TURN + turn**2 / np.maximum(np.diff(ends, axis=1)[:, 0], LEAST_UNSEEN_M))

    def variances(self, grid: Floats) -> tuple[Floats, Floats]:
        """Return the variances of direction (radian²) and place (m²) that the stretches add on a grid.

        Notes
        -----
        Between known ends: of a pipe that turns at random on its way, or by one kink anywhere, the direction a share w of the way
        through is uncertain by the turn times w (1 - w), the place by an eighth of turn times length in the middle.
        """
        direction, place = np.zeros(grid.size), np.zeros(grid.size)
        for (begin, end), turn in zip(self.ends, self.turn, strict=True):
            here = slice(*np.searchsorted(grid, [begin, end]))
            w, way = (grid[here] - begin) / (end - begin), end - begin
            direction[here] = turn * way * w * (1.0 - w)
            place[here] = turn * way * (0.5 * way * w * (1.0 - w)) ** 2
        return direction, place

    def bridged(self, travel: Floats, apart: Floats) -> Floats:
        """Return what the path falls short of the attitude, sample by sample, going on over the stretches as beside them.

        In a stretch neither is known: what they differ by there is a guess, and would pass for a wobble of the tool.
        """
        out = apart.copy()
        seen = np.ones(travel.size, bool)
        seen[self.behind] = False
        for i, (begin, end) in zip(self.behind, self.ends, strict=True):
            near = seen & (travel > begin - BESIDE_M) & (travel <= end + BESIDE_M)
            way = float(np.diff(travel, prepend=travel[0])[near].sum())
            out[i] = apart[near].sum(axis=0) / max(way, LEAST_UNSEEN_M) * (end - begin)
        return out


def turned_as(epochs: Epochs, states: Floats, sigma: Floats) -> Epochs:
    """Return the epochs with the turn over each gap that the attitudes of smoothed states have.

    Parameters
    ----------
    states : (bound, STATE_COLUMNS) about which everything is to be linear.
    sigma : (bound, n) their standard deviations.

    Notes
    -----
    A gap may hide a bend of any angle: the variance of the turn is that of `_kernels.LOST_TURN`, whatever is found. How far the
    path bows in it is seen by the turn that is found: a kink of angle a anywhere in a gap of travel s leaves its path open by
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
        way, arcs = row[k.GAP_TRAVEL], [(np.eye(3) + R) * arc_stretch(R[1, 1]) for R in (old, new)]
        row[k.ATTITUDE_TRAVEL : k.ATTITUDE_TRAVEL + 9] += 0.5 * way * (arcs[1] - arcs[0]).ravel()
        row[k.ATTITUDE_TIME : k.ATTITUDE_TIME + 9] += 0.5 * row[k.GAP] * (new - old).ravel()
        found = np.arccos(np.clip(new[1, 1], -1.0, 1.0)) ** 2 + np.sum(sigma[i + 1, 6:9] ** 2)
        row[k.GAP_BOW] = BOW_TURN * abs(way) + found
    return Epochs(epochs.bounds, epochs.time, table)
