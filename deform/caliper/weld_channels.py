"""Detector events, scan records and accelerometers in; one list of possible girth welds per channel out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from deform.caliper._kernels import bead_and_step
from deform.caliper.cross_section import ScanLog, scan_ranges
from deform.caliper.scans import ScanReader, motion
from deform.caliper.weld_hits import hit_centre, hit_score
from deform.caliper.weld_shape import BEAD_HALF_M, FLANK_M, LEAST_ARM_SCORE, bead_centre, edge, is_narrow
from deform.run.raw import RawRun

DETECTOR = "detector"
HEARD = 100.0  # score of a detector that fired; it has no other
_LEAST_STEP_SCORE = 8.0  # sigma; the wall also waves by itself over such lengths
_LEAST_HIT_SCORE = 5.0  # sigma of the accelerometers' own noise over the same seconds
_LEAST_TRACE = 1.5  # sigma; weaker traces are not kept
_CHUNK, _OVERLAP = 250_000, 1_000  # samples of the accelerometers taken at once
_PIECE_M, _SEEN_M = 1000.0, 1.5  # line looked at once by the arms, and wall on either side that its ends need
_RING_S = 0.25  # a hit rings no longer than this


@dataclass(frozen=True)
class Channel:
    """What one sensor has to say about welds.

    Attributes
    ----------
    name : detector, arms or accelerometer.
    place : (n,) m, chainage.
    score : (n,), size of the event in sigma of its own noise; `HEARD` for a detector.
    sigma : (n,) m, how well this event is placed against the best of its channel; 0 = as well as any.
    axis, level : (m,) m and sigma, the channel's score wherever it has any, so that weak traces can be looked up.
    covered : (m, 2) m, stretches of chainage in which the channel would have seen a weld.
    """

    name: str
    place: np.ndarray
    score: np.ndarray
    sigma: np.ndarray
    axis: np.ndarray
    level: np.ndarray
    covered: np.ndarray

    def covers(self, place: np.ndarray) -> np.ndarray:
        """True where the channel was listening."""
        return _inside(np.asarray(place), self.covered)

    def moved(self, shift: float) -> Channel:
        """The same channel with all places shifted (m)."""
        return replace(self, place=self.place + shift, axis=self.axis + shift)

    def trace(self, place: np.ndarray, reach: float) -> np.ndarray:
        """Greatest score within ``reach`` (m) of each place; 0 where there is none."""
        first, last = np.searchsorted(self.axis, place - reach), np.searchsorted(self.axis, place + reach)
        padded = np.append(self.level, 0.0)
        pairs = np.stack([first, np.maximum(last, first + 1)], axis=1).ravel()
        best = np.maximum.reduceat(padded, np.minimum(pairs, padded.size - 1))[::2]
        return np.where(last > first, np.maximum(best, 0.0), 0.0)

    def without(self, spans: np.ndarray) -> Channel:
        """The channel deaf in the given spans (n, 2) m, such as dents that look like beads."""
        spans = _united(np.asarray(spans, float).reshape(-1, 2))
        place_in, axis_in = _inside(self.place, spans), _inside(self.axis, spans)
        return replace(
            self,
            place=self.place[~place_in],
            score=self.score[~place_in],
            sigma=self.sigma[~place_in],
            axis=self.axis[~axis_in],
            level=self.level[~axis_in],
            covered=_outside(self.covered, spans),
        )


def detector_channel(raw: RawRun, trajectory: xr.Dataset) -> Channel | None:
    """Events of the girth-weld detector at the chainage of the IMU."""
    if raw.weld_events is None:
        return None
    time = np.asarray(raw.weld_events["time"].values, float)
    span = trajectory["time"].values[[0, -1]]
    time = time[np.isfinite(time) & (time >= span[0]) & (time <= span[1])]
    chainage = trajectory["chainage"].values
    place = np.sort(np.interp(time, trajectory["time"].values, chainage))
    heard = np.full(place.size, HEARD)
    return Channel(DETECTOR, place, heard, 0.0 * heard, place, heard, np.array([[chainage.min(), chainage.max()]]))


def arms_channel(reader: ScanReader, log: ScanLog) -> Channel | None:
    """Weld beads and wall steps in the mean radius of a ring, each at the ring's own chainage."""
    start, stop = reader.span()
    pieces = []
    for low in np.arange(start, stop, _PIECE_M):
        high = low + _PIECE_M
        ranges = scan_ranges(reader, log, low - _SEEN_M, high + _SEEN_M)
        index = np.concatenate([np.arange(a, b) for a, b in ranges]) if ranges else np.empty(0, np.int64)
        index = index[log.good[index]]
        if index.size:
            place = reader.chainage(reader.time[index], log.ring)
            order = np.argsort(place, kind="stable")
            pieces.append(arms_piece(place[order], log.radius[index[order]].astype(float), (low, high)))
    return _joined([p for p in pieces if p is not None])


