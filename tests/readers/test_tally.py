"""A vendor's listing becomes a run: what it says is there, in SI, and nothing else."""

from __future__ import annotations

import datetime
import logging

import numpy as np
import pandas as pd
import pytest

from deform.errors import InputError
from deform.readers.reader import read_source
from deform.run.schema import validate_run
from deform.run.store import read_run, write_run
from tests.readers import small_listing as small

DATE = datetime.date(2015, 5, 1)


@pytest.fixture
def acme(tmp_path):
    """Return a function that reads the small listing, some of it replaced."""

    def read(rows=None, header=None, old="", new="", **more):
        path = small.write(tmp_path, rows, header, more.pop("encoding", "utf-8"))
        return read_source(path, small.write_map(tmp_path, old, new), date=DATE, **more)

    return read


def refused(read, *args, **kwargs) -> str:
    with pytest.raises(InputError) as caught:
        read(*args, **kwargs)
    return str(caught.value)


# ---- what a listing says ------------------------------------------------------------------------------------


def test_chainage_starts_at_the_first_girth_weld_and_log_distance_stays_the_vendors(acme):
    welds = acme()["welds"]
    np.testing.assert_allclose(welds["log_distance"], [100, 112, 123.5, 136])
    np.testing.assert_allclose(welds["chainage"], [0, 12, 23.5, 36])


def test_a_weld_bears_the_number_length_and_wall_of_the_joint_that_begins_there(acme):
    welds = acme()["welds"]
    assert list(welds["label"].values) == ["10", "20", "30", "40"]
    np.testing.assert_allclose(welds["joint_length"], [12, 11.5, 12.5, np.nan])
    np.testing.assert_allclose(welds["wall_thickness"], [0.0063, 0.0063, 0.008, 0.008])


def test_dents_are_read_in_millimetre_and_in_per_cent_of_the_diameter(acme):
    dents = acme()["dents"]
    np.testing.assert_allclose(dents["depth"], [0.0085, 0.01])
    np.testing.assert_allclose(dents["clock"], [165.0, 7.5])
    np.testing.assert_allclose(dents["length"], [0.12, 0.06])
    np.testing.assert_allclose(dents["weld_distance"], [4.0, 6.0])
    assert list(dents["label"].values) == ["10", "20"]
    assert "width" not in dents


def test_a_depth_in_per_cent_without_a_diameter_is_unmeasured(acme):
    run = acme(old="outside_diameter_m = 0.5")
    np.testing.assert_allclose(run["dents"]["depth"], [0.0085, np.nan])
    assert list(run["dents"]["sizing"].values) == ["vendor", "unmeasured"]
    assert "outside_diameter_m" not in run.attrs
    assert "1 dents have a depth in % OD only" in run.attrs["repairs"]


def test_the_survey_can_say_the_diameter(acme):
    run = acme(old="outside_diameter_m = 0.5", outside_diameter_m=1.0)
    np.testing.assert_allclose(run["dents"]["depth"], [0.0085, 0.02])
    assert run.attrs["outside_diameter_m"] == 1.0


def test_the_diameter_follows_from_dents_that_have_both_depths(acme):
    run = acme(small.with_cell(2, "Tiefe [% AD]", "1,7"), old="outside_diameter_m = 0.5")
    assert run.attrs["outside_diameter_m"] == pytest.approx(0.5)
    np.testing.assert_allclose(run["dents"]["depth"], [0.0085, 0.01])


def test_a_bend_gives_angle_and_direction(acme):
    features = acme()["features"].to_dataset()
    bend = features.isel(feature=list(features["kind"].values).index("bend"))
    assert float(bend["value"]) == 31.5
    assert str(bend["direction"].values) == "left"
    assert float(bend["chainage"]) == 6.0


