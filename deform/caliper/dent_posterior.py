"""Departures from the undamaged section in, the dents that may have made them out: first values, and what few arms leave open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deform.caliper.dent_shape import ALONG, AROUND, DEPTH, LEAST_FULL, LENGTH, LN10, MOST_FULL, WIDTH, DentFit, wrap

_WIDTHS, _FULLS, _CLOCKS = 41, 7, 321  # points of the grid
_TRUE_TO_SHAPE = 0.02  # of the largest amplitude: how well a real dent keeps to the shape


@dataclass(frozen=True)
class Prior:
    """What is known of dents before one is measured; logs of sizes, sigma in the same.

    Attributes
    ----------
    aspect, aspect_sigma : log of width over length.
    fullness, fullness_sigma : fullness along.
    alike_sigma : fullness around minus along.
    steep, steep_sigma : log of depth over width.

    Notes
    -----
    No measured population of dents stands behind these values. The means of aspect and steepness are those of usual simulated
    dents (0.3 m by 0.2 m, 3 % of a 0.32 m pipe deep); the sigmas, factors of 2.5 and 3.3, are wide enough for the one recorded
    dent at hand. The fullness lies between a bell (2) and a dent with a flat floor (3 and more).
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
    near = (np.abs(place - centre) < 1.2)[:, None] & (np.abs(wrap(clock - at)) < 1.6) & np.isfinite(departure) & (sigma < np.inf)
    if near.sum() < 10:
        return None
    rows, columns = np.nonzero(near)
    s, phi, y, w = place[rows], clock[rows, columns], departure[near], 1.0 / sigma[near] ** 2
    full = Prior.fullness
    best: tuple[float, tuple[float, float, float, float] | None] = (np.inf, None)
    for length in (0.1, 0.17, 0.3, 0.5, 0.9, 1.6):
        for width in (0.25, 0.5, 1.0, 1.9):
            if width < 0.8 * spacing:
                continue
            for side in (-0.5, 0.0, 0.5):
                turn = at + side * min(width, spacing)
                shape = np.exp(-LN10 * (np.abs(2 * (s - centre) / length) ** full + np.abs(2 * wrap(phi - turn) / width) ** full))
                power = float(np.sum(w * shape**2))
                size = float(np.sum(w * shape * y)) / max(power, 1e-12)
                if size > 0:
                    best = min(best, (-(size**2) * power, (size, turn, length, width)), key=lambda b: b[0])
    if best[1] is None:
        return None
    size, turn, length, width = best[1]
    return np.array([np.log(max(size, 0.3 * depth)), centre, turn, np.log(length), np.log(width), full, full])


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
    The readings of an arm along the dent give its amplitude. Width, fullness around and clock run over a grid; for each the
    depth is linear, and is integrated in closed form. Two arms that see the flanks of a narrow dent leave its depth open
    upwards: the sigma of the depth is such that 1.96 of it reach the outer fortieths of its distribution.
    """
    arms = _amplitudes(fit, place, clock, departure, sigma)
    if arms is None:
        return fit
    turn, value, spread2 = arms
    spacing = 2 * np.pi / clock.shape[1]
    log_width = np.linspace(np.log(0.4 * spacing), np.log(max(3.0 * spacing, 2.5 * fit.width / fit.outer_radius)), _WIDTHS)
    full = 2.0 * prior.alike_sigma * np.linspace(-1.0, 1.0, _FULLS)
    log_width, full = (v.ravel() for v in np.meshgrid(log_width, full, indexing="ij"))
    at = spacing * np.linspace(-1.0, 1.0, _CLOCKS)
    size, power = _depths(turn, value, 1.0 / spread2, log_width, np.clip(fit.along_power + full, LEAST_FULL, MOST_FULL), at)
    log_size, log_metre = np.log(size), (log_width + np.log(fit.outer_radius))[:, None]
    unlike = (
        ((log_size - log_metre - prior.steep) / prior.steep_sigma) ** 2
        + ((log_metre - np.log(fit.length) - prior.aspect) / prior.aspect_sigma) ** 2
        + (full[:, None] / prior.alike_sigma) ** 2
    )
    log = 0.5 * size**2 * power - 0.5 * np.log(power) - log_size - 0.5 * unlike
    share = np.exp(log - log.max())
    share /= share.sum()
    widths, clocks = share.sum(axis=1), share.sum(axis=0)
    mean_clock, width = float(clocks @ at), float(widths @ np.exp(log_metre[:, 0]))
    depth, depth_sigma = _mean_and_reach(size.ravel(), share.ravel(), float(np.sum(share / power)))
    return replace(
        fit,
        depth=depth,
        clock=float((fit.clock + mean_clock) % (2 * np.pi)),
        width=width,
        depth_sigma=float(np.sqrt(depth_sigma**2 + section[0])),
        clock_sigma=float(np.sqrt(clocks @ (at - mean_clock) ** 2 + (at[1] - at[0]) ** 2 / 12.0 + section[1])),
        width_sigma=float(np.sqrt(widths @ (np.exp(log_metre[:, 0]) - width) ** 2 + section[2])),
    )


def _amplitudes(fit: DentFit, place: np.ndarray, clock: np.ndarray, departure: np.ndarray, sigma: np.ndarray):
    """Clock about the apex (rad), amplitude along the dent (m) and its variance of each arm in reach; None for too few."""
    along = np.exp(-LN10 * np.abs(2 * (place - fit.centre) / fit.length) ** fit.along_power)
    reach = max(2.0 * fit.width / fit.outer_radius, 6.0 * np.pi / clock.shape[1])
    turn = wrap(clock - fit.clock)
    near = (along > 0.03)[:, None] & (np.abs(turn) < reach) & np.isfinite(departure) & (sigma < np.inf)
    weight = np.where(near, 1.0 / sigma**2, 0.0)
    power = (weight * along[:, None] ** 2).sum(axis=0)
    seen = power > 0.05 * power.max(initial=0.0)
    if seen.sum() < 1 or not power.any():
        return None
    share = weight[:, seen] / np.maximum(weight[:, seen].sum(axis=0), 1e-12)
    value = (weight * along[:, None] * np.where(near, departure, 0.0)).sum(axis=0)[seen] / power[seen]
    spread2 = 1.0 / power[seen] + (_TRUE_TO_SHAPE * np.max(value)) ** 2
    return (share * np.where(near, turn, 0.0)[:, seen]).sum(axis=0), value, spread2


def _depths(turn, value, weight, log_width, power, at) -> tuple[np.ndarray, np.ndarray]:
    """Depth (m) and its inverse variance for each log width and fullness (k) at each clock (rad), from the arms' amplitudes."""
    log_off = np.log(np.maximum(np.abs(turn - at[:, None]), 1e-9)) + np.log(2.0)
    size, total = np.empty((log_width.size, at.size)), np.empty((log_width.size, at.size))
    for k in range(log_width.size):
        shape = np.exp(-LN10 * np.exp(power[k] * (log_off - log_width[k])))
        total[k] = np.maximum((shape**2) @ weight, 1e-12)
        size[k] = np.maximum(shape @ (weight * value) / total[k], 1e-5)
    return size, total


def _mean_and_reach(value: np.ndarray, share: np.ndarray, noise2: float) -> tuple[float, float]:
    """Mean, and the sigma of which 1.96 reach the outer fortieths of a distribution on both sides."""
    mean = float(share @ value)
    order = np.argsort(value)
    low, high = np.interp([0.025, 0.975], np.cumsum(share[order]), value[order])
    spread = float(np.sqrt(share @ (value - mean) ** 2))
    return mean, float(np.hypot(max(spread, (high - mean) / 1.96, (mean - low) / 1.96), np.sqrt(noise2)))
