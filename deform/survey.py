"""The main job: a survey in, the whole output folder out; one function per stage, each resumable."""

from __future__ import annotations

import importlib.util
import logging
import tomllib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import deform.options as _options
from deform.errors import Fault, InputError, MissingExtraError
from deform.ledger import Ledger, Progress, StageRecord, key_of, silent
from deform.processing import control_points, pipe_book, process
from deform.run import history, store
from deform.survey_file import SURFACE_FORMATS, PipeBookEntry, RunEntry, Survey, read_survey

_log = logging.getLogger(__name__)
_EXTRAS = {"pdf": "weasyprint", "gpkg": "pyogrio", "ply": "open3d", "glb": "open3d", "stl": "open3d"}


def run_survey(survey: Survey | Path | str, *, progress: Progress = silent, resume: bool = True, workers: int = 1) -> Path:
    """Run a survey from its sources to the report.

    Parameters
    ----------
    survey : a `Survey`, or the path of a ``survey.toml``.
    progress : called with (stage, fraction, state).
    resume : take over stages that are complete from an earlier run.
    workers : how many runs are processed at the same time.

    Returns
    -------
    Path
        The output folder.

    Raises
    ------
    InputError
        When the data or the survey break a rule; what was complete by then stays and is resumed.
    """
    if not isinstance(survey, Survey):
        survey = read_survey(Path(survey))
    ledger = _open_ledger(survey, progress, resume)
    keys = process_runs(survey, ledger, workers)
    paths = _in_order(survey, [survey.folder / "runs" / f"{run_id}.nc" for run_id in keys])
    compare_runs(survey, ledger, paths, key_of(keys))
    export(survey, ledger, key_of(keys, survey.formats))
    ledger.write()
    return survey.folder


# ---- stage: each source becomes a run --------------------------------------------------------------


def process_runs(survey: Survey, ledger: Ledger, workers: int = 1) -> dict[str, str]:
    """Process every source of the survey; return the key of each run by its id."""
    sources = [_source(entry) for entry in survey.runs]
    _check_ids(sources)
    stage_options = _options.as_dict(survey.options)
    part = {k: stage_options[k] for k in ("navigation", "caliper", "strain", "dent_strain")}
    control = history.sha256(survey.control) if survey.control else None
    constant: list = [survey.line, survey.outside_diameter_m, survey.control_crs]
    if book := _files_of(survey.pipe_book):
        constant += [{file.name: history.sha256(file) for file in book}, survey.pipe_book.columns, stage_options["pipe_book"]]
    keys = {s["id"]: key_of(s["id"], s["inputs"], str(s["entry"].date), part, control, constant) for s in sources}
    waiting = [s for s in sources if not ledger.done(f"process {s['id']}", keys[s["id"]])]
    if workers > 1 and len(waiting) > 1:
        _process_together(survey, ledger, waiting, keys, workers)
    else:
        for source in waiting:
            with ledger.stage(f"process {source['id']}", keys[source["id"]]) as record:
                tick = ledger.ticker(record.name)
                _process_one(survey, source["id"], source["entry"], record, tick)
                ledger.outputs(record, [survey.folder / "runs" / f"{source['id']}.nc"])
    details = {s["id"]: ledger.stages[f"process {s['id']}"].detail for s in sources}
    ledger.header["runs"] = [{"id": s["id"], "inputs": s["inputs"], **details[s["id"]]} for s in sources]
    return keys


def _files_of(book: PipeBookEntry) -> list[Path]:
    """Files that a pipe book is read from; a shipped column map is none."""
    return [Path(name) for name in (book.joints, book.columns, book.straights) if name and Path(name).is_file()]


def _process_one(survey: Survey, run_id: str, entry: RunEntry, record: StageRecord, tick: Callable[[float], None]) -> None:
    control = control_points(survey.control, survey.control_crs)
    size = survey.outside_diameter_m
    book = pipe_book(survey.pipe_book, size) if entry.raw else None
    run = process(entry, survey.options, control=control, book=book, line=survey.line, outside_diameter_m=size, progress=tick)
    record.detail = {"source": run.attrs.get("source", ""), "date": run.attrs.get("date", "")}
    record.detail |= {"repairs": [r for r in str(run.attrs.get("repairs", "")).splitlines() if r]}
    store.write_run(run, survey.folder / "runs" / f"{run_id}.nc")


