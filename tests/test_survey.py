"""The main job on real input: three raw runs with truth, two vendor listings, both mixed; stopped, resumed, refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from deform.errors import InputError
from deform.ledger import key_of
from deform.run import store
from deform.survey import run_survey
from deform.survey_file import read_survey
from tests.judged import judge, judge_tally, short, values
from tests.readers.small_listing import PIPE_BOOK_MAP

LISTINGS = """
[[runs]]
tally = "{real}/ili_two_runs/ili_2007.csv"
columns = "rosen"
id = "2007"
date = 2007-06-01
[[runs]]
tally = "{real}/ili_two_runs/ili_2015.csv"
columns = "baker-hughes"
id = "2015"
date = 2015-05-01
"""


def _survey(folder: Path, runs: str, formats: str = '["html"]') -> Path:
    path = folder / "survey.toml"
    path.write_text(f'[line]\nname = "a line"\n{runs}\n[outputs]\nfolder = "out"\nformats = {formats}\n')
    return path


def _raw(demo: Path, *run_ids: str) -> str:
    return "".join(f'[[runs]]\nraw = "{demo / run_id}"\n' for run_id in run_ids)


@pytest.fixture(scope="session")
def demo_out(demo, tmp_path_factory):
    """Output folder of the three raw demonstration runs."""
    folder = tmp_path_factory.mktemp("demo")
    return run_survey(_survey(folder, _raw(demo, "demo-2019", "demo-2021", "demo-2023")))


@pytest.fixture(scope="session")
def demo_findings(shared, demo_out):
    """What the judge finds in it."""
    return judge(shared, demo_out)


@pytest.fixture(scope="session")
def listings_out(real, tmp_path_factory):
    """Output folder of the two vendor listings."""
    folder = tmp_path_factory.mktemp("listings")
    return run_survey(_survey(folder, LISTINGS.format(real=real)))


@pytest.mark.parametrize("section", ["files", "matching"])
def test_demo_survey_meets_every_bar_of_a_section(demo_findings, section):
    assert short(demo_findings, section) == []
    assert any(f["section"] == section and f["result"] == "ok" for f in demo_findings)


def test_centreline_of_each_demo_run_lies_within_two_metres(demo_findings):
    rms = values(demo_findings, "navigation", "horizontal_rms_m")
    assert len(rms) == 3
    assert max(rms.values()) <= 2.0


def test_ledger_tells_time_memory_inputs_and_what_is_missing(demo_out):
    content = json.loads((demo_out / "survey.json").read_text())
    stages = {s["name"]: s for s in content["stages"]}
    assert set(stages) >= {"process demo-2019", "process demo-2021", "process demo-2023", "match", "compare", "report"}
    assert all(s["status"] == "done" and s["seconds"] > 0 for s in stages.values())
    assert max(s["peak_memory_mb"] for s in stages.values()) < 3000  # the bar of the main job
    assert {r["id"] for r in content["runs"]} == {"demo-2019", "demo-2021", "demo-2023"}
    assert all(len(digest) == 64 for digest in content["runs"][0]["inputs"].values())
    assert content["options"]["strain"]["gauge_length_m"] > 0


def test_report_of_the_demo_names_the_line_and_loads_nothing_from_outside(demo_out):
    page = (demo_out / "report" / "index.html").read_text()
    assert "a line" in page
    assert "demo-2023" in page
    assert 'src="http' not in page
    assert 'href="http' not in page.split("</head>")[0]


def test_table_of_doglegs_holds_the_induction_bends_of_every_run(demo_out):
    table = store.read_table(demo_out / "tables" / "doglegs.csv", "doglegs")
    bends = table[(table.kind == "bend") & (table[["angle_horizontal_deg", "angle_vertical_deg"]].abs().max(axis=1) > 25)]
    assert (bends.groupby("run").size() == 2).all()  # the line has two, 5 diameters in radius
    assert set(bends.run) == {"demo-2019", "demo-2021", "demo-2023"}


def test_second_run_takes_over_what_is_complete(demo_out):
    seen = []
    run_survey(read_survey(demo_out.parent / "survey.toml"), progress=lambda *event: seen.append(event))
    resumed = {stage for stage, _, state in seen if state == "resumed"}
    assert resumed >= {"process demo-2019", "process demo-2021", "process demo-2023", "match", "compare"}


def test_stage_whose_file_was_cut_off_is_run_again(listings_out):
    path = listings_out / "runs" / "2015.nc"
    path.write_bytes(path.read_bytes()[:1000])
    seen = []
    run_survey(read_survey(listings_out.parent / "survey.toml"), progress=lambda *event: seen.append(event))
    assert ("process 2015", 1.0, "done") in seen
    assert ("process 2007", 1.0, "resumed") in seen
    assert store.read_run(path).attrs["id"] == "2015"


def test_listings_of_two_vendors_are_matched_without_a_wrong_pair(shared, listings_out):
    findings = judge_tally(shared, listings_out)
    assert short(findings, "tally") == []
    assert values(findings, "tally", "f1")["2007 2015"] >= 0.999
    assert values(findings, "tally", "wrong")["2007 2015"] == 0


def test_every_unmatched_weld_of_the_listings_has_a_reason(listings_out):
    welds = store.read_table(listings_out / "tables" / "welds.csv", "welds")
    lonely = welds[~welds.status.isin(["matched"])]
    assert len(lonely) > 0
    assert (lonely.reason.str.len() > 5).all()


def test_known_oddities_of_the_listings_are_named(listings_out):
    welds = store.read_table(listings_out / "tables" / "welds.csv", "welds")
    labels = {
        run: store.read_run(listings_out / "runs" / f"{run}.nc", ["welds"])["welds"]["label"].values for run in ("2007", "2015")
    }
    of_2015 = welds[(welds.run == "2015") & welds["index"].notna()]
    by_label = {str(labels["2015"][int(i)]).removesuffix(".0"): s for i, s in zip(of_2015["index"], of_2015.status, strict=True)}
    assert by_label["4160"] == "shifted"
    missed = welds[(welds.run == "2007") & (welds.status == "missed")]
    assert len(missed) >= 2  # the two welds inside joint 4370, which 2007 does not list


@pytest.mark.parametrize("formats", ['["html"]'])
def test_survey_of_one_run_gives_its_inventory_and_no_comparison(demo, tmp_path, formats):
    out = run_survey(_survey(tmp_path, _raw(demo, "demo-2021"), formats))
    assert (out / "runs" / "demo-2021.nc").exists()
    assert (out / "report" / "index.html").exists()
    assert store.read_table(out / "tables" / "zones.csv", "zones").empty


def test_raw_run_and_listing_meet_in_one_survey(demo_out, demo, tmp_path):
    """A listing written from a raw run's own weld log is of the same line and must meet it weld by weld."""
    welds = store.read_run(demo_out / "runs" / "demo-2019.nc", ["welds"])["welds"].to_dataset()
    place = welds.chainage.values[welds.probability.values > 0.5]
    listing = pd.DataFrame(
        {"distance": (place - place[0]) * 1.001 + 7.0, "event": "girth weld", "joint": range(10, 10 + 10 * len(place), 10)}
    )
    listing.to_csv(tmp_path / "listing.csv", index=False)
    (tmp_path / "own.toml").write_text(OWN_MAP)
    runs = '[[runs]]\ntally = "listing.csv"\ncolumns = "own.toml"\nid = "2017"\ndate = 2017-01-01\n' + _raw(demo, "demo-2019")
    survey = _survey(tmp_path, runs)
    out = run_survey(survey)
    table = store.read_table(out / "tables" / "welds.csv", "welds")
    both = table[table.status == "matched"].groupby("weld_id").run.nunique()
    assert (both == 2).sum() >= 0.99 * len(place)


