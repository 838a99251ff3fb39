"""Joint table of the matching in, the same table with axial strain and its significance out, and the elongation of stretches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.geometry.resample import robust_sigma
from deform.run import build

Floats = NDArray[Any]


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


def noise_of_joints(joints: pd.DataFrame, run: str) -> float:
    """Return the robust spread of the changes of joint length of a run (m), NaN when there are none."""
    change = _column(joints, f"change_m:{run}") if len(joints) else np.array([])
    return float(robust_sigma(change)) if np.isfinite(change).sum() > 4 else float("nan")


def elongation(joints: pd.DataFrame, run: str, start: float, end: float) -> tuple[float, float]:
    """Return by how much the joints of a stretch of the reference chainage have grown (m), and the sigma.

    Notes
    -----
    The sum of the changes of all joints that lie in the stretch by more than half. Neighbouring joints share a weld, so that
    their errors cancel but for the two outer welds: σ = that of one joint's change, whatever the number of joints, plus the
    random walk of the odometer, taken as a tenth of it per joint.
    """
    change = _column(joints, f"change_m:{run}") if len(joints) else np.array([])
    if not change.size:
        return float("nan"), float("nan")
    begin = joints["reference_chainage_m"].to_numpy(float)
    stop = np.append(begin[1:], np.nan)
    chosen = (0.5 * (begin + stop) > start) & (0.5 * (begin + stop) < end) & np.isfinite(change)
    if not chosen.any():
        return float("nan"), float("nan")
    noise = np.fmax(noise_of_joints(joints, run), 1e-4)
    return float(change[chosen].sum()), float(noise * np.sqrt(1.0 + 0.01 * chosen.sum()))


def _column(joints: pd.DataFrame, name: str) -> Floats:
    return pd.to_numeric(joints[name]).to_numpy(float) if name in joints else np.full(len(joints), np.nan)
