"""Steps of the wall that are welds and steps that are not: recesses, collars, and welds from pipe to thicker pipe."""

from __future__ import annotations

import datetime

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from caliper_runs import demo_run, true_trajectory

from deform.caliper.measure import measure
from deform.caliper.weld_chain import with_joint_lengths
from deform.caliper.weld_channels import HEARD, Channel, arms_piece
from deform.caliper.welds import weld_log
from deform.options import RouteOptions, RunOptions, SimulateOptions, ToolOptions
from deform.synthetic.simulate import simulate

LENGTH = 720.0
WELDS = np.arange(12.0, LENGTH - 1.0, 12.0) + np.random.default_rng(3).normal(0.0, 0.1, 59)
STEP_WELDS = WELDS[[15, 40]]  # the wall changes by 2 mm there and no bead shows
RECESSES = np.arange(5, 55, 6) * 12.0 + np.random.default_rng(8).uniform(2.0, 9.0, 9)
MIDDLES = {"recess": 0.004, "collar": -0.004}


def trajectory():
    place = np.arange(0.0, LENGTH, 0.1)
    return xr.Dataset(dict.fromkeys(("chainage", "log_distance"), ("time", place)), coords={"time": place})


def ring(seed, depth=0.0, width=0.3, moved=0.0):
    """Scans of one ring over the line: beads at all welds but two, at those a lasting step; recesses of the given depth."""
    place = np.arange(0.0, LENGTH, 0.005) + moved
    radius = 0.25 + np.random.default_rng(seed).normal(0.0, 5e-5, place.size)
    for weld in np.setdiff1d(WELDS, STEP_WELDS):
        radius -= 0.0012 * np.exp(-0.5 * ((place - weld) / 0.006) ** 2)
    radius[(place > STEP_WELDS[0]) & (place < STEP_WELDS[1])] -= 0.002
    for start in RECESSES:
        radius[(place > start) & (place < start + width)] += depth
    return arms_piece(place, radius)


def heard(name, place, score, seed):
    """A channel that hears the given places, each to a centimetre."""
    place = np.sort(place + np.random.default_rng(seed).normal(0.0, 0.01, np.size(place)))
    level = np.full(place.size, score)
    return Channel(name, place, level, 0.0 * level, place, level, np.array([[0.0, LENGTH]]))


def sure(log):
    return log.chainage.values[log.probability.values >= 0.5]


def assert_welds_and_nothing_else(log):
    found = sure(log)
    assert found.size == WELDS.size
    assert np.abs(found - WELDS).max() < 0.04


@pytest.mark.parametrize("rings", [1, 2])
@pytest.mark.parametrize("width", [0.16, 0.3, 0.5])
@pytest.mark.parametrize("kind", list(MIDDLES))
def test_arms_alone_claim_welds_at_wall_steps_but_no_edge_of_a_recess_or_collar(kind, width, rings):
    channels = [ring(k, MIDDLES[kind], width, 0.002 * k) for k in range(rings)]
    assert_welds_and_nothing_else(weld_log(channels, trajectory(), nominal_joint=12.0))


def test_a_silent_detector_and_silent_accelerometers_beside_the_arms_leave_a_recess_no_weld():
    others = [heard("detector", WELDS, HEARD, 1), heard("accelerometer", WELDS, 30.0, 2)]
    log = weld_log([others[0], ring(1, 0.004), ring(2, 0.004), others[1]], trajectory(), nominal_joint=12.0)
    assert_welds_and_nothing_else(log)
    assert np.abs(log.chainage.values[:, None] - RECESSES).min() > 1.0


def test_a_weld_at_a_wall_step_is_claimed_when_no_other_channel_heard_it():
    others = [heard("detector", np.setdiff1d(WELDS, STEP_WELDS), HEARD, 1)]
    others.append(heard("accelerometer", np.setdiff1d(WELDS, STEP_WELDS), 30.0, 2))
    assert_welds_and_nothing_else(weld_log([*others, ring(1, 0.004), ring(2, 0.004)], trajectory(), nominal_joint=12.0))