OWN_MAP = """
name = "own"
title = "a map written for this test"
[columns]
distance = { header = "distance", unit = "m" }
event = "event"
joint = "joint"
[[rows]]
kind = "weld"
event = "girth weld"
"""


# ---- bad input -------------------------------------------------------------------------------------


def test_pipe_book_tells_a_raw_run_how_long_its_joints_are(demo, tmp_path):
    joints = pd.read_csv(demo / "truth" / "demo-2019" / "joints_truth.csv")
    measured = joints.length_m + np.random.default_rng(4).normal(0.0, 0.008, len(joints))
    welds = pd.DataFrame({"Distance [m]": np.cumsum(measured)[:-1].round(3), "Event": "girth weld"})
    welds.to_csv(tmp_path / "book.csv", index=False)
    (tmp_path / "book.toml").write_text(PIPE_BOOK_MAP)
    (tmp_path / "straights.csv").write_text("from_m,to_m,sigma_deg\n425.6,463.2,0.02\n808.1,845.5,0.03\n")
    survey = _survey(tmp_path, _raw(demo, "demo-2019"), "[]")
    book = '[pipe_book]\njoints = "book.csv"\ncolumns = "book.toml"\nstraights = "straights.csv"\n'
    survey.write_text(survey.read_text() + book)
    run = store.read_run(run_survey(survey) / "runs" / "demo-2019.nc", ["welds", "centreline"])
    said = run.attrs["pipe_book"].split()
    assert int(said[0]) > 300
    assert "2 straight stretches" in run.attrs["pipe_book"]
    with xr.open_dataset(demo / "truth" / "demo-2019" / "truth.nc", decode_times=False) as true:
        found, places = run["welds"]["chainage"].values, np.interp(run["welds"]["time"].values, true.time, true.chainage)
    off = found - places
    assert np.std(off) < 0.1  # 4 km; the wheels alone are off by 0.4 % before markers


