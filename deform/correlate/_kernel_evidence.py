"""What is known of the joints and welds of two lists beside the lengths in, its weight for every cell of a band out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from deform.correlate._kernel_moves import student

LEAST, MOST = 0.02, 20.0  # no single hint weighs more, against or for: the lengths of two or three joints overrule each
SEAM_STEP = 2.0  # degree
LOCKED = 1e18  # ratio of a locked pair


class Hints(NamedTuple):
    """Learned traits of the joints that begin at each weld, places of markers, locks; empty arrays where there is nothing.

    ``class_a`` (traits, n), ``class_b`` (traits, m), ``ratio`` (traits, classes, classes): likelihood ratio of each pair of
    classes; ``label_*``: codes, -1 unknown, and the ratios of equal and of other labels; ``seam_*``: degree, NaN unknown, and
    the ratio by difference in steps of `SEAM_STEP`; ``bend_*``: degree, NaN where straight, the scale of their differences and
    the range of angles that bends have; ``mark_a`` (n, 2): marker that stands before the weld, -1 none, and how far, metre;
    ``mark_b``: place of each marker in B, metre, and the scale of the differences; ``lock_a``, ``lock_b``: partner of each
    weld, -1 free; ``forbid_start`` (n + 1), ``forbid``: forbidden partners of each weld.
    """

    class_a: np.ndarray
    class_b: np.ndarray
    ratio: np.ndarray
    label_a: np.ndarray
    label_b: np.ndarray
    label_same: float
    label_other: float
    seam_a: np.ndarray
    seam_b: np.ndarray
    seam_ratio: np.ndarray
    bend_a: np.ndarray
    bend_b: np.ndarray
    bend_sigma: float
    bend_spread: float
    mark_a: np.ndarray
    mark_b: np.ndarray
    mark_sigma: float
    lock_a: np.ndarray
    lock_b: np.ndarray
    forbid_start: np.ndarray
    forbid: np.ndarray


@njit(cache=True, error_model="numpy")
def weigh_joints(low, high, offset, h):
    """Likelihood ratio (cells) that the joints which end at each cell are one, from everything but their lengths."""
    weight = np.ones(offset[-1], np.float32)
    for i in range(1, low.size):
        for j in range(max(low[i], 1), high[i] + 1):
            weight[offset[i] + j - low[i]] = _joint(i - 1, j - 1, h)
    return weight


@njit(cache=True, error_model="numpy")
def _joint(i, j, h):
    w = 1.0
    for k in range(h.class_a.shape[0]):
        w *= h.ratio[k, h.class_a[k, i], h.class_b[k, j]]
    if h.label_a.size and h.label_a[i] >= 0 and h.label_b[j] >= 0:
        w *= h.label_same if h.label_a[i] == h.label_b[j] else h.label_other
    if h.seam_a.size:
        d = abs(h.seam_a[i] - h.seam_b[j])
        if d == d:
            w *= h.seam_ratio[int(min(d, 360.0 - d) / SEAM_STEP)]
    if h.bend_a.size:
        d = h.bend_a[i] - h.bend_b[j]
        if d == d:
            w *= min(LEAST + (1.0 - LEAST) * h.bend_spread * student(d, h.bend_sigma, 2), MOST)
    return w


@njit(cache=True, error_model="numpy")
def weigh_welds(low, high, offset, y, spacing, h):
    """Likelihood ratio (cells) that the two welds are one, from markers and from locked and forbidden pairs."""
    weight = np.ones(offset[-1], np.float32)
    for i in range(low.size):
        for j in range(low[i], high[i] + 1):
            w = 1.0
            if h.mark_a.shape[0] and h.mark_a[i, 0] >= 0:
                d = (y[j] - h.mark_b[int(h.mark_a[i, 0])]) - h.mark_a[i, 1]
                w = min(max(spacing * student(d, h.mark_sigma, 1), LEAST), MOST)
            if h.lock_a.size:
                w *= _locked(i, j, h)
            weight[offset[i] + j - low[i]] = w
    return weight


@njit(cache=True, error_model="numpy")
def _locked(i, j, h):
    if h.lock_a[i] != j and (h.lock_a[i] >= 0 or h.lock_b[j] >= 0):
        return 0.0
    for k in range(h.forbid_start[i], h.forbid_start[i + 1]):
        if h.forbid[k] == j:
            return 0.0
    return LOCKED if h.lock_a[i] == j else 1.0
