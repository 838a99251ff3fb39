"""Options of a route in, the line as it was built out: joints of pipe, and the centreline they make on the ellipsoid."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from deform.geometry.earth import radii
from deform.options import RouteOptions
from deform.synthetic import _kernels
from deform.synthetic._kernels import AZIMUTH, COLUMNS, HEIGHT, LATITUDE, LONGITUDE, PITCH, RISE, TURN, S

Floats = NDArray[Any]

STEP = 0.1  # m, distance of the knots
ELASTIC_STRAIN = 5e-4  # bending strain that a trench imposes on straight pipe
RAMP = 0.4  # m, over which a bend takes its curvature


@dataclass(frozen=True)
class Line:
    """A line at one epoch.

    Attributes
    ----------
    table : shape (n, 21), knots of the centreline (columns of `synthetic._kernels`), angles in radian.
    material : chainage of each knot's material when the line was built (metre).
    replaced : 0 pipe as built, 1 cut-out, 2 re-route.
    joints : one row per joint: joint_id, weld_id (at its start), material_start, start_m, length_m, wall_m, kind,
        bend_angle_deg, is_replaced, ovality, ovality_clock, recess_m, bead_m.
    outside_diameter : metre.
    """

    table: Floats
    material: Floats
    replaced: NDArray[np.int8]
    joints: pd.DataFrame
    outside_diameter: float

    @property
    def chainage(self) -> Floats:
        """Chainage of the knots (metre)."""
        return self.table[:, S]

    @property
    def length(self) -> float:
        """Length of the line (metre)."""
        return float(self.table[-1, S])

    def at(self, chainage: ArrayLike, column: int) -> Floats:
        """Return a column of the table and its derivative at chainages, shape (n, 2)."""
        where = np.atleast_1d(np.asarray(chainage, float))
        out = np.empty((where.size, 2))
        _kernels.fill_columns(self.table, where, column, out)
        return out

    def position(self, chainage: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return latitude, longitude (degree) and height (metre) of the centreline."""
        latitude = self.at(chainage, LATITUDE)[:, 0]
        longitude = self.at(chainage, LONGITUDE)[:, 0]
        return np.degrees(latitude), np.degrees(longitude), self.at(chainage, HEIGHT)[:, 0]

    def curvature(self, chainage: ArrayLike) -> tuple[Floats, Floats]:
        """Return horizontal (to the right) and vertical (sag) curvature (1/m)."""
        pitch = self.at(chainage, PITCH)
        return self.at(chainage, AZIMUTH)[:, 1] * np.cos(pitch[:, 0]), pitch[:, 1]

    def of_material(self, material: ArrayLike) -> Floats:
        """Return the chainage of material given by its chainage as built."""
        step = 1 if self.material[-1] > self.material[0] else -1  # falling in a reversed line
        return np.interp(np.asarray(material, float), self.material[::step], self.chainage[::step])

    def reversed(self) -> Line:
        """Return the line as it lies before a tool that runs upstream: chainage from the far end, headings turned round."""
        table = self.table[::-1].copy()
        table[:, S] = self.length - table[:, S]
        table[:, AZIMUTH] += np.pi
        table[:, PITCH] *= -1.0
        table[:, TURN] *= -1.0
        for column in (_kernels.D_LATITUDE, _kernels.D_LONGITUDE, _kernels.D_HEIGHT):
            table[:, column] *= -1.0
        joints = self.joints.iloc[::-1].copy()
        joints["start_m"] = self.length - joints.start_m - joints.length_m
        joints["ovality_clock"] = -joints.ovality_clock
        beads = self.joints.bead_m.to_numpy()
        joints["bead_m"] = np.append(beads[1:], 0.0)[::-1]
        joints = joints.reset_index(drop=True)
        return replace(self, table=table, material=self.material[::-1], replaced=self.replaced[::-1], joints=joints)


def stream(seed: int, *names: object) -> np.random.Generator:
    """Return the generator of one named effect: an effect more or less leaves all others as they were."""
    return np.random.default_rng([seed, *(zlib.crc32(str(n).encode()) for n in names)])


