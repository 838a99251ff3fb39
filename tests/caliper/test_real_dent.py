"""A dent that a real caliper recorded: 80 arms, a sharp apex with raised shoulders on an oval pipe.

The notebook of the source prints "overall radius 17.544 inch, depth 0.889 inch, 6.975 % OD"; its place (76.06 inch, 103.5
degree) and radius (16.65 inch) are those of another pipe than the file beside it, whose radii run from 5.55 to 5.96 inch.
The convention can be held against this file, the number cannot.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.caliper.dent_shape import DentSamples, fit_dent, inward_departure

INCH = 0.0254
OD = 12.75 * INCH
CENTRE, CLOCK = 69.29 * INCH, np.radians(193.5)


@pytest.fixture(scope="module")
def recorded(real):
    table = pd.read_csv(real / "caliper_dent" / "test_profile.csv", index_col=0)
    place, radius = table.index.to_numpy(float) * INCH, table.to_numpy() * INCH
    clock = np.broadcast_to(np.radians(table.columns.to_numpy(float)), radius.shape)
    return DentSamples(place, clock, radius, np.abs(place - CENTRE) < 0.5)


def test_depth_by_the_convention_of_the_source_is_overall_radius_minus_least(recorded):
    depth = np.median(recorded.radius) - recorded.radius.min()
    assert depth / OD * 100 == pytest.approx(2.36, abs=0.01)
    assert (OD / 2 - recorded.radius.min()) / OD * 100 < 6.6  # no reference within the pipe gives 6.975


def test_depth_below_the_undamaged_section_leaves_ovality_out(recorded):
    fit = fit_dent(recorded, CENTRE, CLOCK, 0.0075, 2e-4)
    direct, _ = inward_departure(recorded, CLOCK, 0.75)
    assert fit.depth / OD * 100 == pytest.approx(1.73, abs=0.08)
    assert fit.depth == pytest.approx(np.nanmax(direct), abs=3 * fit.depth_sigma)
    assert np.degrees(fit.clock) == pytest.approx(194.6, abs=1.0)
    assert fit.depth < np.median(recorded.radius) - recorded.radius.min()


@pytest.mark.parametrize("every", [2, 4])
def test_fewer_arms_find_the_same_dent_with_an_honest_sigma(recorded, every):
    whole = fit_dent(recorded, CENTRE, CLOCK, 0.0075, 2e-4)
    for first in range(every):
        thin = DentSamples(recorded.place, recorded.clock[:, first::every], recorded.radius[:, first::every], recorded.inner)
        fit = fit_dent(thin, CENTRE, CLOCK, 0.0075, 2e-4)
        assert abs(np.degrees(fit.clock - whole.clock)) < 3
        assert fit.depth == pytest.approx(whole.depth, abs=max(1.2e-3, 2 * fit.depth_sigma))
