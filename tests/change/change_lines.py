"""Runs with known movement: lines made here, or the demonstration's truth, with errors as a navigation leaves them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import lfilter

from deform.geometry.earth import enu_shift, radii
from deform.geometry.resample import box_average, interpolate
from deform.run import build

OD = 0.3239
GAUGE = 2.0


@dataclass(frozen=True)
class PlainMap:
    """Chainage map through knots, as `correlate.chainage.ChainageMap` offers it."""

    reference_chainage: np.ndarray
    run_chainage: np.ndarray
    broken: tuple[tuple[float, float], ...] = ()
    knot_sigma: float = 0.01
    direction: int = 1

    def to_run(self, chainage):
        return np.interp(chainage, self.reference_chainage, self.run_chainage)

    def to_reference(self, chainage):
        return np.interp(chainage, self.run_chainage, self.reference_chainage)

    def sigma(self, chainage):
        return np.full(np.shape(chainage), self.knot_sigma)

    def valid(self, chainage):
        s = np.asarray(chainage, float)
        ok = (s >= self.reference_chainage[0]) & (s <= self.reference_chainage[-1])
        for start, end in self.broken:
            ok &= (s <= start) | (s >= end)
        return ok


@dataclass(frozen=True)
class PlainMatching:
    """What the change room reads of `correlate.weld_matching.Matching`."""

    reference: str
    maps: dict
    joints: pd.DataFrame = field(default_factory=pd.DataFrame)
    welds: pd.DataFrame = field(default_factory=pd.DataFrame)
    edits: pd.DataFrame = field(default_factory=lambda: pd.DataFrame({"kind": [], "run": [], "start_m": [], "end_m": []}))


@dataclass(frozen=True)
class Errors:
    """One-sigma errors of a run: as the demonstration tool's, after a good smoother."""

    marker_m: float = 0.3
    marker_every_m: float = 1000.0
    position_m: float = 0.015
    position_length_m: float = 15.0
    attitude_deg: float = 0.02
    curvature_microstrain: float = 28.0
    weld_m: float = 0.008
    heading_deg: float = 0.0
    heading_length_m: float = 100.0


DEMO_TOOL = Errors()


def coloured(rng, n, step, length, sigma):
    """Gaussian noise of a correlation length and a sigma."""
    width = max(length / step / 2.0, 1e-3)
    noise = gaussian_filter1d(rng.standard_normal(n + 8 * int(width) + 8), width)[: n + 0]
    return sigma * noise / max(noise.std(), 1e-12) if width > 0.3 else sigma * rng.standard_normal(n)


def _walked(rng, n, step, errors):
    """A heading error (rad) of a correlation length, as wobble leaves it, and the place error (m) it makes, held by the
    markers.
    """
    if not errors.heading_deg > 0:
        return np.zeros(n), np.zeros(n)
    keep = np.exp(-step / errors.heading_length_m)
    shock = rng.standard_normal(n) * np.sqrt(1.0 - keep**2)
    shock[0] = rng.standard_normal()
    heading = np.radians(errors.heading_deg) * lfilter([1.0], [1.0, -keep], shock)
    heading = gaussian_filter1d(heading, 3.0 / step)
    place = np.cumsum(heading) * step
    s = np.arange(n) * step
    knots = np.unique(np.r_[np.arange(0, n, max(round(errors.marker_every_m / step), 1)), n - 1])
    return heading, place - (CubicSpline(s[knots], place[knots])(s) if knots.size > 3 else np.interp(s, s[knots], place[knots]))


def bump(s, centre, length, amplitude):
    """Raised cosine w = A/2 (1 + cos 2π(s - c)/L) within half a length of its centre."""
    x = np.clip((np.asarray(s) - centre) / length, -0.5, 0.5)
    return 0.5 * amplitude * (1.0 + np.cos(2.0 * np.pi * x))


@dataclass(frozen=True)
class Line:
    """A line at rest: regular chainage, attitude, place."""

    chainage: np.ndarray
    azimuth: np.ndarray
    pitch: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    height: np.ndarray
    welds: np.ndarray

    @property
    def step(self):
        return float(self.chainage[1] - self.chainage[0])


