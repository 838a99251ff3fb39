"""A surface and its colours in, one file of a format out; what a format can hold of units, fields and frame it holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from deform.errors import Fault, InputError
from deform.mesh.library import library
from deform.mesh.surface import Surface

_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])  # glTF: y is up, metres
_VERTICES, _INDICES = 34962, 34963  # what a buffer is for, by the number that glTF gives it


def write_stl(surface: Surface, _: np.ndarray, place: Path) -> None:
    """Write STL: shape only, no colour, no unit (metre by the sidecar)."""
    o3d = library("open3d")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), o3d.utility.Vector3iVector(surface.triangles.astype(np.int32))
    )
    mesh.compute_vertex_normals()
    if not o3d.io.write_triangle_mesh(str(place), mesh, write_ascii=False):
        raise InputError(Fault(str(place), "", "Open3D could not write it", "is the disk full?"))


def write_ply(surface: Surface, paint: np.ndarray, place: Path) -> None:
    """Write PLY: colours, and the fields as numbers of every vertex (``depth_m``, ``radius_m``, ``strain``, ``change_m``)."""
    mesh = _trimesh(surface, paint)
    for name, values in surface.fields.items():
        mesh.vertex_attributes[name] = values.astype(np.float32)
    place.write_bytes(mesh.export(file_type="ply"))


def write_obj(surface: Surface, paint: np.ndarray, place: Path) -> None:
    """Write OBJ: shape and colours of the vertices."""
    place.write_text(_trimesh(surface, paint).export(file_type="obj"), encoding="utf-8")


def write_glb(surface: Surface, paint: np.ndarray, place: Path) -> None:
    """Write GLB as glTF 2.0 asks: upright with y up by the node, colours linear, a matt material, the meaning in ``extras``."""
    trimesh = library("trimesh")
    linear = np.where(paint <= 0.04045, paint / 12.92, ((paint + 0.055) / 1.055) ** 2.4)
    scene = trimesh.Scene()
    scene.add_geometry(_trimesh(surface, linear), node_name="pipe", geom_name="pipe", transform=_UPRIGHT)
    content = trimesh.exchange.gltf.export_glb(
        scene, include_normals=True, tree_postprocessor=lambda tree: _finish(tree, surface)
    )
    place.write_bytes(content)


def _finish(tree: dict[str, Any], surface: Surface) -> None:
    tree["asset"]["generator"] = "deform"
    matt = {"name": "steel", "doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.8}}
    tree["materials"] = [matt]
    for mesh in tree["meshes"]:
        mesh["extras"] = surface.meaning
        for primitive in mesh["primitives"]:
            primitive["material"] = 0
            users = [(index, _VERTICES) for index in primitive["attributes"].values()] + [(primitive["indices"], _INDICES)]
            for accessor, target in users:
                tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] = target


def _trimesh(surface: Surface, paint: np.ndarray) -> Any:
    colours = np.concatenate([np.rint(paint * 255), np.full((len(paint), 1), 255)], axis=1).astype(np.uint8)
    return library("trimesh").Trimesh(surface.vertices, surface.triangles, vertex_colors=colours, process=False)


WRITERS: dict[str, Callable[[Surface, np.ndarray, Path], None]] = {
    "ply": write_ply,
    "stl": write_stl,
    "obj": write_obj,
    "glb": write_glb,
}
