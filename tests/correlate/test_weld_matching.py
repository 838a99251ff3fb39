"""All runs of a line: identities, statuses, maps, joints and edits, on lines with known truth and on two real listings."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from deform.correlate import match_runs
from deform.correlate.chainage import ChainageMap
from deform.errors import InputError, WrongLineError
from deform.options import MatchOptions
from deform.run import build
from tests.correlate.lines import JointList, bare, build_line, cut_out, observe, run_of

FOOT = 0.3048


def truth(matching, lists: dict[str, JointList]) -> pd.DataFrame:
    """Rows with an index, with the true identity of the weld (-1 none)."""
    rows = matching.welds[matching.welds["index"].notna()].copy()
    rows["true"] = [lists[r].weld[int(k)] for r, k in zip(rows["run"], rows["index"], strict=True)]
    return rows


def three_epochs(seed: int = 0, n: int = 400):
    """A line before and after a cut-out of six joints by seven, seen three times."""
    rng = np.random.default_rng(seed)
    first = build_line(rng, n, equal=0.1)
    later = cut_out(rng, first, 200, 6, 7)
    lists = {str(y): observe(rng, t, noise=0.02) for y, t in ((2019, first), (2021, first), (2023, later))}
    return first, later, lists, match_runs([run_of(k, v) for k, v in lists.items()])


def test_one_weld_has_one_identity_in_all_epochs():
    _, _, lists, matching = three_epochs()
    rows = truth(matching, lists)
    assert not rows.duplicated(["weld_id", "run"]).any()
    claimed = rows[(rows["status"] != "false") & (rows["true"] >= 0)]
    assert (claimed.groupby("weld_id")["true"].nunique() < 2).mean() > 0.998
    assert (claimed.groupby("true")["weld_id"].nunique() < 2).mean() > 0.998
    assert len(rows) == sum(v.place.size for v in lists.values())


def test_statuses_say_what_became_of_each_weld():
    first, later, lists, matching = three_epochs()
    rows = truth(matching, lists)
    false = rows["true"] < 0
    assert (rows[false]["status"] == "false").mean() > 0.9
    assert (rows[~false]["status"] == "false").mean() < 0.005
    gone, new = set(first.weld) - set(later.weld), set(later.weld) - set(first.weld)
    identity = rows[rows["true"] >= 0].groupby("weld_id")["true"].first()
    status = {
        (r, identity.get(w)): s
        for r, w, s in zip(matching.welds["run"], matching.welds["weld_id"], matching.welds["status"], strict=True)
    }
    seen = {r: set(v.weld) for r, v in lists.items()}
    assert all(status["2023", w] == "removed" for w in gone if w in seen["2019"] | seen["2021"])
    assert all(status["2023", w] == "added" for w in new & seen["2023"])
    assert not any(("2019", w) in status for w in new)
    missed = [w for w in set(first.weld) - gone if w not in seen["2021"] and w in seen["2019"] & seen["2023"]]
    assert missed
    assert all(status["2021", w] == "missed" for w in missed)
    cut = matching.edits[matching.edits["kind"] == "cutout"]
    assert len(cut) == 1
    assert cut.iloc[0]["start_m"] == pytest.approx(lists["2019"].place[np.searchsorted(lists["2019"].weld, 200)], abs=13.5)


def test_every_weld_that_is_not_matched_has_a_reason():
    _, _, _, matching = three_epochs()
    others = matching.welds[matching.welds["status"] != "matched"]
    assert (others["reason"].str.len() > 10).all()


def test_which_kind_a_replacement_is_stands_in_the_table_of_edits_alone():
    """Geometry may call a cut-out a re-route after the matching: no other table may then contradict."""
    _, _, _, matching = three_epochs()
    replaced = matching.welds["reason"] == "pipe replaced between 2021 and 2023"
    assert set(matching.welds["status"][replaced]) == {"removed", "added"}
    assert "2021: pipe replaced" in set(matching.joints["ends"])
    assert "2023: pipe replaced" in set(matching.joints["begins"])
    words = pd.concat([matching.welds["reason"], matching.joints["begins"], matching.joints["ends"]])
    assert not words.str.contains("cutout|reroute", case=False).any()


def test_eight_epochs_close_every_cycle():
    rng = np.random.default_rng(1)
    true = build_line(rng, 300)
    lists = {}
    for k in range(8):
        if k in (3, 6):
            true = cut_out(rng, true, int(rng.integers(50, 250)), 5, 6)
        lists[f"r{k}"] = observe(rng, true, noise=0.02, scale=rng.uniform(0.99, 1.01))
    rows = truth(match_runs([run_of(k, v) for k, v in lists.items()]), lists)
    claimed = rows[(rows["status"] != "false") & (rows["true"] >= 0)]
    assert not claimed.duplicated(["weld_id", "run"]).any()
    assert (claimed.groupby("weld_id")["true"].nunique() >= 2).sum() <= 1
    assert (claimed.groupby("true")["weld_id"].nunique() >= 2).sum() <= 1


def test_map_follows_the_pipe_and_says_where_it_does_not_hold():
    rng = np.random.default_rng(2)
    first = build_line(rng, 400, equal=0.1)
    later = cut_out(rng, first, 200, 6, 7)
    lists = {"a": observe(rng, first, noise=0.01), "b": observe(rng, later, noise=0.01, scale=1.02)}
    chainage = match_runs([run_of(k, v) for k, v in lists.items()]).maps["b"]
    common = np.intersect1d(lists["a"].weld[lists["a"].weld >= 0], lists["b"].weld[lists["b"].weld >= 0])
    at = {k: v.place[[np.flatnonzero(v.weld == w)[0] for w in common]] for k, v in lists.items()}
    np.testing.assert_allclose(chainage.to_run(at["a"]), at["b"], atol=0.2)
    s = np.linspace(at["a"][0], at["a"][-1], 1000)
    np.testing.assert_allclose(chainage.to_reference(chainage.to_run(s)), s, atol=1e-9)
    assert (np.diff(chainage.to_run(s)) > 0).all()
    inside = 0.5 * (first.place[200] + first.place[206])
    assert not chainage.valid(inside)
    assert chainage.sigma(inside) > chainage.sigma(first.place[100])
    assert chainage.valid(first.place[100])
    assert not chainage.valid(at["a"][-1] + 50.0)
    assert not chainage.valid(at["a"][0] - 50.0)


def test_a_raw_run_whose_header_says_the_wrong_direction_is_refused_by_name():
    rng = np.random.default_rng(3)
    true = build_line(rng, 80)
    runs = {name: run_of(name, observe(rng, true, missed=0, false=0)) for name in ("a", "b")}
    runs["c"] = run_of("c", observe(rng, true, missed=0, false=0, reverse=True))
    match_runs(list(runs.values()))  # a listing may be made in either direction
    for name, run in runs.items():
        run.attrs |= {"source": "raw", "direction": "upstream" if name == "c" else "downstream"}
    with pytest.raises(InputError, match="reverse order of those of a, b") as caught:
        match_runs(list(runs.values()))
    assert [fault.where for fault in caught.value.faults] == ["c"]


def test_a_listing_in_the_other_direction_has_a_map_that_falls():
    rng = np.random.default_rng(3)
    true = build_line(rng, 300, equal=0.1)
    lists = {"a": observe(rng, true), "b": observe(rng, true, reverse=True), "c": observe(rng, true)}
    matching = match_runs([run_of(k, v) for k, v in lists.items()])
    assert matching.maps["b"].direction == -1
    assert matching.maps["c"].direction == 1
    rows = truth(matching, lists)
    claimed = rows[(rows["status"] != "false") & (rows["true"] >= 0)]
    assert (claimed.groupby("weld_id")["true"].nunique() < 2).all()
    s = np.linspace(100.0, 2000.0, 50)
    np.testing.assert_allclose(matching.maps["b"].to_reference(matching.maps["b"].to_run(s)), s, atol=1e-9)


def test_length_change_of_a_joint_is_found_with_its_sigma():
    rng = np.random.default_rng(4)
    true = build_line(rng, 300, equal=0.1)
    longer = bare(true.place + np.where(np.arange(true.place.size) > 150, 0.15, 0.0), true.weld)
    lists = {k: observe(rng, t, missed=0, false=0, noise=0.01) for k, t in (("a", true), ("b", longer))}
    joints = match_runs([run_of(k, v) for k, v in lists.items()]).joints
    at = joints.iloc[150]
    assert at["change_m:b"] == pytest.approx(0.15, abs=0.06)
    assert at["change_m:b"] > 5 * at["change_sigma_m:b"]
    z = joints["change_m:b"] / joints["change_sigma_m:b"]
    assert 0.8 < z.drop(index=150).std() < 1.25


def test_a_weld_that_the_detector_doubts_and_nobody_else_shows_is_false():
    rng = np.random.default_rng(5)
    true = build_line(rng, 200)
    a, b = (observe(rng, true, missed=0, false=0, noise=0.01) for _ in range(2))
    probability = np.full(b.place.size + 1, 0.95)
    place = np.insert(b.place, 101, b.place[100] + 5.0)
    probability[101] = 0.2
    doubted = build.dataset("welds", {"chainage": place, "probability": probability})
    matching = match_runs([run_of("a", a), build.run_tree({"id": "b", "date": "b", "source": "raw"}, welds=doubted)])
    row = matching.welds[(matching.welds["run"] == "b") & (matching.welds["index"] == 101)].iloc[0]
    assert row["status"] == "false"
    assert "0.20" in row["reason"]


def test_a_doubted_weld_of_new_pipe_counts_when_the_joint_would_be_too_long_without_it():
    rng = np.random.default_rng(15)
    first = build_line(rng, 200, equal=0.1)
    later = cut_out(rng, first, 100, 6, 7)
    a, b = observe(rng, first, missed=0, false=0, noise=0.01), observe(rng, later, missed=0, false=0, noise=0.01)
    new = np.flatnonzero(b.weld > first.weld.max())
    lengths = np.diff(b.place)
    doubted = int(new[np.argmax(lengths[new - 1] + lengths[new])])
    probability = np.full(b.place.size, 0.97)
    probability[doubted] = 0.4
    welds = build.dataset("welds", {"chainage": b.place, "probability": probability})
    matching = match_runs([run_of("a", a), build.run_tree({"id": "b", "date": "b", "source": "raw"}, welds=welds)])
    row = matching.welds[(matching.welds["run"] == "b") & (matching.welds["index"] == doubted)].iloc[0]
    assert row["status"] == "added"


def test_doubled_and_unsorted_rows_are_said_and_survive(caplog):
    rng = np.random.default_rng(6)
    true = build_line(rng, 200)
    a, b = (observe(rng, true, missed=0, false=0, noise=0.01) for _ in range(2))
    place = np.insert(b.place, 51, b.place[50] + 0.01)[::-1]
    matching = match_runs([run_of("a", a), run_of("b", bare(place, place))])
    assert "not sorted" in caplog.text
    assert "doubles" in caplog.text
    mine = matching.welds[matching.welds["run"] == "b"]
    assert len(mine) == place.size
    assert (mine["status"] == "false").sum() == 1
    assert (mine["status"] == "matched").sum() == a.place.size


def test_walls_and_seams_pin_the_ends_of_a_cut_out_of_equal_pipe():
    rng = np.random.default_rng(7)
    joints = np.where(rng.random(400) < 0.9, 12.2, rng.uniform(3, 11, 400))
    joints[190:210] = 12.2
    true = bare(np.concatenate([[0.0], np.cumsum(joints)]), np.arange(401))
    a, b = (observe(rng, true, missed=0, false=0, noise=0.02) for _ in range(2))
    seam, wall = rng.uniform(0, 360, 401), np.where(rng.random(401) < 0.3, 0.0127, 0.0087)
    new_seam, new_wall = (seam + 40.0 + rng.normal(0, 5, 401)) % 360.0, wall.copy()
    new_seam[197:203] = rng.uniform(0, 360, 6)
    new_wall[197:203] = np.where(wall[197:203] > 0.01, 0.0087, 0.0127)
    inner = np.zeros(b.place.size)
    inner[198:203] = [0.9, -0.8, 1.1, -0.7, 0.6]
    runs = [
        run_of("a", a, seam_clock=seam, wall_thickness=wall),
        run_of("b", bare(b.place + inner, b.weld), seam_clock=new_seam, wall_thickness=new_wall),
    ]
    matching = match_runs(runs)
    cut = matching.edits[matching.edits["kind"] == "cutout"]
    assert len(cut) == 1
    assert cut.iloc[0]["start_m"] == pytest.approx(a.place[197], abs=0.01)
    assert cut.iloc[0]["end_m"] == pytest.approx(a.place[203], abs=0.01)


def test_locks_are_honoured_and_faults_in_them_are_named():
    rng = np.random.default_rng(8)
    true = build_line(rng, 100)
    a, b = (observe(rng, true, missed=0, false=0) for _ in range(2))
    runs = [run_of("a", a), run_of("b", b)]
    locks = pd.DataFrame(
        [["a", 40, "b", 41, "lock"], ["b", 60, "a", 60, "forbid"]], columns=["run_a", "index_a", "run_b", "index_b", "kind"]
    )
    welds = match_runs(runs, locks=locks).welds
    ids = {(r, int(k)): w for r, k, w in zip(welds["run"], welds["index"].fillna(-1), welds["weld_id"], strict=True)}
    assert ids["a", 40] == ids["b", 41]
    assert ids["a", 60] != ids["b", 60]
    assert ids["a", 20] == ids["b", 20]
    with pytest.raises(InputError, match="kind"):
        match_runs(runs, locks=locks.assign(kind="perhaps"))
    crossed = pd.DataFrame([["a", 40, "b", 41, "lock"], ["a", 41, "b", 40, "lock"]], columns=locks.columns)
    with pytest.raises(InputError, match="cross"):
        match_runs(runs, locks=crossed)
    with pytest.raises(InputError, match="not in the run"):
        match_runs(runs, locks=locks.assign(index_a=1000))


def test_runs_of_two_lines_are_refused_with_the_numbers():
    rng = np.random.default_rng(9)
    runs = [run_of("a", observe(rng, build_line(rng, 300))), run_of("b", observe(rng, build_line(rng, 300)))]
    with pytest.raises(WrongLineError, match=r"a and b.*\d+ and \d+ welds"):
        match_runs(runs)


def test_runs_without_welds_and_doubled_ids_are_named():
    rng = np.random.default_rng(10)
    good = run_of("a", observe(rng, build_line(rng, 100)))
    bare = build.run_tree({"id": "bare", "date": "b", "source": "raw"})
    with pytest.raises(InputError, match=r"bare.*welds"):
        match_runs([good, bare])
    with pytest.raises(InputError, match="twice"):
        match_runs([good, good])
    with pytest.raises(InputError, match="reference"):
        match_runs([good], reference="none")


def test_one_run_alone_is_its_own_reference():
    rng = np.random.default_rng(11)
    matching = match_runs([run_of("a", observe(rng, build_line(rng, 100)))])
    assert matching.reference == "a"
    np.testing.assert_allclose(matching.maps["a"].to_run([10.0, 50.0]), [10.0, 50.0])
    assert len(matching.joints) > 90


def test_no_weld_of_one_run_takes_two_of_another_under_repeated_labels():
    rng = np.random.default_rng(12)
    true = build_line(rng, 200)
    a, b = (observe(rng, true, missed=0, false=0) for _ in range(2))
    labels = np.asarray([str(10 * (k % 50)) for k in range(a.place.size)], object)
    welds = match_runs([run_of("a", a, label=labels), run_of("b", b, label=labels)]).welds
    assert not welds.duplicated(["weld_id", "run"]).any()
    assert (welds["status"] == "matched").all()


def test_a_list_half_in_feet_is_said_and_its_other_half_matched(caplog):
    rng = np.random.default_rng(22)
    true = build_line(rng, 400, equal=0.2)
    a, b = (observe(rng, true, missed=0, false=0, noise=0.01) for _ in range(2))
    joints = np.diff(b.place)
    joints[250:] /= 0.3048
    mixed = bare(np.concatenate([[0.0], np.cumsum(joints)]), b.weld)
    rows = truth(match_runs([run_of("a", a), run_of("b", mixed)]), {"a": a, "b": mixed})
    assert "foot and metre" in caplog.text
    both = rows[(rows["status"] == "matched") & (rows["true"] < 250)].groupby("weld_id")["true"].agg(["nunique", "size"])
    assert (both["nunique"] == 1).all()
    assert (both["size"] == 2).mean() > 0.98


def test_joints_of_zero_length_are_doubles_and_cost_no_other_weld():
    rng = np.random.default_rng(23)
    true = build_line(rng, 200)
    a, b = (observe(rng, true, missed=0, false=0, noise=0.01) for _ in range(2))
    place = np.sort(np.concatenate([b.place, b.place[[40, 41, 90]]]))
    mine = match_runs([run_of("a", a), run_of("b", bare(place, place))]).welds
    mine = mine[mine["run"] == "b"]
    assert (mine["status"] == "false").sum() == 3
    assert (mine["status"] == "matched").sum() == a.n


def test_every_stretch_says_how_much_it_outweighs_the_next_best():
    _, _, _, matching = three_epochs()
    table = matching.stretches
    assert set(table["run_a"]) == {"2019", "2021"}
    assert (table.groupby(["run_a", "run_b"])["welds"].sum() > 350).all()
    long = table[table["welds"] > 100]
    assert (long["margin_nats"] > 100).all()
    assert (table["margin_nats"] > -1e-6).all()
    changed = table[(table["run_a"] == "2021") & (table["run_b"] == "2023") & (table["welds"] > 50)]
    assert len(changed) == 2  # before and behind the cut-out


def test_sigma_of_the_map_is_honest_at_welds_that_took_no_part_in_it():
    z = []
    for seed in range(6):
        rng = np.random.default_rng(40 + seed)
        true = build_line(rng, 300, equal=0.1)
        a, b = (observe(rng, true, missed=0.02, false=0.02, noise=0.03) for _ in range(2))
        chainage = match_runs([run_of("a", a), run_of("b", b)]).maps["b"]
        common = np.intersect1d(a.weld[a.weld >= 0], b.weld)
        at = [v.place[[np.flatnonzero(v.weld == w)[0] for w in common]] for v in (a, b)]
        held = np.isin(at[0], chainage.reference)
        for k in np.flatnonzero(held)[1:-1:7]:  # leave this weld out of the map
            keep = chainage.reference != at[0][k]
            without = ChainageMap("b", chainage.reference[keep], chainage.own[keep], chainage.node_sigma)
            z.append((without.to_run(at[0][k]) - at[1][k]) / without.sigma(at[0][k]))
    assert 0.90 < np.mean(np.abs(z) < 1.96) <= 1.0


# ---- the two real listings -----------------------------------------------------------------------------


def listing(path, event: str, distance: str, word: str):
    """Girth welds of a listing: joint numbers and places (metre)."""
    frame = pd.read_csv(path, dtype=str)
    frame.columns = [" ".join(c.split()) for c in frame.columns]
    rows = frame[frame[event].str.strip() == word]
    return rows["J. no."].astype(float).to_numpy(), rows[distance].str.replace(",", "").astype(float).to_numpy() * FOOT


@pytest.fixture(scope="module")
def listings(real):
    folder = real / "ili_two_runs"
    return {
        "2007": listing(folder / "ili_2007.csv", "event", "log dist. [ft]", "Girth Weld"),
        "2015": listing(folder / "ili_2015.csv", "Event Description", "Log Dist. [ft]", "GirthWeld"),
    }


@pytest.mark.demo
@pytest.mark.parametrize("turned", [False, True])
def test_the_two_real_listings_are_matched_without_one_fault_from_lengths_alone(listings, turned):
    places = {k: v[1] for k, v in listings.items()}
    numbers = {k: v[0] for k, v in listings.items()}
    if turned:
        places["2015"], numbers["2015"] = 20000.0 - places["2015"][::-1], numbers["2015"][::-1]
    matching = match_runs([run_of(k, bare(p, p), probability=np.ones(p.size)) for k, p in places.items()], MatchOptions())
    rows = matching.welds[matching.welds["index"].notna()]
    number = [numbers[r][int(k)] for r, k in zip(rows["run"], rows["index"], strict=True)]
    claimed = rows.assign(number=number)
    claimed = claimed[claimed["status"] != "false"]
    both = claimed[claimed["run"] == "2007"].merge(claimed[claimed["run"] == "2015"], on="weld_id")
    assert (both["number_x"] == both["number_y"]).all()
    assert len(both) == len(set(numbers["2007"]) & set(numbers["2015"]))
    assert set(claimed[claimed["status"] == "shifted"]["number"]) == {4160.0}
    missed = matching.welds[matching.welds["status"] == "missed"]["weld_id"]
    assert set(claimed[claimed["weld_id"].isin(missed)]["number"]) == {70.01, 210.01, 4380.0, 4390.0}
    assert (both[["probability_x", "probability_y"]].min(axis=1) > 0.9).all()
