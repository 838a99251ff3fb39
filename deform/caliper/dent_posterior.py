"""Departures from the undamaged section in, the dents that may have made them out: where to begin, and what few arms leave open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deform.caliper.dent_shape import ALONG, AROUND, DEPTH, LENGTH, LN10, WIDTH, DentFit, wrap

_STAGES = 4  # the grid is laid anew about the mean, four sigma to either side
_WIDTHS, _CLOCKS, _FULLS = 17, 17, 5  # points of the grid
_REACH = 4.0  # sigma


@dataclass(frozen=True)
class Prior:
    """What is known of dents before one is measured; logs of sizes, sigma in the same.

    Attributes
    ----------
    aspect, aspect_sigma : log of width over length.
    fullness, fullness_sigma : fullness along.
    alike_sigma : fullness around minus along.
    steep, steep_sigma : log of depth over width.
    """

    aspect: float = -0.4
    aspect_sigma: float = 0.9
    fullness: float = 2.4
    fullness_sigma: float = 0.9
    alike_sigma: float = 0.4
    steep: float = -3.0
    steep_sigma: float = 1.2

    def normal(self, dent: np.ndarray, outer_radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (7, 7) and right side of the prior at the unknowns of a dent."""
        rows = np.zeros((4, 7))
        log_radius = np.log(outer_radius)
        rows[0, WIDTH], rows[0, LENGTH] = 1 / self.aspect_sigma, -1 / self.aspect_sigma
        rows[1, ALONG] = 1 / self.fullness_sigma
        rows[2, AROUND], rows[2, ALONG] = 1 / self.alike_sigma, -1 / self.alike_sigma
        rows[3, DEPTH], rows[3, WIDTH] = 1 / self.steep_sigma, -1 / self.steep_sigma
        wanted = np.array(
            [
                (self.aspect - log_radius) / self.aspect_sigma,
                self.fullness / self.fullness_sigma,
                0.0,
                (self.steep + log_radius) / self.steep_sigma,
            ]
        )
        return rows.T @ rows, rows.T @ (wanted - rows @ dent)


def first_guess(
    place: np.ndarray,
    clock: np.ndarray,
    departure: np.ndarray,
    sigma: np.ndarray,
    start: tuple[float, float, float],
    spacing: float,
) -> np.ndarray | None:
    """Unknowns of the dent that explains the departures best among a coarse choice of sizes and places.

    Parameters
    ----------
    place, clock, departure, sigma : (n,), (n, arms), ... of the readings about the centre (m, rad, m, m).
    start : centre (m), clock (rad) and depth (m) as the candidate has them.
    spacing : rad, between arms.
    """
    centre, at, depth = start
    near = (np.abs(place - centre) < 0.8)[:, None] & (np.abs(wrap(clock - at)) < 1.6) & np.isfinite(departure) & (sigma < np.inf)
    if near.sum() < 10:
        return None
    rows, columns = np.nonzero(near)
    s, phi, y, w = place[rows], clock[rows, columns], departure[near], 1.0 / sigma[near] ** 2
    best = (np.inf, None)
    for length in (0.1, 0.17, 0.3, 0.5, 0.9):
        for width in (0.25, 0.5, 1.0, 1.9):
            if width < 0.8 * spacing:
                continue
            for side in (-0.5, 0.0, 0.5):
                turn = at + side * min(width, spacing)
                shape = np.exp(-LN10 * (np.abs(2 * (s - centre) / length) ** 2.4 + np.abs(2 * wrap(phi - turn) / width) ** 2.4))
                power = float(np.sum(w * shape**2))
                size = float(np.sum(w * shape * y)) / max(power, 1e-12)
                if size > 0:
                    best = min(best, (-(size**2) * power, (size, turn, length, width)), key=lambda b: b[0])
    if best[1] is None:
        return None
    size, turn, length, width = best[1]
    return np.array([np.log(max(size, 0.3 * depth)), centre, turn, np.log(length), np.log(width), 2.4, 2.4])


