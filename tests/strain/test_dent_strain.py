"""Dent strain: six published dents, closed forms, signs."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.options import DentStrainOptions
from deform.run import build
from deform.strain.dent import FORMS, add_dent_strain, strain_2018, strain_from_sizes, surface_strain

INCH = 0.0254
PIPE = {"outside_diameter": 24 * INCH, "wall_thickness": 0.344 * INCH}
PUBLISHED = [  # depth, length, width in inch; inside, outside strain in percent
    (0.288, 27.54, 8.38, 2.338, 2.331),
    (0.240, 2.66, 15.36, 6.783, 5.872),
    (0.288, 2.89, 11.17, 7.073, 5.969),
    (0.432, 11.37, 5.59, 4.140, 4.041),
    (0.408, 19.46, 6.98, 3.071, 3.043),
    (0.384, 18.09, 5.59, 3.682, 3.654),
]


@pytest.mark.parametrize(("depth", "length", "width", "inside", "outside"), PUBLISHED)
def test_six_published_dents_are_met_to_the_printed_digits(depth, length, width, inside, outside):
    said = strain_from_sizes(depth * INCH, length * INCH, width * INCH, **PIPE)
    assert np.round(np.array(said) * 100, 3) == pytest.approx([inside, outside], abs=1.01e-3)


def bell(depth, length, width, step=0.005, thickness=0.00635, radius=0.15):
    """A patch of pipe of inner radius ``radius`` with a bell-shaped dent at its middle; also its analytic curvatures."""
    place = np.arange(-1.3 * length, 1.3 * length, step)
    angle = np.arange(-1.3 * width, 1.3 * width, step) / radius
    a, b = np.log(10) * 4 / length**2, np.log(10) * 4 / width**2 * (radius + thickness / 2) ** 2
    u = depth * np.exp(-a * place[:, None] ** 2 - b * angle[None, :] ** 2)
    return place, angle, radius - u, a, b


def test_apex_of_a_bell_has_the_curvatures_of_calculus():
    depth, length, width, t = 0.01, 0.3, 0.2, 0.00635
    place, angle, radius, a, b = bell(depth, length, width)
    inside, _ = surface_strain(place, angle, radius, length=length, depth=depth, wall_thickness=t, intervals=20)
    apex = np.unravel_index(np.argmin(radius), radius.shape)
    r = 0.15 + t / 2 - depth
    around = (r - 2 * b * depth) / r**2
    e1, e2, e3 = t / 2 * (1 / (0.15 + t / 2) - around), t / 2 * 2 * a * depth, 0.5 * (depth / length) ** 2
    assert inside[apex] == pytest.approx(float(strain_2018(e1, e2, e3)[0]), rel=0.02)


def test_round_pipe_has_no_strain():
    place, angle = np.linspace(-0.2, 0.2, 41), np.linspace(-0.6, 0.6, 41)
    inside, outside = surface_strain(place, angle, np.full((41, 41), 0.15), length=0.2, depth=1e-9, wall_thickness=0.006)
    assert np.abs([inside, outside]).max() < 1e-9


def test_a_deeper_dent_of_the_same_extent_strains_more():
    said = np.maximum(*strain_from_sizes([0.004, 0.008, 0.016], [0.3] * 3, [0.2] * 3, **PIPE))
    assert (np.diff(said) > 0).all()


def test_legacy_form_is_another_number_and_only_by_name():
    sizes = (0.24 * INCH, 2.66 * INCH, 15.36 * INCH)
    old, new = (strain_from_sizes(*sizes, **PIPE, form=f)[0] for f in ("b31.8-2007", "b31.8-2018"))
    assert set(FORMS) == {"b31.8-2007", "b31.8-2018"}
    assert old != pytest.approx(new, rel=0.01)


def dents(**further):
    return build.dataset(
        "dents", {"chainage": [10.0], "clock": [350.0], "depth": [0.01], "length": [0.3], "width": [0.2], **further}
    )


def wall_with_bell(step, bins):
    place = np.arange(9.0, 11.0, step)
    clock = np.arange(bins) * 360.0 / bins
    side = np.radians((clock - 350.0 + 180) % 360 - 180) * 0.15
    u = 0.01 * np.exp(-np.log(10) * ((2 * (place[:, None] - 10.0) / 0.3) ** 2 + (2 * side[None, :] / 0.2) ** 2))
    values = {"chainage": place, "clock": clock, "radius": 0.15 - u, "reference_radius": np.full(place.size, 0.15)}
    return build.dataset("caliper", values)


def test_strain_of_a_dent_across_the_top_comes_from_its_surface():
    found = add_dent_strain(dents(), wall_with_bell(0.01, 144), outside_diameter=0.3127, wall_thickness=0.00635)
    place, angle, radius, *_ = bell(0.01, 0.3, 0.2)
    truth = np.maximum(*surface_strain(place, angle, radius, length=0.3, depth=0.01, wall_thickness=0.00635, intervals=20)).max()
    assert found.strain_basis.values[0] == "profile"
    assert float(found.strain_max[0]) == pytest.approx(truth, rel=0.15)
    assert float(found.strain_max_sigma[0]) > 0


@pytest.mark.parametrize(
    ("measured", "sigma", "taken"), [(0.0072, 0.0008, 0.00635), (0.0095, 0.0008, 0.0095), (0.0072, None, 0.0072)]
)
def test_a_measured_wall_is_taken_where_it_surely_differs_from_the_stated_one_and_a_listed_one_always(measured, sigma, taken):
    window = wall_with_bell(0.01, 144)
    own = dents(wall_thickness=[measured]).assign_attrs({} if sigma is None else {"wall_thickness_sigma_m": sigma})
    found = add_dent_strain(own, window, outside_diameter=0.3127, wall_thickness=0.00635)
    stated = add_dent_strain(dents(), window, outside_diameter=0.3127, wall_thickness=taken)
    assert float(found.strain_max[0]) == pytest.approx(float(stated.strain_max[0]), rel=1e-9)
    share = sigma / taken if sigma and taken == measured else 0.0
    whole = np.hypot(float(stated.strain_max_sigma[0]), share * float(stated.strain_max[0]))
    assert float(found.strain_max_sigma[0]) == pytest.approx(whole, rel=1e-9)


def test_sizes_serve_where_there_is_no_wall_or_it_is_too_coarse():
    for wall in (None, wall_with_bell(0.2, 24)):
        found = add_dent_strain(dents(), wall, outside_diameter=0.3127, wall_thickness=0.00635)
        assert found.strain_basis.values[0] == "sizes"
    forced = add_dent_strain(
        dents(),
        wall_with_bell(0.01, 144),
        outside_diameter=0.3127,
        wall_thickness=0.00635,
        options=DentStrainOptions(basis="sizes"),
    )
    assert forced.strain_basis.values[0] == "sizes"


def test_a_dent_without_size_has_no_strain():
    missing = build.dataset(
        "dents", {"chainage": [1.0], "depth": [np.nan], "length": [np.nan], "width": [np.nan], "clock": [0.0]}
    )
    found = add_dent_strain(missing, None, outside_diameter=0.3, wall_thickness=0.006)
    assert np.isnan(found.strain_max.values[0])
    assert found.strain_basis.values[0] == ""


def test_a_wall_thicker_than_the_pipe_is_named():
    with pytest.raises(InputError, match="wall_thickness"):
        strain_from_sizes(0.01, 0.3, 0.2, outside_diameter=0.3, wall_thickness=0.2)