def test_start_and_end_of_a_casing_are_one_feature(acme):
    features = acme()["features"].to_dataset()
    casing = features.isel(feature=list(features["kind"].values).index("casing"))
    assert (float(casing["chainage"]), float(casing["chainage_end"])) == (13.0, 20.0)
    assert str(casing["text"].values) == "Mantelrohr Anfang: Straße"


def test_a_step_of_the_wall_is_a_feature(acme):
    features = acme()["features"].to_dataset()
    steps = features.isel(feature=np.flatnonzero(features["kind"].values == "wall_change"))
    np.testing.assert_allclose(steps["chainage"], [23.5])
    np.testing.assert_allclose(steps["value"], [0.008])


def test_what_is_not_understood_is_kept_as_other_and_counted(acme, caplog):
    with caplog.at_level(logging.WARNING):
        features = acme()["features"].to_dataset()
    other = features.isel(feature=list(features["kind"].values).index("other"))
    assert str(other["text"].values) == "Ufo: grün"
    assert float(other["clock"]) == 90.0
    assert any("1 rows have an event that the column map does not know, kept as other: Ufo (1)" in m for m in caplog.messages)


def test_markers_and_valves_have_their_place(acme):
    run = acme()
    assert list(run["markers"]["name"].values) == ["M 7"]
    np.testing.assert_allclose(run["markers"]["chainage"], [25.0])
    assert run["features"]["chainage"].values[0] == -3.0


def test_a_listing_with_coordinates_has_a_centreline_between_them(acme):
    line = acme()["centreline"].to_dataset()
    np.testing.assert_allclose(line["chainage"][[0, -1]], [0.0, 36.0], atol=1e-9)
    assert line.sizes["chainage"] == 361
    at = [0, 120, 235, 360]
    np.testing.assert_allclose(line["latitude"][at], [52.0, 52.0001, 52.0002, 52.0003], atol=1e-12)
    np.testing.assert_allclose(line["height"][at], [50.0, 50.5, 51.0, 50.0], atol=1e-9)
    np.testing.assert_allclose(line["east_sigma"], 1.0)
    assert "up_sigma" not in line


def test_a_stretch_without_coordinates_stays_empty(acme):
    line = acme(small.with_cell(8, "Breite", ""), old="[coordinates]", new="[coordinates]\nlongest_gap_m = 20")["centreline"]
    latitude = line["latitude"].values
    assert np.isfinite(latitude[:120]).all()
    assert np.isnan(latitude[121:-1]).all()


def test_a_gross_coordinate_is_left_out(acme):
    run = acme(small.with_cell(4, "Länge °", "10,5"))
    assert "1 points lie further from their neighbours than the pipe between them is long" in run.attrs["repairs"]
    np.testing.assert_allclose(run["centreline"]["longitude"], 10.0)


def test_coordinates_in_a_national_grid_are_turned_into_wgs84(tmp_path):
    from pyproj import Transformer

    to_grid = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    rows = [list(r) for r in small.ROWS]
    for row in rows:
        if row[10]:
            east, north = to_grid.transform(float(row[11].replace(",", ".")), float(row[10].replace(",", ".")))
            row[10], row[11] = f"{north:.4f}".replace(".", ","), f"{east:.4f}".replace(".", ",")
    columns = small.MAP.replace('latitude = "Breite"', 'northing = { header = "Breite", unit = "m" }')
    columns = columns.replace('longitude = "Länge °"', 'easting = { header = "Länge °", unit = "m" }')
    (tmp_path / "grid.toml").write_text(columns.replace("[coordinates]", '[coordinates]\ncrs = "EPSG:32632"'), encoding="utf-8")
    line = read_source(small.write(tmp_path, rows), tmp_path / "grid.toml", date=DATE)["centreline"]
    np.testing.assert_allclose(line["latitude"][[0, 120]], [52.0, 52.0001], atol=1e-8)
    (tmp_path / "grid.toml").write_text(columns, encoding="utf-8")
    with pytest.raises(InputError, match="have no reference system"):
        read_source(small.write(tmp_path, rows), tmp_path / "grid.toml", date=DATE)