def arms_piece(place: np.ndarray, radius: np.ndarray, own: tuple[float, float] = (-np.inf, np.inf)) -> Channel | None:
    """Events and traces of a piece of line that lie between two places; None for fewer than 100 scans.

    Parameters
    ----------
    place, radius : (n,) m, rising chainage and mean radius of the scans of one ring.
    own : places (m) between which the piece speaks.

    Notes
    -----
    A bead is a narrow inward kick that returns on both sides; a step is believed when the wall keeps its level on both sides
    as pipes do. At the edge of a recess and in a collar the arms have nothing to say for or against a weld: they are deaf.
    """
    if place.size < 100:
        return None
    bead, step = np.empty(place.size, np.float32), np.empty(place.size, np.float32)
    noise = 1.4826 * np.median(np.abs(np.diff(radius))) / np.sqrt(2.0)
    bead_and_step(place, radius, max(noise, 1e-6), BEAD_HALF_M, FLANK_M, bead, step)
    bead /= max(_robust(bead), 1.0)
    step /= max(_robust(step), 1.0)
    edges = [edge(place, radius, step, bead, int(i)) for i in local_peaks(place, step, _LEAST_STEP_SCORE, 2 * FLANK_M)]
    events = [event for event, _ in edges if event is not None]
    other = [centre for event, centre in edges if event is None]
    taken = np.array([e[0] for e in events])
    for i in local_peaks(place, bead, LEAST_ARM_SCORE, 0.1):
        if taken.size and np.abs(taken - place[i]).min() <= 2 * BEAD_HALF_M:
            continue
        if is_narrow(place, radius, int(i)):
            events.append((bead_centre(place, radius, int(i)), float(bead[i]), 0.0))
        else:
            other.append(float(place[i]))
    events.sort()
    table = np.array(events).reshape(-1, 3)
    level = bead.copy()
    at = np.minimum(np.searchsorted(place, table[:, 0]), place.size - 1)
    level[at] = np.maximum(level[at], table[:, 1])
    inside = (place >= own[0]) & (place < own[1])
    heard = inside & (level > _LEAST_TRACE)
    table = table[(table[:, 0] >= own[0]) & (table[:, 0] < own[1])]
    covered = np.clip(_stretches(place), *own)
    covered = covered[covered[:, 1] > covered[:, 0]]
    channel = Channel("arms", table[:, 0], table[:, 1], table[:, 2], place[heard], level[heard].astype(float), covered)
    return channel.without(_around(np.array(other), table[:, 0]))


def _joined(pieces: list[Channel]) -> Channel | None:
    """Pieces of a channel in the order of the line as one."""
    if not pieces:
        return None
    names = ("place", "score", "sigma", "axis", "level", "covered")
    joined = {n: np.concatenate([getattr(p, n) for p in pieces]) for n in names}
    return Channel(pieces[0].name, **joined)


def accelerometer_channel(raw: RawRun, trajectory: xr.Dataset) -> Channel | None:
    """Short shakes of the tool: accelerations freed of slow motion, in sigma of their own noise at that time."""
    time = np.asarray(raw.imu["time"].values, float)
    moving = np.interp(time, trajectory["time"].values, motion(trajectory)) > 0.5
    if time.size < 1000 or not moving.any():
        return None
    interval = float(np.median(np.diff(time)))
    parts = []
    samples = raw.imu["accel_count"]
    for first in range(0, time.size, _CHUNK):
        begin, end = max(0, first - _OVERLAP), min(time.size, first + _CHUNK + _OVERLAP)
        if moving[begin:end].sum() > 500:
            parts.append(
                _hits(
                    samples[begin:end].values,
                    time[begin:end],
                    moving[begin:end],
                    interval,
                    trajectory,
                    (first, first + _CHUNK, begin),
                )
            )
    if not parts:
        return None
    centre, score, axis, level = (np.concatenate([p[k] for p in parts]) for k in range(4))
    chainage = np.interp(time[moving][[0, -1]], trajectory["time"].values, trajectory["chainage"].values)
    order, events = np.argsort(axis, kind="stable"), np.argsort(centre, kind="stable")
    covered = np.array([[chainage.min(), chainage.max()]])
    return Channel("accelerometer", centre[events], score[events], np.zeros(events.size), axis[order], level[order], covered)


