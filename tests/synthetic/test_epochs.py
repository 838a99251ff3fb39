"""What happens to a line between runs: the geometry of movements, replacements and dents."""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from deform.errors import OptionError
from deform.geometry.earth import geodetic_to_local
from deform.options import DentOptions, MovementOptions, ReplacementOptions, RouteOptions, RunOptions, SimulateOptions
from deform.synthetic import epochs
from deform.synthetic.route import lay

RUNS = tuple(RunOptions(id=f"r{y}", date=datetime.date(y, 1, 1)) for y in (2010, 2012, 2014))


def _options(**events):
    route = RouteOptions(length_m=900.0, induction_bends_deg=(), crossings=0, bend_fields=0, hill_pitch_deg=2.0)
    return SimulateOptions(seed=11, route=route, runs=RUNS, **events)


@pytest.fixture(scope="module")
def built():
    return lay(_options().route, 11)


def test_pipe_outside_a_movement_stays_bitwise_upstream_and_to_a_tenth_of_a_millimetre_downstream(built):
    options = _options(movements=(MovementOptions(id="LS", start_m=300.0, length_m=120.0, amplitude_m=0.8),))
    line = epochs.line_at(built, options, 2)
    moved = np.linalg.norm(epochs.displacement(line, built), axis=1)
    assert (moved[built.material < 300.0] == 0).all()
    assert moved[built.material > 420.0].max() < 1e-4
    assert moved.max() == pytest.approx(0.8, abs=1e-4)


def test_movement_has_its_amplitude_direction_and_history(built):
    slide = MovementOptions(id="LS", start_m=300.0, length_m=100.0, amplitude_m=0.5, side_deg=90.0, drop=0.0)
    for run, size in enumerate((0.0, 0.25, 0.5)):
        line = epochs.line_at(built, _options(movements=(slide,)), run)
        d = epochs.displacement(line, built)
        k = np.linalg.norm(d, axis=1).argmax()
        assert np.linalg.norm(d[k]) == pytest.approx(size, abs=2e-3)
        if size:
            side = np.degrees(np.arctan2(d[k, 0], d[k, 1])) - np.degrees(built.at(350.0, 1)[0, 0])
            assert (side + 180) % 360 - 180 == pytest.approx(90.0, abs=0.5)


@pytest.mark.parametrize(
    ("history", "wanted"),
    [("linear", [0, 0.5, 1]), ("accelerating", [0, 0.25, 1]), ("step", [0, 1, 1])],
)
def test_histories(history, wanted):
    movement = MovementOptions(id="M", start_m=300.0, length_m=50.0, amplitude_m=1.0, history=history)
    given = [epochs.fraction(movement, _options(), run) for run in range(3)]
    assert given == pytest.approx(wanted, abs=2e-3)