def _process_apart(survey: Survey, run_id: str, entry: RunEntry) -> StageRecord:
    """Process one run in a process of its own, with a ledger in memory; its record is handed back."""
    ledger = _MemoryLedger(survey.folder)
    with ledger.stage(f"process {run_id}", "") as record:
        _process_one(survey, run_id, entry, record, lambda fraction: None)
    return record


class _MemoryLedger(Ledger):
    """A ledger that times and gathers, and writes nothing."""

    def __init__(self, folder: Path):
        super().__init__(folder, resume=False)

    def write(self) -> Path:
        """Write nothing: the parent's ledger does."""
        return self.folder


def _process_together(survey: Survey, ledger: Ledger, sources: list[dict], keys: dict[str, str], workers: int) -> None:
    with ProcessPoolExecutor(min(workers, len(sources)), mp_context=get_context("spawn")) as pool:
        futures = {}
        for source in sources:
            ledger.progress(f"process {source['id']}", 0.0, "running")
            futures[source["id"]] = pool.submit(_process_apart, survey, source["id"], source["entry"])
        faults: list[Fault] = []
        for run_id, future in futures.items():
            try:
                record = future.result()
            except InputError as fault:
                faults += fault.faults
                ledger.progress(f"process {run_id}", 1.0, "failed")
                continue
            record.key = keys[run_id]
            ledger.outputs(record, [survey.folder / "runs" / f"{run_id}.nc"])
            ledger.stages[record.name] = record
            ledger.progress(record.name, 1.0, record.status)
            ledger.write()
    if faults:
        raise InputError(faults)


def _source(entry: RunEntry) -> dict[str, Any]:
    """Who a source is and which bytes it has, without reading it."""
    path = Path(entry.raw or entry.tally or "")
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    files += [Path(entry.columns)] if entry.columns and Path(entry.columns).is_file() else []
    inputs = {p.name: history.sha256(p) for p in files}
    if entry.columns and not Path(entry.columns).is_file():
        inputs["columns"] = entry.columns
    return {"id": entry.id or _id_of(path), "inputs": inputs, "entry": entry}


def _id_of(path: Path) -> str:
    """The id that a raw run gives itself; its folder's name when ``run.toml`` cannot tell: the reader will say why."""
    try:
        return str(tomllib.loads((path / "run.toml").read_text(encoding="utf-8"))["run"]["id"])
    except (OSError, ValueError, KeyError, TypeError):
        return path.name


def _check_ids(sources: list[dict[str, Any]]) -> None:
    ids = [s["id"] for s in sources]
    twice = sorted({i for i in ids if ids.count(i) > 1})
    if twice:
        raise InputError(Fault("survey", "runs", f"{', '.join(twice)} given more than once; every run needs an id of its own"))


# ---- stage: the runs meet --------------------------------------------------------------------------


def compare_runs(survey: Survey, ledger: Ledger, paths: list[Path], key: str) -> None:
    """Match the welds of all runs, difference what they hold, and write the comparison and the tables."""
    chosen = _options.as_dict(survey.options)
    locks = history.sha256(survey.locks) if survey.locks else None
    match_key = key_of(key, survey.reference, chosen["match"], locks)
    compare_key = key_of(match_key, chosen["change"], chosen["trend"])
    if ledger.done("match", match_key) and ledger.done("compare", compare_key):
        return
    runs = [_stored_run(path) for path in paths]
    with ledger.stage("match", match_key) as record:
        matching = match(runs, survey.options, reference=survey.reference, locks=survey.locks, folder=survey.folder)
        ledger.outputs(record, [survey.folder / "tables" / "welds.csv"])  # compare completes the joints and the edits
    with ledger.stage("doglegs", match_key) as record:
        ledger.outputs(record, [write_doglegs(runs, survey.options, survey.folder)])
    with ledger.stage("compare", compare_key) as record:
        written = compare(runs, matching, survey.options, survey.folder, progress=ledger.ticker("compare"))
        ledger.outputs(record, written)


