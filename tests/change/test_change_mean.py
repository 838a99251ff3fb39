"""Running means over gaps, and the series of a zone that take theirs from them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.change.running_mean import running_mean
from deform.change.series import zone_series


def plain(values, width, least):
    """The same by its definition, place by place."""
    half, out = width // 2, np.full(values.size, np.nan)
    for i in range(values.size):
        window = values[max(i - half, 0) : i + half + 1]
        known = window[np.isfinite(window)]
        if known.size > least * (2 * half + 1):
            out[i] = known.mean()
    return out


@pytest.mark.parametrize("width", [0, 1, 4, 5, 31, 200])
@pytest.mark.parametrize("least", [0.0, 0.5])
def test_running_mean_equals_its_definition_over_gaps_and_at_the_ends(width, least):
    rng = np.random.default_rng(width)
    rows = rng.standard_normal((3, 60))
    rows[1, 20:40], rows[2, rng.random(60) < 0.6] = np.nan, np.nan
    got = running_mean(rows, width, least)
    for row, mean in zip(rows, got, strict=True):
        np.testing.assert_allclose(mean, plain(row, width, least), atol=1e-12)


def test_unknown_pipe_beside_a_peak_does_not_pull_its_value_to_zero():
    axis = np.arange(0.0, 100.0, 0.5)
    up = np.stack([np.zeros(axis.size), np.where(axis < 50.0, 0.4, np.nan)])
    parts = {f"displacement_{name}": up if name == "up" else 0.0 * up for name in ("east", "north", "up")}
    sigma = {f"{name}_sigma": np.full(up.shape, 0.01) for name in parts}
    arrays = {name: (("epoch", "chainage"), values) for name, values in (parts | sigma).items()}
    arrays["date"] = (("epoch",), np.array(["2015-05-01", "2019-05-01"]))
    ds = xr.Dataset(arrays, coords={"epoch": ["r0", "r1"], "chainage": axis})
    zones = pd.DataFrame({"zone_id": ["Z001"], "kind": ["movement"], "start_m": [49.0], "end_m": [60.0]})
    (series,) = zone_series(SimpleNamespace(dataset=ds, zones=zones))
    assert series.value[1] == pytest.approx(0.4)
