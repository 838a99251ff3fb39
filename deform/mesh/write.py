"""An output folder in, surfaces of its dents and zones as files out, each with a sidecar that says unit, frame and epoch."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from deform.errors import Fault, InputError, OptionError
from deform.mesh.colours import colours
from deform.mesh.compare import inner_wall_movement
from deform.mesh.dent_surface import dent_surface, depth_grid, half_length
from deform.mesh.formats import WRITERS
from deform.mesh.library import library
from deform.mesh.pipe_shell import wall_radii, zone_shell
from deform.mesh.preview import preview
from deform.mesh.strain_field import strain_grid
from deform.mesh.surface import Surface
from deform.options import MeshOptions
from deform.run import store

_log = logging.getLogger(__name__)
_NOT_THERE = ("removed", "unmeasured", "copied")
_SAME_M = 0.05  # from a dent of the table to the one of the run that it is
FORMATS = (*WRITERS, "png")


@dataclass(frozen=True)
class _Run:
    """Where a run lies, its attributes and its dents."""

    path: Path
    attrs: dict[Any, Any]
    dents: xr.Dataset

    @staticmethod
    def of(folder: Path, run: str) -> _Run:
        """Read attributes and dents of a run; none of either where it cannot be read."""
        path = store.run_path(folder, run)
        try:
            tree = store.read_run(path, groups=("dents",))
        except InputError:
            return _Run(path, {}, xr.Dataset())
        return _Run(path, tree.attrs, tree["dents"].to_dataset() if "dents" in tree.children else xr.Dataset())

    def wall_at(self, chainage: float) -> float:
        """Return the wall thickness (m) that the strain of the dent at a chainage (m) was computed with; NaN when none is known.

        That is its joint's own where the run measured one, else the nominal one (`strain.dent.add_dent_strain`).
        """
        if "wall_thickness" in self.dents and self.dents.sizes["dent"]:
            away = np.abs(self.dents["chainage"].values - chainage)
            own = float(self.dents["wall_thickness"].values[int(np.argmin(away))])
            if away.min() <= _SAME_M and own > 0:
                return own
        return float(self.attrs.get("nominal_wall_m", np.nan))


@dataclass(frozen=True)
class _Measured:
    """One dent in one run: its depths on a grid, its surface in true size and as drawn."""

    depth: xr.DataArray
    true: Surface
    drawn: Surface


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
    runs = {run: _Run.of(folder, run) for run in table.run.unique()}
    written: list[Path] = []
    done = 0
    for dent, rows in table.groupby("dent_id", sort=False):
        first: tuple[str, _Measured] | None = None
        top = float(rows.depth_m.max()) if rows.depth_m.notna().any() else None
        half = half_length(float(rows.length_m.max()), options)  # one extent for all years
        for row in list[Any](rows.itertuples(index=False)):
            measured = _of_row(runs[row.run], row, half, options, first[1].depth if first else None)
            if measured is not None:
                surface = replace(measured.drawn, meaning=_meaning(runs[row.run], row, measured, first))
                stem = folder / "dents" / f"{dent}_{row.run}"
                written += write_surface(surface, stem, wanted)
                if "png" in wanted:
                    written.append(_write_preview(measured, options, top, stem))
                first = first or (str(row.run), measured)
            done += 1
            if progress:
                progress(done / len(table))
    return written


def write_zone_shells(
    folder: Path | str, formats: Iterable[str] = ("ply", "glb"), options: MeshOptions | None = None
) -> list[Path]:
    """Write ``zones/<zone_id>_<run>.<format>``: the pipe of a zone in every run, in one frame, coloured by displacement.

    Nothing is written for pipe that was replaced, nor where no comparison tells how the pipe moved.
    """
    folder, options, wanted = Path(folder), options or MeshOptions(), _known(formats)
    if not (folder / "comparison.nc").exists() or not (folder / "tables" / "zones.csv").exists():
        return []
    zones = store.read_table(folder / "tables" / "zones.csv", "zones")
    comparison = store.read_dataset(folder / "comparison.nc")
    if zones.empty or "displacement_east" not in comparison:
        return []
    reference = store.read_run(store.run_path(folder, str(comparison.attrs["reference"])), groups=("centreline",))
    if wall_radii(reference) is None:
        _log.warning("run %s states no diameter and wall thickness: no shells of zones are drawn", comparison.attrs["reference"])
        return []
    written: list[Path] = []
    for zone in list[Any](zones[zones.kind != "reconfiguration"].itertuples(index=False)):
        for run in comparison["epoch"].values:
            surface = zone_shell(reference, comparison, str(run), float(zone.start_m), float(zone.end_m), options)
            if surface is not None:
                surface = replace(surface, meaning={"zone": zone.zone_id} | surface.meaning)
                written += write_surface(surface, folder / "zones" / f"{zone.zone_id}_{run}", wanted)
    return written


def write_surface(surface: Surface, stem: Path, formats: Iterable[str]) -> list[Path]:
    """Write one surface in several formats, and its sidecar; return the paths. A preview is no format of a surface."""
    paint = colours(surface.value, surface.meaning["colour"]["shows"])
    written = []
    for name in formats:
        if name in WRITERS:
            path = stem.with_name(f"{stem.name}.{name}")
            with store.atomic(path) as place:
                WRITERS[name](surface, paint, place)
            written.append(path)
    further = {
        "fields": sorted(surface.fields),
        "glb_axes": "y up, as glTF asks: the node turns x, y, z into x, z, -y",
        "vertices": len(surface.vertices),
        "triangles": len(surface.triangles),
        "bounds_m": surface.bounds.round(6).tolist(),
    }
    written.append(store.write_json(surface.meaning | further, stem.with_name(f"{stem.name}.json")))
    return written


def _write_preview(measured: _Measured, options: MeshOptions, top: float | None, stem: Path) -> Path:
    o3d, path = library("open3d"), stem.with_name(f"{stem.name}.png")
    value = None
    if options.colour != "depth":
        value = measured.true.value[: measured.depth.size].reshape(measured.depth.shape)
    with store.atomic(path) as place:
        o3d.io.write_image(str(place), o3d.geometry.Image(preview(measured.depth, top, value, options.colour)))
    return path


def _known(formats: Iterable[str]) -> list[str]:
    wanted = list(dict.fromkeys(formats))
    unknown = [name for name in wanted if name not in FORMATS]
    if unknown:
        raise OptionError(Fault("mesh", "formats", f"{', '.join(unknown)} is not known; known are {', '.join(FORMATS)}"))
    return wanted


def _dents(folder: Path) -> pd.DataFrame:
    """Return the rows of the dents that a run has measured."""
    path = folder / "tables" / "dents.csv"
    if not path.exists():
        return pd.DataFrame({"dent_id": [], "run": []})
    table = store.read_table(path, "dents")
    return table[~table.status.isin(_NOT_THERE) & table.run_chainage_m.notna()]


def _of_row(run: _Run, row: Any, half: float, options: MeshOptions, before: xr.DataArray | None) -> _Measured | None:
    """Return a dent of the table as its run measured it; None, with a warning, where map or wall thickness is not known."""
    try:
        window = store.read_wall(run.path, row.run_chainage_m, half + options.step_m)
    except InputError as fault:
        _log.warning("dent %s in %s: no surface: %s", row.dent_id, row.run, fault)
        return None
    depth = None if window is None else _grid(window, row.run_chainage_m, half, options)
    if window is None or depth is None:
        _log.warning("dent %s in %s: no wall map at %.2f m, so no surface", row.dent_id, row.run, row.run_chainage_m)
        return None
    depth.attrs["clock_deg"] = None if pd.isna(row.clock_deg) else float(row.clock_deg)
    wall = run.wall_at(row.run_chainage_m)
    if not np.isfinite(wall):
        text = "dent %s in %s: neither its joint's wall thickness nor the nominal one is stated, so no surface"
        _log.warning(text, row.dent_id, row.run)
        return None
    strain = strain_grid(
        window,
        depth,
        clock_deg=row.clock_deg,
        depth_m=row.depth_m,
        length_m=row.length_m,
        width_m=row.width_m,
        wall_thickness=wall,
    )
    earlier = depth if before is None else before  # in the first run nothing has changed yet
    surfaces = [
        dent_surface(depth, wall_thickness=wall, options=chosen, before=earlier, strain=strain)
        for chosen in (replace(options, exaggeration=1.0), options)
    ]
    return _Measured(depth, *surfaces)


def _grid(window: xr.Dataset, chainage: float, half: float, options: MeshOptions) -> xr.DataArray | None:
    try:
        return depth_grid(window, chainage, half, options)
    except (IndexError, ValueError):  # no scan of the window is whole enough
        return None


def _meaning(run: _Run, row: Any, measured: _Measured, first: tuple[str, _Measured] | None) -> dict[str, Any]:
    """Return the words of a sidecar: who and when, those of the surface, and how far the wall moved since the first run."""
    who = {
        "dent": row.dent_id,
        "run": row.run,
        "date": str(run.attrs.get("date", "")),
        "status": row.status,
        "clock_deg": measured.depth.attrs["clock_deg"],
        "depth_m": None if pd.isna(row.depth_m) else float(row.depth_m),
    }
    if np.isfinite(measured.true.fields.get("strain", np.nan)).any():
        who["strain_max"] = float(np.nanmax(measured.true.fields["strain"]))
    since = {} if first is None else {"moved_since": {"run": first[0], **inner_wall_movement(measured.true, first[1].true)}}
    return who | measured.drawn.meaning | since