def make_line(length=4000.0, *, seed=1, bends_per_km=2.0, step=0.1, elbows=()) -> Line:
    """Return a line of joints of about 12.2 m with cold bends of up to ten degrees and gentle hills.

    ``elbows`` are places (m) and angles (degree) of level bends five metres long.
    """
    rng = np.random.default_rng(seed)
    s = np.arange(0.0, length, step)
    azimuth = np.full(s.size, 200.0) + 3.0 * np.sin(s / 700.0)
    pitch = 1.5 * np.sin(s / 430.0 + 1.0)
    for _ in range(int(bends_per_km * length / 1000.0)):
        at, angle, width = rng.uniform(50, length - 50), rng.uniform(-10, 10), rng.uniform(4, 9)
        turn = angle * np.clip((s - at) / width, 0, 1)
        if rng.random() < 0.6:
            azimuth += turn
        else:
            pitch += turn * np.exp(-np.clip(s - at - width, 0, None) / 60.0)
    for at, angle in elbows:
        azimuth += angle * np.clip((s - at) / 5.0 + 0.5, 0, 1)
    psi, theta = np.radians(azimuth), np.radians(pitch)
    north, east, up = np.cos(psi) * np.cos(theta), np.sin(psi) * np.cos(theta), np.sin(theta)
    height = 230.0 + np.cumsum(up) * step
    meridian, _ = radii(61.0)
    latitude = 61.0 + np.degrees(np.cumsum(north) * step / (meridian + 230.0))
    longitude = -121.0 + np.degrees(np.cumsum(east) * step / ((radii(latitude)[1] + 230.0) * np.cos(np.radians(latitude))))
    welds = np.cumsum(np.clip(rng.normal(12.2, 0.4, int(length / 12.0) + 10), 6, 14))
    return Line(s, azimuth, pitch, latitude, longitude, height, welds[welds < length - 1])


def moved(line: Line, *, lateral=None, up=None) -> Line:
    """Return the line after a movement: lateral (right positive) and up displacement on its chainage (metre)."""
    zero = np.zeros(line.chainage.size)
    lateral, up = (zero if d is None else np.asarray(d, float) for d in (lateral, up))
    psi = np.radians(line.azimuth)
    latitude, longitude, height = enu_shift(
        line.latitude, line.longitude, line.height, lateral * np.cos(psi), -lateral * np.sin(psi), up
    )
    azimuth = line.azimuth + np.degrees(np.gradient(lateral, line.step))
    pitch = line.pitch + np.degrees(np.gradient(up, line.step))
    return Line(line.chainage, azimuth, pitch, latitude, longitude, height, line.welds)


def make_run(line: Line, run_id: str, date: str, *, seed: int, errors=DEMO_TOOL, dents=None, od=OD) -> xr.DataTree:
    """Return a run as the stages before would hand it over, with errors of this seed."""
    rng = np.random.default_rng(seed)
    s, n, step = line.chainage, line.chainage.size, line.step
    knots = np.arange(s[0] - errors.marker_every_m, s[-1] + 2 * errors.marker_every_m, errors.marker_every_m)
    error = [
        CubicSpline(knots, rng.normal(0, errors.marker_m, knots.size))(s)
        + coloured(rng, n, step, errors.position_length_m, errors.position_m)
        for _ in range(3)
    ]
    slow = [_walked(rng, n, step, errors) for _ in range(2)]
    psi = np.radians(line.azimuth)
    error[0] += slow[0][1] * np.cos(psi)
    error[1] -= slow[0][1] * np.sin(psi)
    error[2] += slow[1][1]
    latitude, longitude, height = enu_shift(line.latitude, line.longitude, line.height, *error)
    values = {"chainage": s, "latitude": latitude, "longitude": longitude, "height": height}
    values |= {f"{name}_sigma": np.full(n, errors.marker_m) for name in ("east", "north", "up")}
    values |= {"speed": 1.1 + 0.2 * np.sin(s / 300.0), "time": 600.0 + s / 1.1}
    theta = np.radians(line.pitch) + slow[1][0]
    azimuth = line.azimuth + np.degrees(slow[0][0])
    turn_h = np.concatenate([[0.0], np.cumsum(np.cos(theta[1:]) * np.diff(np.radians(azimuth)))])
    noise = errors.curvature_microstrain * 1e-6 * 2.0 / od
    for name, turned in (("horizontal", turn_h), ("vertical", theta)):
        mean = np.full(n, np.nan)
        half = round(GAUGE / 2 / step)
        mean[half : n - half] = (turned[2 * half :] - turned[: n - 2 * half]) / (2 * half * step)
        raw = uniform_filter1d(rng.standard_normal(n), max(int(GAUGE / step), 1))
        mean += noise * raw / raw.std()
        sigma = np.full(n, noise)
        values |= {f"curvature_{name}": mean, f"curvature_{name}_sigma": sigma}
        values |= {f"bending_strain_{name}": mean * od / 2, f"bending_strain_{name}_sigma": sigma * od / 2}
    values["azimuth"] = (azimuth + coloured(rng, n, step, 3.0, errors.attitude_deg)) % 360.0
    values["pitch"] = np.degrees(theta) + coloured(rng, n, step, 3.0, errors.attitude_deg)
    values |= {"azimuth_sigma": np.full(n, errors.attitude_deg), "pitch_sigma": np.full(n, errors.attitude_deg)}
    centreline = build.dataset("centreline", values)
    for name in ("curvature_horizontal", "curvature_vertical", "bending_strain_horizontal", "bending_strain_vertical"):
        centreline[name].attrs["gauge_length_m"] = GAUGE
    welds = build.dataset(
        "welds",
        {"chainage": line.welds + rng.normal(0, errors.weld_m, line.welds.size), "probability": np.ones(line.welds.size)},
    )
    attrs = {"id": run_id, "date": date, "line": "made", "source": "raw", "direction": "downstream"}
    attrs |= {"outside_diameter_m": od, "nominal_wall_m": 0.00635}
    return build.run_tree(attrs, centreline=centreline, welds=welds, dents=dents)


