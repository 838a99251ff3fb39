"""The command line: thin commands over `deform.survey`; exit 0 done, 1 the data failed a check, 2 wrong usage."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from deform.errors import DeformError

app = typer.Typer(
    name="deform",
    help="Multi-epoch deformation analysis of pipelines: inspection runs in, honest change with sigma out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object a line: progress, warnings, result.")]
OutFolder = Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Output folder of an earlier run.")]
OptionsFile = Annotated[Path | None, typer.Option("--options", exists=True, dir_okay=False, help="TOML file of options.")]


@dataclass
class _Voice:
    """How a command speaks: bars for people, lines for machines, or nothing."""

    quiet: bool
    json: bool
    bars: Any = None
    tasks: dict[str, Any] = field(default_factory=dict)

    def progress(self, stage: str, fraction: float, state: str) -> None:
        """Show the progress of a stage."""
        if self.json:
            if state != "running" or fraction == 0.0:
                self.line({"event": "stage", "stage": stage, "state": state})
        elif self.bars is not None:
            if stage not in self.tasks:
                self.tasks[stage] = self.bars.add_task(stage, total=1.0)
            self.bars.update(
                self.tasks[stage], completed=fraction, description=stage if state == "running" else f"{stage} ({state})"
            )

    def tick(self, stage: str) -> Callable[[float], None]:
        """Progress of a command that is one stage."""
        return lambda fraction: self.progress(stage, fraction, "running")

    def say(self, text: str, **content: Any) -> None:
        """Tell the result."""
        if self.json:
            self.line({"event": "result", **content})
        elif not self.quiet:
            typer.echo(text)

    def line(self, content: dict[str, Any]) -> None:
        """Write one JSON object as a line."""
        typer.echo(json.dumps(content, default=str))


class _Warnings(logging.Handler):
    """Warnings of the rooms, shown as they come."""

    def __init__(self, voice: _Voice):
        super().__init__(logging.WARNING)
        self.voice = voice

    def emit(self, record: logging.LogRecord) -> None:
        if self.voice.json:
            self.voice.line({"event": "warning", "message": record.getMessage()})
        elif self.voice.bars is not None:
            self.voice.bars.console.print(f"[yellow]warning:[/yellow] {record.getMessage()}", highlight=False, soft_wrap=True)


@contextmanager
def _speaking(quiet: bool, as_json: bool) -> Iterator[_Voice]:
    """Run a command: bars, warnings, and errors as sentences with exit status 1."""
    voice = _Voice(quiet, as_json)
    handler = _Warnings(voice)
    logger = logging.getLogger("deform")
    logger.addHandler(handler)
    logger.propagate = False
    try:
        if quiet or as_json:
            yield voice
        else:
            with _bars() as voice.bars:
                yield voice
    except DeformError as fault:
        if as_json:
            faults = [vars(f) for f in getattr(fault, "faults", [])]
            voice.line({"event": "error", "message": str(fault), "faults": faults})
        else:
            typer.secho(f"error: {fault}", fg="red", err=True)
        raise typer.Exit(1) from None
    except PermissionError as fault:
        typer.secho(f"error: {fault.filename}: cannot be written or read ({fault.strerror})", fg="red", err=True)
        raise typer.Exit(1) from None
    finally:
        logger.removeHandler(handler)
        logger.propagate = True


def _bars() -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"), TimeElapsedColumn())
    return Progress(*columns, console=Console(stderr=True))


def _options_of(folder: Path, file: Path | None) -> Any:
    """Options of a file, else those that made the folder, else the defaults."""
    import tomllib

    from deform.options import Options, options_from

    if file is not None:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
        return options_from(content.get("options", content), file.name)
    try:
        return options_from(json.loads((folder / "survey.json").read_text(encoding="utf-8"))["options"])
    except (OSError, ValueError, KeyError):
        return Options()


def _version(value: bool) -> None:
    if value:
        from deform.run.history import toolkit_version

        typer.echo(f"deform {toolkit_version()}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")] = False,
) -> None:
    """Hold what all commands share."""


@app.command()
def run(
    survey: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="survey.toml")],
    workers: Annotated[int, typer.Option(min=1, help="Runs processed at the same time.")] = 1,
    fresh: Annotated[bool, typer.Option("--fresh", help="Take nothing over from an earlier run.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run a whole survey: sources to report."""
    with _speaking(quiet, as_json) as voice:
        from deform.survey import run_survey

        folder = run_survey(survey, progress=voice.progress, resume=not fresh, workers=workers)
        _tell(voice, folder)


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Where to put the demonstration.")] = Path("deform-demo"),
    workers: Annotated[int, typer.Option(min=1, help="Runs processed at the same time.")] = 2,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Simulate a small line of two epochs, run it, and say where the report is."""
    with _speaking(quiet, as_json) as voice:
        from deform.survey import run_survey, write_demo

        survey = write_demo(folder, progress=voice.tick("simulate"))
        out = run_survey(survey, progress=voice.progress, workers=workers)
        _tell(voice, out)


@app.command("process")
def process_one(
    raw: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Raw run folder.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Output folder; the run goes to OUT/runs.")] = Path("out"),
    options: OptionsFile = None,
    control: Annotated[Path | None, typer.Option(exists=True, dir_okay=False, help="Surveyed control points (CSV).")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Navigate and measure one raw run."""
    with _speaking(quiet, as_json) as voice:
        from deform.processing import control_points, process
        from deform.run import store

        points = control_points(control)
        tree = process(raw, _options_of(out, options), control=points, progress=voice.tick("process"))
        path = store.write_run(tree, out / "runs" / f"{tree.attrs['id']}.nc")
        voice.say(f"run: {path}", run=path)


