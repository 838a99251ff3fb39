"""Output folders of closed form: a line with a landslide, a settlement, a cut-out and dents, for any number of epochs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from deform.run import build, store

OD, WALL = 0.3239, 0.00635
LATITUDE, LONGITUDE = 61.04, -121.28
SLIDE = (2655.0, 2785.0)
SETTLEMENT = (857.0, 903.0)
CUTOUT = (3150.0, 3215.0)
DENTS = (  # id, chainage, clock (degree), depth in each epoch, length, width (metre)
    ("D01", 455.3, 172.0, (0.0071, 0.0071, 0.0071), 0.22, 0.16),
    ("D02", 1391.8, 35.0, (0.0078, 0.0110, 0.0146), 0.34, 0.22),
    ("D03", 1955.1, 205.0, (0.0100, 0.0101, 0.0100), 0.28, 0.20),
    ("D05", 3400.2, 90.0, (None, None, 0.0062), 0.25, 0.18),
)


def write_folder(
    folder: Path,
    *,
    runs: tuple[str, ...] = ("demo-2019", "demo-2021", "demo-2023"),
    length_m: float = 4000.0,
    line: str = "demo",
    zones: bool = True,
    dents: bool = True,
    caliper: bool = True,
    listing: bool = False,
    spike: float | None = None,
    step_m: float = 0.1,
) -> Path:
    """Write an output folder of the contract; ``spike`` plants a one-sample lateral displacement of this size at 1234.5 m."""
    folder = Path(folder)
    rng = np.random.default_rng(7)
    chainage = np.arange(0.0, length_m, step_m)
    moved = [_movement(chainage, k, len(runs)) if zones else np.zeros((2, chainage.size)) for k in range(len(runs))]
    weld_chainage = _weld_places(length_m)
    for k, name in enumerate(runs):
        groups = {
            "welds": _welds(weld_chainage, k, listing, rng),
            "dents": _dent_group(k) if dents else None,
            "markers": None if listing else _markers(length_m, rng),
        }
        if not listing:
            groups["centreline"] = _centreline(chainage, moved[k], k, rng, caliper)
            groups["caliper"] = _wall(k, rng) if caliper else None
            groups["navigation"] = _navigation(k)
        groups["features"] = _features()
        attrs = {
            "id": name,
            "date": f"{2019 + 2 * k}-07-02",
            "line": line,
            "source": "listing" if listing else "raw",
            "direction": "downstream",
            "outside_diameter_m": OD,
            "nominal_wall_m": WALL,
        }
        store.write_run(build.run_tree(attrs, **groups), folder / "runs" / f"{name}.nc")
    if len(runs) > 1:
        if not listing:
            store.write_dataset(_comparison(chainage, moved, runs, rng, spike), folder / "comparison.nc", "comparison")
        _tables(folder, runs, weld_chainage, zones, dents, listing)
    if not listing:
        _doglegs(folder, runs)
    store.write_json(_survey(line, runs, listing), folder / "survey.json")
    return folder


def _weld_places(length_m: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    places = np.cumsum(
        rng.choice([12.2, 12.21, 11.6, 3.4], size=int(length_m / 10), p=[0.5, 0.3, 0.17, 0.03])
        + rng.normal(0, 0.05, int(length_m / 10))
    )
    return places[places < length_m - 5]


def _bump(s: np.ndarray, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return w = (1 - cos 2 pi x / L) / 2 and its second derivative."""
    span = end - start
    phase = 2 * np.pi * (s - start) / span
    inside = (s > start) & (s < end)
    return np.where(inside, (1 - np.cos(phase)) / 2, 0.0), np.where(inside, 0.5 * (2 * np.pi / span) ** 2 * np.cos(phase), 0.0)


def _movement(s: np.ndarray, k: int, n: int) -> np.ndarray:
    """Return lateral and up displacement of epoch k (2, chainage)."""
    slide = 0.8 * k / max(n - 1, 1) * _bump(s, *SLIDE)[0]
    sink = -0.25 * (k == n - 1 and k > 0) * _bump(s, *SETTLEMENT)[0]
    return np.stack([slide, sink])