def match(runs: list[xr.DataTree], options: _options.Options, *, reference=None, locks=None, folder: Path) -> Any:
    """Match the welds of the runs and write ``tables/welds.csv`` and ``tables/joints.csv``."""
    from deform.correlate.evidence import read_locks
    from deform.correlate.weld_matching import match_runs

    held = read_locks(locks) if locks is not None else None
    matching = match_runs(runs, options.match, reference=reference, locks=held)
    store.write_table(matching.welds, folder / "tables" / "welds.csv", "welds")
    store.write_table(matching.joints, folder / "tables" / "joints.csv", "joints")
    for name in ("pairs", "edits", "stretches"):
        store.write_table(getattr(matching, name), folder / "tables" / f"{name}.csv", name)
    return matching


def compare(runs: list[xr.DataTree], matching: Any, options: _options.Options, folder: Path, progress=None) -> list[Path]:
    """Difference the runs and write ``comparison.nc`` and the tables of change; return the files."""
    from deform.change.compare import compare as difference
    from deform.change.trend import trends

    comparison = difference(runs, matching, options.change, progress=progress)
    stack = comparison.dataset.assign_attrs(line=str(runs[0].attrs.get("line", "")))
    written = [store.write_dataset(stack, folder / "comparison.nc", "comparison")]
    tables = {name: getattr(comparison, name) for name in ("zones", "dents", "joints", "ovality", "edits")}
    tables["trends"] = trends(comparison, options.trend)
    written += [store.write_table(frame, folder / "tables" / f"{name}.csv", name) for name, frame in tables.items()]
    if comparison.limits is not None:
        written.append(_write_frame(comparison.limits, folder / "tables" / "limits.csv"))
    return written


def write_doglegs(runs: list[xr.DataTree], options: _options.Options, folder: Path) -> Path:
    """Write ``tables/doglegs.csv``: the bends, and the deflections at welds, tees and valves, of every run with a centreline."""
    from deform.strain.doglegs import doglegs

    found = []
    for run in runs:
        if "centreline" in run.children and "curvature_horizontal" in run["centreline"]:
            groups = {name: run[name].to_dataset() for name in ("welds", "features") if name in run.children}
            size = float(run.attrs["outside_diameter_m"])
            table = doglegs(run["centreline"].to_dataset(), outside_diameter=size, options=options.strain, **groups)
            found.append(table.assign(run=run.attrs["id"]))
    frame = pd.concat(found, ignore_index=True) if found else pd.DataFrame()
    return store.write_table(frame, folder / "tables" / "doglegs.csv", "doglegs")


def _write_frame(frame: pd.DataFrame | xr.Dataset, path: Path) -> Path:
    table = frame.to_dataframe().reset_index() if isinstance(frame, xr.Dataset) else frame
    with store.atomic(path) as place:
        table.to_csv(place, index=False)
    return path


def _in_order(survey: Survey, paths: list[Path]) -> list[Path]:
    """The stored runs by date; two runs of one day keep the order of the survey."""
    dates = {path: str(store.read_run(path, groups=()).attrs.get("date", "")) for path in paths}
    ids = [path.stem for path in paths]
    if survey.reference is not None and survey.reference not in ids:
        raise InputError(Fault("survey", "line.reference", f"{survey.reference!r} is none of the runs {', '.join(ids)}"))
    return sorted(paths, key=dates.__getitem__)


def stored_runs(folder: Path) -> list[xr.DataTree]:
    """The runs of an output folder, by date, with what the matching and the comparison read of them.

    Raises
    ------
    InputError
        When the folder holds none.
    """
    paths = sorted((folder / "runs").glob("*.nc"))
    if not paths:
        raise InputError(Fault(str(folder), "runs", "holds no run", "process runs first: deform process RAW --out FOLDER"))
    runs = [_stored_run(path) for path in paths]
    return sorted(runs, key=lambda run: str(run.attrs.get("date", "")))


def _stored_run(path: Path) -> xr.DataTree:
    """A stored run without what no comparison reads; the radii of its wall map, the largest part, stay in the file."""
    from deform.change.stack import READ

    return store.read_run(path, (*READ, "welds", "features", "markers", "dents"), READ)


# ---- stage: for people -----------------------------------------------------------------------------