def identity_matching(runs, reference=None, edits=None) -> PlainMatching:
    """Return a matching of runs whose chainages agree (welds with their own noise)."""
    reference = reference or runs[0].attrs["id"]
    base = next(r for r in runs if r.attrs["id"] == reference)["welds"]["chainage"].values
    maps = {}
    for run in runs:
        own = run["welds"]["chainage"].values
        if "centreline" not in run.children:
            maps[run.attrs["id"]] = PlainMap(base, own)
            continue
        ends = run["centreline"]["chainage"].values[[0, -1]]
        maps[run.attrs["id"]] = PlainMap(np.r_[ends[0], base, ends[-1]], np.r_[ends[0], own, ends[-1]])
    return PlainMatching(
        reference, maps, joints=joint_table(runs), edits=edits if edits is not None else PlainMatching("", {}).edits
    )


def joint_table(runs) -> pd.DataFrame:
    """Return tables/joints.csv of runs that hold the same welds."""
    base = runs[0]["welds"]["chainage"].values
    frame = {
        "joint_id": [f"J{i:05d}" for i in range(base.size - 1)],
        "weld_id_start": [f"W{i:05d}" for i in range(base.size - 1)],
        "weld_id_end": [f"W{i + 1:05d}" for i in range(base.size - 1)],
        "reference_chainage_m": base[:-1],
    }
    for run in runs:
        length = np.diff(run["welds"]["chainage"].values)
        name = run.attrs["id"]
        frame |= {f"length_m:{name}": length}
        frame |= {f"change_m:{name}": length - np.diff(base), f"change_sigma_m:{name}": np.full(length.size, 0.016)}
    return build.table("joints", frame)


def truth_line(folder: Path) -> tuple[Line, np.ndarray, xr.Dataset]:
    """Return the line of one epoch of the demonstration's truth, the first-year chainage of its material, and the truth."""
    with xr.open_dataset(folder / "truth.nc", decode_times=False, decode_timedelta=False) as ds:
        ds = ds.load()
    welds = pd.read_csv(folder / "welds_truth.csv")
    azimuth = np.degrees(np.unwrap(np.radians(ds["grid_azimuth"].values)))
    place = (ds[f"grid_{n}"].values.astype(float) for n in ("latitude", "longitude", "height"))
    line = Line(
        ds["grid_chainage"].values.astype(float),
        azimuth,
        ds["grid_pitch"].values.astype(float),
        *place,
        welds["chainage_m"].values,
    )
    return line, ds["grid_epoch0_chainage"].values.astype(float), ds