def _strain_change(s: np.ndarray, k: int, n: int) -> np.ndarray:
    slide = 0.8 * k / max(n - 1, 1) * _bump(s, *SLIDE)[1]
    sink = -0.25 * (k == n - 1 and k > 0) * _bump(s, *SETTLEMENT)[1]
    return np.stack([slide, sink]) * OD / 2


def _shape(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuth and pitch (degree) of a wavy line with a few bends."""
    azimuth = 135 + 25 * np.sin(2 * np.pi * s / 2700)
    for place, angle in ((600, 8), (1490, -15), (2210, 90), (3050, -88), (3700, 12)):
        azimuth = azimuth + angle * np.clip((s - place) / 4.0, 0, 1)
    pitch = (
        3 * np.sin(2 * np.pi * s / 800)
        + 6 * np.sin(2 * np.pi * s / 3000)
        + 9 * (np.clip((s - 1700) / 4, 0, 1) - np.clip((s - 1760) / 4, 0, 1))
    )
    return azimuth, pitch


def _centreline(s: np.ndarray, moved: np.ndarray, k: int, rng: np.random.Generator, caliper: bool) -> xr.Dataset:
    step = s[1] - s[0]
    azimuth, pitch = _shape(s)
    east = np.cumsum(np.sin(np.radians(azimuth)) * np.cos(np.radians(pitch))) * step + moved[0] * np.cos(np.radians(azimuth))
    north = np.cumsum(np.cos(np.radians(azimuth)) * np.cos(np.radians(pitch))) * step - moved[0] * np.sin(np.radians(azimuth))
    up = 236 + np.cumsum(np.sin(np.radians(pitch))) * step + moved[1]
    extra = _strain_change(s, k, 3) / (OD / 2) if moved.any() else np.zeros((2, s.size))
    smooth = np.ones(20) / 20
    noise = [np.convolve(rng.normal(0, 4e-4, s.size), smooth, "same") for _ in range(2)]
    horizontal = np.gradient(np.unwrap(np.radians(azimuth)), s) * np.cos(np.radians(pitch)) + extra[0] + noise[0]
    vertical = np.gradient(np.radians(pitch), s) + extra[1] + noise[1]
    sigma = np.full(s.size, 1e-4)
    eh, ev = horizontal * OD / 2, vertical * OD / 2
    metres = 111_400.0
    values = {
        "chainage": s,
        "time": 600 + s / 1.2,
        "log_distance": s * 1.002,
        "latitude": LATITUDE + north / metres,
        "longitude": LONGITUDE + east / (metres * np.cos(np.radians(LATITUDE))),
        "height": up,
        "east_sigma": 0.1 + 0.1 * np.abs(np.sin(np.pi * s / 1000)),
        "north_sigma": 0.1 + 0.1 * np.abs(np.sin(np.pi * s / 1000)),
        "up_sigma": np.full(s.size, 0.15),
        "azimuth": azimuth,
        "pitch": pitch,
        "tool_roll": (s * 0.2) % 360 - 180,
        "speed": 1.2 + 0.2 * np.sin(s / 100),
        "curvature_horizontal": horizontal,
        "curvature_horizontal_sigma": sigma,
        "curvature_vertical": vertical,
        "curvature_vertical_sigma": sigma,
        "bending_strain_horizontal": eh,
        "bending_strain_horizontal_sigma": sigma * OD / 2,
        "bending_strain_vertical": ev,
        "bending_strain_vertical_sigma": sigma * OD / 2,
        "bending_strain": np.hypot(eh, ev),
        "bending_strain_sigma": sigma * OD / 2,
        "bending_strain_clock": np.degrees(np.arctan2(-eh, -ev)) % 360,
    }
    if caliper:
        values["ovality"] = 0.004 + 0.002 * np.sin(s / 40) + rng.normal(0, 2e-4, s.size)
        values |= {"diameter_min": np.full(s.size, OD - 2 * WALL - 0.001), "diameter_max": np.full(s.size, OD - 2 * WALL + 0.001)}
    ds = build.dataset("centreline", values)
    for name in ("curvature_horizontal", "curvature_vertical"):
        ds[name].attrs["gauge_length_m"] = 2.0
    return ds


def _welds(places: np.ndarray, k: int, listing: bool, rng: np.random.Generator) -> xr.Dataset:
    at = places * (1 + 2e-4 * k) + rng.normal(0, 0.005, places.size)
    values = {"chainage": at, "log_distance": at * 1.002, "probability": np.full(at.size, 0.99)}
    if listing:
        values["label"] = [f"{10 * (i + 1)}" for i in range(at.size)]
    else:
        values["time"] = 600 + at / 1.2
    return build.dataset("welds", values)


def _dent_group(k: int) -> xr.Dataset:
    here = [d for d in DENTS if d[3][min(k, 2)] is not None]
    return build.dataset(
        "dents",
        {
            "chainage": [d[1] * (1 + 2e-4 * k) for d in here],
            "clock": [d[2] for d in here],
            "depth": [d[3][min(k, 2)] for d in here],
            "depth_sigma": [4e-4] * len(here),
            "length": [d[4] for d in here],
            "width": [d[5] for d in here],
            "strain_max": [0.012] * len(here),
        },
    )


def _features() -> xr.Dataset:
    return build.dataset(
        "features",
        {
            "chainage": [600.0, 1180.0, 2210.0, 2400.0],
            "chainage_end": [604.0, 1181.5, 2214.0, np.nan],
            "kind": ["bend", "valve", "bend", "metal_loss"],
            "clock": [90.0, np.nan, 90.0, 180.0],
            "value": [8.0, np.nan, 90.0, 0.31],
            "text": ["cold bend <b>8</b> degree", "valve V01", "5 D, 90 degree to the right", "metal loss"],
            "label": ["", "V01", "", ""],
        },
    )


def _navigation(k: int) -> xr.Dataset:
    """Three epochs of a filter whose drifts settle at (1, 2, 3) hundredths of a degree per hour, plus the number of the run."""
    settled = 0.01 * np.array([1.0, 2.0, 3.0]) + 0.001 * k
    return build.dataset(
        "navigation",
        {
            "time": [0.0, 100.0, 200.0],
            "gyro_bias": np.stack([np.zeros(3), settled / 2, settled]),
            "gyro_bias_sigma": np.stack([np.full(3, 0.1), np.full(3, 0.02), np.full(3, 0.005)]),
            "accel_bias": np.full((3, 3), 9.80665e-6 * 20),
            "accel_bias_sigma": np.full((3, 3), 9.80665e-6 * 5),
            "odometer_scale": np.full(3, 3e-4),
            "odometer_scale_sigma": np.full(3, 1e-4),
            "mounting_azimuth": 0.1,
            "mounting_azimuth_sigma": 0.01,
            "alignment_azimuth": 134.95,
            "alignment_azimuth_sigma": 0.08,
            "alignment_pitch": 0.5,
            "alignment_pitch_sigma": 0.004,
            "alignment_roll": -3.0,
            "alignment_roll_sigma": 0.004,
            "kind": ["travel along", "mark up"],
            "innovation_count": [3000, 6],
            "innovation_square": [0.97, 1.4],
            "innovation_outliers": [2, 0],
        },
        error_model="full",
        alignment_method="static",
        remarks="2 slips repaired, 0.41 m of wheel travel lost in them",
    )


def _markers(length_m: float, rng: np.random.Generator) -> xr.Dataset:
    at = np.linspace(3.0, length_m - 3, 5)
    azimuth, _ = _shape(np.arange(0.0, length_m, 0.1))
    i = (at / 0.1).astype(int)
    east, north = np.cumsum(np.sin(np.radians(azimuth)))[i] * 0.1, np.cumsum(np.cos(np.radians(azimuth)))[i] * 0.1
    zero = {
        f"misclosure_{c}_{w}": rng.normal(0, 5.0 if w == "before" else 0.2, 5)
        for c in ("east", "north", "up")
        for w in ("before", "after")
    }
    return build.dataset(
        "markers",
        {
            "name": ["LAUNCHER", "AGM01", "V01 <b>&", "AGM02 Łódź", "RECEIVER"],
            "kind": ["launcher", "agm", "valve", "agm", "receiver"],
            "time": 600 + at / 1.2,
            "chainage": at,
            "latitude": LATITUDE + north / 111_400,
            "longitude": LONGITUDE + east / (111_400 * np.cos(np.radians(LATITUDE))),
            "height": np.full(5, 236.0),
            "sigma_horizontal": np.full(5, 0.3),
            "sigma_vertical": np.full(5, 0.3),
            "used": np.array([True] * 4 + [False]),
            "remark": [""] * 4 + ["41 m off: not used"],
            **zero,
        },
    )


def _wall(k: int, rng: np.random.Generator) -> xr.Dataset:
    clock = np.arange(0, 360, 7.5)
    places, walls = [], []
    for _, at, angle, depths, length, width in DENTS:
        s = at * (1 + 2e-4 * k) + np.arange(-0.8, 0.8, 0.02)
        depth = depths[min(k, 2)] or 0.0
        around = np.radians((clock - angle + 180) % 360 - 180) * (OD / 2 - WALL)
        spread = np.log(10.0) * 4
        bowl = depth * np.exp(
            -spread * ((s[:, None] - at * (1 + 2e-4 * k)) / length) ** 2 - spread * (around[None, :] / width) ** 2
        )
        oval = 0.0005 * np.cos(2 * np.radians(clock))
        places.append(s)
        walls.append(OD / 2 - WALL - bowl + oval[None, :] + rng.normal(0, 1.5e-4, bowl.shape))
    radius = np.concatenate(walls)
    return build.dataset(
        "caliper",
        {
            "chainage": np.concatenate(places),
            "clock": clock,
            "radius": radius,
            "reference_radius": np.full(len(radius), OD / 2 - WALL),
        },
    )


def _comparison(
    s: np.ndarray, moved: list[np.ndarray], runs: tuple[str, ...], rng: np.random.Generator, spike: float | None
) -> xr.Dataset:
    n, shape = len(runs), (len(runs), s.size)
    azimuth, _ = _shape(s)
    lateral, up = np.stack([m[0] for m in moved]), np.stack([m[1] for m in moved])
    drift = np.array([0.0, *rng.normal(0, 0.05, n - 1)])[:, None] * np.sin(2 * np.pi * s / 1000)[None, :]
    lateral, up = lateral + drift, up - drift
    if spike is not None:
        lateral[-1, round(1234.5 / (s[1] - s[0]))] += spike
    smooth = np.ones(20) / 20
    strain = np.stack([_strain_change(s, k, n) if moved[-1].any() else np.zeros((2, s.size)) for k in range(n)], 1)
    for k in range(1, n):
        strain[:, k] += [np.convolve(rng.normal(0, 9e-5, s.size), smooth, "same") for _ in range(2)]
    position_sigma = np.broadcast_to(np.where(np.arange(n) > 0, 0.08, 0.0)[:, None], shape)
    strain_sigma = np.full(shape, 2e-5)
    values = {
        "epoch": list(runs),
        "chainage": s,
        "run_chainage": s[None, :] * (1 + 2e-4 * np.arange(n))[:, None],
        "run_chainage_sigma": np.full(shape, 0.02),
    }
    horizontal = {
        "east": lateral * np.cos(np.radians(azimuth)),
        "north": -lateral * np.sin(np.radians(azimuth)),
        "up": up,
        "lateral": lateral,
        "axial": 0 * lateral,
    }
    for name, value in horizontal.items():
        values |= {f"displacement_{name}": value, f"displacement_{name}_sigma": position_sigma}
    for i, name in enumerate(("horizontal", "vertical")):
        values |= {f"curvature_change_{name}": strain[i] / (OD / 2), f"curvature_change_{name}_sigma": strain_sigma / (OD / 2)}
        values |= {f"bending_strain_change_{name}": strain[i], f"bending_strain_change_{name}_sigma": strain_sigma}
    values["stable"] = (np.abs(lateral) < 0.1) & (np.abs(up) < 0.1)
    dates = [f"{2019 + 2 * k}-07-02" for k in range(n)]
    return build.dataset("comparison", values | {"date": dates}, reference=runs[0])


def _tables(folder: Path, runs: tuple[str, ...], places: np.ndarray, zones: bool, dents: bool, listing: bool) -> None:
    last = runs[-1]
    rows = []
    for i, at in enumerate(places):
        gone = CUTOUT[0] < at < CUTOUT[1] and zones
        for k, run in enumerate(runs):
            status, reason = ("removed", "cut out between the runs") if gone and k == len(runs) - 1 else ("matched", "")
            if i % 61 == 60 and k == 1 and not gone:
                status, reason = "missed", "the detector did not fire"
            index = None if status in ("removed", "missed") else i
            rows.append((f"W{i + 1:05d}", run, index, at * 1.002, at * (1 + 2e-4 * k), at, 0.998, status, reason))
    columns = [
        "weld_id",
        "run",
        "index",
        "log_distance_m",
        "chainage_m",
        "reference_chainage_m",
        "probability",
        "status",
        "reason",
    ]
    store.write_table(pd.DataFrame(rows, columns=columns), folder / "tables" / "welds.csv", "welds")
    lengths = np.diff(places)
    joints = {
        "joint_id": [f"J{i + 1:05d}" for i in range(lengths.size)],
        "weld_id_start": [f"W{i + 1:05d}" for i in range(lengths.size)],
        "weld_id_end": [f"W{i + 2:05d}" for i in range(lengths.size)],
        "reference_chainage_m": places[:-1],
    }
    for k, run in enumerate(runs):
        joints |= {
            f"length_m:{run}": lengths + 0.002 * k,
            f"change_m:{run}": np.full(lengths.size, 0.002 * k),
            f"change_sigma_m:{run}": np.full(lengths.size, 0.01),
        }
    store.write_table(pd.DataFrame(joints), folder / "tables" / "joints.csv", "joints")
    store.write_table(_zone_table(runs, zones), folder / "tables" / "zones.csv", "zones")
    store.write_table(_dent_table(runs, places, listing) if dents else pd.DataFrame(), folder / "tables" / "dents.csv", "dents")
    trends = [
        ("Z1", "displacement", len(runs), 0.2, 0.01, 0.18, 0.22, 0.95, 0.8, "displacement 1.0 m", 1.0, "2024-07-01", 0.98, 1, ""),
        (
            "D02",
            "dent depth",
            len(runs),
            0.0017,
            0.0001,
            0.0015,
            0.0019,
            0.95,
            0.0146,
            "dent depth 6 % OD",
            0.0194,
            "2026-05-01",
            0.9,
            2,
            "three epochs only",
        ),
    ]
    names = [
        "subject",
        "kind",
        "n_epochs",
        "rate_per_year",
        "rate_sigma_per_year",
        "rate_low_per_year",
        "rate_high_per_year",
        "interval_probability",
        "last_value",
        "limit_name",
        "limit_value",
        "forecast_date",
        "forecast_probability",
        "rank",
        "remark",
    ]
    store.write_table(pd.DataFrame(trends if zones and dents else [], columns=names), folder / "tables" / "trends.csv", "trends")
    pair = {"run_from": runs[0], "run_to": last}
    floor = {"speed_class": "all speeds"}
    limits = [
        pair | floor | {"quantity": "displacement", "component": "lateral", "noise_sigma": 0.0121},
        pair | floor | {"quantity": "bending strain", "component": "vertical", "noise_sigma": 2.04e-5},
        *[
            pair | _limit(wavelength, amplitude, component)
            for component in ("lateral", "up")
            for wavelength, amplitude in ((20.0, 0.006), (60.0, 0.031), (200.0, 0.22))
        ],
        pair | floor | {"quantity": "joint length", "component": "axial", "noise_sigma": 0.004, "wavelength_m": 60.0,
                        "limit_elongation_m": 0.012, "limit_axial_strain": 2e-4, "decided_by": "joint length"},
    ]  # fmt: skip
    store.write_table(pd.DataFrame(limits), folder / "tables" / "limits.csv", "limits")


def _doglegs(folder: Path, runs: tuple[str, ...]) -> None:
    rows = [
        {"run": run, "kind": kind, "start_m": at, "end_m": at + 4.0, "angle_horizontal_deg": turn, "angle_vertical_deg": 0.02,
         "angle_deg": abs(turn), "angle_sigma_deg": 0.013, "clock_deg": 90.0, "radius_m": 30.0, "standardised_percent": 0.54}
        for run in runs
        for kind, at, turn in (("bend", 600.0, 8.0), ("bend", 2210.0, 90.0), ("bend", 3050.0, -88.0))
    ]  # fmt: skip
    store.write_table(pd.DataFrame(rows), folder / "tables" / "doglegs.csv", "doglegs")


def _limit(wavelength: float, amplitude: float, component: str) -> dict:
    return {
        "quantity": "displacement",
        "component": component,
        "speed_class": "all speeds",
        "wavelength_m": wavelength,
        "limit_displacement_m": amplitude,
        "limit_90_displacement_m": 1.25 * amplitude,
        "limit_strain_change": 2e-5,
        "limit_axial_strain": 1e-7,
        "decided_by": "curvature",
    }


def _zone_table(runs: tuple[str, ...], zones: bool) -> pd.DataFrame:
    if not zones:
        return pd.DataFrame()
    rows = [
        (
            "Z1",
            "movement",
            SLIDE[0] + 5,
            SLIDE[1] - 6,
            runs[1],
            1.45e-4,
            2e-5,
            0.81,
            0.08,
            222.0,
            0.9999,
            "displacement to the right over 9 sigma; bending strain change",
        ),
        (
            "Z2",
            "bending",
            SETTLEMENT[0] - 2,
            SETTLEMENT[1] + 1,
            runs[-1],
            3.8e-4,
            2e-5,
            0.26,
            0.09,
            None,
            0.998,
            "vertical bending strain change over 12 sigma <script>alert(1)</script>",
        ),
        ("Z3", "reconfiguration", *CUTOUT, runs[-1], None, None, None, None, None, 1.0, "6 joints cut out, 7 put in"),
    ]
    names = [
        "zone_id",
        "kind",
        "start_m",
        "end_m",
        "first_epoch",
        "peak_strain_change",
        "peak_strain_change_sigma",
        "peak_displacement_m",
        "peak_displacement_sigma_m",
        "direction_deg",
        "confidence",
        "reasons",
    ]
    return pd.DataFrame(rows, columns=names)


def _dent_table(runs: tuple[str, ...], places: np.ndarray, listing: bool) -> pd.DataFrame:
    rows = []
    for name, at, clock, depths, length, width in DENTS:
        joint = f"J{max(int(np.searchsorted(places, at)), 1):05d}"
        before = None
        for k, run in enumerate(runs):
            depth = depths[min(k, 2)]
            if depth is None:
                continue
            grown = before is not None and depth - before > 0.001
            status = "new" if before is None else "grown" if grown else "copied" if listing else "stable"
            change = None if before is None else depth - before
            rows.append(
                (
                    name,
                    run,
                    at,
                    at * (1 + 2e-4 * k),
                    joint,
                    clock,
                    depth,
                    4e-4,
                    length,
                    width,
                    0.012,
                    status,
                    change,
                    5e-4,
                    "no size in the run before" if before is None else "",
                )
            )
            before = depth
    names = [
        "dent_id",
        "run",
        "reference_chainage_m",
        "run_chainage_m",
        "joint_id",
        "clock_deg",
        "depth_m",
        "depth_sigma_m",
        "length_m",
        "width_m",
        "strain_max",
        "status",
        "depth_change_m",
        "depth_change_sigma_m",
        "reason",
    ]
    return pd.DataFrame(rows, columns=names)


def _survey(line: str, runs: tuple[str, ...], listing: bool) -> dict:
    return {
        "line": line,
        "deform_version": "0.1.0",
        "options": {"strain": {"gauge_length_m": 2.0}, "change": {"k_sigma": 3.0}},
        "runs": [
            {
                "id": r,
                "date": f"{2019 + 2 * k}-07-02",
                "source": "listing" if listing else "raw",
                "inputs": {"imu.nc": "ab" * 32, "odometer.nc": "cd" * 32},
                "repairs": ["odometer wheel 2: 3 slips filled"] if k else [],
            }
            for k, r in enumerate(runs)
        ],
        "stages": [
            {"name": n, "seconds": 3.2, "peak_memory_mb": 410.0, "status": "done"}
            for n in ("read", "navigate", "caliper", "match", "compare")
        ],
        "warnings": [{"stage": "navigate", "message": "marker RECEIVER: 41 m off; not used"}],
        "missing": [],
    }
