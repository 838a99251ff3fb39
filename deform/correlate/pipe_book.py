"""A pipe book and the weld events of a raw run in; joints and straight stretches by the times of their passage out."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from deform.correlate.alignment import PairAlignment, align
from deform.correlate.weld_list import weld_list
from deform.errors import WrongLineError
from deform.geometry.resample import MAD_TO_SIGMA
from deform.nav.aiding import KnownPipe
from deform.options import MatchOptions, PipeBookOptions

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)

_SURE = 0.95  # posterior from which a weld event is taken for a weld of the book
_MOST_JOINTS = 3  # of the book in one length, where the detector missed welds
_OUTLIER = 4.0  # sigmas beyond which a length is that of another pipe, or its weld is none
_LEAST_LENGTHS = 20  # that tell their own scatter


def known_pipe(
    book: xr.DataTree,
    time: Floats,
    place: Floats,
    run_id: str,
    straights: NDArray[Any] | None = None,
    options: PipeBookOptions | None = None,
) -> KnownPipe:
    """Return what a pipe book says of the pipe that a run passed.

    Parameters
    ----------
    book : listing of the joints as they were laid, with group ``/welds``.
    time, place : (event,) times at which the run's detector saw welds (s), and the odometer's distance there (m), both rising.
    run_id : name of the run in messages.
    straights : (stretch, 3) from and to (m along the book), and how far the azimuth may stray within it, as sigma (degree).

    Returns
    -------
    KnownPipe
        Empty, with a warning, where the run's events and the book have nothing in common.

    Notes
    -----
    A length counts with the scatter of the run's own lengths against the book's about their local scale, which holds the errors
    of the book, of the detector and of the wheels within a joint; lengths beyond four sigmas (pipe replaced since, a false
    event) are left out. An error s that all lengths of the book share (its tape, its temperature) does not average out: with N
    lengths of mean length l the variance of each is raised by N (s l)², so that all of them together know the scale to s.
    """
    options, match = options or PipeBookOptions(), MatchOptions()
    welds = weld_list(book)
    keep = np.flatnonzero(np.diff(place, prepend=-np.inf) > match.least_joint_m)
    time, place = time[keep], place[keep]
    try:
        found = align(welds.place, place, match, (welds.run, run_id))
    except WrongLineError as fault:
        _log.warning("run %s: the pipe book is not used: %s", run_id, fault)
        return KnownPipe()
    sure = found.posterior > _SURE
    at, event = found.i[sure], found.j[sure]
    order = np.argsort(at, kind="stable")
    at, event = at[order], event[order]
    joints = _joints(welds.place, place, time, at, event, found, options)
    _log.info("run %s: %d of %d joints of the pipe book are known, sigma %.3f m each",
              run_id, len(joints), welds.n - 1, joints[0, 3] if len(joints) else np.nan)  # fmt: skip
    return KnownPipe(joints, _straights(straights, welds.place[at], time[event]))


def _joints(book: Floats, place: Floats, time: Floats, at: NDArray[Any], event: NDArray[Any], found: PairAlignment,
            options: PipeBookOptions) -> Floats:  # fmt: skip
    """Times at both ends, length and its sigma of the pipe between welds that both know, in the order of travel."""
    near = np.diff(at) <= _MOST_JOINTS
    length, measured = np.diff(book[at]), np.abs(np.diff(place[event]))
    off = measured / found.local[at[:-1]] - length
    near &= np.isfinite(off)
    if near.sum() < _LEAST_LENGTHS:
        return np.empty((0, 4))
    scatter = MAD_TO_SIGMA * float(np.median(np.abs(off[near] - np.median(off[near]))))
    sigma = max(scatter, options.length_sigma_m)
    near &= np.abs(off) < _OUTLIER * sigma
    shared = options.scale_sigma_ppm * 1e-6 * float(length[near].mean())
    sigma = float(np.sqrt(sigma**2 + near.sum() * shared**2))
    begin = np.minimum(time[event[:-1]], time[event[1:]])[near]
    end = np.maximum(time[event[:-1]], time[event[1:]])[near]
    joints = np.column_stack([begin, end, length[near], np.full(begin.size, sigma)])
    return joints[np.argsort(begin, kind="stable")]


def _straights(straights: NDArray[Any] | None, place: Floats, time: Floats) -> Floats:
    """Times at both ends and sigma (radian) of the part of each straight stretch that lies between welds that both know."""
    if straights is None or place.size < 2:
        return np.empty((0, 3))
    low, high = np.clip(straights[:, 0], place[0], place[-1]), np.clip(straights[:, 1], place[0], place[-1])
    here = high > low
    ends = np.sort(np.column_stack([np.interp(low[here], place, time), np.interp(high[here], place, time)]), axis=1)
    stretches = np.column_stack([ends, np.radians(straights[here, 2])])
    return stretches[np.argsort(stretches[:, 0], kind="stable")]
