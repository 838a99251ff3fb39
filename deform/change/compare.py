"""Runs of one line and their matching in, what changed between them out: dataset, zones, dents, joints, limits of detection."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from deform.change.axial_zones import axial_zones
from deform.change.dent_change import compare_dents
from deform.change.detection_limit import joint_rows, limit_rows
from deform.change.joint_change import Elongation, with_axial_strain
from deform.change.ovality_change import ovality_table
from deform.change.pair import PairChange, PairSearch
from deform.change.reroute import told_by_geometry
from deform.change.stack import POSITION, Layer, layer, reference_axis, run_day, run_id, tangents
from deform.change.threads import cores
from deform.change.zone_table import zone_table
from deform.errors import Fault, InputError
from deform.options import ChangeOptions
from deform.run import build, history

log = logging.getLogger(__name__)
Floats = NDArray[Any]
_DATUM_COMMENT = (
    "relative to the pipe that is judged stable; a movement that is longer or smaller than tables/limits.csv says can be found"
    " is taken for drift of the runs and does not show here"
)
_DISPLACEMENT = ("east", "north", "up", "lateral", "axial")


@dataclass(frozen=True)
class Comparison:
    """What changed between the runs of a line.

    Attributes
    ----------
    dataset : group ``comparison`` of the vocabulary: epoch × reference chainage, all against the reference run, with sigma.
    zones : table ``zones``.
    dents : table ``dents``, all runs.
    joints : table ``joints``, with axial strain.
    limits : table ``limits``: noise floors and detection limits of each pair.
    ovality : table ``ovality``: stretches whose section changed.
    edits : table ``edits`` of the matching, what geometry tells of them added.
    remarks : what the runs cannot tell, in words.
    """

    dataset: xr.Dataset
    zones: pd.DataFrame
    dents: pd.DataFrame
    joints: pd.DataFrame
    limits: pd.DataFrame
    ovality: pd.DataFrame
    edits: pd.DataFrame
    remarks: tuple[str, ...] = ()


def compare(
    runs: list[xr.DataTree],
    matching: Any,
    options: ChangeOptions | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare the runs of a line with its reference run.

    Parameters
    ----------
    runs : runs of the line; they are taken in the order of their dates, one without a date where it stands in the list.
    matching : `correlate.weld_matching.Matching` of the same runs.
    options : thresholds.
    progress : called with the fraction done.

    Raises
    ------
    InputError
        When a run has no chainage map, or the reference run no axis.

    Notes
    -----
    Each run is brought to the steel of the reference run (`stack`), its difference freed of the drift of the two trajectories
    by the pipe that did not move (`datum`), movements are searched in position and curvature together (`wavelength`,
    `zones`), their extent is what explains the curvature best (`support`), and every derived number gets its sigma from the
    stable pipe of the pair itself (`noise_floor`, `bridge`). Runs are compared with the reference run and with the run before.
    A listing tells only what it holds.
    """
    options, tick = options or ChangeOptions(), progress or (lambda fraction: None)
    runs = _in_order(runs, matching)
    names = [run_id(run) for run in runs]
    reference = str(matching.reference)
    base = runs[names.index(reference)]
    axis = reference_axis(base, options.axis_step_m)
    remarks: list[str] = []
    ground = _whole(layer(base, matching.maps[reference], axis), axis)
    diameter = _diameter(runs, ground, remarks)
    axes = tangents(ground, axis) if ground.has(*POSITION) or ground.has("azimuth", "pitch") else None
    values = _Values(len(runs), axis.size)
    with ThreadPoolExecutor(cores()) as pool:
        searches = _searched(pool, runs, matching, (axis, axes), ground, values, remarks, options, tick)
        pairs, steps = _finish(pool, searches, values, diameter, reference)
    tick(0.9)
    return _comparison(runs, matching, options, tick, values, (pairs, steps), axis, ground, diameter, remarks)