def lay(options: RouteOptions, seed: int = 1, calm: Sequence[tuple[float, float]] = ()) -> Line:
    """Return the line as it was built.

    Parameters
    ----------
    options : where it runs and of which pipe.
    seed : same seed, same line.
    calm : stretches (start, end; metre) in which the pipe is laid straight.
    """
    joints = lay_joints(options, stream(seed, "joints"))
    joints, turn, rise = _bend(joints, options, calm, stream(seed, "bends"))
    length = float(joints.start_m.iloc[-1] + joints.length_m.iloc[-1])
    chainage = np.append(np.arange(0.0, length - 0.5 * STEP, STEP), length)
    table = np.zeros((chainage.size, COLUMNS))
    table[:, S] = chainage
    table[:, RISE], table[:, TURN] = _profile(chainage, joints, turn, rise, 5.0 * options.outside_diameter_m)
    table[:, PITCH] = _integral(chainage, table[:, RISE])
    table[:, TURN] /= np.cos(table[:, PITCH])
    table[:, AZIMUTH] = np.radians(options.azimuth_deg) + _integral(chainage, table[:, TURN])
    place = (np.radians(options.latitude_deg), np.radians(options.longitude_deg), options.height_m)
    _kernels.integrate_line(table, *place)
    return Line(table, chainage.copy(), np.zeros(chainage.size, np.int8), joints, options.outside_diameter_m)


def lay_joints(options: RouteOptions, rng: np.random.Generator) -> pd.DataFrame:
    """Return the joints of a line, all straight: mill lots of like length, pups, valves, heavy wall at crossings."""
    length = draw_lengths(options.length_m, options.joint_m, options.pup_share, rng)
    start = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    pup = length < 0.5 * options.joint_m
    wall = options.wall_m * (1.0 + rng.normal(0.0, 0.01, length.size))
    for place in crossings(options):
        heavy = (start > place - 60.0) & (start + length < place + 60.0)
        wall[heavy] = options.heavy_wall_m * (1.0 + rng.normal(0.0, 0.01, heavy.sum()))
    kind = np.where(pup, "pup", "straight").astype(object)
    for place in np.arange(0.5, options.length_m / options.valve_spacing_m) * options.valve_spacing_m:
        i = int(np.searchsorted(start, place)) - 1
        kind[i], length[i], wall[i] = "valve", 1.5, options.heavy_wall_m
        start = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    return _describe(length, kind, wall, options.valve_recess_m, rng)


def draw_lengths(total: float, joint: float, pup_share: float, rng: np.random.Generator) -> Floats:
    """Return joint lengths with about a total: lots from one mill scatter little about the length of the mill."""
    mills = joint * np.array([1.0, 1.02, 1.038, 1.057, 0.985])
    lengths: list[float] = []
    done = 0.0
    while done < total:
        mill, spread = rng.choice(mills), rng.choice([0.012, 0.05, 0.15])
        lot = rng.normal(mill, spread, int(rng.integers(15, 70)))
        short = rng.random(lot.size)
        lot = np.where(short < pup_share, rng.uniform(0.08, 0.4, lot.size) * joint, lot)
        lot = np.where(short > 1.0 - 0.06, lot - rng.exponential(0.08 * joint, lot.size).clip(0, 0.45 * joint), lot)
        lengths += list(lot)
        done += float(lot.sum())
    cut = np.array(lengths)
    return cut[: int(np.searchsorted(np.cumsum(cut), total)) + 1]


def crossings(options: RouteOptions) -> Floats:
    """Return the chainages of river crossings."""
    return options.length_m * (np.arange(options.crossings) + 0.42) / max(options.crossings, 1)


