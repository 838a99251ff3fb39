"""Rings of ranges in, their robust harmonics out: mean radius, place of the centre and oval as the arms see them."""

from __future__ import annotations

import numpy as np

from deform.geometry._kernels_harmonics import fit_harmonics


def harmonic_basis(angle: np.ndarray) -> np.ndarray:
    """Columns 1, cos, sin, cos 2, sin 2 of the angles (rad); shape (..., 5)."""
    waves = [f(k * angle) for k in (1, 2) for f in (np.cos, np.sin)]
    return np.stack([np.ones_like(angle), *waves], axis=-1)


class HarmonicFitter:
    """Robust harmonics of every ring of ranges, readings that stand off (dents, openings) down-weighted by Tukey's biweight.

    Parameters
    ----------
    angle : (arms,) rad, of the arms in the tool's cross-section, clockwise from up.
    sigma : m, standard deviation of one reading.
    least : readings below which a ring has no result.

    Notes
    -----
    radius(angle) = h0 + h1 cos(angle) + h2 sin(angle) + h3 cos(2 angle) + h4 sin(2 angle): h0 is the mean radius, the centre of
    the pipe lies at h2 to the right and h1 up of the tool's axis, h3 and h4 are the oval. A circle seen from a point off its
    centre by e also shows -e^2 / 4 R (1 - cos 2 (angle - direction)), which the caller may take out. The full adjustment
    with covariance is `deform.geometry.circle.adjust_ellipse`; to first order in oval and offset the two are equal, and this
    one is what a hundred kilometres of scans can afford.

    Examples
    --------
    >>> angle = np.arange(24) * 2 * np.pi / 24
    >>> fitter = HarmonicFitter(angle, sigma=3e-4)
    >>> harmonics, *_ = fitter.fit(0.15 + 0.002 * np.cos(angle)[None] - 0.001 * np.sin(angle)[None])
    >>> (np.round(harmonics[0], 6) + 0.0).tolist()
    [0.15, 0.002, -0.001, 0.0, 0.0]
    """

    def __init__(self, angle: np.ndarray, sigma: float, least: int = 6):
        self.angle, self.sigma, self.least = np.asarray(angle, float), float(sigma), int(least)
        self.basis = harmonic_basis(self.angle)
        self._inverse = np.linalg.pinv(self.basis)

    def fit(self, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Fit rings of ranges (n, arms) in metre, NaN where an arm gave nothing.

        Returns
        -------
        harmonics : (n, 5) m; NaN where too few arms are there.
        residual : (n, arms) m, measured minus fitted.
        spread : (n,) m, standard deviation of the readings that stand no further off than four sigma.
        used : (n,) sum of the weights.
        """
        n, arms = radius.shape
        harmonics, residual = np.empty((n, self.basis.shape[1])), np.empty((n, arms))
        spread, used = np.empty(n), np.empty(n)
        whole = np.ascontiguousarray(radius, float)
        fit_harmonics(whole, self.basis, self._inverse, self.sigma, self.least, harmonics, residual, spread, used)
        return harmonics, residual, spread, used
