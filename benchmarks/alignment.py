"""Alignment against its limit, Li et al. (2012): 28.2° N, 600 s, ten sets at rest and ten in motion, azimuth and level.

``python -m benchmarks.alignment [SETS]``. The limit at rest is drift / (Ω cos φ) with the random walk's share of the mean rate.
In motion it is the best linear estimate from the same data by one who knows the true motion and the true statistics of every
error (generalised least squares, derived here from the truth, nothing of the filter in it): its expected sigma, and its
error in each set. The rms of ten sets by itself scatters by a fifth; the ratio to the best estimate of the same sets does not.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from benchmarks._best_alignment import best_estimate, true_attitudes
from deform.geometry import earth
from deform.geometry.rotation import matrix_to_rotation_vector
from deform.nav import odometer
from deform.nav.alignment import Alignment, align
from deform.nav.inertial_alignment import Record, coarse, record
from deform.nav.navigate import aid_of, counts_of
from deform.nav.strapdown import epoch_bounds, preintegrate
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.run.raw import RawRun
from deform.synthetic import imu
from deform.synthetic.in_memory import raw_run
from deform.synthetic.route import stream
from deform.synthetic.simulate import Passage, ride

LATITUDE, SECONDS, SETS = 28.2, 600.0, 10
THEIRS = {"rest": 0.008, "motion": 0.08}


def options(seed: int, moving: bool, roll: float, grade: str = "navigation") -> SimulateOptions:
    """One short line in a drawn direction, a tool at rest at its begin or already moving."""
    rest = {"static_start_s": 0.0 if moving else SECONDS, "static_end_s": 0.0, "stops": 0}
    tool = ToolOptions(imu=grade, roll_turns_per_km=roll, caliper=False, **rest)
    towards = float(np.random.default_rng(seed).uniform(0.0, 360.0))
    plain = {"crossings": 0, "bend_fields": 0, "induction_bends_deg": ()}
    route = RouteOptions(length_m=900.0 if moving else 60.0, latitude_deg=LATITUDE, azimuth_deg=towards, **plain)
    return SimulateOptions(seed=seed, route=route, tool=tool, runs=(RunOptions(id="set", date="2012-07-30"),))


def cut(raw: RawRun, seconds: float) -> RawRun:
    """The first seconds of a run."""
    inertial, wheels = (d.isel(sample=d["time"].values <= seconds + 1e-6) for d in (raw.imu, raw.odometer))
    return replace(raw, imu=inertial, odometer=wheels)


def aligned(raw: RawRun) -> tuple[Alignment, Record]:
    """The alignment as `navigate` makes it, and the record it stands on."""
    counts, wheels = counts_of(raw), odometer.combine(raw)
    epochs = preintegrate(counts, wheels.profile, epoch_bounds(counts.time, 1.0))
    aid = aid_of(epochs, wheels.profile)
    return align(counts, epochs, aid, raw.header), record(epochs, aid)


def error_deg(attitude: np.ndarray, passage: Passage, at: float) -> np.ndarray:
    """Turning error about east, north, up (degree) of an attitude at a time."""
    return np.degrees(matrix_to_rotation_vector(attitude @ true_attitudes(passage, np.array([at]))[0].T))


def at_rest(seed: int, grade: str, errors: imu.Errors | None = None) -> tuple[np.ndarray, np.ndarray, float]:
    """Error (east, north, up) of a set at rest, what its drifts and biases alone make of it, and the stated azimuth sigma.

    What is in the mean rate and force cannot be told from the earth's: the drift east turns the azimuth by drift / Ω cos φ, the
    bias and the axes askew tilt the level, and the level the azimuth by tan φ.
    """
    passage = ride(options(seed if errors is None else 0, False, 0.3, grade))
    opts = options(seed if errors is None else 0, False, 0.3, grade)
    drawn = errors or imu.draw_errors(imu.grade_of(opts.tool), stream(opts.seed, "set", "imu errors"))
    raw = raw_run(passage, opts, drawn, noise=f" {seed}")
    found = aligned(raw)[0]
    C = true_attitudes(passage, np.array([1.0]))[0]
    latitude = raw.header.launch.latitude_deg
    force, rate = C.T @ [0.0, 0.0, float(earth.gravity(latitude))], C.T @ earth.earth_rate(latitude)
    bias, drift = (
        C @ (drawn.accel_matrix @ force + drawn.accel_bias - force),
        C @ (drawn.gyro_matrix @ rate + drawn.gyro_bias - rate),
    )
    level = np.array([-bias[1], bias[0]]) / float(earth.gravity(latitude))
    turn = -drift[0] / earth.earth_rate(latitude)[1] - level[1] * np.tan(np.radians(latitude))
    return error_deg(found.attitude, passage, 1.0), np.degrees([*level, turn]), float(np.degrees(found.sigma[2]))


def rest_limit(grade: imu.Grade, seconds: float = SECONDS) -> tuple[float, float]:
    """Limit of the azimuth at rest (degree): with a drift of its own for each set, and the scatter under one drift."""
    north = earth.earth_rate(LATITUDE)[1]
    walk = grade.gyro_random_walk_deg_per_sqrt_h * imu.DEG_PER_SQRT_H / np.sqrt(seconds) / north
    wander = imu.wander_sigma(grade)[0] / north  # the mean of a wandering bias over a set is nearly its value
    drift = grade.gyro_bias_deg_per_h * imu.DEG_PER_H / north
    return float(np.degrees(np.sqrt(drift**2 + walk**2 + wander**2))), float(np.degrees(np.hypot(walk, wander)))


def in_motion(seed: int, roll: float) -> tuple[np.ndarray, ...]:
    """Errors of coarse-and-fine and of the best estimate, sigma of the best estimate, stated sigma (east, north, up; degree)."""
    opts = options(seed, True, roll)
    passage = ride(opts)
    raw = cut(raw_run(passage, opts), SECONDS)
    found, kept = aligned(raw)
    first, _ = coarse(kept, raw.header.launch.latitude_deg, raw.header.launch.height_m)
    best = best_estimate(passage, kept, found.time, imu.grade_of(opts.tool), opts.tool)
    errors = (error_deg(a, passage, found.time) for a in (found.attitude, first))
    return *errors, *best, np.degrees(found.sigma)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else SETS
    print(f"{sets} sets of {SECONDS:.0f} s at {LATITUDE}° N; degree")
    print(f"{'':34}{'azimuth':>9}{'limit':>9}{'ratio':>7}{'level':>9}{'limit':>9}{'stated':>9}   theirs")
    for grade in ("navigation", "li-2012"):
        error, known, stated = (np.array(v) for v in zip(*(at_rest(s, grade) for s in range(sets)), strict=True))
        limit, scatter = rest_limit(imu.GRADES[grade])
        made = np.hypot(rms(known[:, 2]), scatter)
        line(f"at rest, {grade}", error, made, np.hypot(*np.mean(known[:, :2] ** 2, axis=0) ** 0.5), rms(stated), "")
        print(f"{'':34}(expected limit over all drifts {limit:.4f})")
        shared = imu.draw_errors(imu.GRADES[grade], np.random.default_rng(3))
        same = np.array([at_rest(s, grade, shared)[0] for s in range(sets)])
        same -= same.mean(axis=0)
        line(
            "   scatter under one turn-on bias", same * np.sqrt(sets / (sets - 1)), scatter, np.nan, np.nan, "0.008, level 0.002"
        )
    for roll, name in ((0.0, "in motion, no roll"), (0.3, "in motion, 0.3 turns per km")):
        fine, first, best, sigma, stated = (np.array(v) for v in zip(*(in_motion(s, roll) for s in range(sets)), strict=True))
        line(f"{name}, coarse", first, rms(best[:, 2]), np.hypot(rms(best[:, 0]), rms(best[:, 1])), np.nan, "0.2, level 0.05")
        line(
            f"{name}, fine",
            fine,
            rms(best[:, 2]),
            np.hypot(rms(best[:, 0]), rms(best[:, 1])),
            rms(stated[:, 2]),
            "0.08, level 0.007",
        )
        print(f"{'':34}(expected sigma of the best estimate {rms(sigma[:, 2]):.4f})")


def line(name: str, error: np.ndarray, limit: float, level_limit: float, stated: float, theirs: str) -> None:
    azimuth, level = rms(error[:, 2]), float(np.hypot(rms(error[:, 0]), rms(error[:, 1])))
    print(
        f"{name:34}{azimuth:9.4f}{limit:9.4f}{azimuth / limit:7.2f}{level:9.4f}{level_limit:9.4f}{stated:9.4f}   {theirs}",
        flush=True,
    )


if __name__ == "__main__":
    main()