@app.command()
def match(
    folder: OutFolder,
    reference: Annotated[str | None, typer.Option(help="Run whose chainage is the axis; default the earliest.")] = None,
    locks: Annotated[Path | None, typer.Option(exists=True, dir_okay=False, help="CSV of locked or forbidden pairs.")] = None,
    options: OptionsFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Match the welds of the stored runs."""
    with _speaking(quiet, as_json) as voice:
        import deform.survey as stages

        runs = stages.stored_runs(folder)
        stages.match(runs, _options_of(folder, options), reference=reference, locks=locks, folder=folder)
        voice.say(f"welds: {folder / 'tables' / 'welds.csv'}", welds=folder / "tables" / "welds.csv")


@app.command()
def compare(
    folder: OutFolder,
    reference: Annotated[str | None, typer.Option(help="Run whose chainage is the axis; default the earliest.")] = None,
    locks: Annotated[Path | None, typer.Option(exists=True, dir_okay=False, help="CSV of locked or forbidden pairs.")] = None,
    options: OptionsFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Match the stored runs and difference them: comparison.nc and the tables of change."""
    with _speaking(quiet, as_json) as voice:
        import deform.survey as stages

        runs, chosen = stages.stored_runs(folder), _options_of(folder, options)
        matching = stages.match(runs, chosen, reference=reference, locks=locks, folder=folder)
        written = stages.compare(runs, matching, chosen, folder, progress=voice.tick("compare"))
        voice.say("\n".join(map(str, written)), files=written)


@app.command()
def screen(
    folders: Annotated[list[Path], typer.Argument(exists=True, file_okay=False, help="Output folders of the lines.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Where the screening goes.")] = Path("screening"),
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Rank the trends of many lines for maintenance planning."""
    with _speaking(quiet, as_json) as voice:
        from deform.survey import screen_lines

        written = screen_lines(folders, out)
        voice.say("\n".join(map(str, written)), files=written)


@app.command()
def report(
    folder: OutFolder,
    formats: Annotated[list[str] | None, typer.Option("--format", "-f", help="html, pdf, xlsx, gpkg; may be repeated.")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Write the reports anew from an output folder."""
    with _speaking(quiet, as_json) as voice:
        from deform.report import write_report

        chosen = _options_of(folder, None)
        written = write_report(folder, formats=tuple(formats or ("html",)), options=chosen.report, progress=voice.tick("report"))
        voice.say("\n".join(map(str, written.values())), files=written)


@app.command("export-dents")
def export_dents(
    folder: OutFolder,
    formats: Annotated[list[str] | None, typer.Option("--format", "-f", help="ply, glb, stl, obj, png; may be repeated.")] = None,
    colour: Annotated[str | None, typer.Option("--colour", help="What the colours show: depth, strain or change.")] = None,
    exaggeration: Annotated[
        float | None, typer.Option("--exaggeration", help="Factor on the depth drawn; 1 = true size.")
    ] = None,
    zones: Annotated[bool, typer.Option("--zones", help="Write the pipe of every zone as well.")] = False,
    options: OptionsFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Write the surface of every measured dent, and on request the pipe of every zone."""
    with _speaking(quiet, as_json) as voice:
        from dataclasses import asdict

        from deform.mesh import write_dent_surfaces, write_zone_shells
        from deform.options import options_from

        given = {"colour": colour, "exaggeration": exaggeration}
        asked = asdict(_options_of(folder, options).mesh) | {k: v for k, v in given.items() if v is not None}
        chosen = options_from({"mesh": asked}, "export-dents").mesh
        wanted = tuple(formats or ("ply", "glb", "stl"))
        written = write_dent_surfaces(folder, formats=wanted, options=chosen, progress=voice.tick("dents"))
        written += write_zone_shells(folder, formats=wanted, options=chosen) if zones else []
        voice.say("\n".join(sorted({str(path.parent) for path in written})) or "no dent has a wall map", files=written)


@app.command()
def simulate(
    folder: Annotated[Path, typer.Argument(help="Where the raw runs and their truth go.")],
    options: OptionsFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Simulate raw runs of a line with known truth, and a survey.toml that runs them."""
    with _speaking(quiet, as_json) as voice:
        from deform.survey import write_demo

        survey = write_demo(folder, options_file=options, progress=voice.tick("simulate"))
        voice.say(f"survey: {survey}", survey=survey)


@app.command()
def info(
    path: Annotated[Path, typer.Argument(exists=True, help="Raw run folder, listing, or a file that deform wrote.")],
    as_json: Json = False,
) -> None:
    """Say what a file is and what it holds."""
    with _speaking(True, as_json) as voice:
        from deform.readers.reader import scan

        found = scan(path)
        if as_json:
            voice.line({"event": "result", "format": found.format, "path": found.path, "remarks": found.remarks, **found.summary})
            return
        typer.echo(f"{found.path}: {found.format}")
        for key, value in found.summary.items():
            typer.echo(f"  {key}: {value}")
        for remark in found.remarks:
            typer.secho(f"  {remark}", fg="yellow")


def _tell(voice: _Voice, folder: Path) -> None:
    page = folder / "report" / "index.html"
    place = page if page.exists() else folder
    voice.say(f"report: {place}", report=place, folder=folder)


def main() -> None:
    """Entry point of the console script."""
    app()


if __name__ == "__main__":
    main()
