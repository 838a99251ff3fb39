"""The groups of one run of a test output folder."""

from __future__ import annotations

import numpy as np
import xarray as xr

from deform.run import build
from tests.report.fabricated_line import DENTS, LATITUDE, LONGITUDE, OD, WALL, headings, strain_change


def centreline(s: np.ndarray, moved: np.ndarray, k: int, rng: np.random.Generator, caliper: bool) -> xr.Dataset:
    step = s[1] - s[0]
    azimuth, pitch = headings(s)
    east = np.cumsum(np.sin(np.radians(azimuth)) * np.cos(np.radians(pitch))) * step + moved[0] * np.cos(np.radians(azimuth))
    north = np.cumsum(np.cos(np.radians(azimuth)) * np.cos(np.radians(pitch))) * step - moved[0] * np.sin(np.radians(azimuth))
    up = 236 + np.cumsum(np.sin(np.radians(pitch))) * step + moved[1]
    extra = strain_change(s, k, 3) / (OD / 2) if moved.any() else np.zeros((2, s.size))
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


def welds_group(places: np.ndarray, k: int, listing: bool, rng: np.random.Generator) -> xr.Dataset:
    at = places * (1 + 2e-4 * k) + rng.normal(0, 0.005, places.size)
    values = {"chainage": at, "log_distance": at * 1.002, "probability": np.full(at.size, 0.99)}
    if listing:
        values["label"] = [f"{10 * (i + 1)}" for i in range(at.size)]
    else:
        values["time"] = 600 + at / 1.2
    return build.dataset("welds", values)


def dents_group(k: int) -> xr.Dataset:
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


def features_group() -> xr.Dataset:
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


def navigation_group(k: int) -> xr.Dataset:
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


def markers_group(length_m: float, rng: np.random.Generator) -> xr.Dataset:
    at = np.linspace(3.0, length_m - 3, 5)
    azimuth, _ = headings(np.arange(0.0, length_m, 0.1))
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


def wall_group(k: int, rng: np.random.Generator) -> xr.Dataset:
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
