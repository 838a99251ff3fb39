"""Options of a simulation in, raw run folders as a tool delivers them and the truth behind them out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.options import RunOptions, SimulateOptions, ToolOptions
from deform.synthetic import arms, epochs, files, imu, truth, wheels
from deform.synthetic.motion import TRAP_M, Motion, move
from deform.synthetic.route import Line, lay, stream

Floats = NDArray[Any]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Passage:
    """One run: the line that it finds (downstream), the same in the direction of travel, and the motion through it."""

    run: RunOptions
    tool: ToolOptions
    index: int
    line: Line
    built: Line
    motion: Motion

    @property
    def upstream(self) -> bool:
        """True when the tool ran against the chainage of the line."""
        return self.run.direction == "upstream"

    def chainage(self, distance: Floats) -> Floats:
        """Return chainage of the line for distance in the direction of travel, and the other way round."""
        return self.line.length - distance if self.upstream else distance


def simulate(options: SimulateOptions, folder: Path, progress: Callable[[float], None] | None = None) -> list[str]:
    """Write a raw run folder for every run below ``folder``, and what the simulator knew below ``folder/truth``.

    Parameters
    ----------
    options : line, events, dents, tool and runs; the same options write the same bytes.
    folder : where the run folders go; existing files of the same name are overwritten.
    progress : called with the fraction done.

    Returns
    -------
    names of the runs in the order of the options.

    Raises
    ------
    OptionError
        When an event or a dent does not fit the line or the runs, or the IMU is of no known grade.
    """
    folder = Path(folder)
    built = built_line(options)
    parts = _Parts(progress, len(options.runs))
    for index, run in enumerate(options.runs):
        passage = passage_of(options, built, index)
        _write_run(passage, options, folder / run.id, folder / "truth" / run.id, parts)
        _log.info("simulated %s: %.1f m in %.0f s", run.id, passage.line.length, passage.motion.duration)
    return [run.id for run in options.runs]


def built_line(options: SimulateOptions) -> Line:
    """Return the line of a simulation as it was built."""
    return lay(options.route, options.seed, epochs.calm_spans(options))


def passage_of(options: SimulateOptions, built: Line, index: int) -> Passage:
    """Return one run: its line, and the tool's motion through it."""
    run = options.runs[index]
    tool = run.tool or options.tool
    imu.grade_of(tool)
    line = epochs.line_at(built, options, index)
    way = line.reversed() if run.direction == "upstream" else line
    return Passage(run, tool, index, line, built, move(way, tool, options.seed, run.id))


def ride(options: SimulateOptions, index: int = 0) -> Passage:
    """Return one run without writing it: for `imu.increments`, `imu.counts` and `truth.trajectory` in tests of navigation."""
    return passage_of(options, built_line(options), index)


def _write_run(passage: Passage, options: SimulateOptions, folder: Path, truth_folder: Path, parts: _Parts) -> None:
    run, tool, motion = passage.run, passage.tool, passage.motion
    folder.mkdir(parents=True, exist_ok=True)
    truth_folder.mkdir(parents=True, exist_ok=True)
    errors = imu.draw_errors(imu.grade_of(tool), stream(options.seed, run.id, "imu errors"))
    samples = int(motion.duration * imu.rate_of(tool) + 1e-6)
    blocks = imu.counts(motion, tool, errors, options.seed, run.id)
    files.write_imu(folder / "imu.nc", parts.count(blocks, samples, 0.0, 0.5), imu.grade_of(tool), imu.rate_of(tool), run.id)
    time, count, scale, slips = wheels.roll_wheels(motion, tool, options.seed, run.id)
    files.write_odometer(folder / "odometer.nc", time, count, tool, run.id)
    dents = epochs.dents_at(passage.line, options, passage.index)
    caliper = folder / "caliper.nc"
    if tool.caliper:
        fittings = epochs.fittings_at(passage.line, options)
        scanned = arms.scans(motion, dents, tool, options.seed, run.id, passage.upstream, fittings)
        total = int(motion.duration * tool.caliper_rate_hz + 1e-6) + 1
        files.write_caliper(caliper, parts.count(scanned, total, 0.5, 0.95), arms.arm_angles(tool), tool, run.id)
    else:
        caliper.unlink(missing_ok=True)
    events, passed, seen = arms.detect_welds(motion, tool, options.seed, run.id)
    files.write_table(folder / "welds.csv", events, {"time_s": 4, "amplitude": 3})
    heard, true_markers = _markers(passage, options)
    files.write_markers(folder / "markers.csv", heard)
    launch = motion.line.position([TRAP_M]), tool.static_start_s
    files.write_header(folder / "run.toml", options, run, tool, launch)
    _write_truth(passage, truth_folder, options, errors, scale, dents, (passed, seen), true_markers, slips)
    parts.finish_run()