def truth_runs(folder: Path, errors: Errors = DEMO_TOOL, seed: int = 10):
    """Return the demonstration's runs made of truth and errors, with their matching."""
    names = sorted(p.name for p in Path(folder).iterdir() if (p / "truth.nc").exists())
    dates = {"demo-2019": "2019-07-02", "demo-2021": "2021-07-08", "demo-2023": "2023-07-05"}
    runs, welds, material, lines, edits = [], {}, {}, {}, []
    for i, name in enumerate(names):
        line, steel, _ = truth_line(Path(folder) / name)
        true = pd.read_csv(Path(folder) / name / "dents_truth.csv", dtype={"dent_id": str})
        rng = np.random.default_rng(seed + 100 + i)
        dents = build.dataset(
            "dents",
            {
                "chainage": true.chainage_m + rng.normal(0, 0.01, len(true)),
                "clock": (true.clock_deg + rng.normal(0, 2, len(true))) % 360,
                "depth": true.depth_m + rng.normal(0, 0.0004, len(true)),
                "depth_sigma": np.full(len(true), 0.0004),
                "length": true.length_m,
                "width": true.width_m,
                "strain_max": 0.3 * true.depth_m,
                "sizing": ["measured"] * len(true),
            },
        )
        run = make_run(line, name, dates.get(name, f"{2019 + i}-07-01"), seed=seed + i, errors=errors, dents=dents)
        runs.append(run)
        table = pd.read_csv(Path(folder) / name / "welds_truth.csv", dtype={"weld_id": str})
        welds[name] = dict(zip(table.weld_id, run["welds"]["chainage"].values, strict=True))
        lines[name], material[name] = line, steel
        events = pd.read_csv(Path(folder) / name / "events_truth.csv")
        for e in events[events.type.isin(["cutout", "reroute"])].itertuples():
            if e.event_id not in {x["id"] for x in edits}:
                edits.append(
                    {
                        "id": e.event_id,
                        "kind": e.type,
                        "run": name,
                        "start_m": e.epoch0_start_m,
                        "end_m": e.epoch0_end_m,
                        "n_old": int(e.n_old),
                        "n_new": int(e.n_new),
                        "reason": "",
                    }
                )
    reference = names[0]
    maps = {}
    for name in names:
        common = [w for w in welds[reference] if w in welds[name]]
        a, b = np.array([welds[reference][w] for w in common]), np.array([welds[name][w] for w in common])
        ends = [lines[reference].chainage[[0, -1]], lines[name].chainage[[0, -1]]]
        breaks = tuple((e["start_m"], e["end_m"]) for e in edits if e["run"] <= name)
        maps[name] = PlainMap(np.r_[ends[0][0], a, ends[0][1]], np.r_[ends[1][0], b, ends[1][1]], breaks)
    matching = PlainMatching(reference, maps, joints=_truth_joints(names, welds), edits=pd.DataFrame(edits))
    return runs, matching


def _truth_joints(names, welds) -> pd.DataFrame:
    base = welds[names[0]]
    ids = list(base)
    frame = {"joint_id": [f"J{i:05d}" for i in range(len(ids) - 1)], "weld_id_start": ids[:-1], "weld_id_end": ids[1:]}
    frame["reference_chainage_m"] = [base[w] for w in ids[:-1]]
    first = np.diff([base[w] for w in ids])
    for name in names:
        own = np.diff([welds[name].get(w, np.nan) for w in ids])
        frame |= {f"length_m:{name}": own, f"change_m:{name}": own - first, f"change_sigma_m:{name}": np.full(first.size, 0.016)}
    return build.table("joints", frame)


def averaged(line: Line, turned: np.ndarray, gauge: float) -> np.ndarray:
    """Return the curvature of a turn (radian) over a gauge length on the line's own chainage."""
    half = gauge / 2
    return (
        interpolate(line.chainage + half, line.chainage, turned) - interpolate(line.chainage - half, line.chainage, turned)
    ) / gauge


__all__ = [
    "OD",
    "Errors",
    "Line",
    "PlainMap",
    "PlainMatching",
    "averaged",
    "box_average",
    "bump",
    "coloured",
    "identity_matching",
    "joint_table",
    "make_line",
    "make_run",
    "moved",
    "truth_line",
    "truth_runs",
]
