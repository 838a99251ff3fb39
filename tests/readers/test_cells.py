"""Cells of tables: numbers, clock positions and angles in every way of writing that listings use."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deform.errors import OptionError
from deform.readers import cells


@pytest.mark.parametrize(
    ("text", "decimal", "value"),
    [
        ("14949.71", ".", 14949.71),
        ("14,949.71", ".", 14949.71),
        (" 0,0 ", ",", 0.0),
        ("1.234,5", ",", 1234.5),
        ("1 234 567,5", ",", 1234567.5),
        ("1\u00a0234,5", ",", 1234.5),
        ("−3.5", ".", -3.5),
        ("1e-3", ".", 0.001),
        ("7", ",", 7.0),
    ],
)
def test_numbers_are_read_with_their_marks(text, decimal, value):
    assert cells.number(text, decimal) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "decimal"), [("1,5", "."), ("12;5", "."), ("ten", "."), ("1_000", "."), ("inf", "."), ("1,2,3", ",")]
)
def test_what_is_no_number_is_refused(text, decimal):
    with pytest.raises(ValueError, match=r".+"):
        cells.number(text, decimal)


@pytest.mark.parametrize("text", ["", " ", "-", "N/A", "nan", "#N/A"])
def test_an_empty_cell_is_no_number_and_no_fault(text):
    assert math.isnan(cells.number(text))
    assert math.isnan(cells.clock(text, "h:mm"))
    assert math.isnan(cells.angle(text))


@pytest.mark.parametrize(
    ("text", "form", "degree"),
    [
        ("12:00:00", "h:mm", 0.0),
        ("06:30", "h:mm", 195.0),
        ("9:04:30", "h:mm", 272.25),
        ("0:30", "h:mm", 15.0),
        ("12:30", "h:mm", 15.0),
        ("6", "h:mm", 180.0),
        ("0.375", "h:mm", 270.0),
        ("10,48", "h.mm", 324.0),
        ("3.30", "h.mm", 105.0),
        ("7", "h.mm", 210.0),
        ("10.5", "hours", 315.0),
        ("95", "degree", 95.0),
        ("-90", "degree", 270.0),
        ("360", "degree", 0.0),
    ],
)
def test_clock_positions_are_angles_from_the_top(text, form, degree):
    assert cells.clock(text, form) == pytest.approx(degree)


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("6:75", "h:mm"),
        ("14:00", "h:mm"),
        ("10,61", "h.mm"),
        ("25", "hours"),
        ("400", "degree"),
        ("6.5", "h:mm"),
        ("INFINITY", "h:mm"),
    ],
)
def test_what_is_no_clock_position_is_refused(text, form):
    with pytest.raises(ValueError, match=r".+"):
        cells.clock(text, form)


@given(minutes=st.integers(0, 719))
def test_every_minute_of_the_clock_is_half_a_degree(minutes):
    hours, rest = divmod(minutes, 60)
    for text, form in (
        (f"{hours or 12}:{rest:02d}", "h:mm"),
        (f"{hours:02d}:{rest:02d}:00", "h:mm"),
        (f"{hours or 12},{rest:02d}", "h.mm"),
    ):
        assert cells.clock(text, form) == pytest.approx(minutes / 2)


@pytest.mark.parametrize(
    ("text", "degree"),
    [
        ("61.5", 61.5),
        ("-121.25", -121.25),
        ("61°30'00\"N", 61.5),
        ("121° 15' W", -121.25),
        ("121 15 00.0 W", -121.25),
        ("61.5 S", -61.5),
        ("61.5°", 61.5),
    ],
)
def test_angles_are_read_in_degrees_minutes_and_seconds(text, degree):
    assert cells.angle(text) == pytest.approx(degree)


@given(value=st.floats(-179.99, 179.99))
def test_degrees_minutes_seconds_come_back(value):
    seconds = round(abs(value) * 3600, 4)
    degrees, rest = divmod(seconds, 3600)
    text = f"{int(degrees)}°{int(rest // 60):02d}'{rest % 60:07.4f}\" {'W' if value < 0 else 'E'}"
    if f"{rest % 60:07.4f}" != "60.0000":
        assert cells.angle(text) == pytest.approx(value, abs=1e-7)


def test_a_station_is_hundreds_plus_the_rest():
    assert cells.station("123+45.6") == pytest.approx(12345.6)
    assert cells.station("0+05") == 5.0
    assert cells.station("12345.6") == 12345.6


def test_units_have_multiples():
    assert cells.factor("0.1 mm", "length") == pytest.approx(1e-4)
    assert cells.factor("ft", "length") == 0.3048
    with pytest.raises(OptionError, match="furlong"):
        cells.factor("2 furlong", "length")


def test_words_have_one_form():
    assert cells.key("Log\u00a0 Dist.\n [FT]") == cells.key("log dist. [ft]")


@given(text=st.text(max_size=12), form=st.sampled_from(cells.CLOCK_FORMATS), decimal=st.sampled_from([".", ","]))
def test_any_text_is_a_value_or_is_refused(text, form, decimal):
    column = np.array([text], dtype=object)
    for one in (lambda t: cells.clock(t, form, decimal), lambda t: cells.number(t, decimal), cells.angle, cells.station):
        values, refused = cells.convert(column, one)
        assert values.shape == (1,)
        assert not np.isinf(values[0])
        assert refused in ([], [0])
