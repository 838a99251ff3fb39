"""A pipe book is read as a listing, its straight stretches as a table; what cannot be is refused with its line."""

from __future__ import annotations

import numpy as np
import pytest

from deform.errors import InputError
from deform.readers.pipe_book import read_joints, read_straights
from tests.readers.small_listing import PIPE_BOOK_MAP


def test_joints_are_those_of_the_listing(tmp_path):
    (tmp_path / "book.toml").write_text(PIPE_BOOK_MAP, encoding="utf-8")
    places = [12.9, 25.3, 38.1, 51.0]
    (tmp_path / "book.csv").write_text("Distance [m],Event\n" + "".join(f"{p},girth weld\n" for p in places), encoding="utf-8")
    book = read_joints(tmp_path / "book.csv", str(tmp_path / "book.toml"))
    np.testing.assert_allclose(np.diff(book["welds"]["chainage"].values), np.diff(places))


@pytest.fixture
def straights(tmp_path):
    def read(rows: str):
        (tmp_path / "straights.csv").write_text(f"from_m,to_m,sigma_deg\n{rows}", encoding="utf-8")
        return read_straights(tmp_path / "straights.csv")

    return read


def test_straight_stretches_come_in_order(straights):
    np.testing.assert_array_equal(straights("500,620,0.02\n100,180.5,0.01\n"), [[100, 180.5, 0.01], [500, 620, 0.02]])


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("100,90,0.01\n", "to_m, line 2: is 90"),
        ("100,180,0.01\n150,300,0.01\n", "150 m lies within the stretch from 100 to 180 m"),
        ("100,180,0\n", "sigma_deg, line 2: is 0"),
        ("100,a,0.01\n", "to_m, line 2: is 'a'"),
    ],
)
def test_a_stretch_that_cannot_be_is_refused(straights, rows, told):
    with pytest.raises(InputError, match=r"straights\.csv") as fault:
        straights(rows)
    assert told in str(fault.value)
