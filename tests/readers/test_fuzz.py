"""Whatever is done to an input, it is read (with its repairs recorded) or refused with an InputError: never anything else."""

from __future__ import annotations

import contextlib
import datetime
import logging
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deform.errors import InputError
from deform.readers.control import read_control
from deform.readers.raw_folder import read_raw_folder
from deform.readers.reader import read_source
from deform.run.raw import RawRun
from deform.run.schema import dataset_faults, validate_run
from tests.readers import small_listing as small
from tests.readers import tiny_run as tiny

FILES = ("run.toml", "imu.nc", "odometer.nc", "caliper.nc", "welds.csv", "markers.csv")
DATE = datetime.date(2015, 5, 1)
TEXT = st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\r\n\x00"), max_size=8)
quick = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def sound() -> dict[str, bytes]:
    """Return the files of a sound raw run."""
    with tempfile.TemporaryDirectory() as place:
        folder = tiny.write_raw(Path(place) / "tiny")
        return {name: (folder / name).read_bytes() for name in FILES}


@pytest.fixture(autouse=True)
def _quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def read_or_refused(files: dict[str, bytes]) -> RawRun | None:
    """Read a raw run of these files; None when it was refused. What is read must be fit for use."""
    with tempfile.TemporaryDirectory() as place:
        for name, content in files.items():
            (Path(place) / name).write_bytes(content)
        try:
            raw = read_raw_folder(Path(place))
        except InputError:
            return None
        for ds in (raw.imu, raw.odometer, *([raw.arms] if raw.arms is not None else [])):
            assert (np.diff(ds["time"].values) > 0).all()
        assert (np.diff(raw.odometer["count"].values, axis=0) >= 0).all()
        for group, ds in (("weld_events", raw.weld_events), ("passages", raw.passages)):
            assert ds is None or dataset_faults(group, ds) == []
        if raw.arms is not None:
            assert raw.arms["radius"].values.shape[0] == raw.arms.sizes["scan"]
            raw.arms.close()
        return raw


@quick
@given(name=st.sampled_from(FILES), share=st.floats(0, 1))
def test_a_file_cut_off_anywhere_is_read_or_refused(sound, name, share):
    content = sound[name][: int(share * len(sound[name]))]
    raw = read_or_refused(sound | {name: content})
    if name.endswith(".nc") and len(content) < len(sound[name]):
        assert raw is None


@quick
@given(
    name=st.sampled_from(["run.toml", "welds.csv", "markers.csv"]),
    edits=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=5),
)
def test_bytes_changed_in_a_text_file_are_read_or_refused(sound, name, edits):
    content = bytearray(sound[name])
    for share, value in edits:
        content[int(share * len(content))] = value
    read_or_refused(sound | {name: bytes(content)})


PARTS = {"imu": ("time", "gyro_count", "accel_count"), "odometer": ("time", "count"), "caliper": ("time", "arm_angle", "radius")}


@quick
@given(data=st.data())
def test_values_lost_or_changed_anywhere_are_read_or_refused(sound, data):
    part = data.draw(st.sampled_from(sorted(PARTS)))
    name = data.draw(st.sampled_from(PARTS[part]))
    ds = getattr(tiny, part)()
    values = ds[name].values.astype(float)
    where = data.draw(st.lists(st.integers(0, values.size - 1), min_size=1, max_size=6))
    value = data.draw(st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, 65535.0]))
    values.ravel()[where] = value
    attrs = {k: v for k, v in ds[name].attrs.items() if k != "_FillValue"}
    ds[name] = (ds[name].dims, values, attrs)
    with tempfile.TemporaryDirectory() as place:
        tiny.write_nc(Path(place) / "part.nc", ds)
        raw = read_or_refused(sound | {f"{part}.nc": (Path(place) / "part.nc").read_bytes()})
    if raw is not None and part != "caliper" and np.isnan(value):
        assert raw.repairs


def read_listing(rows: list[list[str]], header: list[str], place: Path) -> None:
    """Read a listing; a run that comes out follows the schema."""
    try:
        run = read_source(small.write(place, rows, header), small.write_map(place), date=DATE)
    except InputError:
        return
    validate_run(run)


@quick
@given(order=st.permutations(range(len(small.HEADER))))
def test_the_order_of_columns_does_not_matter(tmp_path, order):
    def shuffled(row):
        return [row[i] for i in order]

    run = read_source(
        small.write(tmp_path, [shuffled(r) for r in small.ROWS], shuffled(small.HEADER)), small.write_map(tmp_path), date=DATE
    )
    np.testing.assert_allclose(run["welds"]["joint_length"], [12, 11.5, 12.5, np.nan])
    np.testing.assert_allclose(run["dents"]["clock"], [165.0, 7.5])


@quick
@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(small.ROWS) - 1), st.integers(0, len(small.HEADER) - 1), st.one_of(TEXT, st.just(""))),
        max_size=8,
    ),
    dropped=st.sets(st.integers(0, len(small.ROWS) - 1), max_size=6),
)
def test_any_words_in_a_listing_are_read_or_refused(tmp_path, edits, dropped):
    rows = [list(r) for r in small.ROWS]
    for row, column, text in edits:
        rows[row][column] = text.replace(";", "").replace('"', "")
    read_listing([r for i, r in enumerate(rows) if i not in dropped], small.HEADER, tmp_path)


@quick
@given(share=st.floats(0, 1))
def test_a_listing_cut_off_anywhere_is_read_or_refused(tmp_path, share):
    path = small.write(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    try:
        run = read_source(path, small.write_map(tmp_path), date=DATE)
    except InputError:
        return
    validate_run(run)


@quick
@given(content=st.binary(max_size=200), suffix=st.sampled_from([".csv", ".xlsx", ".nc", ".txt", ".xls", ".ods"]))
def test_any_bytes_are_read_or_refused(tmp_path, content, suffix):
    path = tmp_path / f"any{suffix}"
    path.write_bytes(content)
    for columns in (None, small.write_map(tmp_path)):
        with pytest.raises(InputError):
            read_source(path, columns, date=DATE)
    with pytest.raises(InputError):
        read_control(path)


@quick
@given(cells=st.lists(st.lists(TEXT, min_size=4, max_size=4), min_size=1, max_size=4), crs=st.sampled_from([None, "EPSG:32610"]))
def test_any_words_in_a_control_table_are_read_or_refused(tmp_path, cells, crs):
    header = ["name", "latitude", "longitude", "height"] if crs is None else ["name", "easting", "northing", "height"]
    path = tmp_path / "control.csv"
    path.write_text(
        "\n".join(",".join(c.replace(",", "").replace('"', "") for c in row) for row in [header, *cells]), encoding="utf-8"
    )
    with contextlib.suppress(InputError):
        assert dataset_faults("control", read_control(path, crs)) == []