def _write_truth(passage, folder, options, errors, scale, dents, welds, markers, slips) -> None:
    truth.write_dataset(passage, errors, scale, folder / "truth.nc")
    events = epochs.events_at(passage.line, passage.built, options, passage.index)
    files.write_table(folder / "events_truth.csv", events)
    files.write_table(folder / "dents_truth.csv", dents.drop(columns="sharpness"))
    if options.fittings:  # a table that the demonstration data do not have
        files.write_table(folder / "fittings_truth.csv", epochs.fittings_at(passage.line, options))
    files.write_table(folder / "joints_truth.csv", truth.joints_table(passage.line))
    files.write_table(folder / "welds_truth.csv", truth.welds_table(passage, *welds))
    files.write_table(folder / "markers_truth.csv", markers)
    files.write_table(folder / "slips_truth.csv", slips)


def heard_markers(passage: Passage, options: SimulateOptions) -> pd.DataFrame:
    """Return the rows of ``markers.csv``: markers as heard and surveyed."""
    return _markers(passage, options)[0]


def _markers(passage: Passage, options: SimulateOptions) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the markers as heard and surveyed, and the undisturbed ones."""
    tool, line, route = passage.tool, passage.line, options.route
    rng = stream(options.seed, passage.run.id, "markers")
    true = _marker_places(passage, route.marker_spacing_m)
    true["true_time_s"] = passage.motion.passage(passage.chainage(true.chainage_m.to_numpy()))
    true["latitude_deg"], true["longitude_deg"], true["height_m"] = line.position(true.chainage_m)
    trap = true.kind.isin(["launcher", "receiver"]).to_numpy()
    sigma = np.where(trap, tool.trap_noise_m, tool.marker_noise_m)
    time = true.true_time_s + np.where(trap, 0.0, rng.normal(0.0, tool.marker_time_noise_s, len(true)))
    time[~trap & (rng.random(len(true)) < tool.unheard)] = np.nan
    shift = rng.normal(0.0, 1.0, (3, len(true))) * sigma
    gross = np.full(len(true), "", object)
    wrong = rng.permutation(np.flatnonzero(~trap))[: tool.gross_markers]
    for k, i in enumerate(wrong):
        if k % 2:
            time[i] += rng.choice([-1.0, 1.0]) * rng.uniform(8.0, 30.0)
            gross[i] = "time"
        else:
            shift[:2, i] += rng.uniform(15.0, 60.0, 2) * rng.choice([-1.0, 1.0], 2)
            gross[i] = "coordinates"
    true["gross_error"] = gross
    heard = true[["name", "kind"]].assign(time_s=time)
    heard["latitude_deg"], heard["longitude_deg"], heard["height_m"] = epochs.shifted(true, shift)
    return heard.assign(sigma_horizontal_m=sigma, sigma_vertical_m=sigma), true


def _marker_places(passage: Passage, spacing: float) -> pd.DataFrame:
    """Markers in the order of travel: traps, above-ground ones, valves; upstream the launcher is the far end."""
    line, built = passage.line, passage.built
    stakes = np.arange(spacing, built.length - 0.5 * spacing, spacing)
    valves = built.joints[built.joints.kind == "valve"]
    middle = (valves.material_start + 0.5 * valves.length_m).to_numpy()
    rows = [("LAUNCHER" if not passage.upstream else "RECEIVER", TRAP_M)]
    rows += [(f"AGM{i + 1:02d}", x) for i, x in enumerate(stakes)] + [(f"V{i + 1:02d}", x) for i, x in enumerate(middle)]
    frame = pd.DataFrame(rows, columns=["name", "epoch0_chainage_m"])
    frame["chainage_m"] = line.of_material(frame.epoch0_chainage_m)
    far = line.length - TRAP_M
    last = {"name": "RECEIVER" if not passage.upstream else "LAUNCHER", "chainage_m": far}
    last["epoch0_chainage_m"] = float(np.interp(far, line.chainage, line.material))
    frame = pd.concat([frame, pd.DataFrame([last])]).sort_values("chainage_m").reset_index(drop=True)
    kinds = {"LAUNCHER": "launcher", "RECEIVER": "receiver"}
    frame["kind"] = [kinds.get(n, "valve" if n.startswith("V") else "agm") for n in frame.name]
    step = -1 if passage.upstream else 1
    return frame[["name", "kind", "chainage_m", "epoch0_chainage_m"]][::step].reset_index(drop=True)


class _Parts:
    """Progress over runs and blocks."""

    def __init__(self, progress: Callable[[float], None] | None, runs: int):
        self.progress, self.runs, self.done = progress, runs, 0

    def count(self, blocks, total: int, low: float, high: float):
        """Pass blocks on and report how far their rows are."""
        rows = 0
        for block in blocks:
            yield block
            rows += len(block[0])
            self._report(low + (high - low) * rows / total)

    def finish_run(self) -> None:
        """Report a whole run."""
        self._report(1.0)
        self.done += 1

    def _report(self, part: float) -> None:
        if self.progress is not None:
            self.progress((self.done + part) / self.runs)
