"""The arrays and rates that the jitted pieces of the matching share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

BIN = 0.01  # metre, of the densities of joint lengths
MOST_LOOSE = 400  # welds of both runs that may lie before the first pair of an alignment, or behind its last
LONGEST_CUT = 16  # listed joints of a replaced stretch that is weighed as a cut-out in place; a longer one is a re-route


class Rates(NamedTuple):
    """How two lists of one line differ: noise (metre) and weights of the moves."""

    sigma: float  # scale of Student's t of a joint's length difference, metre
    shape: int  # its degrees of freedom are 2 ** (shape + 1) - 1: 3, 7 or 15
    same: float
    missed_a: float  # per weld
    missed_b: float
    again: float  # the weld next to a missed one is missed as well
    false_a: float  # per metre
    false_b: float
    shifted: float
    shift_m: float
    cut: float  # a replaced stretch begins, per weld
    cut_more: float  # it has one joint more
    reroute: float  # a stretch laid anew, of any length in either run, begins and ends
    reroute_more: float  # it has one joint more, of either run
    ends: float  # an alignment begins or ends within both lists


class Lists(NamedTuple):
    """Two weld lists on one scale, B of the later run, with the densities of the line's joint lengths.

    ``x`` (n) and ``y`` (m) are metre, rising; ``inv_a``, ``inv_b`` one over the density of the listed joint that ends at each
    weld (metre); ``fresh`` the running sum over B of the log of the density of new pipe over that of all pipe, ``closing`` that
    of one over the density of new pipe, bounded (metre); ``density`` (1/m) of listed joints and ``shared`` (1/m) of the mean of
    two
    listings of one joint, both in bins of 1 cm; ``slack`` (33) the scale of the length difference of a replaced stretch, by its
    joints in both runs together, metre.
    """

    x: np.ndarray
    y: np.ndarray
    inv_a: np.ndarray
    inv_b: np.ndarray
    fresh: np.ndarray
    closing: np.ndarray
    density: np.ndarray
    shared: np.ndarray
    slack: np.ndarray


class Band(NamedTuple):
    """First and last column of each row (n), and where each row begins in the flat arrays (n + 1)."""

    low: np.ndarray
    high: np.ndarray
    offset: np.ndarray


class Evidence(NamedTuple):
    """What speaks for each cell of a band beside the lengths, in its flat order; empty where nothing does.

    ``weld`` : likelihood ratio that the two welds are one; ``joint`` : that the two joints which end there are one.
    """

    weld: np.ndarray
    joint: np.ndarray


NOTHING = Evidence(np.empty(0, np.float32), np.empty(0, np.float32))
