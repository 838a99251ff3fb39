"""A curve along the pipe in, a compact text for a page out: 16-bit steps, thinned only where it is too long, peaks kept."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

_GAP = np.int16(-32768)
_STEPS = 32767


def pack(x: np.ndarray, y: np.ndarray, most_points: int) -> dict[str, Any]:
    """Return a curve as base64 of little-endian integers.

    Parameters
    ----------
    x : rising places (n,), metre.
    y : values (n,), NaN in gaps.
    most_points : longer curves are thinned to about this number: the least and the greatest value of every stretch.

    Returns
    -------
    dict
        ``y`` (int16, -32768 in a gap), ``scale`` and ``offset`` (y = offset + scale · integer), and either ``x0`` and ``dx``
        (regular) or ``x0`` and ``x`` (uint32, millimetre from ``x0``).

    Notes
    -----
    The step is 1/65534 of the range of the curve; a regular axis is stored as two numbers.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    keep = thinned(x, y, most_points)
    x, y = x[keep], y[keep]
    finite = np.isfinite(y)
    low, high = (float(y[finite].min()), float(y[finite].max())) if finite.any() else (0.0, 0.0)
    offset, scale = (high + low) / 2, max((high - low) / 2 / _STEPS, 1e-300)
    steps = np.full(y.size, _GAP, "<i2")
    steps[finite] = np.rint((y[finite] - offset) / scale).astype("<i2")
    packed: dict[str, Any] = {"n": int(y.size), "scale": scale, "offset": offset, "y": _text(steps)}
    if x.size > 1 and np.allclose(np.diff(x), x[1] - x[0], rtol=0, atol=1e-6):
        return packed | {"x0": float(x[0]), "dx": float((x[-1] - x[0]) / (x.size - 1))}
    return packed | {"x0": float(x[0]), "x": _text(np.rint((x - x[0]) * 1000).astype("<u4"))}


def thinned(x: np.ndarray, y: np.ndarray, most_points: int) -> np.ndarray:
    """Return rising indices of at most about ``most_points`` points: extremes of every stretch, ends, and one per gap."""
    if y.size <= most_points:
        return np.arange(y.size)
    from tsdownsample import MinMaxDownsampler  # imported when needed: it is compiled code

    valid = np.flatnonzero(np.isfinite(y))
    if valid.size == 0:
        return np.array([0, y.size - 1])
    chosen = valid
    if valid.size > most_points:
        picked = MinMaxDownsampler().downsample(x[valid].copy(), y[valid].copy(), n_out=most_points - most_points % 2)
        chosen = valid[picked.astype(int)]
    extremes = [valid[np.argmin(y[valid])], valid[np.argmax(y[valid])]]
    gaps = np.flatnonzero(~np.isfinite(y[1:]) & np.isfinite(y[:-1])) + 1
    return np.unique(np.concatenate([chosen, extremes, gaps]))


def unpack(packed: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return (x, y) of a packed curve: what the page sees."""
    steps = np.frombuffer(base64.b64decode(packed["y"]), "<i2")
    y = np.where(steps == _GAP, np.nan, packed["offset"] + packed["scale"] * steps.astype(float))
    if "x" in packed:
        return packed["x0"] + np.frombuffer(base64.b64decode(packed["x"]), "<u4") / 1000, y
    return packed["x0"] + packed["dx"] * np.arange(packed["n"]), y


def _text(array: np.ndarray) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")
