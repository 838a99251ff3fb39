"""Two surfaces of one dent in, the distance between them out."""

from __future__ import annotations

import numpy as np

from deform.mesh.library import library
from deform.mesh.surface import Surface


def distance(surface: Surface, other: Surface) -> np.ndarray:
    """Return the signed distance (m) of every vertex of a surface (n,) from another one, positive outside the other's steel.

    Both must stand in one frame, which `dent_surface` and `zone_shell` guarantee for one dent or zone in all runs.
    """
    o3d = library("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(other.vertices.astype(np.float32)), o3d.core.Tensor(np.ascontiguousarray(other.triangles, np.uint32))
    )
    return scene.compute_signed_distance(o3d.core.Tensor(surface.vertices.astype(np.float32))).numpy().astype(float)