def _describe(length: Floats, kind: Floats, wall: Floats, recess: float, rng: np.random.Generator) -> pd.DataFrame:
    n = length.size
    return pd.DataFrame(
        {
            "joint_id": [f"J{i + 1:05d}" for i in range(n)],
            "weld_id": [f"W{i:05d}" for i in range(n)],
            "material_start": np.concatenate([[0.0], np.cumsum(length)[:-1]]),
            "start_m": np.concatenate([[0.0], np.cumsum(length)[:-1]]),
            "length_m": length,
            "wall_m": wall,
            "kind": kind,
            "bend_angle_deg": 0.0,
            "is_replaced": 0,
            "ovality": rng.gamma(4.0, 0.0006, n),
            "ovality_clock": rng.uniform(0, np.pi, n),
            "recess_m": np.where(kind == "valve", recess, 0.0),
            "bead_m": rng.normal(0.0012, 0.0003, n).clip(0.0003),
        }
    )


def _bend(
    joints: pd.DataFrame, options: RouteOptions, calm: Sequence[tuple[float, float]], rng: np.random.Generator
) -> tuple[pd.DataFrame, Floats, Floats]:
    """Choose for each joint the turn to the right and upward (radian) that keeps the line on its plan."""
    start, length = joints.start_m.to_numpy(), joints.length_m.to_numpy()
    kind = joints.kind.to_numpy().copy()
    n = len(joints)
    plan_azimuth, plan_pitch = _plan(start + length, options, rng)
    straight = np.any([(start + length > low) & (start < high) for low, high in calm], axis=0) if calm else np.zeros(n, bool)
    induction = _induction(start, length, np.where(straight, "calm", kind), options)
    turn, rise = np.zeros(n), np.zeros(n)
    azimuth, pitch, shift = plan_azimuth[0], 0.0, 0.0
    elastic = 2.0 * ELASTIC_STRAIN / options.outside_diameter_m
    field, slack = _fields(start, options), rng.uniform(0.2, 1.2, n)  # degree, what the trench leaves unfollowed
    for i in range(n):
        if i in induction:
            turn[i], kind[i] = np.radians(induction[i]), "induction"
            shift += turn[i]
        elif kind[i] == "straight" and not straight[i]:
            want = plan_azimuth[i] + shift - azimuth, plan_pitch[i] - pitch
            if field[i]:
                want = want[0] + np.radians(rng.uniform(-5, 5)), want[1] + np.radians(rng.uniform(-4, 4))
            size = np.hypot(*want)
            most = min(np.radians(10.0), np.radians(1.2) * length[i])
            if size > np.radians(1.6):
                kind[i], part = "cold", min(1.0, most / size)
            elif size > np.radians(slack[i]):
                kind[i], part = "elastic", min(1.0, elastic * (length[i] - 2.0) / size)
            else:
                part = 0.0
            turn[i], rise[i] = part * want[0], part * want[1]
        azimuth, pitch = azimuth + turn[i] / np.cos(pitch), pitch + rise[i]
    extra = np.select([kind == "cold", kind == "induction"], [rng.uniform(0.002, 0.009, n), rng.uniform(0.012, 0.017, n)], 0.0)
    described = joints.assign(kind=kind, bend_angle_deg=np.degrees(np.hypot(turn, rise)), ovality=joints.ovality + extra)
    return described, turn, rise


