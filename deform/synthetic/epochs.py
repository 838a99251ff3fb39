"""A line as built and what happens to it in, the line of each run out: ground movement, cut-outs, re-routes, dents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deform.errors import Fault, OptionError
from deform.geometry.earth import enu_difference, enu_shift
from deform.options import MovementOptions, ReplacementOptions, SimulateOptions
from deform.synthetic import _kernels
from deform.synthetic._kernels import AZIMUTH, HEIGHT, LATITUDE, LONGITUDE, PITCH, RISE, TURN, S
from deform.synthetic.route import Line, draw_lengths, stream

__all__ = [
    "calm_spans",
    "dents_at",
    "displacement",
    "events_at",
    "fittings_at",
    "line_at",
    "place_of",
    "shifted",
]

Floats = NDArray[Any]

MATERIAL = {"cutout": 1, "reroute": 2}
DENT_COLUMNS = [
    *("dent_id", "chainage_m", "epoch0_chainage_m", "clock_deg", "depth_m"),
    *("depth_pct_od", "length_m", "width_m", "sharpness"),
]
FITTING_COLUMNS = ["fitting_id", "kind", "chainage_m", "epoch0_chainage_m", "clock_deg", "height_m", "length_m"]
EVENT_COLUMNS = [
    *("event_id", "type", "start_m", "end_m", "epoch0_start_m", "epoch0_end_m", "peak_displacement_m"),
    *("peak_added_bending_strain", "peak_total_bending_strain", "peak_axial_strain", "elongation_m", "history", "n_old", "n_new"),
]


@dataclass(frozen=True)
class Place:
    """Where an event acts: its span of material (metre) and the displacement vector at full size (east, north, up; metre)."""

    start: float
    end: float
    vector: Floats
    plateau: float


def line_at(built: Line, options: SimulateOptions, run: int) -> Line:
    """Return the line that one run finds.

    Parameters
    ----------
    built : the line as built.
    options : the simulation; movements and replacements are read.
    run : index of the run in the order of the options.

    Notes
    -----
    The centreline of the run is X(m) + D(m) of the material m, with D the sum of the movements; headings and curvature
    follow from its first and second derivative, arc length from the length of the first, so that a displaced pipe is
    longer by just what the displacement stretches it. Knots keep their material: pipe that did not move is bitwise itself.
    """
    line = built
    shift = np.zeros((3, built.table.shape[0], 3))  # D, dD/dm, d²D/dm²
    for movement in options.movements:
        shift += fraction(movement, options, run) * _field(built, place_of(built, movement))
    replaced = built.replaced.copy()
    active = [r for r in options.replacements if run >= r.first_run]
    for replacement in active:
        place = place_of(built, replacement)
        shift += _field(built, place)
        inside = (built.material >= place.start - 1e-9) & (built.material <= place.end + 1e-9)
        replaced[inside] = MATERIAL[replacement.kind]
    if not shift.any() and not active:
        return built
    line = replace(built, table=_displaced(built.table, built.material, shift), replaced=replaced)
    joints = built.joints
    for replacement in active:
        joints = _replaced_joints(line, joints, replacement, place_of(built, replacement), options)
    return replace(line, joints=_along(line, joints))


def calm_spans(options: SimulateOptions) -> list[tuple[float, float]]:
    """Return the stretches that move, with a margin: pipe that is laid straight there stretches by no more than steel can."""
    return [(m.start_m - 15.0, m.start_m + m.length_m + 15.0) for m in options.movements if m.straight]


def fraction(movement: MovementOptions, options: SimulateOptions, run: int) -> float:
    """Return the part of a movement's amplitude that one run finds.

    Raises
    ------
    OptionError
        When the movement gives fractions, but not one for each run.
    """
    if movement.fractions:
        if len(movement.fractions) != len(options.runs):
            rule = f"{len(movement.fractions)} fractions for {len(options.runs)} runs; give one for each"
            raise OptionError(Fault("simulation", f"movement {movement.id}", rule))
        return movement.fractions[run]
    if movement.history == "step":
        return 1.0 if run >= movement.step_run else 0.0
    days = [(r.date - options.runs[0].date).days for r in options.runs]
    share = days[run] / days[-1] if days[-1] else 0.0
    return share**2 if movement.history == "accelerating" else share


def place_of(built: Line, event: MovementOptions | ReplacementOptions) -> Place:
    """Return where an event acts; a replacement reaches from girth weld to girth weld.

    Raises
    ------
    OptionError
        When the event does not lie on the line.
    """
    start, end = event.start_m, event.start_m + event.length_m
    if end > built.length - 5.0 or start < 5.0:
        rule = f"lies at {start} .. {end} m of a line of {built.length:.1f} m; it must stay 5 m inside"
        raise OptionError(Fault("simulation", f"event {event.id}", rule))
    if isinstance(event, ReplacementOptions):
        welds = built.joints.material_start.to_numpy()[1:]
        start = float(welds[np.abs(welds - start).argmin()])
        end = float(welds[np.abs(welds - end).argmin()])
        return Place(start, end, event.offset_m * _across(built, start, end, np.array([1.0, 0.0, 0.0])), 0.2)
    side, drop = np.radians(event.side_deg), event.drop
    ways = {"landslide": [np.sin(side), np.cos(side), -drop], "settlement": [0.0, 0.0, -1.0], "heave": [0.0, 0.0, 1.0]}
    return Place(start, end, event.amplitude_m * _across(built, start, end, np.array(ways[event.kind])), event.plateau)


def displacement(line: Line, built: Line) -> Floats:
    """Return the displacement (n, 3) of each knot since the line was built (east, north, up; metre)."""
    now, then = line.table, built.table
    degrees = [np.degrees(x) for x in (now[:, LATITUDE], now[:, LONGITUDE], then[:, LATITUDE], then[:, LONGITUDE])]
    return np.stack(enu_difference(degrees[0], degrees[1], now[:, HEIGHT], degrees[2], degrees[3], then[:, HEIGHT]), axis=-1)


def shifted(places: pd.DataFrame, shift: Floats) -> tuple[Floats, Floats, Floats]:
    """Return latitude, longitude, height of places moved by east, north, up (3, n), metre."""
    return enu_shift(places.latitude_deg.to_numpy(), places.longitude_deg.to_numpy(), places.height_m.to_numpy(), *shift)


def dents_at(line: Line, options: SimulateOptions, run: int) -> pd.DataFrame:
    """Return the dents that one run finds: not the ones on pipe that is no longer there.

    Raises
    ------
    OptionError
        When a dent does not give a depth for each run.
    """
    rows = []
    for dent in options.dents:
        if len(dent.depths_od) != len(options.runs):
            rule = f"{len(dent.depths_od)} depths for {len(options.runs)} runs; give one for each, 0 where it is not there"
            raise OptionError(Fault("simulation", f"dent {dent.id}", rule))
        on_old_pipe = line.replaced[np.searchsorted(line.material, dent.chainage_m).clip(0, line.replaced.size - 1)] == 0
        if dent.depths_od[run] > 0 and on_old_pipe:
            rows.append(
                {
                    "dent_id": dent.id,
                    "chainage_m": float(line.of_material(dent.chainage_m)),
                    "epoch0_chainage_m": dent.chainage_m,
                    "clock_deg": dent.clock_deg % 360.0,
                    "depth_m": dent.depths_od[run] * line.outside_diameter,
                    "depth_pct_od": 100.0 * dent.depths_od[run],
                    "length_m": dent.length_m,
                    "width_m": dent.width_m,
                    "sharpness": dent.sharpness,
                }
            )
    columns = [
        "dent_id",
        "chainage_m",
        "epoch0_chainage_m",
        "clock_deg",
        "depth_m",
        "depth_pct_od",
        "length_m",
        "width_m",
        "sharpness",
    ]
    return pd.DataFrame(rows, columns=columns).sort_values("chainage_m").reset_index(drop=True)


def fittings_at(line: Line, options: SimulateOptions) -> pd.DataFrame:
    """Return the tees and wrinkles on pipe that is still there."""
    rows = []
    for fitting in options.fittings:
        if line.replaced[np.searchsorted(line.material, fitting.chainage_m).clip(0, line.replaced.size - 1)] == 0:
            row = {"fitting_id": fitting.id, "kind": fitting.kind, "chainage_m": float(line.of_material(fitting.chainage_m))}
            row |= {"epoch0_chainage_m": fitting.chainage_m, "clock_deg": fitting.clock_deg % 360.0}
            rows.append(row | {"height_m": fitting.height_m, "length_m": fitting.length_m})
    return pd.DataFrame(rows, columns=FITTING_COLUMNS)


def events_at(line: Line, built: Line, options: SimulateOptions, run: int) -> pd.DataFrame:
    """Return every event with its span and size in one run, columns as in `events_truth.csv`."""
    moved = np.linalg.norm(displacement(line, built), axis=1)
    radius = 0.5 * line.outside_diameter
    now, then = (radius * np.stack(x.curvature(x.chainage)) for x in (line, built))
    added = np.linalg.norm(now - then, axis=0)
    rows = []
    happened: list[MovementOptions | ReplacementOptions] = [*options.movements]
    happened += [r for r in options.replacements if run >= r.first_run]
    for event in happened:
        place = place_of(built, event)
        low, high = np.searchsorted(built.material, [place.start, place.end])
        span = slice(max(low - 1, 0), high + 1)
        stretch = np.diff(line.chainage[span]) / np.diff(built.chainage[span]) - 1.0
        ends = line.of_material([place.start, place.end])
        row: dict[str, Any] = {"event_id": event.id, "type": event.kind, "start_m": ends[0], "end_m": ends[1]}
        row |= {"epoch0_start_m": place.start, "epoch0_end_m": place.end, "peak_displacement_m": moved[span].max()}
        row["elongation_m"] = ends[1] - ends[0] - (place.end - place.start)
        if isinstance(event, ReplacementOptions):
            number = [_within(x.joints, place).sum() for x in (built, line)]
            row |= {"history": "step", "n_old": number[0], "n_new": number[1]}
        else:
            row |= {"peak_added_bending_strain": added[span].max(), "history": "given" if event.fractions else event.history}
            row |= {"peak_total_bending_strain": np.linalg.norm(now[:, span], axis=0).max(), "peak_axial_strain": stretch.max()}
        rows.append(row)
    columns = [
        "event_id",
        "type",
        "start_m",
        "end_m",
        "epoch0_start_m",
        "epoch0_end_m",
        "peak_displacement_m",
        "peak_added_bending_strain",
    ]
    columns += ["peak_total_bending_strain", "peak_axial_strain", "elongation_m", "history", "n_old", "n_new"]
    return pd.DataFrame(rows, columns=columns)


def bump(u: Floats, plateau: float) -> Floats:
    """Return a bump over 0..1 with flat top and its two derivatives, shape (3, n); twice differentiable at its ends."""
    ramp = 0.5 * (1.0 - plateau) or 0.5
    inner = np.minimum(u, 1.0 - u) / ramp
    sign = np.where(u > 0.5, -1.0, 1.0) / ramp
    x = np.clip(inner, 0.0, 1.0)
    value = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
    slope = 140.0 * x**3 * (1.0 - x) ** 3
    second = 420.0 * x**2 * (1.0 - x) ** 2 * (1.0 - 2.0 * x)
    return np.stack([value, slope * sign, second * sign**2])


def _across(built: Line, start: float, end: float, way: Floats) -> Floats:
    """Unit vector (east, north, up) of a way given as right, ahead, up, without its part along the pipe in the middle.

    Steel does not stretch by the percents that ground along the pipe would ask for: the pipe follows across its axis only.
    """
    middle = 0.5 * (start + end)
    azimuth, pitch = built.at(middle, AZIMUTH)[0, 0], built.at(middle, PITCH)[0, 0]
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    ahead = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    vector = way[0] * right + way[1] * ahead + way[2] * np.array([0.0, 0.0, 1.0])
    axis = np.cos(pitch) * ahead + np.sin(pitch) * np.array([0.0, 0.0, 1.0])
    vector = vector - (vector @ axis) * axis
    return vector / np.linalg.norm(vector)


def _field(built: Line, place: Place) -> Floats:
    span = place.end - place.start
    shape = bump((built.material - place.start) / span, place.plateau)
    return (shape / span ** np.arange(3)[:, None])[:, :, None] * place.vector


def _displaced(table: Floats, material: Floats, shift: Floats) -> Floats:
    """Table of the line X + D: headings and their slopes from the derivatives, then positions by integration."""
    out = table.copy()
    a, p = table[:, AZIMUTH], table[:, PITCH]
    sa, ca, sp, cp = np.sin(a), np.cos(a), np.sin(p), np.cos(p)
    first = np.stack([sa * cp, ca * cp, sp], axis=1) + shift[1]
    turn, rise = table[:, TURN], table[:, RISE]
    second = np.stack([ca * cp * turn - sa * sp * rise, -sa * cp * turn - ca * sp * rise, cp * rise], axis=1) + shift[2]
    level2 = first[:, 0] ** 2 + first[:, 1] ** 2
    stretch = np.sqrt(level2 + first[:, 2] ** 2)
    moved = np.abs(shift[1:]).max(axis=(0, 2)) > 0
    stretch[~moved] = 1.0
    side = first[:, 0] * ca - first[:, 1] * sa
    ahead = first[:, 0] * sa + first[:, 1] * ca
    azimuth, pitch = a + np.arctan2(side, ahead), np.arctan2(first[:, 2], np.sqrt(level2))
    turning = (second[:, 0] * first[:, 1] - second[:, 1] * first[:, 0]) / level2
    along = (first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1]) / level2
    rising = np.sqrt(level2) * (second[:, 2] - first[:, 2] * along) / stretch**2
    out[moved, AZIMUTH], out[moved, PITCH] = azimuth[moved], pitch[moved]
    out[moved, TURN], out[moved, RISE] = turning[moved] / stretch[moved], rising[moved] / stretch[moved]
    extra = 0.5 * np.diff(material) * ((stretch[1:] - 1.0) + (stretch[:-1] - 1.0))
    out[:, S] = material + np.concatenate([[0.0], np.cumsum(extra)])
    _kernels.integrate_line(out, table[0, LATITUDE], table[0, LONGITUDE], table[0, HEIGHT])
    return out


def _replaced_joints(
    line: Line, joints: pd.DataFrame, event: ReplacementOptions, place: Place, options: SimulateOptions
) -> pd.DataFrame:
    """Joints with those of a span exchanged; the welds at both ends of the span keep their names."""
    rng = stream(options.seed, "replacement", event.id)
    inside = _within(joints, place)
    ends = line.of_material([place.start, place.end])
    length = _new_lengths(float(ends[1] - ends[0]), int(inside.sum()), event.kind, options, rng)
    n = length.size
    start = ends[0] + np.concatenate([[0.0], np.cumsum(length)[:-1]])
    fresh = joints[inside].iloc[[0] * n].copy()
    fresh["joint_id"] = [f"{event.id}-{i + 1:03d}" for i in range(n)]
    fresh["weld_id"] = [str(joints[inside].weld_id.iloc[0])] + [f"W{event.id}-{i + 1:03d}" for i in range(1, n)]
    fresh["material_start"] = np.interp(start, line.chainage, line.material)
    fresh["length_m"], fresh["is_replaced"], fresh["recess_m"] = length, 1, 0.0
    fresh["bead_m"] = rng.normal(0.0012, 0.0003, n).clip(0.0003)
    fresh["wall_m"] = options.route.wall_m * (1.0 + rng.normal(0.0, 0.01, n))
    fresh["ovality"], fresh["ovality_clock"] = rng.gamma(4.0, 0.0006, n), rng.uniform(0, np.pi, n)
    headings = line.at(np.append(start, ends[1]), AZIMUTH)[:, 0], line.at(np.append(start, ends[1]), PITCH)[:, 0]
    angle = np.degrees(np.hypot(np.diff(headings[0]) * np.cos(headings[1][1:]), np.diff(headings[1])))
    fresh["bend_angle_deg"], fresh["kind"] = angle, np.select([angle > 1.6, angle > 0.25], ["cold", "elastic"], "straight")
    return pd.concat([joints[~inside], fresh]).sort_values("material_start", kind="stable").reset_index(drop=True)


def _within(joints: pd.DataFrame, place: Place) -> pd.Series:
    """Joints that begin in a span of material."""
    return joints.material_start.between(place.start - 1e-6, place.end - 1e-6)


def _new_lengths(total: float, old: int, kind: str, options: SimulateOptions, rng: np.random.Generator) -> Floats:
    """Lengths of the new joints, their sum the length of the new pipe."""
    if kind == "cutout":
        parts = rng.uniform(0.6, 1.0, old + 1)
        return total * parts / parts.sum()
    length = draw_lengths(total, options.route.joint_m, options.route.pup_share, rng)
    length[-1] = total - length[:-1].sum()
    if length[-1] < 1.0 and length.size > 1:
        length = np.append(length[:-2], length[-2] + length[-1])
    return length


def _along(line: Line, joints: pd.DataFrame) -> pd.DataFrame:
    start = line.of_material(joints.material_start.to_numpy())
    return joints.assign(start_m=start, length_m=np.diff(np.append(start, line.length)))
