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
from deform.run import build, history, store
from deform.run.raw import RawRun
from deform.survey_file import SURFACE_FORMATS, RunEntry, Survey, read_survey

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
    part = {k: stage_options[k] for k in ("navigation", "caliper", "strain")}
    control = history.sha256(survey.control) if survey.control else None
    keys = {s["id"]: key_of(s["id"], s["inputs"], str(s["entry"].date), part, control) for s in sources}
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


def process(
    entry: RunEntry | Path | str,
    options: _options.Options | None = None,
    *,
    control: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.DataTree:
    """Return the run of one source: a raw run folder is navigated and measured, a listing is read.

    Examples
    --------
    >>> run = process("demo-2019")  # doctest: +SKIP
    """
    from deform.readers.reader import read_source

    options = options or _options.Options()
    if not isinstance(entry, RunEntry):
        entry = RunEntry(raw=str(entry))
    if entry.tally:
        return read_source(Path(entry.tally), columns=entry.columns, run_id=entry.id, date=entry.date)
    raw = read_source(Path(entry.raw or ""), run_id=entry.id, date=entry.date)
    if not isinstance(raw, RawRun):
        return raw
    return process_raw(raw, options, control=control, progress=progress)


def process_raw(
    raw: RawRun,
    options: _options.Options,
    *,
    control: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.DataTree:
    """Return the run of a raw run: navigation, caliper, centreline, bending and dent strain, in this order."""
    from deform.caliper.measure import measure, on_chainage
    from deform.nav.navigate import navigate
    from deform.nav.trajectory import centreline
    from deform.strain.bending import add_bending
    from deform.strain.dent import add_dent_strain

    tick = progress or (lambda fraction: None)
    pipe = raw.header.pipe
    navigation = navigate(raw, options.navigation, control=control, progress=lambda f: tick(0.6 * f))
    caliper = measure(raw, navigation.trajectory, options.caliper, progress=lambda f: tick(0.6 + 0.3 * f))
    line = centreline(navigation, raw.header, options.navigation, pose=caliper.pose)
    line = add_bending(line, outside_diameter=pipe.outside_diameter_m, options=options.strain)
    dents = caliper.dents
    if caliper.wall is not None:
        line = line.assign(on_chainage(caliper, line["chainage"].values))
    if dents is not None:
        sizes = {"outside_diameter": pipe.outside_diameter_m, "wall_thickness": pipe.nominal_wall_m}
        dents = add_dent_strain(dents, caliper.wall, **sizes)
    tick(1.0)
    return build.run_tree(
        _run_attrs(raw),
        centreline=line,
        welds=caliper.welds,
        caliper=caliper.wall,
        dents=dents,
        markers=navigation.markers,
        features=caliper.features,
        navigation=navigation.diagnostics,
    )


def _run_attrs(raw: RawRun) -> dict[str, Any]:
    header = raw.header
    return {
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


def _process_one(survey: Survey, run_id: str, entry: RunEntry, record: StageRecord, tick: Callable[[float], None]) -> None:
    run = process(entry, survey.options, control=control_points(survey.control), progress=tick)
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


def control_points(path: Path | None) -> xr.Dataset | None:
    """Surveyed control points of a file, or None without one."""
    if path is None:
        return None
    from deform.readers.control import read_control

    return read_control(path)


# ---- stage: the runs meet --------------------------------------------------------------------------


def compare_runs(survey: Survey, ledger: Ledger, paths: list[Path], key: str) -> None:
    """Match the welds of all runs, difference what they hold, and write the comparison and the tables."""
    chosen = _options.as_dict(survey.options)
    locks = history.sha256(survey.locks) if survey.locks else None
    match_key = key_of(key, survey.reference, chosen["match"], locks)
    compare_key = key_of(match_key, chosen["change"], chosen["trend"])
    if ledger.done("match", match_key) and ledger.done("compare", compare_key):
        return
    runs = [store.read_run(path) for path in paths]
    with ledger.stage("match", match_key) as record:
        matching = match(runs, survey.options, reference=survey.reference, locks=survey.locks, folder=survey.folder)
        ledger.outputs(record, [survey.folder / "tables" / f"{name}.csv" for name in ("welds", "joints")])
    with ledger.stage("compare", compare_key) as record:
        written = compare(runs, matching, survey.options, survey.folder, progress=ledger.ticker("compare"))
        ledger.outputs(record, written)


def match(runs: list[xr.DataTree], options: _options.Options, *, reference=None, locks=None, folder: Path) -> Any:
    """Match the welds of the runs and write ``tables/welds.csv`` and ``tables/joints.csv``."""
    from deform.correlate.weld_matching import match_runs

    matching = match_runs(runs, options.match, reference=reference, locks=locks)
    store.write_table(matching.welds, folder / "tables" / "welds.csv", "welds")
    store.write_table(matching.joints, folder / "tables" / "joints.csv", "joints")
    return matching


def compare(runs: list[xr.DataTree], matching: Any, options: _options.Options, folder: Path, progress=None) -> list[Path]:
    """Difference the runs and write ``comparison.nc`` and the tables of change; return the files."""
    from deform.change.compare import compare as difference
    from deform.change.trend import trends

    comparison = difference(runs, matching, options.change, progress=progress)
    for remark in comparison.remarks:
        _log.warning("%s", remark)
    written = [store.write_dataset(comparison.dataset, folder / "comparison.nc", "comparison")]
    tables = {"zones": comparison.zones, "dents": comparison.dents, "joints": comparison.joints}
    tables["trends"] = trends(comparison, options.trend)
    written += [store.write_table(frame, folder / "tables" / f"{name}.csv", name) for name, frame in tables.items()]
    if comparison.limits is not None:
        written.append(_write_frame(comparison.limits, folder / "tables" / "limits.csv"))
    return written


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
    """The runs of an output folder, by date.

    Raises
    ------
    InputError
        When the folder holds none.
    """
    paths = sorted((folder / "runs").glob("*.nc"))
    if not paths:
        raise InputError(Fault(str(folder), "runs", "holds no run", "process runs first: deform process RAW --out FOLDER"))
    runs = [store.read_run(path) for path in paths]
    return sorted(runs, key=lambda run: str(run.attrs.get("date", "")))


# ---- stage: for people -----------------------------------------------------------------------------


def export(survey: Survey, ledger: Ledger, key: str) -> None:
    """Write dent surfaces and reports; what an absent extra forbids is named in `survey.json`."""
    wanted = [f for f in survey.formats if _available(f, ledger)]
    surfaces = tuple(f for f in wanted if f in SURFACE_FORMATS)
    if surfaces and not ledger.done("surfaces", key):
        with ledger.stage("surfaces", key) as record:
            from deform.mesh import write_dent_surfaces

            written = write_dent_surfaces(survey.folder, formats=surfaces, progress=ledger.ticker("surfaces"))
            ledger.outputs(record, _flat(written))
    reports = tuple(f for f in wanted if f not in SURFACE_FORMATS)
    if reports:
        with ledger.stage("report", key) as record:
            from deform.report import write_report

            ledger.write()  # the report shows what the ledger holds
            written = write_report(
                survey.folder, formats=reports, options=survey.options.report, progress=ledger.ticker("report")
            )
            ledger.outputs(record, _flat(written))


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