def test_a_run_of_a_listing_follows_the_schema_and_survives_the_disk(acme, tmp_path):
    run = acme()
    validate_run(run)
    back = read_run(write_run(run, tmp_path / "acme.nc"))
    np.testing.assert_array_equal(back["welds"]["label"], run["welds"]["label"])
    assert back.attrs["source"] == "listing"
    assert back.attrs["nominal_wall_m"] == 0.0063
    assert len(back.attrs["input_sha256"]) == 64


# ---- ways to write it -----------------------------------------------------------------------------------------


def test_spelling_of_headers_with_line_breaks_and_case_does_not_matter(acme):
    header = [h.replace(" [", "\n  [").upper() for h in small.HEADER]
    np.testing.assert_allclose(acme(header=header)["welds"]["chainage"], [0, 12, 23.5, 36])


def test_lines_above_the_header_do_not_matter(acme):
    title = [["Bericht", "Leitung 7", *[""] * 11], ["", *[""] * 12]]
    np.testing.assert_allclose(acme([small.HEADER, *small.ROWS], header=title[0])["welds"]["chainage"], [0, 12, 23.5, 36])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_the_encoding_is_found(acme, encoding):
    assert list(acme(encoding=encoding)["welds"]["label"].values) == ["10", "20", "30", "40"]


def test_an_encoding_that_was_guessed_is_recorded(acme):
    assert "is no UTF-8" in acme(encoding="cp1252").attrs["repairs"]


def test_numbers_and_lengths_of_the_joint_that_ends_are_moved(acme):
    rows = [list(r) for r in small.ROWS]
    welds = [r for r in rows if r[1] == "Rundnaht"]
    for row, label, length in zip(welds, ["5", "10", "20", "30"], ["9,9", "12,0", "11,5", "12,5"], strict=True):
        row[3], row[4] = label, length
    run = acme(rows, old="[pipe]", new='[joints]\nnumber = "ends"\nlength = "ends"\n[pipe]')
    assert list(run["welds"]["label"].values) == ["10", "20", "30", ""]
    np.testing.assert_allclose(run["welds"]["joint_length"], [12, 11.5, 12.5, np.nan])


def listing_of(joints: np.ndarray, lengths: np.ndarray) -> list[list[str]]:
    """Return rows of girth welds only."""
    at = 100 + np.append(0, np.cumsum(joints))
    texts = [f"{x:.2f}".replace(".", ",") for x in lengths]
    return [[f"{x:.2f}".replace(".", ","), "Rundnaht", "", str(i), texts[i], *[""] * 8] for i, x in enumerate(at)]


def test_lengths_of_the_joint_that_ends_are_recognised(acme):
    joints = np.random.default_rng(1).uniform(6, 14, 40).round(2)
    run = acme(listing_of(joints, np.append(7.77, joints)))
    np.testing.assert_allclose(run["welds"]["joint_length"][:-1], joints)
    assert "fits the joint that ends at the weld" in run.attrs["repairs"]


def test_a_few_lengths_in_feet_are_taken_as_empty(acme):
    joints = np.random.default_rng(2).uniform(6, 14, 40).round(2)
    lengths = np.append(joints, np.nan)
    lengths[[5, 9]] /= 0.3048
    rows = listing_of(joints, lengths)
    rows[-1][4] = ""
    run = acme(rows)
    assert np.flatnonzero(np.isnan(run["welds"]["joint_length"])).tolist() == [5, 9, 40]
    assert "2 lengths look as if foot and metre were exchanged" in run.attrs["repairs"]


# ---- what is wrong ----------------------------------------------------------------------------------------------


def test_a_listing_needs_a_date(tmp_path):
    with pytest.raises(InputError, match="a listing does not know its date"):
        read_source(small.write(tmp_path), small.write_map(tmp_path))


