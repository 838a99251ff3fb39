"""Screening of several output folders: one ranked table, and what could not be read is named."""

from __future__ import annotations

import change_lines as lines
import numpy as np
import pytest

from deform.change.compare import compare
from deform.change.screen import screen
from deform.change.trend import trends
from deform.run import store


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    places = []
    for name, size in (("still", 0.0), ("slow", 0.15), ("fast", 0.9)):
        line = lines.make_line(1500.0, seed=2)
        way = lines.bump(line.chainage, 800.0, 60.0, size)
        runs = [
            lines.make_run(lines.moved(line, lateral=share * way), f"r{k}", f"202{k}-01-01", seed=70 + k)
            for k, share in enumerate((0.0, 0.5, 1.0))
        ]
        comparison = compare(runs, lines.identity_matching(runs))
        folder = tmp_path_factory.mktemp("surveys") / name
        store.write_dataset(comparison.dataset, folder / "comparison.nc", "comparison")
        for table in ("zones", "dents", "limits"):
            store.write_table(getattr(comparison, table), folder / "tables" / f"{table}.csv", table)
        store.write_table(trends(comparison), folder / "tables" / "trends.csv", "trends")
        places.append(folder)
    return places


def test_lines_are_ranked_by_urgency_and_the_still_one_only_counts_as_seen(folders):
    found = screen(folders)
    assert list(found.table["rank"]) == list(range(1, len(found.table) + 1))
    assert found.table.line.iloc[0] == "fast"
    assert set(found.table.line) == {"fast", "slow"}
    assert list(found.lines.zones) == [0, 1, 1]
    assert np.isfinite(found.lines.least_movement_seen_m).all()
    assert not found.unread


def test_folder_that_cannot_be_read_is_named_and_stops_nothing(folders, tmp_path):
    found = screen([tmp_path / "nothing", folders[2]])
    assert found.unread[0][0].endswith("nothing")
    assert "no such file" in found.unread[0][1]
    assert len(found.lines) == 1
