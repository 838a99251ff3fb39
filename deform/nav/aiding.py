"""Odometer, rests, markers and control points in; measurements on the epochs with their variances out."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from deform.nav._kernels import GAP_TURN
from deform.nav._kernels_filter import MOST_MARKS
from deform.nav._kernels_state import BANDS, RESET_COURSE, RESET_DISTANCE
from deform.nav.strapdown import Epochs

Floats = NDArray[np.float64]
log = logging.getLogger(__name__)

REST_VARIANCE = 1e-4**2  # m², of the displacement of a tool at rest within one epoch
LEAST_VARIANCE = 1e-5**2  # m², of any displacement
SETTLING_RAD = 1e-6  # by which a tool at rest may turn within an epoch
STRAIGHT_M = 50.0  # way over which the azimuth of straight pipe strays by itself
WOBBLE_DENSITY = 2.0 * math.radians(0.15) ** 2 * 20.0  # m² per m: of a wobble that is no state, 0.15 degree, forgotten in 20 m
RIDE_DENSITY = 2e-7  # m² per m: what is left of the ride across the pipe when the wobble is a state


@dataclass(frozen=True)
class TravelAid:
    """Displacement by the odometer along the tool: one measurement in three components per epoch.

    Parameters
    ----------
    speeds : (epoch + 1,) speed at the bounds (m/s).
    variance : (epoch, 3) along, to the right, up (m²); 0 = no measurement.
    stationary : (epoch,) the tool stands still: zero displacement.
    along_shape : (epoch,) variance along from the odometer's own sigma (m²).
    travel : (epoch,) odometer distance (m).
    tilt : (epoch, 2 bands) direction of the pipe in the tool by the caliper's arms, right and up of each band of waves (radian).
    doubt : (epoch,) further variance along that the data cannot make less (m²): of a guess, of a bend unseen by opposite wheels.
    lone : one wheel of a tool alone tells the travel.
    """

    speeds: Floats
    variance: Floats
    stationary: NDArray[np.bool_]
    along_shape: Floats
    travel: Floats
    tilt: Floats
    doubt: Floats
    lone: bool = False

    @property
    def far(self) -> float:
        """How many times the gate a displacement along may lie out and still pull in full.

        No other wheel shows the slips of a lone one. They last, and pulled for seconds the velocity would follow.
        """
        return 1.0 if self.lone else 3.0

    def with_noise(self, along: float, right: float, up: float, rest: float = REST_VARIANCE) -> TravelAid:
        """Return the aid with a factor on the variance along, densities (m² per m) right and up, a variance at rest (m²).

        A component that is no measurement stays none.
        """
        moving = ~self.stationary
        variance = np.full_like(self.variance, rest)
        variance[moving, 0] = along * self.along_shape[moving] + self.doubt[moving] + LEAST_VARIANCE
        slip = 0.02**2 * self.along_shape[moving] + LEAST_VARIANCE
        variance[moving, 1] = right * self.travel[moving] + slip
        variance[moving, 2] = up * self.travel[moving] + slip
        return replace(self, variance=np.where(self.variance > 0, variance, 0.0))


@dataclass(frozen=True)
class KnownPipe:
    """What is known of the pipe without the run, by the times at which the run passed it.

    Parameters
    ----------
    joints : (joint, 4) times at which the welds at both ends were passed (s), length between them and its sigma (m).
    straights : (stretch, 3) times of begin and end (s), and how far the azimuth may stray within the stretch, as sigma (radian).
    """

    joints: Floats = field(default_factory=lambda: np.empty((0, 4)))
    straights: Floats = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class SpanAid:
    """What is known of stretches of pipe: lengths of joints between two welds, and stretches that keep their azimuth.

    Parameters
    ----------
    joint : (bound, 2) length (m) of the joint that ends at a bound, NaN for none, and its variance (m²); no rows without joints.
    straight : (bound,) variance of the pipe's azimuth against that of its straight stretch (radian²), 0 outside of one.
    begins : (bound,) flags of what begins anew behind the bound: `RESET_DISTANCE`, `RESET_COURSE`.
    resting : (epoch,) variance of the turn about the vertical (radian²) of a tool at rest, 0 in motion.
    """

    joint: Floats = field(default_factory=lambda: np.empty((0, 2)))
    straight: Floats = field(default_factory=lambda: np.empty(0))
    begins: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    resting: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def arguments(self) -> tuple:
        """In the order of the kernels."""
        return self.joint, self.straight, self.begins, self.resting


@dataclass(frozen=True)
class MarkAid:
    """Passages of points with known coordinates.

    Parameters
    ----------
    index : (mark,) row in the table the mark comes from.
    epoch : (mark,) bound at which it was passed, rising.
    place : (mark, 3) latitude, longitude (radian), height (m).
    variance : (mark, 3) along the horizontal track, across, up (m²).
    late : (mark,) time of the passage minus time of the bound (s).
    weight : (mark,) 1, or less for one that the others contradict.
    """

    index: NDArray[np.int64]
    epoch: NDArray[np.int64]
    place: Floats
    variance: Floats
    late: Floats
    weight: Floats

    def only(self, keep: NDArray[np.bool_]) -> MarkAid:
        """Return the marks that a mask keeps."""
        return MarkAid(*(getattr(self, name)[keep] for name in ("index", "epoch", "place", "variance", "late", "weight")))

    def weighted(self, weight: Floats) -> MarkAid:
        """Return the same marks with other weights."""
        return replace(self, weight=weight)

    @property
    def used_variance(self) -> Floats:
        """Variance over weight."""
        return self.variance / self.weight[:, None]


def travel_aid(
    epochs: Epochs,
    speed: Floats,
    speed_sigma: Floats,
    stationary: NDArray[np.bool_],
    across: float = RIDE_DENSITY,
    doubt: Floats | None = None,
) -> TravelAid:
    """Return the travel measurements with variances as they are before the data have spoken (`noise.learn`).

    Parameters
    ----------
    speed, speed_sigma, stationary : on the samples, from `odometer.combine`.
    across : density of the noise across the pipe (m² per m).
    doubt : (epoch,) sigma of the speed that nothing makes less (m/s).

    Notes
    -----
    The tool wobbles in the pipe: its axis leaves the pipe's by a random angle of sigma w that forgets itself over a length l.
    Summed over a distance s much longer than l, the path walks off with variance 2 w² l s. A model that holds the wobble as
    a state needs little noise besides; one that does not needs the density 2 w² l, not w² per epoch.
    """
    begin = epochs.bounds[:-1] + 1
    size = np.diff(epochs.bounds)
    still = np.add.reduceat(stationary[: epochs.bounds[-1] + 1].astype(np.int32), begin) == size
    sigma = np.add.reduceat(speed_sigma[: epochs.bounds[-1] + 1], begin) / size
    travel, seconds = np.abs(epochs.travel), epochs.duration
    along_shape = sigma**2 * seconds * np.maximum(1.0, seconds)
    variance = np.full((len(travel), 3), REST_VARIANCE)
    variance[epochs.gap > 0] = 0.0
    kept = np.zeros(len(travel)) if doubt is None else (doubt * seconds) ** 2
    no_tilt = np.zeros((len(travel), 2 * BANDS))
    aid = TravelAid(speed[epochs.bounds].astype(float), variance, still, along_shape, travel, no_tilt, kept)
    return aid.with_noise(1.0, across, across)


def mark_aid(epochs: Epochs, time: Floats, place: Floats, sigma: Floats, time_sigma_s: float) -> MarkAid:
    """Return the passages that lie on the run.

    Parameters
    ----------
    time : (mark,) s, NaN for a passage not heard.
    place : (mark, 3) latitude, longitude (radian), height (m).
    sigma : (mark, 2) horizontal, vertical (m).
    time_sigma_s : error of a passage's time; it works along the track by the speed of the moment.
    """
    inside = np.isfinite(time) & (time >= epochs.time[0] - 0.5) & (time <= epochs.time[-1] + 0.5) & np.isfinite(place).all(axis=1)
    index = np.flatnonzero(inside)
    index = index[np.argsort(time[index], kind="stable")]
    epoch = nearest_bound(epochs.time, time[index])
    crowded = np.concatenate([np.zeros(min(MOST_MARKS, epoch.size), bool), epoch[MOST_MARKS:] == epoch[:-MOST_MARKS]])
    if crowded.any():
        at = ", ".join(f"{t:.1f}" for t in time[index[crowded]])
        log.warning("more than %d markers are passed at one time; left out: those at t=%s s", MOST_MARKS, at)
        index, epoch = index[~crowded], epoch[~crowded]
    t = time[index]
    before = np.clip(epoch - 1, 0, None)
    after = np.clip(epoch, None, len(epochs.table) - 1)
    speed = (epochs.travel[before] + epochs.travel[after]) / (epochs.duration[before] + epochs.duration[after])
    late = t - epochs.time[epoch]
    lost = np.where(late < 0, epochs.table[before, GAP_TURN], epochs.table[after, GAP_TURN])
    horizontal, vertical = ((speed * late) ** 2 * lost + sigma[index, c] ** 2 for c in (0, 1))  # in a gap the pipe may bend
    variance = np.column_stack([horizontal + (speed * time_sigma_s) ** 2, horizontal, vertical])
    return MarkAid(index, epoch, place[index], variance, late, np.ones(index.size))


def span_aid(epochs: Epochs, travel: TravelAid, known: KnownPipe) -> SpanAid:
    """Return what is known of joints and straight stretches, on the epochs.

    Parameters
    ----------
    travel : speeds at the bounds; they take a weld's passage to the nearest bound.

    Notes
    -----
    Joints follow one another or stand apart; one that overlaps the one before it is left out. The error of a weld's time works
    twice and opposite in neighbouring joints; as here each length counts by itself, its sigma should hold both times.

    Azimuths of a straight stretch are seen at every epoch, but stray slowly: as many of them as there are in `STRAIGHT_M` count
    as one.

    References
    ----------
    Porter (1990), section 3.5 (distance updates from joint lengths) and 4.2.1 (heading constraints on straight pipe).
    """
    n = epochs.bounds.size
    begins = np.zeros(n, np.int64)
    joint, straight = np.empty((0, 2)), np.empty(0)
    if len(known.joints):
        joint = np.full((n, 2), np.nan)
        last = -1
        for begin_s, end_s, length, sigma in known.joints[np.argsort(known.joints[:, 0], kind="stable")]:
            begin, end = nearest_bound(epochs.time, np.array([begin_s, end_s]))
            if begin < last or end <= begin or not length > 0:
                log.warning("joint of %.3f m from t=%.2f s to %.2f s overlaps the one before, or has no length; not used",
                            length, begin_s, end_s)  # fmt: skip
                continue
            late = travel.speeds[[begin, end]] * (np.array([begin_s, end_s]) - epochs.time[[begin, end]])
            joint[end] = length + late[0] - late[1], sigma**2
            begins[begin] |= RESET_DISTANCE
            last = end
    if len(known.straights):
        straight = np.zeros(n)
        for begin_s, end_s, sigma in known.straights:
            begin, end = nearest_bound(epochs.time, np.array([begin_s, end_s]))
            begins[begin] |= RESET_COURSE
            here = np.arange(begin + 1, end)
            here = here[~travel.stationary[here]]
            way = np.maximum(travel.travel[here], 0.05)
            straight[here] = sigma**2 * np.maximum(STRAIGHT_M / way, 1.0)
    return SpanAid(joint, straight, begins if begins.any() else np.empty(0, np.int64))


def rest_aid(epochs: Epochs, travel: TravelAid, walk: float, pulse: float) -> Floats:
    """Return that a tool at rest does not turn about the vertical (`SpanAid.resting`): the gyros then show their bias there.

    Parameters
    ----------
    walk : variance of the gyros' random walk per second (radian²/s).
    pulse : of the gyros (radian).
    """
    variance = walk * epochs.duration + pulse**2 / 6.0 + SETTLING_RAD**2
    return np.where(travel.stationary & (epochs.gap == 0), variance, 0.0)


def nearest_bound(bounds: Floats, time: Floats) -> NDArray[np.int64]:
    """Return the index of the bound nearest to each time."""
    right = np.clip(np.searchsorted(bounds, time), 1, bounds.size - 1)
    return np.where(bounds[right] - time < time - bounds[right - 1], right, right - 1).astype(np.int64)
