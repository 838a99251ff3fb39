"""The vocabulary: each variable once, complete, with a sigma partner where one is promised."""

from __future__ import annotations

import pytest

import deform.vocabulary as vocabulary
from deform.errors import SchemaError

CONTRACT = {
    "centreline": """time log_distance latitude longitude height east_sigma north_sigma up_sigma azimuth pitch tool_roll speed
        curvature_horizontal curvature_vertical curvature_horizontal_sigma curvature_vertical_sigma bending_strain_horizontal
        bending_strain_vertical bending_strain bending_strain_clock ovality diameter_min diameter_max""",
    "welds": "chainage log_distance time probability label",
    "caliper": "radius chainage",
    "comparison": """displacement_east displacement_north displacement_up displacement_lateral displacement_axial
        curvature_change_horizontal curvature_change_vertical bending_strain_change_horizontal bending_strain_change_vertical
        displacement_east_sigma displacement_axial_sigma bending_strain_change_vertical_sigma run_chainage""",
}
TABLES = {
    "welds": "weld_id run index log_distance_m chainage_m reference_chainage_m probability status",
    "dents": """dent_id run reference_chainage_m run_chainage_m joint_id clock_deg depth_m depth_sigma_m length_m width_m
        strain_max status""",
    "zones": """zone_id kind start_m end_m first_epoch peak_strain_change peak_strain_change_sigma peak_displacement_m
        peak_displacement_sigma_m direction_deg confidence reasons""",
}


@pytest.mark.parametrize("group", CONTRACT)
def test_names_of_the_contract_are_described(group):
    assert set(CONTRACT[group].split()) <= set(vocabulary.group(group))


@pytest.mark.parametrize("table", TABLES)
def test_columns_of_the_contract_come_first_and_in_order(table):
    wanted = TABLES[table].split()
    assert list(vocabulary.table(table))[: len(wanted)] == wanted


@pytest.mark.parametrize("group", vocabulary.groups())
def test_every_variable_has_a_long_name_and_numbers_have_units(group):
    for variable in vocabulary.group(group).values():
        assert variable.long_name
        if variable.type == "float":
            assert variable.units is not None, variable.name


def test_sigma_partner_has_the_units_of_its_variable():
    group = vocabulary.group("centreline")
    assert group["azimuth_sigma"].units == group["azimuth"].units
    assert group["azimuth_sigma"].sigma_of == "azimuth"


def test_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(SchemaError, match=r"no variable 'azimut'.*azimuth"):
        vocabulary.variable("centreline", "azimut")