def _plan(where: Floats, options: RouteOptions, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Azimuth relative to the first one and pitch (radian) that the route asks for."""
    azimuth = _followed(where, options) if options.vertices else _slow(where, np.radians(options.wander_deg), 900.0, rng)
    pitch = _slow(where, np.radians(options.hill_pitch_deg), 450.0, rng)
    for place in crossings(options):
        x = where - place
        pitch = np.where((x > -75) & (x <= -30), np.radians(-8.0), pitch)
        pitch = np.where((x > -30) & (x <= 30), 0.0, pitch)
        pitch = np.where((x > 30) & (x <= 75), np.radians(8.0), pitch)
    ends = np.clip(np.minimum(where, where[-1] - where) / 40.0, 0.0, 1.0)
    return azimuth - azimuth[0], pitch * ends


def _followed(where: Floats, options: RouteOptions) -> Floats:
    """Azimuth along a chain of vertices, the corners rounded over 150 m."""
    longitude, latitude = np.radians(np.array(options.vertices, float)).T
    meridian, normal = radii(np.degrees(latitude[0]))
    east, north = np.diff(longitude) * normal * np.cos(latitude[:-1]), np.diff(latitude) * meridian
    corner = np.concatenate([[0.0], np.cumsum(np.hypot(east, north))])
    fine = np.arange(0.0, max(where[-1], corner[-1]) + 1.0)
    x, y = np.interp(fine, corner, np.append(0.0, np.cumsum(east))), np.interp(fine, corner, np.append(0.0, np.cumsum(north)))
    azimuth = np.unwrap(np.arctan2(np.diff(x, append=2 * x[-1] - x[-2]), np.diff(y, append=2 * y[-1] - y[-2])))
    width = min(151, fine.size // 2 * 2 - 1)  # odd, so that the filter keeps its place
    smooth = np.convolve(np.pad(azimuth, width // 2, mode="edge"), np.ones(width) / width, mode="valid")
    return np.interp(where, fine, smooth)


def _slow(where: Floats, size: float, wavelength: float, rng: np.random.Generator, terms: int = 5) -> Floats:
    """Sum of sinusoids of about an amplitude, wavelengths spread about a middle one."""
    out = np.zeros_like(where)
    for _ in range(terms):
        length = wavelength * rng.uniform(0.5, 2.5)
        out += size / np.sqrt(terms) * rng.uniform(0.7, 1.3) * np.sin(2 * np.pi * (where / length + rng.random()))
    return out


def _fields(start: Floats, options: RouteOptions) -> NDArray[np.bool_]:
    """Stretches of 80 m in which every joint is bent on site."""
    places = options.length_m * (np.arange(options.bend_fields) + 0.73) / max(options.bend_fields, 1)
    return np.any(np.abs(start[:, None] - places) < 40.0, axis=1, keepdims=False)


def _induction(start: Floats, length: Floats, kind: Floats, options: RouteOptions) -> dict[int, float]:
    """Joint that becomes each induction bend, and its angle (degree)."""
    chosen: dict[int, float] = {}
    count = len(options.induction_bends_deg)
    for k, angle in enumerate(options.induction_bends_deg):
        i = int(np.searchsorted(start, options.length_m * (k + 0.13) / count))
        while i + 1 < len(start) and (kind[i] != "straight" or length[i] < _arc(angle, options) + 2.0 or i in chosen):
            i += 1
        chosen[i] = angle
    return chosen


def _arc(angle_deg: float, options: RouteOptions) -> float:
    """Length of a 5D bend."""
    return abs(np.radians(angle_deg)) * 5.0 * options.outside_diameter_m


def _profile(chainage: Floats, joints: pd.DataFrame, turn: Floats, rise: Floats, radius: float) -> tuple[Floats, Floats]:
    """Vertical and horizontal curvature of the knots: in each bent joint a plateau with rounded flanks, its area the turn."""
    vertical, horizontal = np.zeros_like(chainage), np.zeros_like(chainage)
    bent = np.flatnonzero((turn != 0) | (rise != 0))
    start, length, kind = joints.start_m.to_numpy(), joints.length_m.to_numpy(), joints.kind.to_numpy()
    for i in bent:
        if kind[i] == "induction":
            plateau = abs(turn[i]) * radius
            ramp = min(RAMP, 0.5 * plateau)
        else:
            ramp = 2.0 if kind[i] == "elastic" else RAMP
            plateau = length[i] - ramp - (0.2 if kind[i] == "elastic" else 0.35 * length[i])
        half = 0.5 * (plateau + ramp)
        middle = start[i] + 0.5 * length[i]
        low, high = np.searchsorted(chainage, [middle - half - STEP, middle + half + STEP])
        inner = (half - np.abs(chainage[low:high] - middle)) / ramp
        u = np.clip(inner, 0.0, 1.0)
        shape = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
        area = float(_integral(chainage[low:high], shape)[-1])
        vertical[low:high] += shape * rise[i] / area
        horizontal[low:high] += shape * turn[i] / area
    return vertical, horizontal


def _integral(x: Floats, y: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(x) * (y[1:] + y[:-1]))])
