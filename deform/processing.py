"""One source in, one run out: a raw run folder is navigated and measured, a listing is read."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from deform.options import Options
from deform.run import build
from deform.run.raw import RawRun
from deform.survey_file import PipeBookEntry, RunEntry

if TYPE_CHECKING:
    from deform.nav.aiding import KnownPipe

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PipeBook:
    """What is known of the pipe as laid: a run of its joints, and straight stretches along it (`read_straights`) or None."""

    joints: xr.DataTree
    straights: np.ndarray | None = None


def process(
    entry: RunEntry | Path | str,
    options: Options | None = None,
    *,
    control: xr.Dataset | None = None,
    book: PipeBook | None = None,
    line: str | None = None,
    outside_diameter_m: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.DataTree:
    """Return the run of one source: a raw run folder is navigated and measured, a listing is read.

    Parameters
    ----------
    entry : what a survey says of the run, or the path of a raw run folder.
    options : options of all stages.
    control : surveyed control points (group ``control``).
    book : what is known of the pipe as laid; it aids the navigation of a raw run.
    line, outside_diameter_m : of a listing, which seldom says them.
    progress : called with the fraction done.

    Returns
    -------
    DataTree
        The run, with the groups that its source can give.

    Raises
    ------
    InputError
        With every fault of the source.

    Examples
    --------
    >>> run = process("demo-2019")  # doctest: +SKIP
    """
    from deform.readers.reader import read_source

    options = options or Options()
    if not isinstance(entry, RunEntry):
        entry = RunEntry(raw=str(entry))
    path = Path(entry.raw or entry.tally or "")
    known = {"line": line, "outside_diameter_m": outside_diameter_m} if entry.tally else {}
    source = read_source(path, entry.columns, entry.id, entry.date, **known)  # type: ignore[arg-type] # mypy joins str and float
    if isinstance(source, RawRun):
        return process_raw(source, options, control=control, book=book, progress=progress)
    return source


def process_raw(
    raw: RawRun,
    options: Options,
    *,
    control: xr.Dataset | None = None,
    book: PipeBook | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.DataTree:
    """Return the run of a raw run: navigation, caliper, centreline, bending and dent strain, in this order."""
    from deform.caliper.measure import measure, on_chainage
    from deform.nav.navigate import navigate
    from deform.nav.trajectory import centreline
    from deform.readers.control_check import datum_remark
    from deform.strain.bending import add_bending
    from deform.strain.dent import add_dent_strain

    tick = progress or (lambda fraction: None)
    pipe = raw.header.pipe
    if remark := datum_remark(control, raw.passages, raw.header.id):
        log.warning("%s", remark)
    known = None if book is None else _known_pipe(raw, book, options)
    navigation = navigate(raw, options.navigation, control, lambda f: tick(0.6 * f), known)
    caliper = measure(raw, navigation.trajectory, options.caliper, progress=lambda f: tick(0.6 + 0.3 * f))
    line = centreline(navigation, raw.header, options.navigation, pose=caliper.pose)
    line = add_bending(line, outside_diameter=pipe.outside_diameter_m, options=options.strain)
    dents = caliper.dents
    shape = on_chainage(caliper, line["chainage"].values)
    if shape is not None:
        line = line.assign(shape)
        line["ovality"].attrs["definition"] = shape.attrs["definition"]
    if dents is not None:
        size, wall = pipe.outside_diameter_m, pipe.nominal_wall_m
        dents = add_dent_strain(dents, caliper.wall, outside_diameter=size, wall_thickness=wall, options=options.dent_strain)
    tick(1.0)
    return build.run_tree(
        _run_attrs(raw, known),
        centreline=line,
        welds=caliper.welds,
        caliper=caliper.wall,
        dents=dents,
        markers=navigation.markers,
        features=caliper.features,
        navigation=navigation.diagnostics,
    )


def _known_pipe(raw: RawRun, book: PipeBook, options: Options) -> KnownPipe | None:
    """Find the joints of the pipe book that the run passed by its weld events and wheels."""
    from deform.correlate.pipe_book import known_pipe
    from deform.nav import odometer

    if raw.weld_events is None:
        log.warning("run %s: the pipe book is not used: the run has no weld events", raw.id)
        return None
    time = raw.weld_events["time"].values
    place = odometer.combine(raw, options.navigation).profile.at(time)[0]
    return known_pipe(book.joints, time, place, raw.id, book.straights, options.pipe_book)


def _run_attrs(raw: RawRun, known: KnownPipe | None) -> dict[str, Any]:
    header = raw.header
    aids = (
        {}
        if known is None
        else {
            "pipe_book": f"{len(known.joints)} lengths of joints and {len(known.straights)} straight stretches aid the navigation"
        }
    )
    return aids | {
        "id": header.id,
        "line": header.run.line,
        "date": header.run.date.isoformat(),
        "direction": header.run.direction,
        "source": "raw",
        "outside_diameter_m": header.pipe.outside_diameter_m,
        "nominal_wall_m": header.pipe.nominal_wall_m,
        "nominal_joint_m": header.pipe.nominal_joint_m,
        "input_sha256": "\n".join(f"{digest}  {name}" for name, digest in sorted(raw.hashes.items())),
        "repairs": "\n".join(raw.repairs),
    }


def pipe_book(entry: PipeBookEntry, outside_diameter_m: float | None = None) -> PipeBook | None:
    """Return the pipe book of a survey, or None without one; errors as in `deform.readers.pipe_book`."""
    if entry.joints is None:
        return None
    from deform.readers.pipe_book import read_joints, read_straights

    joints = read_joints(entry.joints, entry.columns, outside_diameter_m)
    return PipeBook(joints, None if entry.straights is None else read_straights(entry.straights))


def control_points(path: Path | None, crs: str | None = None) -> xr.Dataset | None:
    """Surveyed control points of a file, or None without one; ``crs`` where the file does not say its reference system."""
    if path is None:
        return None
    from deform.readers.control import read_control

    return read_control(path, crs)
