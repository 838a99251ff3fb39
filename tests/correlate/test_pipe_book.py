"""Lengths of a pipe book meet the weld events of a run: they come with the right times, and pipe replaced since is left out."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from deform.correlate.pipe_book import known_pipe
from deform.options import PipeBookOptions
from tests.correlate.lines import build_line, cut_out, observe, run_of

SPEED, NOISE_M, SCALE = 1.25, 0.02, 1.004
EXACT = PipeBookOptions(length_sigma_m=0.005, scale_sigma_ppm=0.0)


@pytest.fixture(scope="module")
def laid():
    return build_line(np.random.default_rng(1), 300)


def passed(seen, *, upstream=False):
    """Times at which a detector saw the welds of a list, and the odometer's distance there."""
    place = SCALE * (seen.place[-1] - seen.place[::-1] if upstream else seen.place - seen.place[0])
    return 600.0 + place / SCALE / SPEED, place


def seen_of(line, seed=3, missed=0.03, false=0.02):
    return observe(np.random.default_rng(seed), line, noise=0.0, weld_noise=NOISE_M, missed=missed, false=false)


@pytest.mark.parametrize("upstream", [False, True])
def test_each_length_stands_between_the_passages_of_its_welds(laid, upstream):
    known = known_pipe(run_of("pipe book", laid), *passed(seen_of(laid), upstream=upstream), "run", options=EXACT)
    begin, end, length, sigma = known.joints.T
    assert len(known.joints) > 0.8 * (laid.n - 1)
    assert (np.diff(begin) > 0).all()
    assert (begin[1:] >= end[:-1] - 1e-9).all()
    off = (end - begin) * SPEED - length
    assert np.abs(off).max() < 5.0 * sigma[0]
    assert 0.8 < np.std(off) / sigma[0] < 1.2
    assert sigma[0] == pytest.approx(NOISE_M * np.sqrt(2.0), rel=0.15)


def test_pipe_that_was_replaced_since_is_left_out(laid):
    after = cut_out(np.random.default_rng(5), laid, 120, 4)
    known = known_pipe(run_of("pipe book", laid), *passed(seen_of(after)), "run", options=EXACT)
    begin, end, length, sigma = known.joints.T
    assert len(known.joints) > 0.8 * (laid.n - 5)
    assert np.abs((end - begin) * SPEED - length).max() < 5.0 * sigma[0]
    first, last = (float((laid.place[k] - laid.place[0]) / SPEED + 600.0) for k in (121, 123))
    assert not ((begin < last) & (end > first) & (begin > first - 5.0)).any()


def test_an_error_that_all_lengths_share_does_not_average_out(laid):
    shared = PipeBookOptions(length_sigma_m=0.005, scale_sigma_ppm=200.0)
    known = known_pipe(run_of("pipe book", laid), *passed(seen_of(laid)), "run", options=shared)
    n, length, sigma = len(known.joints), known.joints[:, 2].mean(), known.joints[0, 3]
    assert sigma / np.sqrt(n) / length > 200e-6  # what all lengths together know of the scale


def test_a_book_of_another_line_is_not_used_and_said(laid, caplog):
    other = build_line(np.random.default_rng(77), 280)
    with caplog.at_level(logging.WARNING):
        known = known_pipe(run_of("pipe book", other), *passed(seen_of(laid)), "run-7")
    assert not len(known.joints)
    assert not len(known.straights)
    assert "run-7" in caplog.text
    assert "pipe book is not used" in caplog.text


def test_straight_stretches_are_led_over_by_the_welds_around_them(laid):
    start = laid.place[0]
    stretches = np.array([[start + 500.0, start + 800.0, 0.01], [laid.place[-1] + 50.0, laid.place[-1] + 90.0, 0.01]])
    known = known_pipe(run_of("pipe book", laid), *passed(seen_of(laid)), "run", stretches, EXACT)
    ((begin, end, sigma),) = known.straights
    assert begin == pytest.approx(600.0 + 500.0 / SPEED, abs=0.1)
    assert end == pytest.approx(600.0 + 800.0 / SPEED, abs=0.1)
    assert sigma == pytest.approx(np.radians(0.01))