def test_a_missing_column_is_named_with_the_nearest_one(acme):
    header = ["Abstand [ft]", *small.HEADER[1:]]
    assert "distance: no column 'Abstand [m]' (is it 'abstand [ft]'?)" in refused(acme, header=header)


def test_a_column_that_is_not_needed_may_be_absent(acme):
    run = acme(header=[h if h != "Uhr" else "Zeit" for h in small.HEADER])
    assert "clock" not in run["dents"]
    assert "no column for clock" in run.attrs["repairs"]


def test_a_distance_in_the_wrong_unit_is_refused(acme):
    old = 'header = "Abstand [m]", unit = "m"'
    assert "gives joints of 0.012 m (median)" in refused(acme, old=old, new=old.replace('unit = "m"', 'unit = "mm"'))
    assert "gives joints of 1.2e+04 m (median)" in refused(acme, old=old, new=old.replace('unit = "m"', 'unit = "km"'))


def test_joint_lengths_in_another_unit_than_the_distance_are_refused(acme):
    old = 'header = "Länge [m]", unit = "m"'
    assert "joint_length: is 0.3048 times" in refused(acme, old=old, new=old.replace('unit = "m"', 'unit = "ft"'))


def test_a_girth_weld_without_a_distance_is_refused_by_its_line(acme):
    assert "distance, line 6: a girth weld without a distance" in refused(acme, small.with_cell(4, "Abstand [m]", ""))


def test_a_row_without_a_place_is_left_out_and_counted(acme):
    run = acme([*small.ROWS, ["", "Summe", "36 m", *[""] * 10]])
    assert "1 rows without a distance are left out, first line 14: Summe: 36 m" in run.attrs["repairs"]


def test_cells_that_cannot_be_read_are_counted(acme):
    run = acme(small.with_cell(2, "Uhr", "unten"))
    np.testing.assert_allclose(run["dents"]["clock"], [np.nan, 7.5])
    assert "1 cells of column 'Uhr' cannot be read, first 'unten' in line 4; taken as empty" in run.attrs["repairs"]


def test_a_column_that_cannot_be_read_at_all_is_refused(acme):
    rows = [list(r) for r in small.ROWS]
    for row in rows:
        row[4] = row[4].replace(",", " Meter ")
    assert "joint_length: 3 cells of column 'Länge [m]' cannot be read" in refused(acme, rows)


def test_rows_out_of_order_and_rows_twice_are_put_right(acme):
    rows = [*small.ROWS[6:], *small.ROWS[:6], small.ROWS[4]]
    run = acme(rows)
    np.testing.assert_allclose(run["welds"]["chainage"], [0, 12, 23.5, 36])
    assert "falls 1 times" in run.attrs["repairs"]
    assert "1 girth welds stand there twice, first line 14, joint 20" in run.attrs["repairs"]


def test_a_listing_without_girth_welds_is_refused(acme):
    assert "0 girth welds found" in refused(acme, [r for r in small.ROWS if r[1] != "Rundnaht"])


def test_an_empty_listing_is_refused(tmp_path):
    path = tmp_path / "acme.csv"
    path.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="is empty"):
        read_source(path, small.write_map(tmp_path), date=DATE)
    small.write(tmp_path, rows=[])
    with pytest.raises(InputError, match="has a header and no rows"):
        read_source(path, small.write_map(tmp_path), date=DATE)


def test_an_end_without_a_start_is_kept_as_a_point(acme):
    run = acme([r for r in small.ROWS if r[1] != "Mantelrohr Anfang"])
    assert "1 starts or ends of a stretch have no partner" in run.attrs["repairs"]
    assert "casing" in run["features"]["kind"].values


