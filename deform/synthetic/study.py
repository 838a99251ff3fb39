"""Angular increments at a high rate in, the attitude error that a lower data rate, a pulse or an update formula brings out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from deform.errors import InputError, OptionError
from deform.geometry.rotation import matrix_to_rotation_vector
from deform.synthetic import _kernels
from deform.synthetic.imu import ARCSECOND, increments
from deform.synthetic.motion import Motion

Floats = NDArray[Any]

FINE_HZ = 1024.0
RATES_HZ = (8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0)
PORTER_PULSE_RAD = 25.1787 * ARCSECOND
METHODS = {"savage": 0, "coning": 1, "xyz": 2, "yzx": 3, "zxy": 4}


def shaken_rates(seconds: float = 60.0, *, size_deg_per_s: float = 2.0, frequency_hz: float = 1.0, seed: int = 1) -> Floats:
    """Return increments (n, 3) at `FINE_HZ` of a constant plus a sinusoidal rate about all axes, modulated by noise (radian).

    Parameters
    ----------
    seconds : duration.
    size_deg_per_s : amplitude of the constant and of the sinusoidal part.
    frequency_hz : frequency of the sinusoid; its phase differs between the axes, so that the axis of rotation cones.
    seed : of the noise.

    Notes
    -----
    The sinusoids are integrated in closed form, the slow noise that modulates them is held over each increment.

    References
    ----------
    Porter (1990), §3.7: "rotating a unit vector at various rates, constant and sinusoidal, with noise modulation".
    """
    rng = np.random.default_rng(seed)
    n = int(seconds * FINE_HZ)
    time = np.arange(n + 1) / FINE_HZ
    phase, constant = np.array([0.0, 0.5, 1.0]) * np.pi, np.array([0.3, -0.2, 1.0])
    omega = 2 * np.pi * frequency_hz
    waves = -np.cos(omega * time[:, None] + phase) / omega
    nodes = rng.normal(0.0, 0.3, (int(seconds) + 2, 3))
    slow = 1.0 + np.stack([np.interp(time[:-1], np.arange(len(nodes)), column) for column in nodes.T], axis=1)
    return np.radians(size_deg_per_s) * (constant / FINE_HZ + slow * np.diff(waves, axis=0))


def ridden_rates(motion: Motion, begin: float, seconds: float) -> Floats:
    """Return increments (n, 3) at `FINE_HZ` of a simulated tool in its pipe (radian)."""
    return increments(motion, FINE_HZ, begin, int(seconds * FINE_HZ))[:, :3]


def attitude_errors(fine: ArrayLike, rate_hz: float, *, pulse_rad: float = 0.0, method: str = "savage") -> Floats:
    """Return the attitude error (m, 3) at a lower rate against the rotation vectors at `FINE_HZ` (radian).

    Parameters
    ----------
    fine : increments (n, 3) at `FINE_HZ`.
    rate_hz : data rate; it divides `FINE_HZ`.
    pulse_rad : size of a pulse, its remainder carried on; 0 for none.
    method : one of `METHODS`: ``savage`` (rotation vector), ``coning`` (with the two-sample coning term), or the order of three
        elementary turns.

    Raises
    ------
    InputError
        When the rate does not divide the fine one.
    OptionError
        When the method is unknown.
    """
    if method not in METHODS:
        raise OptionError(f"attitude update {method!r} is unknown; known are {', '.join(METHODS)}")
    every = FINE_HZ / rate_hz
    if every != int(every):
        raise InputError(f"data rate {rate_hz} Hz does not divide {FINE_HZ} Hz")
    fine = np.ascontiguousarray(fine, float)
    fine = fine[: fine.shape[0] // int(every) * int(every)]
    coarse = fine.reshape(-1, int(every), 3).sum(axis=1)
    if pulse_rad > 0:
        pulses = np.empty(coarse.shape, np.int64)
        _kernels.quantize(coarse, np.full(3, float(pulse_rad)), np.zeros(3), pulses)
        coarse = pulses * float(pulse_rad)
    true = _attitudes(fine, "coning")[int(every) - 1 :: int(every)]
    return matrix_to_rotation_vector(np.swapaxes(true, 1, 2) @ _attitudes(coarse, method))


def data_rate(fine: ArrayLike, rates_hz: Sequence[float] = RATES_HZ) -> pd.DataFrame:
    """Return largest and final error of each data rate (arc second): Porter's Fig. 3-4."""
    return pd.DataFrame([{"rate_hz": r, **_size(attitude_errors(fine, r))} for r in rates_hz])


def quantization(fine: ArrayLike, rates_hz: Sequence[float] = RATES_HZ, pulse_rad: float = PORTER_PULSE_RAD) -> pd.DataFrame:
    """Return the same with pulses, and the errors in pulses: Porter's Fig. 3-5."""
    rows = []
    for rate in rates_hz:
        size = _size(attitude_errors(fine, rate, pulse_rad=pulse_rad, method="coning"))
        rows.append({"rate_hz": rate, **size, "rms_pulses": size["rms_arcsec"] * ARCSECOND / pulse_rad})
    return pd.DataFrame(rows)


def commutativity(fine: ArrayLike, rate_hz: float = 16.0) -> pd.DataFrame:
    """Return the errors of each update formula at one rate (arc second): Porter's Fig. 3-6."""
    return pd.DataFrame([{"method": m, **_size(attitude_errors(fine, rate_hz, method=m))} for m in METHODS])


def _attitudes(turns: Floats, method: str) -> Floats:
    out = np.empty((turns.shape[0], 3, 3))
    _kernels.follow(np.ascontiguousarray(turns), METHODS[method], out)
    return out


def _size(errors: Floats) -> dict[str, float]:
    angle = np.linalg.norm(errors, axis=1) / ARCSECOND
    return {"rms_arcsec": float(np.sqrt(np.mean(angle**2))), "max_arcsec": float(angle.max()), "final_arcsec": float(angle[-1])}
