"""A line and a tool in, the tool's motion through it out: distance, speed and attitude at any time of the tool's clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from deform.geometry.rotation import attitude_to_matrix
from deform.options import ToolOptions
from deform.synthetic import _kernels
from deform.synthetic._kernels import ABOVE, RIGHT, ROLL, TILT, YAW
from deform.synthetic.route import Line, stream

Floats = NDArray[Any]

KNOT_S = 0.25  # s, distance of the knots of the speed
TRAP_M = 3.0  # m, the IMU stands this far inside the line at both ends
RAMP_S = 6.0  # s, in which the tool takes its speed
STOP_S = 4.0  # s, in which it comes to a stop or leaves it


@dataclass(frozen=True)
class Motion:
    """The tool in the line, which lies in the direction of travel.

    Attributes
    ----------
    line : the line, its table with roll, wobble and offset of the tool in it.
    speed : shape (n, 5), per interval of `KNOT_S` the distance at its start and the cubic of the speed.
    mounting : matrix (3, 3) from the IMU's body axes to the tool's.
    mounting_deg : its azimuth, pitch and roll (degree).
    vibration : shape (k, 4), component, amplitude, angular rate, phase.
    hit_times, hit_signs : when the tool was hit by a weld, and how (m/s).
    begin, end : times between which the tool moves (second).
    duration : end of the record (second).
    """

    line: Line
    speed: Floats
    mounting: Floats
    mounting_deg: tuple[float, float, float]
    vibration: Floats
    hit_times: Floats
    hit_signs: Floats
    begin: float
    end: float
    duration: float

    @property
    def tables(self) -> tuple[Any, ...]:
        """What the kernels take, in their order."""
        return (self.line.table, self.speed, KNOT_S, self.mounting, self.vibration, self.hit_times, self.hit_signs)

    def distance(self, times: ArrayLike) -> tuple[Floats, Floats]:
        """Return the IMU's chainage in the direction of travel (metre) and its speed (m/s)."""
        times = np.atleast_1d(np.asarray(times, float))
        out = np.empty((times.size, 2))
        _kernels.fill_travel(self.speed, KNOT_S, times, out)
        return out[:, 0], out[:, 1]

    def passage(self, chainage: ArrayLike) -> Floats:
        """Return the first time at which the IMU is at chainages in the direction of travel; NaN where it never is."""
        where = np.atleast_1d(np.asarray(chainage, float))
        low = np.full(where.shape, self.begin)
        high = np.full(where.shape, self.end)
        for _ in range(50):
            middle = 0.5 * (low + high)
            before = self.distance(middle)[0] < where
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        first, last = self.distance([self.begin, self.end])[0]
        return np.where((where >= first - 1e-6) & (where <= last + 1e-6), high, np.nan)

    def states(self, times: ArrayLike) -> Floats:
        """Return (n, 16) at times, in radian, metre, m/s.

        Columns: latitude, longitude, height, velocity east, north, up, distance, speed, azimuth and pitch of the pipe,
        azimuth, pitch, roll of the IMU, azimuth, pitch, roll of the tool.
        """
        times = np.ascontiguousarray(times, float)
        out = np.empty((times.size, 16))
        table, speed, step, mounting, vibration, hit_times, hit_signs = self.tables
        _kernels.fill_states(times, table, speed, step, mounting, vibration, hit_times, hit_signs, out)
        return out


def move(line: Line, tool: ToolOptions, seed: int, name: str) -> Motion:
    """Return the motion of one run through a line that lies in the direction of travel."""
    table = line.table.copy()
    _ride(table, tool, stream(seed, name, "ride"))
    line = Line(table, line.material, line.replaced, line.joints, line.outside_diameter)
    speed, begin, end = _speed(line.length, tool, stream(seed, name, "speed"))
    rng = stream(seed, name, "mounting")
    angles = rng.normal(0.0, tool.mounting_deg, 3) if tool.mounting_deg else np.zeros(3)
    quiet = Motion(
        line=line,
        speed=speed,
        mounting=attitude_to_matrix(*angles),
        mounting_deg=(float(angles[0]), float(angles[1]), float(angles[2])),
        vibration=_vibration(tool, stream(seed, name, "vibration")),
        hit_times=np.empty(0),
        hit_signs=np.empty((0, 3)),
        begin=begin,
        end=end,
        duration=end + tool.static_end_s,
    )
    if tool.vibration == 0:
        return quiet
    hits = quiet.passage(line.joints.start_m.to_numpy()[1:])
    hits = hits[np.isfinite(hits)]
    signs = stream(seed, name, "hits").normal(0.0, 1.0, (hits.size, 3)) * np.array([0.004, 0.003, 0.006]) * tool.vibration
    return Motion(**{**quiet.__dict__, "hit_times": hits, "hit_signs": signs})


