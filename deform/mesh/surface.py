"""A grid of points round a pipe in, a triangle surface out: vertices, triangles, a value per vertex; plain arrays, no library."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Surface:
    """A triangle surface.

    Attributes
    ----------
    vertices : (n, 3), metre.
    triangles : (m, 3), indices, counter-clockwise seen from outside the steel.
    value : (n,), what the colour shows, NaN where unknown.
    meaning : unit, frame and whatever else a reader must know; goes into the sidecar.
    fields : further numbers of every vertex by name, such as ``radius_m``; formats that can hold them do.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    value: np.ndarray
    meaning: dict = field(default_factory=dict)
    fields: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def bounds(self) -> np.ndarray:
        """Least and greatest corner (2, 3), metre."""
        return np.stack([self.vertices.min(0), self.vertices.max(0)])


def tube_triangles(rows: int, around: int, *, outward: bool, first: int = 0) -> np.ndarray:
    """Return the triangles (m, 3) of a closed tube of ``rows`` rings of ``around`` points each, normals out of or into the tube.

    Rings run downstream (x), points clockwise looking downstream, so that a ring is (sin clock, cos clock) in (y, z).
    """
    r, c = np.meshgrid(np.arange(rows - 1), np.arange(around), indexing="ij")
    a = (r * around + c).ravel() + first
    b = (r * around + (c + 1) % around).ravel() + first
    below, other = a + around, b + around
    triangles = np.concatenate([np.stack([a, below, b], 1), np.stack([b, below, other], 1)])
    return triangles if outward else triangles[:, ::-1]


def rim_triangles(inner: np.ndarray, outer: np.ndarray, *, downstream: bool) -> np.ndarray:
    """Return the triangles that close the steel between two rings of vertex indices at an end of the tube."""
    after_inner, after_outer = np.roll(inner, -1), np.roll(outer, -1)
    triangles = np.concatenate([np.stack([inner, after_inner, outer], 1), np.stack([after_inner, after_outer, outer], 1)])
    return triangles if downstream else triangles[:, ::-1]


def steel(
    inner: np.ndarray, outer: np.ndarray, value: np.ndarray, meaning: dict, fields: dict[str, np.ndarray] | None = None
) -> Surface:
    """Return the closed surface of a piece of pipe from the points of its inner and outer wall.

    Parameters
    ----------
    inner, outer : points (rows, around, 3), metre.
    value : (rows, around), what the colour of both walls shows.
    meaning : goes into the sidecar.
    fields : (rows, around) each, further numbers of both walls.
    """
    rows, around, _ = inner.shape
    n = rows * around
    ring = np.arange(around)
    triangles = np.concatenate(
        [
            tube_triangles(rows, around, outward=False),
            tube_triangles(rows, around, outward=True, first=n),
            rim_triangles(ring, ring + n, downstream=False),
            rim_triangles(ring + n - around, ring + 2 * n - around, downstream=True),
        ]
    )
    vertices = np.concatenate([inner.reshape(n, 3), outer.reshape(n, 3)])
    both = {name: np.tile(np.ravel(values), 2) for name, values in (fields or {}).items()}
    return Surface(vertices, triangles, np.tile(np.ravel(value), 2), meaning, both)
