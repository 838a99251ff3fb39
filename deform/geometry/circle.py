"""Points around a pipe in, circles and ellipses out: direct batched fits, and the combined adjustment with covariance.

Notes
-----
Porter (2-2) prints the ellipse with x cos(alpha) + dx and z sin(alpha) + dz, which does not rotate the section. Here the
point is moved to the centre and rotated, u = (x - cx) sin(alpha) + (z - cz) cos(alpha) along the greater axis, v across it,
and u^2/a^2 + v^2/b^2 - 1 = 0. As the orientation of a circle is undetermined, the adjustment works with

    f = m (X^2 + Z^2) + p (Z^2 - X^2) + 2 q X Z - 1,  X = x - cx, Z = z - cz,

m = (1/a^2 + 1/b^2) / 2, (p, q) = (1/a^2 - 1/b^2) / 2 (cos 2 alpha, sin 2 alpha), which is the same ellipse without the
singularity; a, b, alpha and their covariance follow from it. x is to the right, z up, alpha clockwise from up, looking
downstream.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deform.errors import Fault, InputError
from deform.geometry._kernels_circle import adjust_sections, fit_directly

_ROUNDS_PLAIN, _ROUNDS_ROBUST = 6, 12
_BAD_FIT = 3.0  # sigma of unit weight above which a section is flagged


@dataclass(frozen=True)
class SectionFit:
    """Adjusted sections; all arrays lead with the number of sections n.

    Attributes
    ----------
    right, up : (n,) m, centre.
    semi_major, semi_minor : (n,) m; equal for a circle.
    orientation : (n,) rad, of the greater axis, clockwise from up, in 0 .. pi.
    covariance : (n, 5, 5) of right, up, semi_major, semi_minor, orientation (m, rad), scaled by the sigma of the points;
        where the section is round within its noise the orientation has the variance of an unknown angle.
    residual : (n, arms) m, measured minus adjusted along the ray from the origin (Porter 2-6), NaN where missing.
    sigma_unit : (n,) standard deviation of unit weight; 1 when the points are as good as stated.
    points : (n,) points, or their weights, that carry the section.
    bad : (n,) true where the fit failed, or sigma_unit is above 3.
    """

    right: np.ndarray
    up: np.ndarray
    semi_major: np.ndarray
    semi_minor: np.ndarray
    orientation: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    sigma_unit: np.ndarray
    points: np.ndarray
    bad: np.ndarray

    @property
    def ovality(self) -> np.ndarray:
        """(greatest - least diameter) / mean diameter."""
        return 2 * (self.semi_major - self.semi_minor) / (self.semi_major + self.semi_minor)

    @property
    def ovality_sigma(self) -> np.ndarray:
        """Standard deviation of the ovality."""
        total = self.semi_major + self.semi_minor
        by_a, by_b = 4 * self.semi_minor / total**2, -4 * self.semi_major / total**2
        c = self.covariance
        return np.sqrt(by_a**2 * c[:, 2, 2] + by_b**2 * c[:, 3, 3] + 2 * by_a * by_b * c[:, 2, 3])


def fit_ellipse_direct(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Fit an ellipse to each section by one linear solution.

    Parameters
    ----------
    x, z : (n, arms) m, points to the right and up; NaN where missing. The origin must lie inside the section.

    Returns
    -------
    (n, 5) right, up (m), semi_major, semi_minor (m), orientation (rad); NaN where fewer than 5 points stand or no ellipse fits.

    Notes
    -----
    Least squares on A x^2 + B x z + C z^2 + D x + E z = 1. Near a circle about the origin its misclosure is
    2 e / R, so it is the fit of the radial residuals e to first order.

    Examples
    --------
    >>> angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    >>> ring = fit_ellipse_direct(0.16 * np.sin(angle)[None] + 0.002, 0.15 * np.cos(angle)[None])
    >>> np.round(ring[0], 4).tolist()
    [0.002, 0.0, 0.16, 0.15, 1.5708]
    """
    x, z = _points(x, z)
    values = np.empty((len(x), 5))
    fit_directly(x, z, _scale(x, z), values)
    return values


def adjust_ellipse(x, z, sigma: float = 3e-4, tangential_sigma: float = 0.0, robust: bool = False) -> SectionFit:
    """Adjust an ellipse to each section by combined least squares.

    Parameters
    ----------
    x, z : (n, arms) m, NaN where missing; rays start at the origin (the tool's axis).
    sigma, tangential_sigma : m, of a point along and across its ray; equal ones give the orthogonal distance fit.
    robust : down-weight points that stand off (dents) by Tukey's biweight.

    Returns
    -------
    SectionFit

    Raises
    ------
    InputError
        When shapes differ or sigma is not positive.

    References
    ----------
    Porter 1990, eq. (2-2) corrected, (2-3) to (2-6).
    """
    return _adjusted(x, z, sigma, tangential_sigma, robust, circle=False)


def adjust_circle(x, z, sigma: float = 3e-4, tangential_sigma: float = 0.0, robust: bool = False) -> SectionFit:
    """Adjust a circle to each section by combined least squares.

    Parameters, returns and raises as `adjust_ellipse`; the two axes are equal and the orientation is zero.

    References
    ----------
    Porter 1990, eq. (2-1), (2-3) to (2-6).
    """
    return _adjusted(x, z, sigma, tangential_sigma, robust, circle=True)


def _points(x, z) -> tuple[np.ndarray, np.ndarray]:
    right, up = (np.ascontiguousarray(np.atleast_2d(np.asarray(v, float))) for v in (x, z))
    if right.shape != up.shape:
        raise InputError(Fault("section", "x, z", f"shapes {right.shape} and {up.shape} differ"))
    return right, up


def _scale(x: np.ndarray, z: np.ndarray) -> float:
    """One over the typical distance of the points (1/m), by which the direct fit makes them of the order of one."""
    some = slice(None, None, max(1, len(x) // 200))
    size = float(np.nanmedian(np.hypot(x[some], z[some]))) if x.size else 1.0
    return 1.0 / size if size > 0 else 1.0


def _adjusted(x, z, sigma: float, tangential: float, robust: bool, circle: bool) -> SectionFit:
    x, z = _points(x, z)
    if not (sigma > 0 and tangential >= 0):
        raise InputError(
            Fault("section", "sigma", f"{sigma}, {tangential}; the radial one must be positive, the other not negative")
        )
    n, arms = x.shape
    values, covariance, residual = np.empty((n, 5)), np.empty((n, 5, 5)), np.empty((n, arms))
    weights, variance = np.empty(n), np.empty(n)
    rounds = _ROUNDS_ROBUST if robust else _ROUNDS_PLAIN
    adjust_sections(
        x, z, sigma, tangential, robust, circle, rounds, _scale(x, z), values, covariance, residual, weights, variance
    )
    sigma_unit = np.sqrt(variance)
    bad = ~np.isfinite(values[:, 2]) | ~(sigma_unit < _BAD_FIT)
    right, up, major, minor, orientation = values.T
    return SectionFit(right, up, major, minor, orientation, covariance, residual, sigma_unit, weights, bad)
