"""A column map says what it means, or is refused by key."""

from __future__ import annotations

import pytest

from deform.errors import InputError
from deform.readers.columns import column_map, shipped
from tests.readers import small_listing as small


def test_three_maps_are_shipped_and_found_by_name():
    assert set(shipped()) >= {"rosen", "baker-hughes", "infotech"}
    for name, columns in shipped().items():
        assert columns.name == name
        assert column_map(name) == column_map(f"{name}.toml") == columns


def test_a_map_of_ones_own_is_read_from_its_path(tmp_path):
    columns = column_map(small.write_map(tmp_path))
    assert columns.name == "acme"
    assert [c.unit for c in columns.columns["dent_depth"]] == ["mm", "% OD"]
    assert columns.rows[2].words == {"links": "left", "rechts": "right", "ab": "over", "auf": "sag"}


def test_a_name_that_is_nearly_right_gets_advice():
    with pytest.raises(InputError, match=r"did you mean 'rosen'\?"):
        column_map("rossen.toml")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "acme"', "", "name: Field required"),
        ('decimal = ","', 'decimal = ";"', "file.decimal"),
        ("[file]", "[file]\ncolour = 1", "file.colour"),
        ('unit = "m" }\nevent', 'unit = "furlong" }\nevent', "distance: unit 'furlong' is no length"),
        ('header = "Abstand [m]", unit = "m"', 'header = "Abstand [m]"', "distance: has no unit"),
        ('event = "Ereignis"', "", "event: is missing; a listing has it"),
        ('joint = "Rohr"', 'joint = "Rohr"\nrust = "Rost"', "rust: unknown field"),
        ('format = "h:mm"', 'format = "hh"', "clock: format 'hh' is none of h:mm"),
        ('unit = "% OD"', 'unit = "% wall"', "unit '% wall' is for depth only"),
        ('kind = "valve"', 'kind = "ventil"', "rows.3.kind"),
        ('event = "Armatur"', "", "has none of event, event_pattern, comment_pattern"),
        ('event_pattern = "^Marker"', 'event_pattern = "^Marker("', "is no regular expression"),
        ("?P<angle>", "?P<winkel>", "capture names ['winkel']"),
        ("?P<angle>", "?P<depth>", "units are missing for the captured depth"),
        ('kind = "weld"', 'kind = "other"', "no rule of kind 'weld'"),
        ("[[rows]]", "[[rows]", "is no TOML"),
    ],
)
def test_a_wrong_map_is_refused_by_key(tmp_path, old, new, told):
    with pytest.raises(InputError) as caught:
        column_map(small.write_map(tmp_path, old, new))
    assert told in str(caught.value)
    assert "acme.toml" in str(caught.value)
