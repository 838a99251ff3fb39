"""Lengths of the same joints in two runs in; axial strain of each joint with its sigma out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deform.errors import InputError
from deform.geometry.resample import MAD_TO_SIGMA

Floats = NDArray[Any]


@dataclass(frozen=True)
class AxialStrain:
    """Axial strain of joints.

    Attributes
    ----------
    strain : relative change of length since the reference, positive where the joint is longer; shape (n,).
    sigma : its standard deviation; shape (n,).
    scale : ratio of the two runs' scales, taken off as common to all joints (a strain that all joints share is not seen).
    scale_sigma : its standard deviation.
    length_sigma : standard deviation of the change of one joint's length that was used (metre); shape (n,).
    reference_length : lengths in the reference run (metre); shape (n,).
    """

    strain: Floats
    sigma: Floats
    scale: float
    scale_sigma: float
    length_sigma: Floats
    reference_length: Floats

    def pooled(self, first: int, last: int) -> tuple[float, float]:
        """Return the strain of a string of joints (first to last, both included) as one, and its sigma.

        A weld's error lengthens one joint and shortens its neighbour: over a string only the errors of its two ends stay.
        """
        part = slice(first, last + 1)
        known = np.isfinite(self.strain[part])
        if not known.any():
            return np.nan, np.nan
        length, strain = self.reference_length[part][known], self.strain[part][known]
        ends = float(self.length_sigma[part][known].mean())
        return float(np.sum(strain * length) / length.sum()), float(np.hypot(ends / length.sum(), self.scale_sigma))


def axial_strain(
    length: ArrayLike,
    reference_length: ArrayLike,
    length_sigma: ArrayLike | None = None,
    reference_sigma: ArrayLike | None = None,
) -> AxialStrain:
    """Return the axial strain of joints from the change of their lengths.

    Parameters
    ----------
    length, reference_length : of the same joints in the run and in the reference run (metre); NaN where a weld was not found.
    length_sigma, reference_sigma : standard deviations (metre), or None: the spread of the changes themselves is taken.

    Raises
    ------
    InputError
        When shapes differ or a length is not positive.

    Notes
    -----
    The common scale is the median ratio of lengths; strain = length / (scale × reference) - 1. An inertial unit sees
    bending, not axial strain: this is its only cue. A centimetre in twenty metres is 500 microstrain.

    References
    ----------
    Porter (1990), section 2.4.

    Examples
    --------
    >>> found = axial_strain([12.0, 12.0, 20.01, 12.0, 12.0], [12.0, 12.0, 20.0, 12.0, 12.0], 0.007, 0.007)
    >>> round(float(found.strain[2]) * 1e6), 495 < float(found.sigma[2]) * 1e6 < 750
    (500, True)
    """
    new, old = np.asarray(length, float), np.asarray(reference_length, float)
    if new.shape != old.shape or new.ndim != 1:
        raise InputError(f"lengths {new.shape} and reference lengths {old.shape}: must be two lists of the same joints")
    if (new <= 0).any() or (old <= 0).any():
        raise InputError("length: must be positive")
    known = np.isfinite(new) & np.isfinite(old)
    if not known.any():
        nothing = np.full(new.shape, np.nan)
        return AxialStrain(nothing, nothing, 1.0, np.nan, nothing, old)
    ratio = new / old
    scale = float(np.median(ratio[known]))
    change = new - scale * old
    if length_sigma is None or reference_sigma is None:
        spread = MAD_TO_SIGMA * float(np.median(np.abs(change[known]))) if known.sum() > 2 else np.nan
        sigma = np.full(new.shape, spread)
    else:
        sigma = np.hypot(np.broadcast_to(length_sigma, new.shape), np.broadcast_to(reference_sigma, new.shape))
    each = sigma / old
    scale_sigma = float(1.2533 * np.sqrt(np.mean(each[known] ** 2) / known.sum()))
    return AxialStrain(change / (scale * old), np.hypot(each, scale_sigma), scale, scale_sigma, sigma, old)
