"""The tables of a test output folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from deform.run import store
from tests.report.fabricated_line import CUTOUT, DENTS, SETTLEMENT, SLIDE


def write_tables(folder: Path, runs: tuple[str, ...], places: np.ndarray, zones: bool, dents: bool, listing: bool) -> None:
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


def write_doglegs(folder: Path, runs: tuple[str, ...]) -> None:
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
