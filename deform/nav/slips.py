"""A solution in; where its wheels slipped unseen by each other, the way lost there, and epochs that have it again, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deform.geometry import earth
from deform.nav import _kernels as k
from deform.nav import _kernels_state as kernels
from deform.nav.filter import GATE
from deform.nav.solution import Solution
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]

TOLD_M = 0.5  # way lost in one slip that is told
ONE_SLIP_S = 2.0  # between epochs that slip, within which they are one


@dataclass(frozen=True)
class SlipsSeen:
    """Slips that the inertial unit tells: epochs whose displacement along the tool lies beyond the filter's gate.

    Parameters
    ----------
    begin : (slip,) s.
    lost : (slip,) way by the smoothed path minus that by the wheels (m).
    epochs : those of the problem, with the way of the smoothed path where the wheels slipped.
    lone : one wheel alone tells the travel.
    """

    begin: Floats
    lost: Floats
    epochs: Epochs
    lone: bool = True

    @classmethod
    def of(cls, solution: Solution) -> SlipsSeen:
        """Return what a solution tells of its wheels."""
        epochs, states = solution.problem.epochs, solution.smoothed.states
        with np.errstate(invalid="ignore"):
            here = np.flatnonzero(np.abs(solution.filtered.news[:, 0]) > GATE)
        table, scale = epochs.table.copy(), 1.0 + states[here, kernels.SCALE]
        place = np.degrees(states[:, :2]), states[:, 2]
        step = earth.enu_difference(*(v for i in (here + 1, here) for v in (*place[0][i].T, place[1][i])))
        way = np.sqrt(np.sum(np.square(step), axis=0)) / scale
        lost = way - table[here, k.TRAVEL]
        turned = slice(k.ATTITUDE_TIME, k.ATTITUDE_TIME + 9)
        table[here, k.ATTITUDE_TRAVEL : k.ATTITUDE_TRAVEL + 9] = table[here, turned] * (way / table[here, k.DURATION])[:, None]
        table[here, k.TRAVEL] = way
        first = np.flatnonzero(np.diff(epochs.time[here], prepend=-np.inf) > ONE_SLIP_S)
        total = np.add.reduceat(lost * scale, first) if first.size else np.empty(0)
        return cls(epochs.time[here[first]], total, Epochs(epochs.bounds, epochs.time, table), solution.problem.travel.lone)

    def remark(self) -> str:
        """Say what a lone wheel lost; empty when it is little."""
        told = self.lost > TOLD_M
        if not self.lone or not told.any():
            return ""
        worst = int(np.argmax(self.lost))
        return (
            f"the lone wheel lost {self.lost[told].sum():.1f} m in {told.sum()} slips that only the inertial unit tells, "
            f"{self.lost[worst]:.1f} m of it at t={self.begin[worst]:.1f} s: the way there is the inertial unit's"
        )
