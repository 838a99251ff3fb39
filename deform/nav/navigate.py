"""A raw run in; trajectory, markers with their misclosures and diagnostics of the navigation out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.nav import gaps, odometer, product
from deform.nav.aiding import RIDE_DENSITY, WOBBLE_DENSITY, KnownPipe, TravelAid, mark_aid, rest_aid, span_aid, travel_aid
from deform.nav.alignment import align
from deform.nav.arm_tilt import ring_centres
from deform.nav.compensation import compensation_table
from deform.nav.error_model import compose
from deform.nav.filter import Problem
from deform.nav.first_state import first_state
from deform.nav.product import Checks
from deform.nav.profile import Profile
from deform.nav.reverse import agreement
from deform.nav.sanity import check_motion
from deform.nav.second_path import second_path
from deform.nav.slips import SlipsSeen
from deform.nav.solution import Solution, solve
from deform.nav.strapdown import Counts, Epochs, epoch_bounds, preintegrate
from deform.options import NavigationOptions
from deform.run import build
from deform.run.raw import RawRun
from deform.run.stamps import usual_step

Floats = NDArray[np.float64]
Progress = Callable[[float], None] | None
log = logging.getLogger(__name__)

CORNERING = 0.5  # m/s²: a hundredth of the time pushed aside by more, a tool has its lever and lean as states


@dataclass(frozen=True)
class Navigation:
    """What the navigation of one run gives.

    Parameters
    ----------
    trajectory : group ``trajectory`` of the vocabulary (dim ``time``), about the IMU in the pipe, in the direction of travel.
    markers : group ``markers``: each marker with its misclosure before and after, and a remark where it was not believed.
    diagnostics : group ``navigation``: alignment, biases, mounting, scale with sigmas, innovations, second trajectory, backward
        run; attribute ``remarks`` says in words where these contradict the trajectory.
    """

    trajectory: xr.Dataset
    markers: xr.Dataset
    diagnostics: xr.Dataset


def navigate(
    raw: RawRun,
    options: NavigationOptions | None = None,
    control: xr.Dataset | None = None,
    progress: Progress = None,
    known: KnownPipe | None = None,
) -> Navigation:
    """Return the trajectory of a raw run.

    Parameters
    ----------
    raw : the raw run.
    options : options of the navigation.
    control : group ``control`` of the vocabulary; a point that bears the name of a marker of the run gives it its coordinates.
    progress : called with the fraction done.
    known : lengths of joints and straight stretches from a pipe book (`deform.correlate.pipe_book.known_pipe`).

    Raises
    ------
    InputError
        With every fault that keeps the run from being navigated.
    OptionError
        When lengths of joints are given to an error model that reckons by the odometer.
    """
    options, known = options or NavigationOptions(), known or KnownPipe()
    tell = progress or (lambda fraction: None)
    counts = counts_of(raw)
    wheels = odometer.combine(raw, options)
    tell(0.25)
    passages = with_control(raw.passages if raw.passages is not None else _no_passages(), control)
    if not np.isfinite(passages["time"].values).any():
        said = "run %s: no marker was heard: nothing holds the path behind the launch, its sigma grows to the end"
        log.warning(said, raw.id)
    bounds = epoch_bounds(counts.time, options.filter_interval_s, passages["time"].values)
    epochs = preintegrate(counts, wheels.profile, bounds)
    corners = bool(np.quantile(epochs.side_force, 0.99) > CORNERING)
    model = compose(options.error_model, raw.header, len(known.joints) > 0, len(known.straights) > 0, corners)
    model = model.with_wander(wheels.wander)
    across = RIDE_DENSITY if model.index("wobble").stop else WOBBLE_DENSITY
    travel = aid_of(epochs, wheels.profile, across)
    # the speed of a vehicle on a road errs often and hardly slips
    travel = replace(travel, lone=wheels.profile.lone and not corners)
    aligned = align(counts, epochs, travel, raw.header)
    check_motion(counts, wheels.profile, epochs, travel, aligned, raw.header)
    tell(0.4)
    sigma = np.nan_to_num(np.column_stack([passages["sigma_horizontal"].values, passages["sigma_vertical"].values]), nan=1.0)
    places = np.column_stack(
        [np.radians(passages["latitude"].values), np.radians(passages["longitude"].values), passages["height"].values]
    )
    marks = mark_aid(epochs, passages["time"].values, places, sigma, options.marker_time_sigma_s)
    start, aligned = first_state(raw, epochs, marks, aligned, model, float(travel.speeds[0]))
    resting = rest_aid(epochs, travel, float(model.walk[8]), counts.gyro_pulse)
    spans = replace(span_aid(epochs, travel, known), resting=resting)
    solution = solve(Problem(epochs, travel, marks, model, start, spans), ring_centres(raw))
    tell(0.8)
    with ThreadPoolExecutor(1) as beside:  # the backward run and the trajectory need nothing of each other
        backward = beside.submit(agreement, solution.problem, solution.filtered, solution.smoothed)
        line = product.trajectory_dataset(raw, counts, solution, wheels, options)
        slips = SlipsSeen.of(solution)
        hidden = gaps.remarks(solution.problem.epochs)
        checks = Checks(second_path(solution, slips.epochs), backward.result(), slips, hidden)
    for remark in checks.remarks:
        log.warning("run %s: %s", raw.id, remark)
    remarks = _mark_remarks(solution, passages, raw.id)
    tell(1.0)
    return Navigation(
        line,
        product.marker_dataset(raw, passages, solution, line, remarks),
        product.diagnostics_dataset(solution, aligned, checks),
    )


def aid_of(epochs: Epochs, profile: Profile, across: float = RIDE_DENSITY) -> TravelAid:
    """Return the travel measurements of the epochs by the odometer's profile."""
    speed, sigma, still = profile.per_epoch(epochs.time)
    single = Epochs(np.arange(epochs.bounds.size), epochs.time, epochs.table)  # one sample an epoch
    doubt = profile.mean_per_epoch(profile.doubt, epochs.time)
    return travel_aid(single, speed, np.append(0.0, sigma), np.append(False, still), across, doubt)