# ---- the listings of the field ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "columns", "event", "weld", "label", "distance"),
    [
        ("ili_2007.csv", "rosen", "event", "Girth Weld", "J. no.", "log dist. [ft]"),
        ("ili_2015.csv", "baker-hughes.toml", "Event Description", "GirthWeld", "J. no.", "Log Dist. [ft]"),
    ],
)
def test_every_girth_weld_of_the_real_listings_is_read(real, file, columns, event, weld, label, distance):
    path = real / "ili_two_runs" / file
    frame = pd.read_csv(path, dtype=str)
    frame = frame[frame[event] == weld]
    run = read_source(path, columns, run_id="x", date=DATE)
    validate_run(run)
    np.testing.assert_allclose(run["welds"]["log_distance"], frame[distance].astype(float) * 0.3048, atol=1e-9)
    assert list(run["welds"]["label"].values) == [f"{float(v):.10g}" for v in frame[label]]
    assert run.attrs["nominal_wall_m"] == pytest.approx(0.00874)
    assert run.attrs["repairs"] == ""


def test_dents_of_2015_have_the_sizes_that_were_printed(real):
    run = read_source(real / "ili_two_runs" / "ili_2015.csv", date=DATE)
    dents = run["dents"]
    np.testing.assert_allclose(dents["depth"] / 0.0254, [0.288, 0.24, 0.288, 0.432, 0.408, 0.384])
    np.testing.assert_allclose(dents["length"] / 0.0254, [27.54, 2.66, 2.89, 11.37, 19.46, 18.09])
    np.testing.assert_allclose(dents["width"] / 0.0254, [8.38, 15.36, 11.17, 5.59, 6.98, 5.59])
    assert run.attrs["outside_diameter_m"] == pytest.approx(24 * 0.0254)


def test_features_of_the_real_listings_are_complete(real):
    counts = {}
    for year, columns in (("2007", "rosen"), ("2015", "baker-hughes")):
        path = real / "ili_two_runs" / f"ili_{year}.csv"
        features = read_source(path, columns, date=DATE)["features"].to_dataset()
        kinds, found = np.unique(features["kind"].values.astype(str), return_counts=True)
        counts[year] = dict(zip(kinds.tolist(), found.tolist(), strict=True))
        bends = features.isel(feature=np.flatnonzero(features["kind"].values == "bend"))
        assert np.isfinite(bends["value"]).all()
        assert set(bends["direction"].values) == {"left", "right", "over", "sag"}
    del counts["2007"]["wall_change"]
    points = {"bend": 78, "flange": 2, "marker": 14, "support": 5, "tap": 18, "tee": 2, "valve": 4}
    assert counts["2007"] == points | {"metal_loss": 387 + 236 + 88, "other": 5}
    expected = {"bend": 76, "tap": 18, "valve": 4, "tee": 5, "sleeve": 30, "casing": 1, "marker": 26, "flange": 1}
    assert {k: counts["2015"][k] for k in expected} == expected


def test_the_russian_listing_is_read_with_seams_walls_and_dents(real):
    run = read_source(real / "pipe_tally_infotech" / "infotech.csv", date=DATE)
    validate_run(run)
    welds = run["welds"]
    assert welds.sizes["weld"] == 11877
    assert float(welds["chainage"][-1]) == pytest.approx(130110.43)
    kinds, counts = np.unique(welds["seam_kind"].values.astype(str), return_counts=True)
    kinds = dict(zip(kinds.tolist(), counts.tolist(), strict=True))
    assert kinds["spiral"] == 9134 / 2  # the seam is listed at both ends of such a joint
    assert kinds["longitudinal"] > 4000
    np.testing.assert_allclose(welds["wall_thickness"][:4], [0.0232, 0.0187, 0.0232, 0.0232])
    np.testing.assert_allclose(welds["seam_clock"][1:3], [324.0, 186.0])
    assert run["dents"].sizes["dent"] == 8
    np.testing.assert_allclose(run["dents"]["depth"], 0.01)
    kinds = run["features"]["kind"].values
    assert [np.count_nonzero(kinds == k) for k in ("casing", "valve", "tee", "tap", "marker")] == [16, 8, 22, 8, 29]
    assert "does not know" not in run.attrs["repairs"]