def _speed(length: float, tool: ToolOptions, rng: np.random.Generator) -> tuple[Floats, float, float]:
    """Cubics of the speed; the distance between the traps is met exactly by a last scaling."""
    way = length - 2.0 * TRAP_M
    ride = way / tool.speed_m_per_s
    stops = np.sort(rng.uniform(0.1, 0.9, tool.stops)) * ride
    dwell = rng.uniform(10.0, 60.0, tool.stops)
    moving = RAMP_S * 2 + ride + float(dwell.sum()) + 2 * STOP_S * tool.stops
    begin = np.ceil(tool.static_start_s / KNOT_S) * KNOT_S
    end = begin + np.ceil(moving / KNOT_S) * KNOT_S
    knots = np.arange(round((end + tool.static_end_s) / KNOT_S) + 8) * KNOT_S
    x = knots - begin
    speed = np.full(knots.size, tool.speed_m_per_s)
    for _ in range(6):
        period = np.exp(rng.uniform(np.log(15.0), np.log(600.0)))
        amplitude = tool.speed_variation * tool.speed_m_per_s * rng.uniform(0.3, 0.7)
        speed += amplitude * np.sin(2 * np.pi * (x / period + rng.random()))
    speed = np.maximum(speed, 0.3 * tool.speed_m_per_s)
    gate = _rise((end - knots) / RAMP_S)
    if tool.static_start_s > 0:  # else the tool is already moving when its clock starts
        gate *= _rise(x / RAMP_S)
    late = 0.0
    for at, pause in zip(stops, dwell, strict=True):
        at, late = at + late, late + pause + 2 * STOP_S
        gate *= 1.0 - _rise((x - at) / STOP_S) * _rise((at + 2 * STOP_S + pause - x) / STOP_S)
    speed = speed * gate
    curve = PchipInterpolator(knots, speed)
    curve.c *= way / float(curve.antiderivative()(knots[-1]))
    distance = TRAP_M + curve.antiderivative()(knots[:-1])
    return np.ascontiguousarray(np.column_stack([distance, curve.c.T])), float(begin), float(end)


def _rise(u: Floats) -> Floats:
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def _ride(table: Floats, tool: ToolOptions, rng: np.random.Generator) -> None:
    """Fill roll, wobble and offset of the tool along the line, each with its derivative."""
    s = table[:, 0]
    roll = 2 * np.pi * tool.roll_turns_per_km / 1000.0 * rng.choice([-1.0, 1.0])
    _waves(table, ROLL, np.radians(6.0) * (tool.roll_turns_per_km > 0), (40.0, 500.0), rng)
    table[:, ROLL] += rng.uniform(-np.pi, np.pi) * (tool.roll_turns_per_km > 0) + roll * s
    table[:, ROLL + 1] += roll
    for column in (YAW, TILT):
        _waves(table, column, np.radians(tool.wobble_deg), tool.wobble_length_m, rng, tool.wobble_waves, tool.wobble_slope)
    for column, wobble, rest in ((RIGHT, YAW, 0.0), (ABOVE, TILT, -1.0)):
        _waves(table, column, 0.7 * tool.offset_m, (5.0, 120.0), rng)
        table[:, column] += rest * tool.offset_m
        table[:, column : column + 2] -= tool.wobble_pivot_m * table[:, wobble : wobble + 2]


def _waves(
    table: Floats,
    column: int,
    sigma: float,
    lengths: tuple[float, float],
    rng: np.random.Generator,
    n: int = 10,
    slope: float = 1.0,
) -> None:
    """Add sinusoids of a standard deviation in all to a column, their derivative to the next one; see `ToolOptions`."""
    s = table[:, 0]
    wavelengths = np.exp(rng.uniform(np.log(lengths[0]), np.log(lengths[1]), n))
    power = wavelengths**slope
    amplitudes = sigma * np.sqrt(2.0 * power / power.sum())
    for amplitude, wavelength, phase in zip(amplitudes, wavelengths, rng.uniform(0, 2 * np.pi, n), strict=True):
        k = 2 * np.pi / wavelength
        table[:, column] += amplitude * np.sin(k * s + phase)
        table[:, column + 1] += amplitude * k * np.cos(k * s + phase)


def _vibration(tool: ToolOptions, rng: np.random.Generator) -> Floats:
    """Sinusoids of the ride on the wall: velocities of about 0.3 mm/s, angles of about 4 µrad, 6 to 35 Hz."""
    rows = []
    for component, size in ((0, 3e-4), (1, 2e-4), (2, 4e-4), (3, 4e-6), (4, 4e-6)):
        for frequency in np.exp(rng.uniform(np.log(6.0), np.log(35.0), 3)):
            phase = rng.uniform(0, 2 * np.pi)
            rows.append((component, size * tool.vibration * rng.uniform(0.5, 1.5), 2 * np.pi * frequency, phase))
    return np.array(rows if tool.vibration else np.empty((0, 4)), float).reshape(-1, 4)
