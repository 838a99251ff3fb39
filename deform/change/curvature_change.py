"""Two runs at the same steel in, the change of curvature per component with a sigma from their own stable pipe out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change.noise_floor import bend_terms, floor_by_class, spread
from deform.change.stack import Layer

Floats = NDArray[Any]
COMPONENTS = ("horizontal", "vertical")


@dataclass(frozen=True)
class CurvatureChange:
    """Change of curvature of one component.

    Attributes
    ----------
    change, sigma : (n,) run minus reference and its standard deviation (1/m).
    floors : noise floor by speed class (1/m) on straight pipe.
    fraction, shift : what bends add: a fraction of the curvature, a shift along the pipe (m).
    """

    change: Floats
    sigma: Floats
    floors: dict[int, float]
    fraction: float
    shift: float


def curvature_change(
    reference: Layer, other: Layer, component: str, step: float, classes: Floats, stable: Floats
) -> CurvatureChange | None:
    """Return the change of curvature of one component, or None when either run has no curvature.

    Parameters
    ----------
    reference, other : the two runs on the reference chainage.
    component : ``horizontal`` or ``vertical``; changes are formed per component, never from totals.
    step : of the reference chainage (m).
    classes : (n,) speed class of each place.
    stable : (n,) true where the pipe is judged unchanged.

    Notes
    -----
    σ² = f² (σ_run² + σ_reference²) + (a k)² + (b dk/ds)²: f from the stable straight pipe of each speed class, a and b from
    its bends (`noise_floor.bend_terms`), b at least the sigma of the chainage map. A bend that both runs see is no change.
    Straight pipe is told by the mean of the two runs, whose noise is independent of that of their difference: choosing by one
    run alone would choose its quiet moments.
    """
    name = f"curvature_{component}"
    if not (reference.has(name) and other.has(name)):
        return None
    base, change = reference.values[name], other.values[name] - reference.values[name]
    formal = _formal(reference, other, name, change)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = 0.5 * np.abs(base + other.values[name])
        straight = stable & (middle < 4.0 * spread(change[stable]))
        use = straight if straight.sum() > 200 else stable
        factor, floors = floor_by_class(change / formal, classes, use)
    factor = np.where(np.isfinite(factor), factor, 1.0)
    quiet = factor * formal
    a, b = bend_terms(change, quiet, base, step, stable)
    slope = np.nan_to_num(np.gradient(base, step))
    shift = np.sqrt(b**2 + np.nan_to_num(other.run_chainage_sigma) ** 2)
    sigma = np.sqrt(quiet**2 + (a * base) ** 2 + (shift * slope) ** 2)
    typical = float(np.nanmedian(formal)) if np.isfinite(formal).any() else np.nan
    return CurvatureChange(change, sigma, {k: v * typical for k, v in floors.items()}, a, b)


def _formal(reference: Layer, other: Layer, name: str, change: Floats) -> Floats:
    """Root sum of squares of the stated sigmas, one for all where a run states none."""
    if reference.has(f"{name}_sigma") and other.has(f"{name}_sigma"):
        formal = np.hypot(reference.values[f"{name}_sigma"], other.values[f"{name}_sigma"])
        if (formal[np.isfinite(change)] > 0).all():
            return formal
    return np.where(np.isfinite(change), 1.0, np.nan)