def _comparison(runs, matching, options, tick, values, changes, axis, ground, diameter, remarks) -> Comparison:
    """Tables and dataset from the finished pairs."""
    names, reference = [run_id(run) for run in runs], ground.run
    pairs, steps = changes
    joints = with_axial_strain(matching.joints, reference, names, options.k_sigma)
    grown = axial_zones(joints, reference, names, options)
    edits = told_by_geometry(matching.edits, [*steps, *pairs], runs, matching.maps, options)
    zones = zone_table(pairs, steps, grown, axis, edits, diameter, options)
    dents = compare_dents(runs, matching, options, joints)
    rows = [row for pair in (*pairs, *steps) for row in limit_rows(pair, diameter)]
    rate = options.false_alarms_per_100_km
    rows += [row for name in names for row in joint_rows(reference, name, Elongation(joints, name), rate)]
    limits = build.table("limits", pd.DataFrame(rows))
    ovality = ovality_table(pairs, axis, dents, options)
    tick(1.0)
    for remark in remarks:
        log.warning("%s", remark)
    dataset = values.dataset(names, runs, axis, reference, ground.gauge_length)
    if np.isfinite(diameter):
        dataset.attrs["outside_diameter_m"] = diameter
    return Comparison(dataset, zones, dents, joints, limits, ovality, edits, tuple(remarks))


def _searched(pool, runs, matching, place, ground, values, remarks, options, tick) -> list[tuple[int, PairSearch]]:
    """Every run searched for what changed since the reference run and since the run before, several pairs at a time."""
    names = [run_id(run) for run in runs]
    first = names.index(ground.run)
    begun: list[tuple[int, Future[PairSearch]]] = []
    before = None
    for k, run in enumerate(runs):
        if k == first:
            values.reference(k, ground)
            before = ground
            continue
        other = layer(run, matching.maps[names[k]], place[0])
        remarks += _what_is_missing(ground, other)
        values.place(k, other)
        if place[1] is not None:
            begun.append((k, pool.submit(_search, ground, other, *place, matching, options, (first, k))))
            if before is not None and before is not ground:
                begun.append((k, pool.submit(_search, before, other, *place, matching, options, (k - 1, k))))
        before = other
    found = []
    for k, search in begun:
        found.append((k, search.result()))
        tick(0.7 * len(found) / len(begun))
    return found


def _search(
    ground: Layer, other: Layer, axis: Floats, axes: Any, matching: Any, options: ChangeOptions, order: tuple[int, int]
) -> PairSearch:
    """Search one run for what changed since another; ``order`` are their places among the runs."""
    broken = [np.asarray(matching.maps[run].broken, float).reshape(-1, 2) for run in {ground.run, other.run}]
    edits = tuple((float(start), float(end)) for start, end in np.concatenate(broken))
    since = None if ground.run == str(matching.reference) else ground.run
    known = f"change_m:{other.run}" in matching.joints and (since is None or f"change_m:{since}" in matching.joints)
    longer = Elongation(matching.joints, other.run, since) if known else None
    search = PairSearch(ground, other, axis, axes, options, edits, longer, order)
    search.run()
    return search


def _finish(
    pool: ThreadPoolExecutor, searches: list[tuple[int, PairSearch]], values: _Values, diameter: float, reference: str
) -> tuple[list[PairChange], list[PairChange]]:
    """Changes since the reference run and since the run before, on datums that what moved in any run has no part in; each
    search is let go when it is done.
    """
    moving = [stretch for _, search in searches for stretch in search.excluded]
    ends = [(k, pool.submit(search.finish_clear_of, moving)) for k, search in searches]
    searches.clear()
    pairs: list[PairChange] = []
    steps: list[PairChange] = []
    for k, end in ends:
        pair = end.result()
        if pair.reference == reference:
            values.change(k, pair, diameter)
            pairs.append(pair)
        else:
            steps.append(pair)
    return pairs, steps


def _in_order(runs: list[xr.DataTree], matching: Any) -> list[xr.DataTree]:
    """Runs by date, those without a date where they stand among them; every one must have a map."""
    faults = [
        Fault(run_id(r), "chainage map", "the matching holds none for this run") for r in runs if run_id(r) not in matching.maps
    ]
    if str(matching.reference) not in {run_id(r) for r in runs}:
        faults.append(Fault(str(matching.reference), "reference", "is not among the runs"))
    if faults:
        raise InputError(faults)
    days = np.array([run_day(run) for run in runs])
    order, dated = np.arange(len(runs)), np.flatnonzero(np.isfinite(days))
    order[dated] = dated[np.argsort(days[dated], kind="stable")]
    return [runs[i] for i in order]


def _whole(ground: Layer, axis: Floats) -> Layer:
    """The reference run holds its own steel everywhere."""
    zero = np.zeros(axis.size)
    return Layer(
        ground.run,
        ground.date,
        axis.copy(),
        zero,
        np.ones(axis.size, bool),
        ground.values,
        ground.gauge_length,
        ground.outside_diameter,
    )


