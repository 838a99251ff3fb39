"""Joint table of the matching in, the same table with axial strain and its significance out, and the elongation of stretches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.geometry.resample import robust_sigma
from deform.run import build

Floats = NDArray[Any]
_COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # joints of a string


def with_axial_strain(joints: pd.DataFrame, reference: str, runs: list[str], k_sigma: float) -> pd.DataFrame:
    """Return the joint table with the axial strain of every run since the reference run.

    Parameters
    ----------
    joints : table ``joints`` of the matching, with ``length_m:<run>``, ``change_m:<run>``, ``change_sigma_m:<run>``.
    reference, runs : names.
    k_sigma : a change of length is called significant above this many sigma.

    Returns
    -------
    The table with ``axial_strain:<run>`` (1, positive = longer), ``axial_strain_sigma:<run>`` and ``significant:<run>``.

    Notes
    -----
    ε = ΔL / L. An inertial unit sees bending only; the change of joint length is the one axial cue, and a weak one: 1 cm in
    20 m is 500 microstrain. The sigma is the larger of that of the matching and the robust spread over all joints of this
    pair.

    References
    ----------
    Porter (1990), section 2.4.
    """
    if joints is None or not len(joints):
        return build.table("joints", joints if joints is not None else {})
    out = joints.copy()
    base = _column(out, f"length_m:{reference}")
    for run in runs:
        change = _column(out, f"change_m:{run}")
        if run == reference or not np.isfinite(change).any():
            continue
        with np.errstate(invalid="ignore", divide="ignore"):
            sigma = np.fmax(_column(out, f"change_sigma_m:{run}"), float(robust_sigma(change)))
            out[f"axial_strain:{run}"] = change / base
            out[f"axial_strain_sigma:{run}"] = sigma / base
            out[f"significant:{run}"] = np.abs(change) > k_sigma * sigma
    return build.table("joints", out)


class Elongation:
    """By how much the joints of stretches of the reference chainage have grown from one run to another.

    Parameters
    ----------
    joints : table ``joints`` of the matching.
    run : name of the later run.
    since : name of the earlier one; None for the reference run.

    Notes
    -----
    Neighbouring joints share a weld, so that their errors cancel but for the two outer welds; the odometer adds a random walk.
    Neither is assumed: the sigma of a string of n joints is the robust spread of all strings of n joints of this pair.
    """

    def __init__(self, joints: pd.DataFrame, run: str, since: str | None = None):
        change = _column(joints, f"change_m:{run}") if joints is not None and len(joints) else np.array([])
        if since is not None and change.size:
            change = change - _column(joints, f"change_m:{since}")
        self.change = change
        self.begin = joints["reference_chainage_m"].to_numpy(float) if change.size else change
        self.stop = np.append(self.begin[1:], np.nan)
        counts = [n for n in _COUNTS if np.isfinite(change).sum() > 4 * n]
        self.spreads = {n: float(robust_sigma(self.strings(n))) for n in counts}

    @property
    def noise(self) -> float:
        """Robust spread of the changes of one joint's length (m), NaN when there are too few."""
        return self.spreads.get(1, float("nan"))

    def strings(self, count: int) -> Floats:
        """Change of length of each string of so many joints that follow each other (m), NaN where one is not known."""
        if self.change.size < count:
            return np.array([])
        summed = np.concatenate([[0.0], np.cumsum(np.nan_to_num(self.change))])
        gaps = np.concatenate([[0], np.cumsum(~np.isfinite(self.change))])
        return np.where(gaps[count:] > gaps[:-count], np.nan, summed[count:] - summed[:-count])

    def sigma(self, count: int) -> float:
        """Standard deviation of the change of length of a string of joints (m)."""
        known = [(n, s) for n, s in self.spreads.items() if np.isfinite(s) and s > 0]
        if not known:
            return float("nan")
        return float(np.exp(np.interp(np.log(max(count, 1)), *np.log(np.array(known, float)).T)))

    def __call__(self, start: float, end: float) -> tuple[float, float]:
        """Elongation of the joints that lie in a stretch by more than half (m), and its sigma."""
        middle = 0.5 * (self.begin + self.stop)
        chosen = (middle > start) & (middle < end) & np.isfinite(self.change)
        if not chosen.any():
            return float("nan"), float("nan")
        return float(self.change[chosen].sum()), self.sigma(int(chosen.sum()))


def _column(joints: pd.DataFrame, name: str) -> Floats:
    return pd.to_numeric(joints[name]).to_numpy(float) if name in joints else np.full(len(joints), np.nan)
