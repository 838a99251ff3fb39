"""An output folder in, its datasets and tables out; what is absent or unreadable is listed, never fatal."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import deform.vocabulary as vocabulary
from deform.errors import DeformError, Fault, InputError
from deform.run import store

_log = logging.getLogger(__name__)

TABLES = ("zones", "dents", "trends", "joints", "welds")  # of the contract; others are shown as they are found
_GROUPS = ("welds", "dents", "markers", "features", "navigation")
# Of the long arrays only what a report shows is read, and held in single precision where that is finer than any picture.
_CENTRELINE = (
    *("latitude", "longitude", "height", "time", "speed", "azimuth", "azimuth_sigma", "pitch", "tool_roll"),
    *("east_sigma", "north_sigma", "up_sigma", "curvature_horizontal", "curvature_vertical", "ovality", "diameter_min"),
    *("bending_strain", "bending_strain_horizontal_sigma"),
)
_COMPARISON = (
    "run_chainage",
    *(
        f"{name}{end}"
        for name in (
            *(f"displacement_{axis}" for axis in ("east", "north", "up", "lateral")),
            *(f"{what}_change_{way}" for what in ("bending_strain", "curvature") for way in ("horizontal", "vertical")),
        )
        for end in ("", "_sigma")
    ),
)
_DOUBLE = ("latitude", "longitude", "time", "run_chainage")


@dataclass(frozen=True)
class Content:
    """What an output folder holds.

    Attributes
    ----------
    folder : the folder.
    line : name of the line.
    survey : content of ``survey.json``.
    runs : runs in the order of their dates, with what of the centreline is shown; wall maps are read piecewise by `wall_window`.
    comparison : what of ``comparison.nc`` is shown, or None.
    tables : the tables of the contract by name, empty ones for those absent; ``limits`` and others as they were found.
    absent : (what, why) of everything that was not there or not readable.
    """

    folder: Path
    line: str
    survey: dict
    runs: list[xr.DataTree]
    comparison: xr.Dataset | None
    tables: dict[str, pd.DataFrame]
    absent: list[tuple[str, str]] = field(default_factory=list)

    @property
    def ids(self) -> list[str]:
        """Names of the runs."""
        return [str(run.attrs["id"]) for run in self.runs]

    @property
    def reference(self) -> str:
        """Name of the run whose chainage is the axis."""
        given = self.comparison.attrs.get("reference") if self.comparison is not None else None
        return str(given) if given in self.ids else self.ids[0]

    @property
    def dates(self) -> dict[str, str]:
        """Date of each run as text."""
        return {str(run.attrs["id"]): str(run.attrs.get("date", "")) for run in self.runs}

    def run(self, name: str) -> xr.DataTree:
        """Return a run by its name."""
        return self.runs[self.ids.index(name)]

    def group(self, name: str, group: str) -> xr.Dataset | None:
        """Return a group of a run, None when the run does not hold it."""
        run = self.run(name)
        return run[group].to_dataset() if group in run.children else None

    @property
    def k_sigma(self) -> float:
        """How many sigma a change must exceed, as the survey chose it."""
        return float(self.survey.get("options", {}).get("change", {}).get("k_sigma", 3.0))

    @property
    def epochs(self) -> list[str]:
        """Names of the runs in the comparison."""
        return [] if self.comparison is None else [str(name) for name in self.comparison["epoch"].values]

    @property
    def outside_diameter(self) -> float:
        """Outside diameter (m) of the reference run, else of the first run that states it, else NaN."""
        stated = [float(run.attrs.get("outside_diameter_m", np.nan)) for run in [self.run(self.reference), *self.runs]]
        return next((diameter for diameter in stated if np.isfinite(diameter)), np.nan)

    @cached_property
    def compares_movement(self) -> bool:
        """True when the comparison holds a displacement or a change of strain, not only the map between the runs."""
        names = ("displacement_lateral", "displacement_up", "bending_strain_change_horizontal", "bending_strain_change_vertical")
        ds = self.comparison
        return ds is not None and any(name in ds and bool(np.isfinite(ds[name].values).any()) for name in names)


def read_content(folder: Path) -> Content:
    """Read an output folder.

    Raises
    ------
    InputError
        When it holds no readable run.
    """
    folder = Path(folder)
    absent: list[tuple[str, str]] = []
    survey = _survey(folder, absent)
    runs = []
    for path in sorted([*folder.glob("runs/*.nc"), *folder.glob("runs/*.zarr")]):
        try:
            runs.append(_run(path))
        except (DeformError, OSError) as fault:
            absent.append((f"runs/{path.name}", str(fault)))
    if not runs:
        raise InputError(Fault(str(folder), "runs", "holds no readable run", "; ".join(why for _, why in absent)))
    runs.sort(key=lambda run: (str(run.attrs.get("date", "")), str(run.attrs.get("id", ""))))
    comparison = None
    if (folder / "comparison.nc").exists():
        try:
            comparison = _shown(folder / "comparison.nc", None, _COMPARISON)
        except (DeformError, OSError, ValueError, RuntimeError) as fault:
            absent.append(("comparison.nc", str(fault)))
    elif len(runs) > 1:
        absent.append(("comparison.nc", "not written: the runs were not compared along the line"))
    line = str(survey.get("line") or runs[0].attrs.get("line") or folder.name)
    return Content(folder, line, survey, runs, comparison, _tables(folder, absent), absent)


def _run(path: Path) -> xr.DataTree:
    """Return a run with its small groups, and of its centreline what is shown."""
    run = store.read_run(path, groups=_GROUPS)
    try:
        centreline = _shown(path, "centreline", _CENTRELINE)
    except (OSError, KeyError, ValueError):  # a listing without coordinates has none
        return run
    return xr.DataTree(xr.Dataset(attrs=run.attrs), children={**run.children, "centreline": xr.DataTree(centreline)})


def _shown(path: Path, group: str | None, names: tuple[str, ...]) -> xr.Dataset:
    """Return the named variables of a group that are there, read one by one."""
    with xr.open_dataset(path, engine=store.engine(path), group=group, decode_times=False) as ds:
        found = {}
        for name in names:
            if name in ds:
                values = ds[name].load().drop_encoding()
                found[name] = values if name in _DOUBLE else values.astype(np.float32)
        coords = {name: values.load().drop_encoding() for name, values in ds.coords.items()}
        return xr.Dataset(found, coords, ds.attrs)


def wall_window(content: Content, run: str, chainage: float, half_length: float) -> xr.Dataset | None:
    """Return the wall map of a run about a chainage, by `run.store.read_wall`; None, with a warning, when it is damaged."""
    try:
        return store.read_wall(store.run_path(content.folder, run), chainage, half_length)
    except InputError as fault:
        _log.warning("wall of %s at %.2f m is not shown: %s", run, chainage, fault)
        return None


def records(frame: pd.DataFrame) -> list[Any]:
    """Return the rows of a table as named tuples."""
    return list(frame.itertuples(index=False))


def _survey(folder: Path, absent: list[tuple[str, str]]) -> dict:
    try:
        content = json.loads((folder / "survey.json").read_text(encoding="utf-8"))
        return content if isinstance(content, dict) else {}
    except FileNotFoundError:
        absent.append(("survey.json", "not there: options, hashes and warnings are unknown"))
    except (OSError, ValueError) as fault:
        absent.append(("survey.json", f"cannot be read ({fault})"))
    return {}


def _tables(folder: Path, absent: list[tuple[str, str]]) -> dict[str, pd.DataFrame]:
    tables = {}
    for name in TABLES:
        path = folder / "tables" / f"{name}.csv"
        tables[name] = _empty(name)
        if not path.exists():
            absent.append((f"tables/{name}.csv", "not written"))
            continue
        try:
            tables[name] = store.read_table(path, name)
        except pd.errors.EmptyDataError:
            continue
        except (DeformError, ValueError, OSError) as fault:
            absent.append((f"tables/{name}.csv", f"cannot be read ({fault})"))
    for path in sorted((folder / "tables").glob("*.csv")):
        if path.stem not in tables:
            try:
                tables[path.stem] = pd.read_csv(path)
            except (ValueError, OSError) as fault:
                absent.append((f"tables/{path.name}", f"cannot be read ({fault})"))
    return tables


def _empty(name: str) -> pd.DataFrame:
    columns = vocabulary.table(name)
    return pd.DataFrame({key: pd.Series(dtype=object if c.type == "text" else float) for key, c in columns.items()})