def export(survey: Survey, ledger: Ledger, key: str) -> None:
    """Write dent surfaces and reports; what an absent extra forbids is named in `survey.json`."""
    wanted = [f for f in survey.formats if _available(f, ledger)]
    surfaces = tuple(f for f in wanted if f in SURFACE_FORMATS)
    if surfaces and not ledger.done("surfaces", key):
        with ledger.stage("surfaces", key) as record:
            from deform.mesh import write_dent_surfaces, write_zone_shells

            written = write_dent_surfaces(survey.folder, surfaces, survey.options.mesh, progress=ledger.ticker("surfaces"))
            written += write_zone_shells(survey.folder, surfaces, survey.options.mesh)
            ledger.outputs(record, _flat(written))
    reports = tuple(f for f in wanted if f not in SURFACE_FORMATS)
    if reports:
        with ledger.stage("report", key) as record:
            ledger.outputs(record, _write_reports(survey, ledger, reports))


def _write_reports(survey: Survey, ledger: Ledger, formats: tuple[str, ...]) -> list[Path]:
    """Write one format after the other: what one of them cannot show must not cost the others. The page comes last."""
    from deform.report import write_report

    written: list[Path] = []
    for number, name in enumerate(sorted(formats, key="html".__eq__)):
        ledger.write()  # the reports show what the ledger holds
        try:
            files = write_report(
                survey.folder,
                formats=(name,),
                options=survey.options.report,
                progress=_part(ledger.ticker("report"), number, len(formats)),
            )
        except InputError as fault:
            ledger.missing[name] = str(fault)
            _log.warning("output %s is not written: %s", name, fault)
        else:
            written += _flat(files)
    return written


def _part(tick: Callable[[float], None], number: int, parts: int) -> Callable[[float], None]:
    """Progress of one of several equal parts of a stage."""
    return lambda fraction: tick((number + fraction) / parts)


def _flat(written: Any) -> list[Path]:
    values = written.values() if isinstance(written, dict) else written or ()
    return [Path(p) for v in values for p in (v if isinstance(v, list | tuple | set) else [v])]


def _available(name: str, ledger: Ledger) -> bool:
    module = _EXTRAS.get(name)
    if module is None or importlib.util.find_spec(module) is not None:
        return True
    extra = {"pdf": "pdf", "gpkg": "gis"}.get(name, "mesh")
    ledger.missing[name] = str(MissingExtraError(f"output {name!r}", extra))
    _log.warning("%s", ledger.missing[name])
    return False


# ---- beside the main job ---------------------------------------------------------------------------


def write_demo(folder: Path, *, options_file: Path | None = None, progress: Callable[[float], None] | None = None) -> Path:
    """Simulate the raw runs of a small line, with their truth, and a survey that runs them; return ``survey.toml``."""
    from deform.synthetic.simulate import simulate

    chosen = _options.SimulateOptions.demo() if options_file is None else _options.simulate_options_from(options_file)
    run_ids = simulate(chosen, folder, progress=progress)
    entries = "".join(f'\n[[runs]]\nraw = "{run_id}"\n' for run_id in run_ids)
    path = folder / "survey.toml"
    with store.atomic(path) as place:
        place.write_text(f'[line]\nname = "{chosen.line}"\n{entries}\n[outputs]\nfolder = "out"\n', encoding="utf-8")
    return path


def screen_lines(folders: list[Path], out: Path) -> list[Path]:
    """Rank what changed on many lines: ``screening.csv``, ``lines.csv`` and a page; a folder that cannot be read is named."""
    from deform.change.screen import screen
    from deform.report.screening import write_screening

    found = screen(folders)
    for folder, fault in found.unread:
        _log.warning("%s is left out: %s", folder, fault)
    if found.lines.empty:
        raise InputError([Fault(folder, "", fault) for folder, fault in found.unread])
    tables = [_write_frame(found.table, out / "screening.csv"), _write_frame(found.lines, out / "lines.csv")]
    return [*tables, write_screening(folders, out / "screening.html")]


def _open_ledger(survey: Survey, progress: Progress, resume: bool) -> Ledger:
    ledger = Ledger(survey.folder, progress, resume)
    ledger.header = {
        "line": survey.line,
        "reference": survey.reference,
        "formats": list(survey.formats),
        "options": _options.as_dict(survey.options),
        "control": survey.control.name if survey.control else None,
        "runs": [],
    }
    return ledger
