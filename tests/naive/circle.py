"""Plain twins of the section adjustment: a general solver on the exact distance along each ray, and the printed matrices."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares


def ray_length(parameters, angle):
    """Length (m) of the ray at ``angle`` (clockwise from up) from the origin to the ellipse right, up, a, b, alpha."""
    right, up, a, b, alpha = parameters
    sin, cos = np.sin(alpha), np.cos(alpha)
    du, dv = np.sin(angle) * sin + np.cos(angle) * cos, np.sin(angle) * cos - np.cos(angle) * sin
    ou, ov = -right * sin - up * cos, -right * cos + up * sin
    first, second, third = (du / a) ** 2 + (dv / b) ** 2, du * ou / a**2 + dv * ov / b**2, (ou / a) ** 2 + (ov / b) ** 2 - 1
    return (-second + np.sqrt(second**2 - first * third)) / first


def ellipse_by_rays(radius, angle, start, sigma):
    """Least squares on the measured minus the exact ray length; parameters and covariance."""
    fit = least_squares(
        lambda p: (ray_length(p, angle) - radius) / sigma, start, x_scale=[1e-3, 1e-3, 1e-2, 1e-2, 1e-1], xtol=1e-15
    )
    return fit.x, np.linalg.inv(fit.jac.T @ fit.jac)


def circle_by_porter(x, z, sigma, rounds=20):
    """Porter (2-1), (2-3) to (2-6) as printed, one section: unknowns R, dx, dz with centre at -dx, -dz."""
    cov_points = sigma**2 * np.eye(2 * len(x))
    unknowns = np.array([np.hypot(x, z).mean(), 0.0, 0.0])
    observed = np.stack([x, z], axis=1)
    adjusted = observed.copy()
    for _ in range(rounds):
        size, dx, dz = unknowns
        ax, az = adjusted.T
        w = (ax + dx) ** 2 + (az + dz) ** 2 - size**2
        a = np.stack([np.full(len(x), -2 * size), 2 * (ax + dx), 2 * (az + dz)], axis=1)
        b = np.zeros((len(x), 2 * len(x)))
        for i in range(len(x)):
            b[i, 2 * i : 2 * i + 2] = 2 * (ax[i] + dx), 2 * (az[i] + dz)
        w = w + b @ (observed - adjusted).ravel()
        m = np.linalg.inv(b @ cov_points @ b.T)
        delta = -np.linalg.solve(a.T @ m @ a, a.T @ m @ w)
        residual = -cov_points @ b.T @ m @ (a @ delta + w)
        unknowns = unknowns + delta
        adjusted = observed + residual.reshape(-1, 2)
    return unknowns, np.linalg.inv(a.T @ m @ a), residual.reshape(-1, 2)
