"""A small listing by code, in a vendor's way of our own, and its column map: four joints and one feature of each kind."""

from __future__ import annotations

from pathlib import Path

MAP = """
name = "acme"
[file]
delimiter = ";"
decimal = ","
[pipe]
outside_diameter_m = 0.5
[columns]
distance = { header = "Abstand [m]", unit = "m" }
event = "Ereignis"
comment = "Bemerkung"
joint = "Rohr"
joint_length = { header = "Länge [m]", unit = "m" }
wall = { header = "Wand [mm]", unit = "mm" }
clock = { header = "Uhr", format = "h:mm" }
dent_depth = [{ header = "Tiefe [mm]", unit = "mm" }, { header = "Tiefe [% AD]", unit = "% OD" }]
length = { header = "Ausdehnung [mm]", unit = "mm" }
latitude = "Breite"
longitude = "Länge °"
elevation = { header = "Höhe [m]", unit = "m" }
[coordinates]
sigma_horizontal_m = 1.0
[[rows]]
kind = "weld"
event = "Rundnaht"
[[rows]]
kind = "dent"
event = "Beule"
[[rows]]
kind = "bend"
event = "Bogen"
capture = '(?P<angle>[\\d,]+) Grad (?P<direction>\\w+)'
words = { links = "left", rechts = "right", ab = "over", auf = "sag" }
[[rows]]
kind = "valve"
event = "Armatur"
[[rows]]
kind = "marker"
event_pattern = "^Marker"
[[rows]]
kind = "casing"
event = "Mantelrohr Anfang"
part = "start"
[[rows]]
kind = "casing"
event = "Mantelrohr Ende"
part = "end"
"""

HEADER = [
    "Abstand [m]",
    "Ereignis",
    "Bemerkung",
    "Rohr",
    "Länge [m]",
    "Wand [mm]",
    "Uhr",
    "Tiefe [mm]",
    "Tiefe [% AD]",
    "Ausdehnung [mm]",
    "Breite",
    "Länge °",
    "Höhe [m]",
]

ROWS = [
    ["97,0", "Armatur", "Schieber 1", "", "", "", "", "", "", "", "", "", ""],
    ["100,0", "Rundnaht", "", "10", "12,0", "6,3", "", "", "", "", "52,0", "10,0", "50,0"],
    ["104,0", "Beule", "", "", "", "", "5:30", "8,5", "", "120", "", "", ""],
    ["106,0", "Bogen", "31,5 Grad links", "", "", "", "", "", "", "", "", "", ""],
    ["112,0", "Rundnaht", "", "20", "11,5", "6,3", "", "", "", "", "52,0001", "10,0", "50,5"],
    ["113,0", "Mantelrohr Anfang", "Straße", "", "", "", "", "", "", "", "", "", ""],
    ["118,0", "Beule", "", "", "", "", "12:15", "", "2,0", "60", "", "", ""],
    ["120,0", "Mantelrohr Ende", "", "", "", "", "", "", "", "", "", "", ""],
    ["123,5", "Rundnaht", "", "30", "12,5", "8,0", "", "", "", "", "52,0002", "10,0", "51,0"],
    ["125,0", "Markerstein", "M 7", "", "", "", "", "", "", "", "", "", ""],
    ["126,0", "Ufo", "grün", "", "", "", "3:00", "", "", "", "", "", ""],
    ["136,0", "Rundnaht", "", "40", "", "8,0", "", "", "", "", "52,0003", "10,0", "50,0"],
]


def write(folder: Path, rows: list[list[str]] | None = None, header: list[str] | None = None, encoding: str = "utf-8") -> Path:
    """Write the listing, with other rows or another header when given; return its path."""
    lines = [HEADER if header is None else header, *(ROWS if rows is None else rows)]
    path = folder / "acme.csv"
    path.write_text("\n".join(";".join(f'"{c}"' if "\n" in c else c for c in line) for line in lines) + "\n", encoding=encoding)
    return path


def write_map(folder: Path, old: str = "", new: str = "") -> Path:
    """Write the column map, one part of it replaced; return its path."""
    assert old in MAP
    path = folder / "acme.toml"
    path.write_text(MAP.replace(old, new, 1) if old else MAP, encoding="utf-8")
    return path


def with_cell(row: int, header: str, text: str) -> list[list[str]]:
    """Return the rows with one cell replaced."""
    rows = [list(r) for r in ROWS]
    rows[row][HEADER.index(header)] = text
    return rows


# Column map of a pipe book that lists its girth welds
PIPE_BOOK_MAP = """name = "book"
[columns]
distance = { header = "Distance [m]", unit = "m" }
event = "Event"
[pipe]
outside_diameter_m = 0.3239
[[rows]]
kind = "weld"
event = "girth weld"
"""
