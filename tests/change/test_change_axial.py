"""Strings of joints that grew together: found where they are, and what no string may claim."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from deform.change.axial_zones import axial_zones
from deform.change.zone_table import _flagged, _Group, zone_table
from deform.options import ChangeOptions
from deform.run import build

RUNS = ["r2013", "r2017", "r2022"]


def joints(growth, *, seed=0, weld=0.006, count=900):
    """Joint table of three runs; ``growth`` gives the added length of each joint by run."""
    rng = np.random.default_rng(seed)
    length = np.clip(rng.normal(12.0, 0.5, count), 8.0, 14.0)
    begin = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    frame = {"joint_id": [f"J{i}" for i in range(count)], "weld_id_start": [f"W{i}" for i in range(count)]}
    frame |= {"weld_id_end": [f"W{i + 1}" for i in range(count)], "reference_chainage_m": begin}
    for run in RUNS:
        added = np.zeros(count) + growth.get(run, 0.0)
        noise = np.diff(rng.normal(0.0, weld, count + 1)) if run != RUNS[0] else 0.0
        frame |= {f"length_m:{run}": length + added, f"change_m:{run}": added + noise}
        frame |= {f"change_sigma_m:{run}": np.full(count, 1.5 * weld)}
    return begin, build.table("joints", frame)


def stretch(first, last, total, count=900):
    out = np.zeros(count)
    out[first:last] = total / (last - first)
    return out


def test_zone_is_told_by_the_pairs_with_the_reference_run_whichever_shows_it_best():
    """Not by the order of a set of names, which changes from process to process."""
    first, second, step = (SimpleNamespace(reference=r) for r in ("r2013", "r2013", "r2017"))
    weak, strong = SimpleNamespace(statistic=40.0), SimpleNamespace(statistic=90.0)
    members = [(step, strong), (second, weak), (second, weak)]
    assert _flagged(_Group(0.0, 1.0, members), [first, second]) == [second]
    assert _flagged(_Group(0.0, 1.0, members[:1]), [first, second]) == [step]


def test_string_that_grew_is_found_where_and_when_it_grew():
    begin, table = joints({"r2022": stretch(300, 312, 0.15)})
    (zone,) = axial_zones(table, "r2013", RUNS, ChangeOptions())
    assert zone.run == "r2022"
    assert zone.change == pytest.approx(0.15, abs=4 * zone.sigma)
    assert min(zone.end, begin[312]) - max(zone.start, begin[300]) > 0.6 * (
        max(zone.end, begin[312]) - min(zone.start, begin[300])
    )
    assert zone.statistic > zone.limit
    assert zone.confidence > 0.99


def test_confidence_of_a_string_near_the_threshold_is_that_of_the_rate_of_false_alarms():
    options = ChangeOptions(false_alarms_per_100_km=5.0)
    zones = []
    for seed in range(6):
        begin, table = joints({"r2022": stretch(300, 304, 0.026)}, seed=seed)
        zones += axial_zones(table, "r2013", RUNS, options)
    told = zone_table([], [], zones, begin, None, 0.3, options).confidence
    least = 1.0 - options.false_alarms_per_100_km * begin[-1] / 1e5
    assert 0.3 < least < 0.6
    assert told.between(least - 0.02, 1.0).all()
    assert (told < 0.99).any()


def test_growth_between_the_last_runs_is_told_once_and_shortening_has_its_sign():
    _, table = joints({"r2017": stretch(500, 520, -0.2), "r2022": stretch(500, 520, -0.2)})
    (zone,) = axial_zones(table, "r2013", RUNS, ChangeOptions())
    assert zone.run in {"r2017", "r2022"}
    assert zone.change < 0


def test_reference_that_is_the_last_run_turns_no_sign():
    _, table = joints({"r2013": stretch(500, 520, -0.2), "r2017": stretch(500, 520, -0.2)})
    (zone,) = axial_zones(table, "r2022", RUNS, ChangeOptions())
    assert zone.change > 0
    assert zone.run == "r2022"


def test_joints_that_did_not_change_make_no_zone():
    assert not [zone for seed in range(6) for zone in axial_zones(joints({}, seed=seed)[1], "r2013", RUNS, ChangeOptions())]


def test_one_weld_set_wrong_is_no_strain_however_far():
    wrong = np.zeros(900)
    wrong[400], wrong[401] = 0.3, -0.3
    alone = np.zeros(900)
    alone[100] = 0.4
    for growth in (wrong, alone):
        assert not axial_zones(joints({"r2022": growth})[1], "r2013", RUNS, ChangeOptions())


def test_chainage_that_a_slip_carried_off_and_the_next_joint_gave_back_is_no_strain():
    slipped = np.zeros(900)
    slipped[300:303] = -0.05, -0.05, 0.1
    assert not axial_zones(joints({"r2022": slipped})[1], "r2013", RUNS, ChangeOptions())


def test_no_joints_make_no_zones():
    assert axial_zones(None, "r2013", RUNS, ChangeOptions()) == []
