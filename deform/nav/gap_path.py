"""A problem with gaps in; the same about a path by dead reckoning that turns at the gaps so that it meets the marks, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deform.geometry.rotation import rotation_vector_to_matrix
from deform.nav import _kernels_state as kernels
from deform.nav._kernels import GAP_TURN, place_difference
from deform.nav.dead_reckoning import dead_reckon
from deform.nav.filter import Problem
from deform.nav.gaps import turned_as

Floats = NDArray[np.float64]

LOOSE = 0.01  # share of the way between two marks by which dead reckoning may miss
HUBER = 3.0  # sigma beyond which the way between two marks loses weight
ROUNDS, SETTLED_RAD = 30, 1e-5


def about_reckoning(problem: Problem) -> Problem:
    """Return the problem with states about which everything may be taken as linear at first.

    Notes
    -----
    A filter cannot go first: with the azimuth open by tens of degrees behind a gap it takes its own corrections for forces.
    Dead reckoning needs no more than the attitude. It is level behind each gap (`_kernels.levelled_turn`); its azimuth gains an
    unknown turn there, of the variance that the gap allows, and one at the start.
    """
    start, epochs = problem.start.state, problem.epochs
    mounting = np.array([start[kernels.MOUNTING], 1.0, start[kernels.MOUNTING + 1]])
    attitude, scale = start[kernels.MATRIX : kernels.MATRIX + 9].reshape(3, 3), 1.0 + start[kernels.SCALE]
    straight = dead_reckon(epochs, start[:3], attitude, mounting, scale)
    at = np.append(0, np.flatnonzero(epochs.table[:, GAP_TURN] > 0) + 1)  # bounds behind the turns
    prior = np.append(problem.start.covariance[8, 8], epochs.table[at[1:] - 1, GAP_TURN])
    turns = turns_to_marks(problem, straight.steps, at, prior)
    turned = np.cumsum(turns)[np.searchsorted(at, np.arange(epochs.bounds.size), side="right") - 1]
    states, sigma = np.tile(start, (turned.size, 1)), np.zeros((turned.size, kernels.NAVIGATED))
    matrix, sigma[at, 8] = slice(kernels.MATRIX, kernels.MATRIX + 9), np.sqrt(prior)
    states[:, matrix] = (rotation_vector_to_matrix(np.outer(turned, [0.0, 0.0, 1.0])) @ straight.attitudes).reshape(-1, 9)
    epochs = turned_as(epochs, states, sigma)
    path = dead_reckon(epochs, start[:3], states[0, matrix].reshape(3, 3), mounting, scale)
    velocity = path.steps / epochs.duration[:, None]
    states[:, :3], states[:, matrix] = path.places, path.attitudes.reshape(-1, 9)
    states[:, 3:6] = np.concatenate([velocity[:1], 0.5 * (velocity[1:] + velocity[:-1]), velocity[-1:]])
    return replace(problem, about=states, epochs=epochs)


def turns_to_marks(problem: Problem, steps: Floats, at: NDArray[np.int64], prior: Floats) -> Floats:
    """Return the turns of azimuth (radian, to the left) that lead a dead-reckoned path from mark to mark.

    Parameters
    ----------
    steps : (epoch, 3) east, north, up of each epoch's travel (m).
    at : (turn,) bounds from which the path is turned, rising.
    prior : (turn,) their variances about zero (radian²).

    Notes
    -----
    Gauss and Newton, in the space of the ways between marks: there may be far more gaps than marks. A way that lies beyond
    `HUBER` sigma, of a mark in the wrong place, loses weight.
    """
    marks, start = problem.marks, problem.start
    bound, place = np.append(0, marks.epoch), np.vstack([start.state[:3], marks.place])
    spread = np.append(start.covariance[0, 0] + start.covariance[1, 1], marks.variance[:, :2].sum(axis=1))
    new = np.flatnonzero(np.diff(bound) > 0) + 1
    if not new.size:
        return np.zeros(at.size)
    last = np.append(0, new[:-1])
    wanted = np.array([place_difference(place[i], place[j])[:2] for i, j in zip(new, last, strict=True)])
    edges = np.unique(np.concatenate([at, bound]))
    edges = edges[edges < len(steps)]
    parts = np.add.reduceat(steps[:, :2], edges, axis=0)  # ways that no turn and no mark divides
    size = np.add.reduceat(np.linalg.norm(steps, axis=1), edges)
    way = np.searchsorted(bound[new], edges, side="right")  # which way between marks each belongs to
    inside = way < new.size
    parts, size, edges, way = parts[inside], size[inside], edges[inside], way[inside]
    R = 0.5 * (spread[new] + spread[last]) + (LOOSE * np.bincount(way, size, new.size)) ** 2
    behind = edges[:, None] >= at  # (part, turn) parts that a turn turns
    turns, weight = np.zeros(at.size), np.ones(new.size)
    for _ in range(ROUNDS):
        heading = behind @ turns
        c, s = np.cos(heading), np.sin(heading)
        e, n = c * parts[:, 0] - s * parts[:, 1], s * parts[:, 0] + c * parts[:, 1]
        path = np.column_stack([np.bincount(way, v, new.size) for v in (e, n)])
        slopes = np.zeros((2, new.size, at.size))
        for axis, slope in enumerate((-n, e)):
            np.add.at(slopes[axis], way, slope[:, None] * behind)
        J, miss, noise = slopes.reshape(-1, at.size), (wanted - path).T.ravel(), np.tile(R / weight, 2)
        found = prior * (J.T @ np.linalg.solve(J * prior @ J.T + np.diag(noise), miss + J @ turns))
        moved, turns = np.abs(found - turns).max(), found
        weight = np.minimum(1.0, HUBER / np.maximum(np.hypot(*(wanted - path).T) / np.sqrt(R), 1e-9))
        if moved < SETTLED_RAD:
            break
    return turns