def test_heading_curvature_and_stretch_of_the_moved_line_are_those_of_its_positions(built):
    options = _options(movements=(MovementOptions(id="ST", kind="settlement", start_m=500.0, length_m=40.0, amplitude_m=0.3),))
    line = epochs.line_at(built, options, 2)
    span = np.flatnonzero((line.material > 495) & (line.material < 545))
    origin = [float(x[0]) for x in line.position([520.0])]
    xyz = np.array(geodetic_to_local(*line.position(line.chainage[span]), *origin)).T
    steps = np.diff(xyz, axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx(np.diff(line.chainage[span]), abs=1e-6)
    middle = line.at(0.5 * (line.chainage[span][1:] + line.chainage[span][:-1]), 3)[:, 0]
    assert np.arctan2(steps[:, 2], np.hypot(steps[:, 0], steps[:, 1])) == pytest.approx(middle, abs=3e-5)
    rise = np.diff(line.at(line.chainage[span], 3)[:, 0]) / np.diff(line.chainage[span])
    mean = 0.5 * (line.table[span, 4][1:] + line.table[span, 4][:-1])
    assert rise == pytest.approx(mean, abs=2e-4)


def test_movement_lengthens_the_pipe_by_what_its_slope_stretches_it():
    route = RouteOptions(length_m=600.0, induction_bends_deg=(), crossings=0, bend_fields=0, hill_pitch_deg=0.0, wander_deg=0.0)
    straight = lay(route)
    slide = MovementOptions(id="LS", start_m=200.0, length_m=120.0, amplitude_m=1.0, drop=0.0)
    options = SimulateOptions(route=route, runs=RUNS, movements=(slide,))
    line = epochs.line_at(straight, options, 2)
    u = np.linspace(0, 1, 20001)
    slope = epochs.bump(u, slide.plateau)[1] / 120.0
    assert line.length - straight.length == pytest.approx(np.trapezoid(np.sqrt(1 + slope**2) - 1, u) * 120.0, rel=1e-3)


def test_bump_is_smooth_and_its_derivatives_are_right():
    u = np.linspace(0, 1, 100001)
    for plateau in (0.0, 0.3, 0.8):
        value, slope, second = epochs.bump(u, plateau)
        assert value.max() == pytest.approx(1.0)
        assert np.abs(np.gradient(value, u) - slope)[5:-5].max() < 1e-3
        assert np.abs(np.gradient(slope, u) - second)[5:-5].max() < 0.2
        assert abs(second[0]) < 1e-9
        assert (epochs.bump(np.array([-0.1, 1.1]), plateau) == 0).all()


def test_cut_out_goes_from_weld_to_weld_and_exchanges_the_joints(built):
    options = _options(replacements=(ReplacementOptions(id="C1", start_m=300.0, length_m=70.0, first_run=2),))
    assert epochs.line_at(built, options, 1) is built
    line = epochs.line_at(built, options, 2)
    place = epochs.place_of(built, options.replacements[0])
    new, old = line.joints, built.joints
    assert (new.is_replaced == 1).sum() == (old.material_start.between(place.start - 1e-6, place.end - 1e-6)).sum() + 1
    assert {place.start, place.end} <= set(old.material_start.round(12)) | set(old.material_start)
    kept = new[new.is_replaced == 0].merge(old, on="joint_id")
    assert (kept.length_m_x - kept.length_m_y).abs().max() < 1e-9
    gone = set(old.weld_id) - set(new.weld_id)
    assert len(gone) == len(old[old.material_start.between(place.start, place.end)]) - 2  # the welds at both ends stay
    assert np.allclose(new.start_m + new.length_m, np.append(new.start_m[1:], line.length))


def test_re_route_leaves_by_its_offset_and_has_material_two(built):
    options = _options(replacements=(ReplacementOptions(id="R1", kind="reroute", start_m=300.0, length_m=300.0, offset_m=8.0),))
    line = epochs.line_at(built, options, 1)
    assert set(np.unique(line.replaced)) == {0, 2}
    assert np.linalg.norm(epochs.displacement(line, built), axis=1).max() == pytest.approx(8.0, abs=0.01)
    assert line.length > built.length + 0.5


def test_dents_grow_come_and_go_with_their_pipe(built):
    dents = (
        DentOptions(id="D1", chainage_m=330.0, clock_deg=-20.0, depths_od=(0.02, 0.02, 0.02)),
        DentOptions(id="D2", chainage_m=700.0, clock_deg=40.0, depths_od=(0.0, 0.02, 0.03)),
    )
    options = _options(dents=dents, replacements=(ReplacementOptions(id="C1", start_m=300.0, length_m=70.0, first_run=2),))
    there = [list(epochs.dents_at(epochs.line_at(built, options, k), options, k).dent_id) for k in range(3)]
    assert there == [["D1"], ["D1", "D2"], ["D2"]]
    first = epochs.dents_at(built, options, 0).iloc[0]
    assert first.clock_deg == 340.0
    assert first.depth_m == pytest.approx(0.02 * built.outside_diameter)


def test_events_say_span_and_size(built):
    slide = MovementOptions(id="LS", start_m=300.0, length_m=100.0, amplitude_m=0.5)
    options = _options(movements=(slide,), replacements=(ReplacementOptions(id="C1", start_m=600.0, length_m=60.0, first_run=2),))
    early, late = (epochs.events_at(epochs.line_at(built, options, k), built, options, k) for k in (0, 2))
    assert list(early.event_id) == ["LS"]
    assert early.peak_displacement_m.iloc[0] == 0.0
    assert list(late.type) == ["landslide", "cutout"]
    assert late.peak_displacement_m.iloc[0] == pytest.approx(0.5, abs=1e-3)
    assert late.peak_added_bending_strain.iloc[0] > 1e-4
    assert late.n_new.iloc[1] == late.n_old.iloc[1] + 1


@pytest.mark.parametrize(
    "events",
    [
        {"movements": (MovementOptions(id="M", start_m=850.0, length_m=100.0, amplitude_m=1.0),)},
        {"movements": (MovementOptions(id="M", start_m=300.0, length_m=50.0, amplitude_m=1.0, fractions=(0.0, 1.0)),)},
        {"dents": (DentOptions(id="D", chainage_m=300.0, clock_deg=0.0, depths_od=(0.01,)),)},
    ],
)
def test_events_that_do_not_fit_are_refused_by_name(built, events):
    options = _options(**events)
    with pytest.raises(OptionError, match=r"simulation: (event|movement|dent) [MD]"):
        epochs.dents_at(epochs.line_at(built, options, 2), options, 2)