def _hits(counts, time, moving, interval: float, trajectory: xr.Dataset, chunk: tuple[int, int, int]):
    """Places and scores of the hits of one chunk, and the places and scores of all samples that show a trace."""
    first, last, begin = chunk
    score, energy = hit_score(counts, interval, moving)
    chainage = np.interp(time - 0.5 * interval, trajectory["time"].values, trajectory["chainage"].values)
    index = begin + np.arange(time.size)
    own = (index >= first) & (index < last)
    peak = local_peaks(time, score, _LEAST_HIT_SCORE, _RING_S)
    peak = peak[own[peak]]
    centre = np.array([hit_centre(energy, int(i), interval, chainage) for i in peak])
    heard = own & (score > _LEAST_TRACE)
    return centre, score[peak], chainage[heard], score[heard]


def local_peaks(axis: np.ndarray, score: np.ndarray, least: float, apart: float) -> np.ndarray:
    """Indices of local maxima of at least ``least``, the greatest first kept when nearer than ``apart`` along the axis."""
    above = np.flatnonzero(score >= least)
    kept: list[int] = []
    if not above.size:
        return np.empty(0, np.int64)
    groups = np.split(above, np.flatnonzero(np.diff(axis[above]) > apart) + 1)
    for part in groups:
        left = part
        while left.size:
            best = left[np.argmax(score[left])]
            kept.append(int(best))
            left = left[np.abs(axis[left] - axis[best]) > apart]
    return np.array(sorted(kept), np.int64)


def _robust(values: np.ndarray) -> float:
    use = values[np.isfinite(values)]
    return 1.4826 * float(np.median(np.abs(use - np.median(use)))) if use.size else 1.0


def _stretches(place: np.ndarray, gap: float = 0.2) -> np.ndarray:
    """Stretches of an axis without gaps."""
    cuts = np.flatnonzero(np.diff(place) > gap)
    return np.stack([place[np.concatenate([[0], cuts + 1])], place[np.concatenate([cuts, [place.size - 1]])]], axis=1)


def _around(centres: np.ndarray, events: np.ndarray) -> np.ndarray:
    """Spans (m, 2) of two bead widths about the centres (m), cut back to leave events (m) that stand within their reach."""
    reach = np.full(centres.size, 4 * BEAD_HALF_M)
    if events.size:
        right = np.clip(np.searchsorted(events, centres), 0, events.size - 1)
        nearest = np.minimum(np.abs(events[right] - centres), np.abs(events[np.maximum(right - 1, 0)] - centres))
        reach = np.minimum(reach, nearest - BEAD_HALF_M)
    use = reach > 0.0
    return np.stack([centres - reach, centres + reach], axis=1)[use]


def _united(spans: np.ndarray) -> np.ndarray:
    """The same ground as spans that rise and do not overlap."""
    if not len(spans):
        return spans
    spans = spans[np.argsort(spans[:, 0], kind="stable")]
    reach = np.maximum.accumulate(spans[:, 1])
    first = np.concatenate([[0], np.flatnonzero(spans[1:, 0] > reach[:-1]) + 1])
    return np.stack([spans[first, 0], reach[np.append(first[1:] - 1, len(spans) - 1)]], axis=1)


def _inside(place: np.ndarray, spans: np.ndarray) -> np.ndarray:
    """True where a place lies in one of the spans, which rise and do not overlap."""
    if not len(spans):
        return np.zeros(place.shape, bool)
    at = np.searchsorted(spans[:, 0], place, side="right") - 1
    return (at >= 0) & (place <= spans[np.maximum(at, 0), 1])


def _outside(covered: np.ndarray, spans: np.ndarray) -> np.ndarray:
    """What is left of the stretches without the spans."""
    points = np.unique(np.concatenate([covered.ravel(), spans.ravel()]))
    middle = 0.5 * (points[1:] + points[:-1])
    keep = _inside(middle, covered) & ~_inside(middle, spans)
    return np.stack([points[:-1], points[1:]], axis=1)[keep]