def _diameter(runs: list[xr.DataTree], ground: Layer, remarks: list[str]) -> float:
    known = {
        run_id(r): float(r.attrs["outside_diameter_m"])
        for r in runs
        if np.isfinite(float(r.attrs.get("outside_diameter_m", np.nan)))
    }
    if known and max(known.values()) - min(known.values()) > 1e-3:
        words = ", ".join(f"{name} {value:.4f}" for name, value in known.items())
        remarks.append(
            f"the runs state different outside diameters ({words} m); strains are formed with that of the reference run"
        )
    return ground.outside_diameter if np.isfinite(ground.outside_diameter) else next(iter(known.values()), float("nan"))


def _what_is_missing(ground: Layer, other: Layer) -> list[str]:
    remarks = []
    if not (ground.has(*POSITION) and other.has(*POSITION)):
        remarks.append(f"{other.run}: no coordinates to compare with {ground.run}: no displacement")
    if not (ground.has("curvature_horizontal") and other.has("curvature_horizontal")):
        remarks.append(f"{other.run}: no curvature to compare with {ground.run}: no change of bending strain")
    share = float(other.valid.mean())
    if share < 0.95:
        remarks.append(f"{other.run}: holds {100 * share:.0f} % of the pipe of {ground.run}; nothing is said about the rest")
    if (
        np.isfinite(ground.gauge_length)
        and np.isfinite(other.gauge_length)
        and abs(ground.gauge_length - other.gauge_length) > 0.01
    ):
        remarks.append(
            f"{other.run}: curvature over {other.gauge_length:g} m, {ground.run} over {ground.gauge_length:g} m:"
            " not the same quantity in bends"
        )
    if other.date == ground.date:
        remarks.append(f"{other.run} and {ground.run} are of one day: their difference is noise, and carries no rate")
    return remarks


class _Values:
    """Arrays of the comparison, each made when the first run can fill it."""

    def __init__(self, epochs: int, size: int):
        self.shape = (epochs, size)
        self.arrays: dict[str, Floats] = {}
        self.filled: dict[str, set[int]] = {}
        self.zero: int | None = None
        self.stable = np.zeros(self.shape, bool)

    def _put(self, name: str, k: int, values: Floats | None, sigma: Floats | None = None) -> None:
        for key, row in ((name, values), (f"{name}_sigma", sigma)):
            if row is not None:
                if key not in self.arrays:
                    self.arrays[key], self.filled[key] = np.empty(self.shape), set()
                self.arrays[key][k] = row
                self.filled[key].add(k)

    def reference(self, k: int, ground: Layer) -> None:
        self.zero = k
        self.place(k, ground)
        self.stable[k] = True

    def place(self, k: int, run: Layer) -> None:
        self._put("run_chainage", k, run.run_chainage, run.run_chainage_sigma)

    def change(self, k: int, pair: PairChange, diameter: float) -> None:
        self.stable[k] = pair.stable
        if pair.displacement is not None and pair.displacement_sigma is not None:
            for m, name in enumerate(_DISPLACEMENT):
                self._put(f"displacement_{name}", k, pair.displacement[:, m], pair.displacement_sigma[:, m])
        for name, change in pair.curvature.items():
            self._put(f"curvature_change_{name}", k, change.change, change.sigma)
            if np.isfinite(diameter):
                half = diameter / 2.0
                self._put(f"bending_strain_change_{name}", k, change.change * half, change.sigma * half)
        self._put("ovality_change", k, pair.ovality, pair.ovality_sigma)

    def dataset(self, names: list[str], runs: list[xr.DataTree], axis: Floats, reference: str, gauge: float) -> xr.Dataset:
        for name, array in self.arrays.items():
            for k in set(range(self.shape[0])) - self.filled[name]:
                array[k] = 0.0 if k == self.zero and not name.startswith("run_chainage") else np.nan
        dates = [str(run.attrs.get("date", "")) for run in runs]
        values = {"epoch": names, "date": dates, "chainage": axis, **self.arrays}
        if any(name.startswith(("displacement", "curvature")) for name in self.arrays):
            values["stable"] = self.stable
        ds = build.dataset("comparison", values, reference=reference, dates=", ".join(dates))
        for variable in ds.data_vars:
            if str(variable).startswith(("curvature_change", "bending_strain_change")):
                ds[variable].attrs["gauge_length_m"] = gauge
            if str(variable).startswith("displacement"):
                ds[variable].attrs["comment"] = _DATUM_COMMENT
        history.append(ds.attrs, f"{len(names)} runs compared with {reference}")
        return ds
