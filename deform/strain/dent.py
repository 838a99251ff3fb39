"""Dents and the wall around them in, the largest effective strain of each dent out (ASME B31.8 form)."""

from __future__ import annotations

import logging

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline

from deform.errors import Fault, InputError
from deform.options import DentStrainOptions
from deform.run import build

logger = logging.getLogger(__name__)

_ROOT3 = np.sqrt(3.0)
_DEGREE = 5
_SURE = 2.0  # sigma by which a measured wall must differ from the stated one to be believed


def strain_2018(bending_around, bending_along, stretch_along):
    """Effective strain at the inner and the outer surface, form of ASME B31.8 of 2018.

    Parameters
    ----------
    bending_around : e1 = (t/2) (1/R0 - 1/R1).
    bending_along : e2 = -t / (2 R2).
    stretch_along : e3 = (d/L)^2 / 2.

    Returns
    -------
    inside, outside : arrays like the inputs.

    References
    ----------
    ASME B31.8-2018, non-mandatory appendix R, as given in the field's literature; held against six published dents in the tests.
    """
    e1, e2, e3 = bending_around, bending_along, stretch_along
    inside = 2 / _ROOT3 * np.sqrt(e1**2 + e1 * (e2 + e3) + (e2 + e3) ** 2)
    outside = 2 / _ROOT3 * np.sqrt(e1**2 - e1 * (e3 - e2) + (e3 - e2) ** 2)
    return inside, outside


def strain_legacy(bending_around, bending_along, stretch_along):
    """Effective strain at the inner and the outer surface, form printed before 2018 (no 2/sqrt 3, other sign of the product).

    Parameters and returns as `strain_2018`. Kept only so that old reports can be compared.
    """
    e1, e2, e3 = bending_around, bending_along, stretch_along
    inside = np.sqrt(e1**2 - e1 * (e2 + e3) + (e2 + e3) ** 2)
    outside = np.sqrt(e1**2 + e1 * (e3 - e2) + (e3 - e2) ** 2)
    return inside, outside


FORMS = {"b31.8-2018": strain_2018, "b31.8-2007": strain_legacy}


def strain_from_sizes(depth, length, width, *, outside_diameter: float, wall_thickness: float, form: str = "b31.8-2018"):
    """Return inside and outside effective strain where only the sizes of a dent are known.

    Parameters
    ----------
    depth, length, width : m, arrays of one shape; full extents.
    outside_diameter, wall_thickness : m.
    form : a key of `FORMS`.

    Returns
    -------
    inside, outside : arrays like ``depth``; NaN where a size is missing or not positive.

    Notes
    -----
    Each profile is taken as an arc through apex and ends, R = (4 d^2 + w^2) / (8 d); the dent is taken as re-entrant
    (R1 = -R(width)) and inward (R2 = -R(length)), which is the worst case for its sizes.

    Examples
    --------
    >>> inch = 0.0254
    >>> pipe = dict(outside_diameter=24 * inch, wall_thickness=0.344 * inch)
    >>> inside, _ = strain_from_sizes(0.24 * inch, 2.66 * inch, 15.36 * inch, **pipe)
    >>> round(float(inside) * 100, 2)
    6.78
    """
    _check(outside_diameter, wall_thickness)
    return _from_sizes(depth, length, width, outside_diameter, wall_thickness, form)


def _from_sizes(depth, length, width, outside_diameter: float, wall_thickness, form: str):
    depth, length, width = (np.where(np.asarray(v, float) > 0, np.asarray(v, float), np.nan) for v in (depth, length, width))
    around, along = (-(4 * depth**2 + extent**2) / (8 * depth) for extent in (width, length))
    e1 = wall_thickness / 2 * (2 / outside_diameter - 1 / around)
    e2 = -wall_thickness / (2 * along)
    return FORMS[form](e1, e2, 0.5 * (depth / length) ** 2)


