"""An output folder in, surfaces of its dents and zones as files out, each with a sidecar that says unit, frame and epoch."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deform.errors import DeformError, Fault, InputError, OptionError
from deform.mesh.colours import colours
from deform.mesh.dent_surface import dent_surface, depth_grid, half_length, read_window
from deform.mesh.library import library
from deform.mesh.pipe_shell import zone_shell
from deform.mesh.preview import preview
from deform.mesh.surface import Surface
from deform.options import MeshOptions
from deform.run import store

_log = logging.getLogger(__name__)
_NOT_THERE = ("removed", "unmeasured", "copied")
FORMATS = ("ply", "glb", "stl", "obj", "png")


def write_dent_surfaces(
    folder: Path | str,
    formats: Iterable[str] = ("ply", "glb", "stl"),
    options: MeshOptions | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Path]:
    """Write ``dents/<dent_id>_<run>.<format>`` for every dent and run that has a wall map there.

    Parameters
    ----------
    folder : output folder of a survey (``runs/``, ``tables/dents.csv``).
    formats : of ``ply``, ``glb``, ``stl``, ``obj``, ``png`` (a preview).
    options : steps, colour, exaggeration.
    progress : called with the fraction done.

    Returns
    -------
    list of Path
        The files written, sidecars (``.json``) among them. Empty when no run has a wall map.

    Raises
    ------
    OptionError
        When a format is not known.
    MissingExtraError
        When Open3D or trimesh is not installed.
    """
    folder, options, wanted = Path(folder), options or MeshOptions(), _known(formats)
    table = _dents(folder)
    written: list[Path] = []
    before: dict[str, Any] = {}
    for done, row in enumerate(table):
        surface, depth = _of_row(folder, row, options, before.get(row.dent_id))
        if surface is None:
            _log.warning("dent %s in %s: no wall map at %.2f m, so no surface", row.dent_id, row.run, row.run_chainage_m)
        else:
            before.setdefault(row.dent_id, depth)
            written += write_surface(surface, folder / "dents" / f"{row.dent_id}_{row.run}", wanted, depth=depth)
        if progress:
            progress((done + 1) / len(table))
    return written


def write_zone_shells(
    folder: Path | str, formats: Iterable[str] = ("ply", "glb"), options: MeshOptions | None = None
) -> list[Path]:
    """Write ``zones/<zone_id>_<run>.<format>``: the pipe of a zone in every run, in one frame, coloured by displacement."""
    folder, options, wanted = Path(folder), options or MeshOptions(), _known(formats)
    zones = store.read_table(folder / "tables" / "zones.csv", "zones")
    comparison = store.read_dataset(folder / "comparison.nc")
    reference = store.read_run(_run_path(folder, str(comparison.attrs["reference"])), groups=("centreline",))
    written: list[Path] = []
    for zone in list[Any](zones.itertuples(index=False)):
        for run in comparison["epoch"].values:
            surface = zone_shell(reference, comparison, str(run), float(zone.start_m), float(zone.end_m), options)
            if surface is not None:
                written += write_surface(surface, folder / "zones" / f"{zone.zone_id}_{run}", wanted)
    return written


def write_surface(surface: Surface, stem: Path, formats: Iterable[str], depth: Any = None) -> list[Path]:
    """Write one surface in several formats, and its sidecar; return the paths."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    paint = colours(surface.value, diverging=surface.meaning["colour"]["shows"] != "depth")
    written = []
    for name in formats:
        path = stem.with_name(f"{stem.name}.{name}")
        if name == "png" and depth is None:
            continue
        with store.atomic(path) as place:
            _WRITERS[name](surface, paint, place, depth)
        written.append(path)
    counts = {
        "vertices": len(surface.vertices),
        "triangles": len(surface.triangles),
        "bounds_m": surface.bounds.round(6).tolist(),
    }
    written.append(store.write_json(surface.meaning | counts, stem.with_name(f"{stem.name}.json")))
    return written


def _write_open3d(surface: Surface, paint: np.ndarray, place: Path, _: Any) -> None:
    o3d = library("open3d")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), o3d.utility.Vector3iVector(surface.triangles.astype(np.int32))
    )
    mesh.vertex_colors = o3d.utility.Vector3dVector(paint)
    mesh.compute_vertex_normals()
    if not o3d.io.write_triangle_mesh(str(place), mesh, write_ascii=False):
        raise InputError(Fault(str(place), "", "Open3D could not write it", "is the disk full?"))


def _write_trimesh(surface: Surface, paint: np.ndarray, place: Path, _: Any) -> None:
    trimesh = library("trimesh")
    paint = np.concatenate([np.rint(paint * 255), np.full((len(paint), 1), 255)], axis=1).astype(np.uint8)
    mesh = trimesh.Trimesh(surface.vertices, surface.triangles, vertex_colors=paint, process=False)
    content = mesh.export(file_type=place.suffix[1:])
    place.write_bytes(content if isinstance(content, bytes) else content.encode())


def _write_png(_surface: Surface, _paint: np.ndarray, place: Path, depth: Any) -> None:
    o3d = library("open3d")
    o3d.io.write_image(str(place), o3d.geometry.Image(preview(depth)))


_WRITERS: dict[str, Callable[[Surface, np.ndarray, Path, Any], None]] = {
    "ply": _write_open3d,
    "stl": _write_open3d,
    "obj": _write_trimesh,
    "glb": _write_trimesh,
    "png": _write_png,
}


def _known(formats: Iterable[str]) -> list[str]:
    wanted = list(dict.fromkeys(formats))
    unknown = [name for name in wanted if name not in FORMATS]
    if unknown:
        raise OptionError(Fault("mesh", "formats", f"{', '.join(unknown)} is not known; known are {', '.join(FORMATS)}"))
    return wanted


def _dents(folder: Path) -> list[Any]:
    """Return the rows of the dents that a run has measured, each with the nominal wall."""
    path = folder / "tables" / "dents.csv"
    if not path.exists():
        return []
    table = store.read_table(path, "dents")
    return list(table[~table.status.isin(_NOT_THERE) & table.run_chainage_m.notna()].itertuples(index=False))


def _of_row(folder: Path, row: Any, options: MeshOptions, before: Any) -> tuple[Surface | None, Any]:
    path = _run_path(folder, row.run)
    half = half_length(row.length_m, options)
    window = read_window(path, row.run_chainage_m, half + options.step_m)
    if window is None:
        return None, None
    try:
        depth = depth_grid(window, row.run_chainage_m, half, options)
    except (IndexError, ValueError):
        return None, None
    if before is not None and before.shape != depth.shape:
        before = before.interp(distance=depth["distance"], clock=depth["clock"], kwargs={"fill_value": 0.0})
    attrs = _attrs(path)
    surface = dent_surface(
        window, row.run_chainage_m, half, wall_thickness=float(attrs.get("nominal_wall_m", 0.006)), options=options, before=before
    )
    clock = None if pd.isna(row.clock_deg) else float(row.clock_deg)
    who = {"dent": row.dent_id, "run": row.run, "date": str(attrs.get("date", "")), "status": row.status, "clock_deg": clock}
    depth.attrs["clock_deg"] = clock
    return Surface(surface.vertices, surface.triangles, surface.value, who | surface.meaning), depth


def _attrs(path: Path) -> dict:
    try:
        return dict(store.read_run(path, groups=()).attrs)
    except DeformError:
        return {}


def _run_path(folder: Path, run: str) -> Path:
    return next((p for end in ("nc", "zarr") if (p := folder / "runs" / f"{run}.{end}").exists()), folder / "runs" / f"{run}.nc")
