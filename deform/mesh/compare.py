"""Two surfaces of one dent or zone in, the distance between them out."""

from __future__ import annotations

import numpy as np

from deform.mesh.library import library
from deform.mesh.surface import Surface


def inner_wall_movement(surface: Surface, other: Surface) -> dict[str, float]:
    """Return how far the inner wall of a surface lies from that of an earlier one (metre), nearest point to nearest point.

    Returns
    -------
    dict
        ``most_inward_m``, ``most_outward_m`` (both at least zero), ``rms_m``. The first half of the vertices of `surface.steel`
        are the inner wall; only inner walls are compared, so that a bulge is never measured against the outer one.
    """
    o3d, n = library("open3d"), len(other.vertices) // 2
    walls = [each.vertices[: len(each.vertices) // 2].astype(np.float32) for each in (surface, other)]
    ends = walls[1][:, 0].min(), walls[1][:, 0].max()  # beyond its ends the other one says nothing
    points = walls[0][(walls[0][:, 0] >= ends[0] - 1e-6) & (walls[0][:, 0] <= ends[1] + 1e-6)]
    scene = o3d.t.geometry.RaycastingScene()
    inner = np.ascontiguousarray(other.triangles[(other.triangles < n).all(axis=1)], np.uint32)
    scene.add_triangles(o3d.core.Tensor(walls[1]), o3d.core.Tensor(inner))
    nearest = scene.compute_closest_points(o3d.core.Tensor(points))
    away = points - nearest["points"].numpy()
    inward = np.sign((away * nearest["primitive_normals"].numpy()).sum(axis=1))  # the normals of an inner wall look into the bore
    size = inward * np.linalg.norm(away, axis=1)
    return {
        "most_inward_m": float(max(size.max(), 0.0)),
        "most_outward_m": float(max(-size.min(), 0.0)),
        "rms_m": float(np.sqrt(np.mean(size**2))),
    }
