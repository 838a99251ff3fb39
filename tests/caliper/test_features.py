"""Bends, wall steps, valves, openings, wrinkles and the joint table of simulated lines against what the simulator knew."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks._caliper_line import caliper_line
from deform.caliper.measure import measure
from deform.options import DentOptions, FittingOptions
from deform.run.schema import dataset_faults

TEE = FittingOptions(id="T", chainage_m=105.0, kind="tee", clock_deg=75.0, height_m=0.02, length_m=0.1)
WRINKLE = FittingOptions(id="W", chainage_m=210.0, kind="wrinkle", clock_deg=200.0, height_m=0.005, length_m=0.24)
DENT = DentOptions(id="D", chainage_m=255.0, clock_deg=90.0, depths_od=(0.03,))


@pytest.fixture(scope="module", params=["downstream", "upstream"])
def line(request):
    route = {
        "valve_spacing_m": 320.0,
        "valve_recess_m": 0.005,
        "crossings": 1,
        "induction_bends_deg": (40.0, -25.0),
        "bend_fields": 1,
    }
    tool = {"arms": 32, "caliper_rate_hz": 100.0}
    made = caliper_line(5, 640.0, route, tool, request.param, dents=(DENT,), fittings=(TEE, WRINKLE))
    return made, measure(made.raw, made.trajectory)


def rows(line, kind):
    return line[1].features.isel(feature=np.flatnonzero(line[1].features.kind.values == kind))


def near(found, place, reach):
    return np.flatnonzero(np.abs(found.chainage.values - place) < reach)


def test_the_features_follow_the_vocabulary(line):
    assert dataset_faults("features", line[1].features) == []
    assert (np.diff(line[1].features.chainage.values) >= 0).all()


def sharp(made):
    """Joints with a bend that is one: more than 2 degree, tighter than 500 diameters."""
    joints = made.joints[made.joints.kind.isin(["induction", "cold"])]
    tight = np.radians(joints.bend_angle_deg) / (0.65 * joints.length_m) > 1 / (500 * made.passage.line.outside_diameter)
    return joints[(joints.bend_angle_deg > 2.0) & (tight | (joints.kind == "induction"))]


def test_every_bend_has_its_angle_direction_radius_and_ends(line):
    made, found = line[0], rows(line, "bend")
    place = np.arange(5.0, made.passage.line.length - 5.0, 0.05)
    right, up = made.passage.line.curvature(place)
    true = sharp(made)
    assert found.sizes["feature"] == len(true) >= 8
    for joint in true.itertuples():
        inside = (place > joint.start_m) & (place < joint.start_m + joint.length_m)
        turn = np.degrees([right[inside].sum() * 0.05, up[inside].sum() * 0.05])
        curve = np.hypot(right, up) * inside
        full = place[curve > 0.5 * curve.max()]
        k = np.argmin(np.abs(found.chainage.values - full[0]))
        bend = found.isel(feature=int(k))
        assert float(bend.chainage) == pytest.approx(full[0], abs=0.25)
        assert float(bend.chainage_end) == pytest.approx(full[-1], abs=0.25)
        assert float(bend.value) == pytest.approx(np.hypot(*turn), abs=max(4 * float(bend.value_sigma), 0.2))
        assert float(bend.radius) == pytest.approx(1 / curve.max(), rel=0.15, abs=4 * float(bend.radius_sigma))
        assert (np.radians(float(bend.clock)) - np.arctan2(*turn) + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0, abs=0.1)
        assert str(bend.direction.values) == (
            ["left", "right"][int(turn[0] > 0)] if abs(turn[0]) >= abs(turn[1]) else ["over", "sag"][int(turn[1] > 0)]
        )
        assert (joint.kind == "induction") == ("induction" in str(bend.text.values))


def test_the_angles_of_bends_are_as_sure_as_they_say(line):
    made, found = line[0], rows(line, "bend")
    true = sharp(made)
    middle = (true.start_m + 0.5 * true.length_m).to_numpy()
    order = [int(np.argmin(np.abs(0.5 * (found.chainage.values + found.chainage_end.values) - m))) for m in middle]
    off = (found.value.values[order] - true.bend_angle_deg.to_numpy()) / found.value_sigma.values[order]
    assert np.sqrt(np.mean(off**2)) < 1.8  # half a dozen bends


def test_walls_change_where_heavy_pipe_begins_and_ends(line):
    made, found = line[0], rows(line, "wall_change")
    wall = made.joints.wall_m.to_numpy()
    steps = np.flatnonzero(np.abs(np.diff(wall)) > 1e-3) + 1
    true = made.joints.start_m.to_numpy()[steps]
    apart = np.abs(found.chainage.values[:, None] - true[None, :])
    assert found.sizes["feature"] == true.size
    assert apart.min(axis=0).max() < 0.05
    error = found.value.values - wall[steps][apart.argmin(axis=1)]
    assert np.abs(error).max() < 1e-4


def test_the_sigma_of_a_wall_knows_that_the_outside_diameter_is_not_its_nominal_one(line):
    """API 5L lets the diameter of a body of pipe be 0.75 % off; the wall by the inner radius is then off by half of that."""
    sigma = line[1].welds.wall_thickness_sigma.values
    half = 0.5 * 0.0075 * line[0].passage.line.outside_diameter
    assert (1.96 * sigma[np.isfinite(sigma)] > half).all()
    found = rows(line, "wall_change")
    assert (1.96 * found.value_sigma.values > half).all()
    assert found.sizes["feature"] > 0  # walls are compared by a sigma without it


def test_valves_are_found_by_their_bore_and_by_their_spool_and_nothing_else_is_a_valve(line):
    made, found = line[0], rows(line, "valve")
    true = made.joints[made.joints.kind == "valve"]
    assert len(true) >= 1
    for at, end, value in zip(found.chainage.values, found.chainage_end.values, found.value.values, strict=True):
        inside = (true.start_m < end) & (true.start_m + true.length_m > at)
        assert inside.any()
        assert value == pytest.approx(0.01, abs=4e-3) or value == pytest.approx(true.wall_m[inside].iloc[0], abs=2e-3)
    for joint in true.itertuples():
        assert ((found.chainage.values < joint.start_m + joint.length_m) & (found.chainage_end.values > joint.start_m)).any()


def test_an_opening_is_a_tee_at_its_place_and_clock(line):
    found = rows(line, "tee")
    assert found.sizes["feature"] == 1
    assert float(found.chainage[0]) == pytest.approx(105.0 - 0.05, abs=0.06)
    assert float(found.chainage_end[0]) == pytest.approx(105.0 + 0.05, abs=0.06)
    assert float(found.clock[0]) == pytest.approx(75.0, abs=6.0)
    assert float(found.value[0]) == pytest.approx(0.02, abs=0.006)


def test_a_wrinkle_is_a_train_of_ripples_with_height_and_spacing(line):
    found = rows(line, "wrinkle")
    assert found.sizes["feature"] == 1
    x = np.linspace(-3, 3, 601)
    profile = WRINKLE.height_m * np.cos(np.pi * x) * np.exp(-0.5 * x**2)
    assert float(found.chainage[0]) < 210.0 < float(found.chainage_end[0])
    assert float(found.clock[0]) == pytest.approx(200.0, abs=12.0)
    assert float(found.value[0]) == pytest.approx(np.ptp(profile), abs=max(4 * float(found.value_sigma[0]), 1e-3))
    assert float(found.spacing[0]) == pytest.approx(WRINKLE.length_m, rel=0.2)


def test_the_crest_of_a_wrinkle_is_no_plain_dent_and_a_dent_is_no_wrinkle(line):
    dents = line[1].dents
    assert [str(s) for s in dents.shape.values[near(dents, 255.0, 0.3)]] == ["plain"]
    assert set(dents.shape.values.astype(str)[np.abs(dents.chainage.values - 210.0) < 0.5]) <= {"wrinkle"}


def test_the_joint_table_numbers_every_joint_and_says_what_it_is(line):
    made, welds = line[0], line[1].welds
    sure = np.flatnonzero(welds.probability.values >= 0.5)
    assert welds.joint_number.values[sure].tolist() == list(range(1, sure.size + 1))
    starts, kinds = made.joints.start_m.to_numpy(), made.joints.kind.to_numpy()
    bent = set(sharp(made).start_m)
    same = {"straight": "pipe", "elastic": "pipe", "cold": "bend", "induction": "bend", "valve": "valve", "pup": "pup"}
    for k in sure:
        at = int(np.argmin(np.abs(starts - float(welds.chainage[k]))))
        tee = starts[at] < 105.0 < starts[at] + made.joints.length_m[at]
        straight = kinds[at] == "cold" and starts[at] not in bent
        assert str(welds.joint_kind.values[k]) == ("tee" if tee else "pipe" if straight else same[kinds[at]])
    off = (
        welds.wall_thickness.values[sure]
        - made.joints.wall_m.to_numpy()[np.abs(starts[:, None] - welds.chainage.values[sure]).argmin(axis=0)]
    )
    assert np.nanmax(np.abs(off)) < 1e-4


def test_a_dent_knows_the_wall_of_its_joint(line):
    made, dents = line[0], line[1].dents
    k = int(near(dents, 255.0, 0.3)[0])
    joint = made.joints[made.joints.start_m < 255.0].iloc[-1]
    assert float(dents.wall_thickness[k]) == pytest.approx(joint.wall_m, abs=1e-4)
    assert 0.002 < dents.attrs["wall_thickness_sigma_m"] / made.passage.line.outside_diameter < 0.003