def surface_strain(
    place, angle, radius, *, length: float, depth: float, wall_thickness: float, form: str = "b31.8-2018", intervals: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Return inside and outside effective strain at every cell of a patch of wall.

    Parameters
    ----------
    place : (n,) m along the pipe, rising.
    angle : (m,) rad around the pipe, rising.
    radius : (n, m) m, centre of the pipe to the inner wall; NaN where nothing was measured.
    length, depth : m, of the dent, for the stretch along the pipe.
    intervals : pieces of the B-spline each way.

    Notes
    -----
    A tensor B-spline is fitted to the patch; with r its value at the middle of the wall, 1/R2 = -d2r/ds2 / (1 + (dr/ds)^2)^1.5
    and 1/R1 = (r^2 + 2 r'^2 - r r'') / (r^2 + r'^2)^1.5 (derivatives by the angle), both with their sign: R1 is negative where
    the section is re-entrant. R0 comes from the rim of the patch.
    """
    surface = radius + wall_thickness / 2
    r, by_s, by_ss, by_a, by_aa = _spline_surface(place, angle, surface, intervals)
    around = (r**2 + 2 * by_a**2 - r * by_aa) / (r**2 + by_a**2) ** 1.5
    along = -by_ss / (1 + by_s**2) ** 1.5
    start = np.nanmedian(np.concatenate([surface[0], surface[-1]]))
    e1 = wall_thickness / 2 * (1 / start - around)
    e2 = -wall_thickness / 2 * along
    return FORMS[form](e1, e2, 0.5 * (depth / length) ** 2)


def add_dent_strain(
    dents: xr.Dataset,
    wall: xr.Dataset | None,
    *,
    outside_diameter: float,
    wall_thickness: float,
    options: DentStrainOptions | None = None,
) -> xr.Dataset:
    """Return the dents with ``strain_max``, its sigma and ``strain_basis``.

    Parameters
    ----------
    dents : group ``dents``.
    wall : group ``caliper`` with full resolution around each dent, or None: then sizes are all there is.
    outside_diameter, wall_thickness : m; a dent whose joint has a wall of its own (``wall_thickness`` of the dents) takes that
        where it differs from the stated one by more than two of its sigma (attribute ``wall_thickness_sigma_m``; absent for a
        listed wall, which is believed).
    options : see `DentStrainOptions`.

    Notes
    -----
    ``strain_max`` is the largest of inside and outside over the dent, from the surface at the first window; its sigma holds
    the difference to the second window and the propagated noise of the sizes. Where the surface is too coarse (fewer than six
    cells across the dent either way), or absent, the sizes are used and ``strain_basis`` says so.
    """
    options = options or DentStrainOptions()
    _check(outside_diameter, wall_thickness)
    sizes = {name: dents[name].values.astype(float) for name in ("depth", "length", "width") if name in dents}
    if len(sizes) < 3:
        return dents
    depth, length, width = sizes["depth"], sizes["length"], sizes["width"]
    walls, wall_share = _walls(dents, wall_thickness)
    both = _from_sizes(depth, length, width, outside_diameter, walls, options.form)
    by_sizes = np.maximum(*both)
    value, sigma = by_sizes.copy(), 0.3 * by_sizes
    basis = np.where(np.isfinite(by_sizes), "sizes", "").astype(object)
    if wall is not None and options.basis == "profile":
        for k in range(dents.sizes["dent"]):
            pair = [_strain_at(dents, wall, k, outside_diameter, walls[k], options, window) for window in options.windows]
            if np.isfinite(pair[0]):
                share = np.hypot(_relative_sigma(dents, k), wall_share[k])  # strain goes with the wall
                value[k], basis[k] = pair[0], "profile"
                sigma[k] = np.hypot(share * pair[0], abs(pair[1] - pair[0]) if np.isfinite(pair[1]) else 0.2 * pair[0])
    added = build.add(dents, "dents", {"strain_max": np.clip(value, 0, 1), "strain_max_sigma": sigma, "strain_basis": basis})
    return added.assign_attrs(strain_form=options.form)


def _walls(dents: xr.Dataset, stated: float) -> tuple[np.ndarray, np.ndarray]:
    """Wall (m) that each dent takes, and its relative sigma: 0 where it is stated."""
    own = dents["wall_thickness"].values.astype(float) if "wall_thickness" in dents else np.full(dents.sizes["dent"], np.nan)
    sigma = float(dents.attrs.get("wall_thickness_sigma_m", 0.0))
    other = (own > 0) & (np.abs(own - stated) > _SURE * sigma)
    walls = np.where(other, own, stated)
    return walls, np.where(other, sigma, 0.0) / walls


def _strain_at(
    dents: xr.Dataset,
    wall: xr.Dataset,
    k: int,
    outside_diameter: float,
    thickness: float,
    options: DentStrainOptions,
    window: float,
) -> float:
    """Largest strain of one dent from the wall within ``window`` sizes of it; NaN where the wall is too coarse."""
    centre, clock = float(dents["chainage"][k]), float(dents["clock"][k])
    length, width, depth = (float(dents[n][k]) for n in ("length", "width", "depth"))
    if not (length > 0 and width > 0 and depth > 0):
        return np.nan
    place, angle = wall["chainage"].values, np.radians((wall["clock"].values - clock + 180) % 360 - 180)
    rows = np.flatnonzero(np.abs(place - centre) <= 0.5 * window * length)
    order = np.argsort(angle)
    radius = 0.5 * outside_diameter  # the width is an arc on the outside
    half = min(0.5 * window * width / radius, np.pi) if rows.size else 0.0
    columns = order[np.abs(angle[order]) <= half]
    inside = np.abs(place[rows] - centre) <= 0.5 * length
    if inside.sum() < 6 or (np.abs(angle[columns]) <= 0.5 * width / radius).sum() < 6:
        return np.nan
    patch = wall["radius"].values[np.ix_(rows, columns)]
    if np.isfinite(patch).mean() < 0.7:
        return np.nan
    pieces = max(1, min(options.intervals, len(rows) // 2 - _DEGREE, len(columns) // 2 - _DEGREE))
    strain = surface_strain(
        place[rows],
        angle[columns],
        patch,
        length=length,
        depth=depth,
        wall_thickness=thickness,
        form=options.form,
        intervals=pieces,
    )
    core = (2 * (place[rows] - centre) / length)[:, None] ** 2 + (2 * angle[columns] * radius / width)[None, :] ** 2 <= 1.0
    return float(np.maximum(*strain)[core].max())


def _relative_sigma(dents: xr.Dataset, k: int) -> float:
    """Part of the strain's sigma that comes from the sizes: curvature goes with depth / size^2."""
    total = 0.0
    for name, power in (("depth", 1.0), ("length", 1.4), ("width", 1.4)):
        if f"{name}_sigma" in dents:
            total += (power * float(dents[f"{name}_sigma"][k]) / float(dents[name][k])) ** 2
    return float(np.sqrt(total))


def _spline_surface(place: np.ndarray, angle: np.ndarray, surface: np.ndarray, intervals: int):
    """Value and derivatives of a least-squares tensor B-spline at the cells of the patch."""
    along, around = _design(place, intervals), _design(angle, intervals)
    filled = np.where(np.isfinite(surface), surface, np.nan)
    rows = np.nanmedian(filled, axis=1, keepdims=True)
    filled = np.where(np.isfinite(filled), filled, rows)
    coefficients = np.linalg.pinv(along[0]) @ filled @ np.linalg.pinv(around[0]).T
    pairs = ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2))
    return tuple(along[i] @ coefficients @ around[j].T for i, j in pairs)


def _design(axis: np.ndarray, intervals: int) -> list[np.ndarray]:
    """B-spline basis of degree 5 on an axis and its first two derivatives, each (n, intervals + 5).

    A cubic spline's second derivative runs straight between knots and is 18 % too large at the apex of a bell with 8
    intervals; degree 5 leaves 3 %.
    """
    low, high = axis[0], axis[-1]
    knots = np.concatenate([[low] * _DEGREE, np.linspace(low, high, intervals + 1), [high] * _DEGREE])
    spline = BSpline(knots, np.eye(intervals + _DEGREE), _DEGREE)
    return [spline(axis, nu=order) for order in range(3)]


def _check(outside_diameter: float, wall_thickness: float) -> None:
    faults = []
    if not outside_diameter > 0:
        faults.append(Fault("dent strain", "outside_diameter", f"{outside_diameter}; must be positive"))
    elif not 0 < wall_thickness < outside_diameter / 2:
        rule = f"{wall_thickness}; must lie between 0 and half the outside diameter {outside_diameter}"
        faults.append(Fault("dent strain", "wall_thickness", rule))
    if faults:
        raise InputError(faults)
