"""What docs/listings.md shows is true: its map is valid, its tables hold every field, kind and format."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from deform.readers import cells
from deform.readers.columns import FIELDS, Capture, FeatureKind, column_map

PAGE = Path(__file__).resolve().parents[2] / "docs" / "listings.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def test_the_map_of_the_page_is_valid(page, tmp_path):
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    block = next(b for b in blocks if b.startswith('name = "acme"'))
    coordinates = next(b for b in blocks if b.startswith("[coordinates]"))
    (tmp_path / "acme.toml").write_text(f"{block}\n{coordinates}", encoding="utf-8")
    columns = column_map(tmp_path / "acme.toml")
    assert columns.file.rows_below_header == 1
    assert columns.coordinates.crs == "EPSG:32610"


@pytest.mark.parametrize("word", [*FIELDS, *get_args(FeatureKind), *get_args(Capture), *cells.CLOCK_FORMATS])
def test_every_word_of_a_map_is_explained(page, word):
    assert re.search(rf"`(?:[^`]* )?{re.escape(word)}(?: [^`]*)?`", page)
