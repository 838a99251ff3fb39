"""Noise of a pair of runs at each wavelength in, the least movement that could have been seen out, also where none was found."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import chndtr

from deform.change.axial_zones import strings_of
from deform.change.joint_change import Elongation
from deform.change.noise_floor import class_name
from deform.change.pair import PairChange
from deform.change.wavelength import WaveNoise

Floats = NDArray[Any]


def peak_curvature(amplitude: ArrayLike, length: ArrayLike) -> Floats:
    """Return the largest curvature (1/m) of a movement w = A/2 (1 - cos 2πs/L): 2 π² A / L².

    Examples
    --------
    >>> strain = peak_curvature(0.5, 60.0) * 0.6096 / 2
    >>> round(float(strain) * 100, 4)
    0.0836
    """
    return 2.0 * np.pi**2 * np.asarray(amplitude, float) / np.asarray(length, float) ** 2


def mean_elongation(amplitude: ArrayLike, length: ArrayLike) -> Floats:
    """Return the mean axial strain of a movement w = A/2 (1 - cos 2πs/L) between fixed ends: π² A² / 4 L².

    Examples
    --------
    >>> round(float(mean_elongation(0.5, 60.0)) * 100, 4)
    0.0171
    """
    return np.pi**2 * np.asarray(amplitude, float) ** 2 / (4.0 * np.asarray(length, float) ** 2)


def detectable(sigma: float, limit: float, probability: float) -> float:
    """Return the amplitude that exceeds the threshold with a probability.

    Parameters
    ----------
    sigma : of the amplitude of one component (m).
    limit : threshold on twice the log likelihood ratio.
    probability : of detection, such as 0.5 or 0.9.

    Notes
    -----
    With an amplitude A twice the log likelihood ratio is non-central chi-square with two degrees of freedom and
    non-centrality A²/σ².
    """
    return float(sigma * np.sqrt(_non_centrality(float(limit), float(probability)))) if np.isfinite(sigma) else float("nan")


@lru_cache(maxsize=64)
def _non_centrality(limit: float, probability: float) -> float:
    return float(brentq(lambda n: 1.0 - chndtr(limit, 2.0, n) - probability, 1e-9, 4.0 * limit + 100.0))


def limit_rows(pair: PairChange, outside_diameter: float) -> list[dict]:
    """Return the rows of tables/limits.csv of one pair of runs: its noise floors, then its detection limit at each wavelength."""
    names = {"run_from": pair.reference, "run_to": pair.run}
    rows = []
    for quantity, floors in pair.floors.items():
        kind, _, component = quantity.rpartition(" ") if " " in quantity else (quantity, "", "")
        for number, floor in sorted(floors.items()):
            row = {"quantity": kind, "component": component, "speed_class": class_name(number), "noise_sigma": floor}
            rows.append(names | row)
    for wave in pair.waves:
        for m, component in enumerate(("lateral", "up")):
            rows.append(names | _wave_row(wave, m, component, pair.limit, outside_diameter))
    return rows


def joint_rows(reference: str, run: str, elongation: Elongation, false_alarms_per_100_km: float) -> list[dict]:
    """Return the rows of the joint lengths of a run since the reference run: their noise floor, and the least elongation of
    strings of joints that the search for axial zones finds at this rate of false alarms; none where they are not known.
    """
    if run == reference or not np.isfinite(elongation.noise):
        return []
    names = {"run_from": reference, "run_to": run, "quantity": "joint length", "component": "axial"}
    rows = [names | {"speed_class": class_name(-1), "noise_sigma": elongation.noise}]
    for string in strings_of(elongation, false_alarms_per_100_km):
        least = string.sigma * string.caution * np.sqrt(string.limit)
        row = {"noise_sigma": string.sigma, "wavelength_m": string.length, "limit_elongation_m": least}
        row |= {"limit_axial_strain": least / string.length, "decided_by": "joint length", "speed_class": class_name(-1)}
        rows.append(names | row)
    return rows


def _wave_row(wave: WaveNoise, m: int, component: str, limit: float, outside_diameter: float) -> dict:
    sigma = float(wave.typical[m])
    half, sure = (detectable(sigma, limit * wave.caution[m] ** 2, probability) for probability in (0.5, 0.9))
    position, curvature = (np.nan_to_num(part[m], nan=np.inf) for part in (wave.position, wave.curvature))
    return {
        "quantity": "displacement",
        "component": component,
        "speed_class": class_name(-1),
        "wavelength_m": wave.length,
        "noise_sigma": sigma,
        "limit_displacement_m": half,
        "limit_90_displacement_m": sure,
        "limit_strain_change": float(peak_curvature(half, wave.length) * outside_diameter / 2.0),
        "limit_axial_strain": float(mean_elongation(half, wave.length)),
        "decided_by": "position" if position <= curvature else "curvature",
    }