def test_all_faults_of_a_survey_file_are_listed_at_once(tmp_path):
    path = tmp_path / "survey.toml"
    path.write_text('[line]\nname = "x"\n[[runs]]\nraw = "nowhere"\n[[runs]]\ntally = "none.csv"\n[[runs]]\nraw="a"\ntally="b"\n')
    with pytest.raises(InputError) as caught:
        read_survey(path)
    text = str(caught.value)
    for part in ("nowhere: no such folder", "none.csv: no such file", "columns: is missing", "exactly one of them"):
        assert part in text


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[line]\nname = 'x'\nnmae = 'y'\n", "line.nmae: unknown option"),
        ("[line]\nname = 'x'\n[options]\nstrain.gauge = 2\n", "strain.gauge: unknown option; known here are gauge_length_m"),
        ("[line\n", "is no TOML"),
        ("[line]\nname = 'x'\nruns = []\n", "unknown option"),
    ],
)
def test_survey_file_that_cannot_be_is_answered_with_key_and_rule(tmp_path, text, part):
    path = tmp_path / "survey.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=part):
        read_survey(path)


def test_run_of_another_line_is_refused_and_nothing_half_written(demo, real, tmp_path):
    runs = _raw(demo, "demo-2019") + LISTINGS.format(real=real).split("[[runs]]\n")[1].join(["[[runs]]\n", ""])
    survey = _survey(tmp_path, runs)
    with pytest.raises(InputError, match="line"):
        run_survey(survey)
    assert not (tmp_path / "out" / "tables").exists()
    assert not list((tmp_path / "out").rglob(".*-*"))


def test_truncated_input_stops_with_the_file_named_and_keeps_what_was_complete(demo, tmp_path):
    for run_id in ("demo-2019", "demo-2021"):
        shutil.copytree(demo / run_id, tmp_path / run_id)
    broken = tmp_path / "demo-2021" / "imu.nc"
    broken.chmod(0o644)
    broken.write_bytes(broken.read_bytes()[:100_000])
    with pytest.raises(InputError, match=r"imu\.nc"):
        run_survey(_survey(tmp_path, '[[runs]]\nraw = "demo-2019"\n[[runs]]\nraw = "demo-2021"\n'))
    assert (tmp_path / "out" / "runs" / "demo-2019.nc").exists()
    assert not (tmp_path / "out" / "runs" / "demo-2021.nc").exists()
    content = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert {s["name"]: s["status"] for s in content["stages"]}["process demo-2021"] == "failed"


def test_key_of_a_stage_depends_on_every_part():
    assert key_of("a", {"x": 1}) == key_of("a", {"x": 1})
    assert len({key_of("a", {"x": 1}), key_of("a", {"x": 2}), key_of("b", {"x": 1})}) == 3