def test_a_weld_that_the_others_hear_at_the_edge_of_a_recess_is_believed():
    """The arms cannot tell there and must not vote against it."""
    real = np.append(WELDS, RECESSES[3])
    channels = [heard("detector", real, HEARD, 1), ring(1, 0.004), ring(2, 0.004), heard("accelerometer", real, 30.0, 2)]
    found = sure(weld_log(channels, trajectory(), nominal_joint=12.0))
    assert found.size == real.size
    assert np.abs(found - RECESSES[3]).min() < 0.05


def test_two_rings_fooled_by_one_cause_are_no_surer_than_one():
    rng = np.random.default_rng(5)
    places = np.sort(np.append(WELDS, 305.0))
    level = np.append(rng.uniform(8.0, 20.0, 59), 12.0)[np.argsort(np.append(WELDS, 305.0))]
    arms = Channel("arms", places, level, 0.0 * level, places, level, np.array([[0.0, LENGTH]]))
    detector = heard("detector", WELDS, HEARD, 1)

    def doubt(*rings):
        log = weld_log([detector, *rings], trajectory(), nominal_joint=12.0)
        near = np.abs(log.chainage.values - 305.0) < 0.1
        return log.probability.values[near].max(initial=0.0)

    assert doubt(arms, arms) == pytest.approx(doubt(arms), abs=0.02)


def test_both_ends_of_a_piece_shorter_than_any_pup_are_improbable_even_when_many_such_seem_sure():
    place = np.sort(np.concatenate([WELDS, RECESSES, RECESSES + 0.3]))
    among = np.isin(place, WELDS)
    probability = with_joint_lengths(place, np.where(among, 1.0, 0.96), 12.0)
    assert probability[among].min() > 0.9
    assert probability[~among].reshape(-1, 2).sum(axis=1).max() < 1.5


def test_a_piece_shorter_than_any_pup_is_believed_when_two_kinds_of_channel_hear_both_its_ends():
    real = np.sort(np.append(WELDS, WELDS[20] + 0.4))
    channels = [heard("detector", real, HEARD, 1), heard("accelerometer", real, 30.0, 2)]
    found = sure(weld_log(channels, trajectory(), nominal_joint=12.0))
    assert found.size == real.size
    assert np.abs(found - real).max() < 0.04


@pytest.mark.parametrize("score", [HEARD, 22.0])
def test_one_channel_is_enough_for_a_log_of_welds(score):
    """Nothing contradicts it, so it must not talk itself into taking all it hears for false."""
    name = "detector" if score == HEARD else "accelerometer"
    assert_welds_and_nothing_else(weld_log([heard(name, WELDS, score, 1)], trajectory(), nominal_joint=12.0))


def test_a_channel_made_deaf_loses_all_it_had_there_and_keeps_the_rest():
    channel = heard("arms", np.arange(10.0, 100.0, 10.0), 9.0, 4)
    deaf = channel.without(np.array([[48.0, 52.0], [19.0, 21.0], [20.5, 31.0]]))
    assert deaf.place.size == deaf.score.size == deaf.sigma.size == 6
    assert deaf.covers(np.array([5.0, 20.0, 25.0, 31.5, 50.0, 60.0])).tolist() == [True, False, False, True, False, True]


@pytest.mark.parametrize("direction", ["downstream", "upstream"])
def test_valves_with_a_recess_in_their_bore_add_no_welds(direction, tmp_path):
    options = SimulateOptions(
        line="valves",
        seed=4,
        route=RouteOptions(
            length_m=320.0,
            outside_diameter_m=0.508,
            wall_m=0.0095,
            heavy_wall_m=0.0127,
            valve_spacing_m=80.0,
            valve_recess_m=0.004,
            induction_bends_deg=(),
        ),
        tool=ToolOptions(static_start_s=60.0, static_end_s=20.0, stops=0, arms=40, ring_offset_m=(0.6, -0.6)),
        runs=(RunOptions(id="r", date=datetime.date(2020, 1, 1), direction=direction),),
    )
    simulate(options, tmp_path)
    true = pd.read_csv(tmp_path / "truth" / "r" / "welds_truth.csv").chainage_m.to_numpy()
    found = sure(measure(demo_run(tmp_path, "r"), true_trajectory(tmp_path, "r")).welds)
    apart = np.abs(found[:, None] - true[None, :])
    assert (apart.min(axis=0) < 0.05).all()
    assert (apart.min(axis=1) < 0.05).all()