def posterior(
    fit: DentFit,
    place: np.ndarray,
    clock: np.ndarray,
    departure: np.ndarray,
    sigma: np.ndarray,
    prior: Prior,
    section: np.ndarray,
) -> DentFit:
    """Depth, clock and width with sigma as means over all dents that few arms leave possible.

    Parameters
    ----------
    fit : the most probable dent; its place, length and fullness along are taken as known, for scans are dense.
    place, clock, departure, sigma : (n,), (n, arms), ... of the readings about the centre (m, rad, m, m).
    section : (3,) variance of depth (m2), clock (rad2) and width (m2) that comes from the section and the offset.

    Notes
    -----
    Width, clock and fullness around run over a grid; for each the depth is linear, and is integrated in closed form. The grid
    begins wide, three arms across, and closes in on what is probable.
    """
    along = np.exp(-LN10 * np.abs(2 * (place - fit.centre) / fit.length) ** fit.along_power)
    spacing = 2 * np.pi / clock.shape[1]
    best = fit.width / fit.outer_radius
    reach = max(2.0 * best, 3.0 * spacing)
    near = (along > 0.03)[:, None] & (np.abs(wrap(clock - fit.clock)) < reach) & np.isfinite(departure) & (sigma < np.inf)
    if near.sum() < 3:
        return fit
    readings = (
        np.broadcast_to(along[:, None], clock.shape)[near],
        wrap(clock[near] - fit.clock),
        departure[near],
        1.0 / sigma[near] ** 2,
    )
    middle, spread = np.array([np.log(best), 0.0]), np.array([0.35, 0.3 * spacing])
    for _ in range(_STAGES):
        share, size, power, log_width, turn = _weights(fit, readings, middle, spread, prior)
        middle = np.array([share @ log_width, share @ turn])
        step = 2 * _REACH * spread / (np.array([_WIDTHS, _CLOCKS]) - 1)
        found = np.sqrt([share @ (log_width - middle[0]) ** 2, share @ (turn - middle[1]) ** 2])
        spread = np.maximum(found, 0.5 * step)
    depth = float(share @ size)
    width = float(share @ np.exp(log_width)) * fit.outer_radius
    width2 = float(share @ np.exp(2 * log_width)) * fit.outer_radius**2 - width**2
    return replace(
        fit,
        depth=depth,
        clock=float((fit.clock + middle[1]) % (2 * np.pi)),
        width=width,
        depth_sigma=float(np.sqrt(share @ (size**2 + 1.0 / power) - depth**2 + section[0])),
        clock_sigma=float(np.sqrt(found[1] ** 2 + section[1])),
        width_sigma=float(np.sqrt(max(width2, 0.0) + section[2])),
    )


def _weights(fit: DentFit, readings: tuple[np.ndarray, ...], middle: np.ndarray, spread: np.ndarray, prior: Prior):
    """Share of each dent of a grid, with its depth (m), the inverse variance of that, log width (of rad) and clock (rad)."""
    along, phi, value, weight = readings
    log_widths = middle[0] + spread[0] * np.linspace(-_REACH, _REACH, _WIDTHS)
    clocks = middle[1] + spread[1] * np.linspace(-_REACH, _REACH, _CLOCKS)
    fulls = 2.0 * prior.alike_sigma * np.linspace(-1.0, 1.0, _FULLS)
    log_width, turn, full = (v.ravel() for v in np.meshgrid(log_widths, clocks, fulls, indexing="ij"))
    around = np.clip(fit.along_power + full, 1.05, 8.0)
    shape = along * np.exp(-LN10 * np.abs(2 * (phi - turn[:, None]) / np.exp(log_width)[:, None]) ** around[:, None])
    power = np.maximum((shape**2) @ weight, 1e-12)
    size = (shape @ (weight * value)) / power
    ok = size > 0
    log_size, log_metre = np.log(np.where(ok, size, 1.0)), log_width + np.log(fit.outer_radius)
    unlike = (
        ((log_size - log_metre - prior.steep) / prior.steep_sigma) ** 2
        + ((log_metre - np.log(fit.length) - prior.aspect) / prior.aspect_sigma) ** 2
        + (full / prior.alike_sigma) ** 2
    )
    log = np.where(ok, 0.5 * size**2 * power - 0.5 * np.log(power) - log_size - 0.5 * unlike, -np.inf)
    share = np.exp(log - log.max())
    return share / share.sum(), size, power, log_width, turn
