"""Output folders of closed form: a line with a landslide, a settlement, a cut-out and dents, for any number of epochs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from deform.run import build, store
from tests.report.fabricated_line import OD, WALL, headings, movement, strain_change, weld_places
from tests.report.fabricated_run import (
    centreline,
    dents_group,
    features_group,
    markers_group,
    navigation_group,
    wall_group,
    welds_group,
)
from tests.report.fabricated_tables import write_doglegs, write_tables


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
    moved = [movement(chainage, k, len(runs)) if zones else np.zeros((2, chainage.size)) for k in range(len(runs))]
    weld_chainage = weld_places(length_m)
    for k, name in enumerate(runs):
        groups = {
            "welds": welds_group(weld_chainage, k, listing, rng),
            "dents": dents_group(k) if dents else None,
            "markers": None if listing else markers_group(length_m, rng),
        }
        if not listing:
            groups["centreline"] = centreline(chainage, moved[k], k, rng, caliper)
            groups["caliper"] = wall_group(k, rng) if caliper else None
            groups["navigation"] = navigation_group(k)
        groups["features"] = features_group()
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
        write_tables(folder, runs, weld_chainage, zones, dents, listing)
    if not listing:
        write_doglegs(folder, runs)
    store.write_json(_survey(line, runs, listing), folder / "survey.json")
    return folder


def _comparison(
    s: np.ndarray, moved: list[np.ndarray], runs: tuple[str, ...], rng: np.random.Generator, spike: float | None
) -> xr.Dataset:
    n, shape = len(runs), (len(runs), s.size)
    azimuth, _ = headings(s)
    lateral, up = np.stack([m[0] for m in moved]), np.stack([m[1] for m in moved])
    drift = np.array([0.0, *rng.normal(0, 0.05, n - 1)])[:, None] * np.sin(2 * np.pi * s / 1000)[None, :]
    lateral, up = lateral + drift, up - drift
    if spike is not None:
        lateral[-1, round(1234.5 / (s[1] - s[0]))] += spike
    smooth = np.ones(20) / 20
    strain = np.stack([strain_change(s, k, n) if moved[-1].any() else np.zeros((2, s.size)) for k in range(n)], 1)
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
