"""One table, many files: CSV with any delimiter and decimal mark, workbooks and Parquet give the same run."""

from __future__ import annotations

import datetime

import numpy as np
import pandas as pd
import pytest

from deform.errors import InputError, MissingExtraError
from deform.readers.reader import read_source
from tests.readers import small_listing as small

DATE = datetime.date(2015, 5, 1)


def same_run(run, other) -> None:
    """Hold two runs against each other, variable by variable."""
    assert set(run.children) == set(other.children)
    for name, node in other.children.items():
        for variable in node.variables:
            left, right = run[name][variable].values, node[variable].values
            if right.dtype.kind == "f":
                np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-9)
            else:
                np.testing.assert_array_equal(left, right)


@pytest.fixture
def reference(tmp_path):
    """Return the small listing, read from its CSV."""
    return read_source(small.write(tmp_path), small.write_map(tmp_path), date=DATE)


def typed() -> list[list]:
    """Return the rows with numbers and times of day as a workbook holds them."""
    rows = []
    for row in small.ROWS:
        cells: list = []
        for header, text in zip(small.HEADER, row, strict=True):
            if not text:
                cells.append(None)
            elif header == "Uhr":
                hours, minutes = map(int, text.split(":"))
                cells.append(datetime.time(hours % 24, minutes))
            elif header in ("Ereignis", "Bemerkung"):
                cells.append(text)
            else:
                cells.append(float(text.replace(",", ".")))
        rows.append(cells)
    return rows


@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), ("\t", ","), ("|", "."), (";", ".")])
def test_delimiter_and_decimal_mark_do_not_matter(tmp_path, reference, delimiter, decimal):
    rows = [[c.replace(",", decimal) if i not in (1, 2) else c for i, c in enumerate(r)] for r in small.ROWS]
    quoted = [[f'"{c}"' if delimiter in c else c for c in r] for r in [small.HEADER, *rows]]
    path = tmp_path / "other.csv"
    path.write_text("\r\n".join(delimiter.join(r) for r in quoted), encoding="utf-8")
    columns = small.write_map(tmp_path, 'delimiter = ";"\ndecimal = ","', f'decimal = "{decimal}"')
    same_run(read_source(path, columns, date=DATE), reference)


@pytest.mark.parametrize("sheet", ["", 'sheet = "Liste"', "sheet = 1"])
def test_a_workbook_gives_the_same_run(tmp_path, reference, sheet):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    page = book.active
    if sheet:
        page.append(["nothing", "here"])
        page = book.create_sheet("Liste")
    page.append([])
    page.append(["Pipeline 7"])
    page.append([h.replace(" [", "\n[") for h in small.HEADER])
    for row in typed():
        page.append(row)
    book.save(tmp_path / "acme.xlsx")
    columns = small.write_map(tmp_path, "[file]", f"[file]\n{sheet}")
    same_run(read_source(tmp_path / "acme.xlsx", columns, date=DATE), reference)


def test_a_sheet_that_is_not_there_is_named(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    openpyxl.Workbook().save(tmp_path / "acme.xlsx")
    with pytest.raises(InputError, match=r"has no sheet 'Tally'; there are Sheet"):
        read_source(tmp_path / "acme.xlsx", small.write_map(tmp_path, "[file]", '[file]\nsheet = "Tally"'), date=DATE)


def test_parquet_gives_the_same_run(tmp_path, reference):
    pytest.importorskip("pyarrow")
    frame = pd.DataFrame(typed(), columns=small.HEADER)
    frame["Uhr"] = [None if t is None else t.strftime("%H:%M") for t in frame["Uhr"]]
    frame.to_parquet(tmp_path / "acme.parquet")
    same_run(read_source(tmp_path / "acme.parquet", small.write_map(tmp_path), date=DATE), reference)


def test_parquet_without_its_library_names_the_extra(tmp_path, monkeypatch):
    def absent(*_args, **_kwargs):
        raise ImportError("no pyarrow")

    monkeypatch.setattr(pd, "read_parquet", absent)
    (tmp_path / "acme.parquet").write_bytes(b"PAR1")
    with pytest.raises(MissingExtraError, match="parquet"):
        read_source(tmp_path / "acme.parquet", small.write_map(tmp_path), date=DATE)


@pytest.mark.parametrize("suffix", [".xlsx", ".xls", ".ods", ".parquet", ".csv"])
def test_a_file_that_is_not_what_its_name_says_is_refused(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"acme{suffix}"
    path.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(InputError, match=r"acme"):
        read_source(path, small.write_map(tmp_path), date=DATE)


def test_a_semicolon_inside_quotes_is_text(tmp_path, reference):
    rows = small.with_cell(5, "Bemerkung", '"Straße; Kreis"')
    features = read_source(small.write(tmp_path, rows), small.write_map(tmp_path), date=DATE)["features"]
    assert "Mantelrohr Anfang: Straße; Kreis" in features["text"].values


def test_rows_longer_than_the_header_keep_their_words(tmp_path):
    rows = [list(r) for r in small.ROWS]
    rows[0] = [*rows[0], "", "more"]
    run = read_source(small.write(tmp_path, rows), small.write_map(tmp_path), date=DATE)
    assert "1 rows have more cells than the header" in run.attrs["repairs"]