def counts_of(raw: RawRun) -> Counts:
    """Return the counts of a raw run as the kernels want them."""
    imu = raw.imu
    time = np.ascontiguousarray(imu["time"].values, float)
    return Counts(
        time,
        np.ascontiguousarray(imu["gyro_count"].values),  # 32 bits wide, or 64 where a maker's pulses need it
        np.ascontiguousarray(imu["accel_count"].values),
        float(imu.attrs["gyro_pulse_rad"]),
        float(imu.attrs["accel_pulse_m_per_s"]),
        compensation_table(raw.header.imu),
        usual_step(time),
    )


def with_control(passages: xr.Dataset, control: xr.Dataset | None) -> xr.Dataset:
    """Return the passages with the coordinates and sigmas of the control points that bear their names."""
    if control is None or not control.sizes["point"] or not passages.sizes["marker"]:
        return passages
    out = passages.copy(deep=True)
    row = {str(name): i for i, name in enumerate(control["name"].values)}
    for m, name in enumerate(passages["name"].values):
        i = row.get(str(name))
        if i is None:
            continue
        for variable in ("latitude", "longitude", "height", "sigma_horizontal", "sigma_vertical"):
            if variable in control and np.isfinite(control[variable].values[i]):
                out[variable].values[m] = control[variable].values[i]
    return out


def _no_passages() -> xr.Dataset:
    names = ("name", "kind", "time", "latitude", "longitude", "height", "sigma_horizontal", "sigma_vertical")
    return build.dataset("passages", {name: [] for name in names})


def _mark_remarks(solution: Solution, passages: xr.Dataset, run: str) -> dict[int, str]:
    marks, remarks = solution.problem.marks, {}
    for i, row in enumerate(marks.index):
        if marks.weight[i] < 0.5 and row < passages.sizes["marker"]:
            far = solution.left_out[i]
            size = f"{np.hypot(far[0], far[1]):.2f} m horizontally, {abs(far[2]):.2f} m vertically"
            text = f"contradicted by all other data: {size}; not used"
            remarks[int(row)] = text
            log.warning("marker %s of %s: %s", passages["name"].values[row], run, text)
    return remarks
