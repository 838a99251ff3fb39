"""Two runs at the same steel in, the change of curvature per component with a sigma from their own stable pipe out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels
from deform.change.noise_floor import bend_terms, sample_step, speed_noise, spread
from deform.change.stack import Layer
from deform.change.threads import in_parts

Floats = NDArray[Any]
COMPONENTS = ("horizontal", "vertical")
OTHER = {"horizontal": "vertical", "vertical": "horizontal"}
LEAST_SHARE = 0.005  # of the curvature, radian: a stiff tool cuts the corner of a bend, and leans, as it happens to lie in it
SPILL, SPILL_M = (
    0.001,
    5.0,
)  # of the greatest curvature nearby: its error beside a bend, as seen at bends of 1.6 and 4.6 m radius; fades so


@dataclass(frozen=True)
class CurvatureChange:
    """Change of curvature of one component.

    Attributes
    ----------
    change, sigma : (n,) run minus reference and its standard deviation (1/m).
    floors : noise floor by speed class of both runs (1/m) on straight pipe.
    """

    change: Floats
    sigma: Floats
    floors: dict[int, float]


def curvature_change(
    reference: Layer, other: Layer, component: str, step: float, speeds: tuple[Floats, Floats], stable: Floats
) -> CurvatureChange | None:
    """Return the change of curvature of one component, or None when either run has no curvature.

    Parameters
    ----------
    reference, other : the two runs on the reference chainage.
    component : ``horizontal`` or ``vertical``; changes are formed per component, never from totals.
    step : of the reference chainage (m).
    speeds : `noise_floor.speed_step` of the reference and of the other run, each (n,).
    stable : (n,) true where the pipe is judged unchanged.

    Notes
    -----
    σ² = f² (σ_run² + σ_reference²) + (a k)² + (b dk/ds)² + c² (k² + k'²) + d² (h² + g²): f from the stable straight pipe at the
    speeds of both runs (`noise_floor.speed_noise`), a and b from its bends (`noise_floor.bend_terms`), b at least the sigma of
    the chainage map. Most bends are cold ones and tell little of those of a few diameters. There c = `LEAST_SHARE` of the
    curvature of both components (k' that of the other) is never known, and what the tool's wobble is taken for in them spills
    over: d = `SPILL` of the greatest curvature before and behind the place, h and g, fading over `SPILL_M`. A bend that both runs
    see is no change. Straight pipe is told by the mean of the two runs, whose noise is independent of that of their difference:
    choosing by one run alone would choose its quiet moments.
    """
    name = f"curvature_{component}"
    if not (reference.has(name) and other.has(name)):
        return None
    base, there = reference.values[name], other.values[name]
    stated = _stated(reference, other, name)
    tables, floors, a, b = _noise(base, there, stated, step, speeds, stable)
    change, sigma = np.empty(base.size), np.empty(base.size)
    ones = stated if stated is not None else (base, base)
    crosswise = f"curvature_{OTHER[component]}"
    beside = reference.values[crosswise] if reference.has(crosswise) else base
    runs: tuple[Any, ...] = (base, there, beside, *ones, stated is not None, *speeds, *tables, other.run_chainage_sigma)
    given = (*runs, a, LEAST_SHARE, SPILL, float(np.exp(-step / SPILL_M)), b, step)
    in_parts(base.size, lambda first, last: _kernels.curvature_difference(*(*given, first, last, change, sigma)))
    return CurvatureChange(change, sigma, floors)


def _noise(base, there, stated, step, speeds, stable):
    """Squared factors on the stated sigma by speed step of each run, noise floors (1/m), and what bends add; from a sample of the
    pipe.
    """
    thin = sample_step(base.size)
    at = slice(1, -1, thin)
    k, change, still = base[at], there[at] - base[at], stable[at]
    formal = np.hypot(stated[0][at], stated[1][at]) if stated is not None else np.ones(k.size)
    slope = (base[2::thin] - base[:-2:thin]) / (2.0 * step)
    with np.errstate(invalid="ignore", divide="ignore"):
        straight = still & (0.5 * np.abs(k + there[at]) < 4.0 * spread(change[still]))
        ratio = change / formal
    steps = speeds[0][at], speeds[1][at]
    noise = speed_noise(ratio, *steps, straight if straight.sum() > 200 else still)
    factor = noise.at(*steps)
    tables = tuple(np.where(np.isfinite(part), part, 0.5) for part in (noise.reference, noise.other))
    a, b = bend_terms(change, np.where(np.isfinite(factor), factor, 1.0) * formal, k, slope, still)
    typical = float(np.nanmedian(formal)) if np.isfinite(formal).any() else float("nan")
    return tables, {number: value * typical for number, value in noise.floors.items()}, a, b


def _stated(reference: Layer, other: Layer, name: str) -> tuple[Floats, Floats] | None:
    """Sigmas that the two runs state, or None where one of them states none."""
    name = f"{name}_sigma"
    if not (reference.has(name) and other.has(name)):
        return None
    pair = reference.values[name], other.values[name]
    some = slice(0, None, sample_step(pair[0].size))
    return pair if all((part[some] > 0).any() and not (part[some] <= 0).any() for part in pair) else None
