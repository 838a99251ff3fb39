"""Coordinates in any reference system that PROJ knows in, WGS84 latitude, longitude, height out."""

from __future__ import annotations

import warnings

import numpy as np

from deform.readers.findings import Findings


def to_wgs84(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, crs: str, findings: Findings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return latitude, longitude (degree) and height above the ellipsoid (metre).

    Parameters
    ----------
    x, y : easting and northing, or longitude and latitude, in the units of the system.
    z : height; NaN passes. A compound system (``EPSG:2193+7839``) turns heights above the geoid, when its grid is installed.
    crs : the system, as PROJ reads it (``EPSG:32610``).
    findings : takes a fault for an unknown system, a remark where the most exact transformation lacks its grid.
    """
    from pyproj import CRS, Transformer  # here: most runs need no transformation
    from pyproj.exceptions import CRSError
    from pyproj.transformer import TransformerGroup

    nothing = np.full(np.shape(x), np.nan)
    try:
        source = CRS.from_user_input(crs)
    except CRSError as fault:
        findings.fault(
            "", "crs", f"{crs!r} is no reference system that PROJ knows ({str(fault).split(':')[0]})", "such as EPSG:32610"
        )
        return nothing, nothing, nothing
    target = "EPSG:4979"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        group = TransformerGroup(source, target, always_xy=True)
    if not group.best_available:
        missing = ", ".join(g.short_name for op in group.unavailable_operations[:1] for g in op.grids if not g.available)
        rule = f"the most exact transformation from {source.name} needs the grid {missing or '(unknown)'}"
        findings.repair("", "crs", f"{rule}, which is not installed; the next best is used")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of the missing grid, which was said above
        transformer = Transformer.from_crs(source, target, always_xy=True)
    tall = np.isfinite(z)
    longitude, latitude, height = transformer.transform(x, y, np.where(tall, z, 0.0))
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(longitude) & np.isfinite(latitude)
    return np.where(good, latitude, np.nan), np.where(good, longitude, np.nan), np.where(good & tall, height, np.nan)
