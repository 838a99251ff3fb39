"""Channels in, the weld log out: one row per girth weld with probability, place, sigma and joint length."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.special import ndtr

from deform.caliper.weld_chain import with_joint_lengths
from deform.caliper.weld_channels import HEARD, Channel
from deform.run import build

logger = logging.getLogger(__name__)

_LEVELS = np.array([2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0, 30.0, 50.0])  # sigma: limits of the classes of a score
_FIRES = 4.0  # sigma: scores from here on may be an event of the channel by itself
_SEEN, _MEDIAN, _SPREAD = (
    0.8,
    12.0,
    0.7,
)  # before the data speak: share of welds that a channel sees, their score, its log's sigma
_PRIOR_WEIGHT = 8.0  # welds that the prior is worth
_FALSE_PER_M = 1e-3  # events per metre of a channel that no weld explains, before the data speak
_ROUNDS = 30
_LEAST_KEPT = 0.05  # less probable candidates are not listed at all
_SLOW_SIGMA = {"detector": 0.02, "arms": 0.02, "accelerometer": 0.02}  # m, before the channels have been compared


@dataclass(frozen=True)
class _Candidates:
    place: np.ndarray
    sigma: np.ndarray
    traces: list[np.ndarray]
    covered: list[np.ndarray]
    named: np.ndarray


def weld_log(channels: list[Channel], trajectory: xr.Dataset, cluster: float = 0.15, nominal_joint: float = 12.2) -> xr.Dataset:
    """Combine the channels into group ``welds``.

    Parameters
    ----------
    channels : what each sensor has to say; one is enough, two or three make the log safe.
    trajectory : group ``trajectory``; gives time, odometer distance and sigma at each weld.
    cluster : m, events nearer to each other than this are one weld.
    nominal_joint : m, tells how many welds to expect.

    Notes
    -----
    Hypotheses of a candidate: a girth weld, seen by each channel with its own distribution of scores; or a false event of
    one kind of channel while all others show their background (sampled away from all events). Two rings are of one kind and
    see the same steel: what fools one fools both, so their log likelihoods are averaged, not added. The distributions of
    scores of welds and the rates of false events of each channel are learned from the run itself by expectation and
    maximization, with weak priors, so a poor detector or deaf accelerometers lower their own weight. A rate is learned only
    where another kind listened too: of a single kind nothing but the prior can tell false events from welds. The place is
    the weighted mean of the channels after their constant shifts against each other were taken out; each channel's sigma
    comes from the pairwise differences.
    """
    channels = [c for c in channels if c is not None]
    if not channels:
        return _dataset(np.empty(0), np.empty(0), np.empty(0), np.empty(0, object), trajectory)
    channels, sigma = _align(channels, cluster)
    found = _gather(channels, sigma, cluster)
    if not found.place.size:
        return _dataset(np.empty(0), np.empty(0), np.empty(0), np.empty(0, object), trajectory)
    probability = _probability(channels, sigma, found, cluster, nominal_joint)
    probability = with_joint_lengths(found.place, probability, nominal_joint)
    keep = _best_of_near(found.place, probability, cluster) & (probability > _LEAST_KEPT)
    return _dataset(found.place[keep], found.sigma[keep], probability[keep], found.named[keep], trajectory)


def _align(channels: list[Channel], cluster: float) -> tuple[list[Channel], np.ndarray]:
    """Take out constant shifts between the channels and return each one's own sigma (three-cornered hat)."""
    shift = np.zeros(len(channels))
    for k in range(1, len(channels)):
        difference = _differences(channels[0], channels[k], cluster)
        if difference.size >= 5:
            shift[k] = np.median(difference)
            if abs(shift[k]) > 0.05:
                text = "girth welds by the %s lie %.0f mm %s those by the %s all along: moved onto them (delay, place)"
                way = "behind" if shift[k] > 0 else "before"
                logger.warning(text, channels[k].name, 1e3 * abs(shift[k]), way, channels[0].name)
    moved = [c.moved(-s) for c, s in zip(channels, shift, strict=True)]
    variance, count = np.zeros((len(channels), len(channels))), np.zeros((len(channels), len(channels)))
    for i in range(len(channels)):
        for j in range(i):
            difference = _differences(moved[i], moved[j], cluster)
            if difference.size >= 5:
                variance[i, j] = variance[j, i] = (1.4826 * np.median(np.abs(difference))) ** 2
                count[i, j] = count[j, i] = 1.0
    sigma = np.array([_SLOW_SIGMA.get(c.name, 0.02) for c in channels])
    for k in range(len(channels)):
        others = np.flatnonzero(count[k])
        if others.size >= 2:
            i, j = others[:2]
            own = 0.5 * (variance[k, i] + variance[k, j] - variance[i, j])
            sigma[k] = np.sqrt(max(own, 0.05 * max(variance[k, i], variance[k, j]), 1e-6))
        elif others.size == 1:
            sigma[k] = np.sqrt(variance[k, others[0]] / 2)
    return moved, sigma


def _differences(first: Channel, second: Channel, cluster: float) -> np.ndarray:
    """Places of the second minus the nearest of the first, where they are mutual and near (m)."""
    if not first.place.size or not second.place.size:
        return np.empty(0)
    to_first = _nearest(second.place, first.place)
    back = _nearest(first.place, second.place)
    difference = second.place - first.place[to_first]
    mutual = back[to_first] == np.arange(second.place.size)
    use = mutual & (np.abs(difference) < cluster)
    return difference[use]


def _nearest(places: np.ndarray, among: np.ndarray) -> np.ndarray:
    right = np.clip(np.searchsorted(among, places), 1, max(1, among.size - 1))
    left = right - 1
    right = np.minimum(right, among.size - 1)
    return np.where(np.abs(among[left] - places) <= np.abs(among[right] - places), left, right)


def _reach(sigma: np.ndarray, cluster: float) -> np.ndarray:
    return np.clip(4.0 * np.hypot(sigma, sigma.min()) + 0.01, 0.03, cluster)


def _gather(channels: list[Channel], sigma: np.ndarray, cluster: float) -> _Candidates:
    """Cluster the events of all channels; each candidate looks up every channel's trace at its place."""
    place = np.concatenate([c.place for c in channels])
    source = np.concatenate([np.full(c.place.size, k) for k, c in enumerate(channels)])
    score = np.concatenate([c.score for c in channels])
    own = np.concatenate([np.hypot(c.sigma, s) for c, s in zip(channels, sigma, strict=True)])
    order = np.argsort(place, kind="stable")
    place, source, score, own = place[order], source[order], score[order], own[order]
    reach = float(_reach(sigma, cluster).max())
    groups = np.split(np.arange(place.size), np.flatnonzero(np.diff(place) > reach) + 1) if place.size else []
    places, sigmas, names = [], [], []
    for group in groups:
        best = [group[source[group] == k][np.argmax(score[group][source[group] == k])] for k in np.unique(source[group])]
        weight = 1.0 / own[best] ** 2
        places.append(float(np.sum(weight * place[best]) / weight.sum()))
        sigmas.append(float(1.0 / np.sqrt(weight.sum())))
        names.append("+".join(dict.fromkeys(channels[source[b]].name for b in best)))
    found = np.array(places)
    traces = [c.trace(found, r) for c, r in zip(channels, _reach(sigma, cluster), strict=True)]
    covered = [c.covers(found) for c in channels]
    return _Candidates(found, np.array(sigmas), traces, covered, np.array(names, dtype=object))


def _probability(
    channels: list[Channel], sigma: np.ndarray, found: _Candidates, cluster: float, nominal_joint: float
) -> np.ndarray:
    """Posterior probability of each candidate to be a girth weld."""
    classes = [np.digitize(t, _LEVELS) for t in found.traces]
    fired = [(t >= _FIRES) & c for t, c in zip(found.traces, found.covered, strict=True)]
    span = max(float(np.ptp(found.place)), nominal_joint)
    reach = _reach(sigma, cluster)
    background = [_background(c, found.place, r) for c, r in zip(channels, reach, strict=True)]
    weld_share = [_weld_share(_SEEN, np.log(_MEDIAN), _SPREAD, b) for b in background]
    fading = [_fading(c) for c in channels]
    rates = [_FALSE_PER_M * f for f in fading]
    kinds = _kinds(channels)
    weight = _weights(kinds, found.covered)
    contested = _contested(kinds, found.covered)
    density = 1.0 / nominal_joint
    probability = np.full(found.place.size, 0.5)
    for _ in range(_ROUNDS):
        weld = np.full(found.place.size, np.log(density))
        silent = np.zeros(found.place.size)
        for k, level in enumerate(classes):
            weld += weight[k] * np.log(weld_share[k][level])
            silent += weight[k] * np.log(background[k][level])
        false = np.stack([_false_event(kind, classes, fired, weight, rates, background, silent) for kind in kinds])
        total = np.logaddexp.reduce(false, axis=0)
        before, probability = probability, 1.0 / (1.0 + np.exp(np.clip(total - weld, -700.0, 700.0)))
        blame = np.exp(false - np.where(np.isfinite(total), total, 0.0)) * (1.0 - probability)
        blame = blame[[next(m for m, kind in enumerate(kinds) if k in kind) for k in range(len(channels))]]
        density = (probability.sum() + 1.0) / (span + nominal_joint)
        for k, level in enumerate(classes):
            weld_share[k] = _learned(found.traces[k], np.where(found.covered[k], probability, 0.0), background[k])
            events = np.bincount(level, np.where(contested[k], blame[k], 0.0), _LEVELS.size + 1)
            rates[k] = (events + 0.25 * fading[k]) / (span * contested[k].mean() + 0.25 / _FALSE_PER_M)
        if np.abs(probability - before).max() < 1e-6:
            break
    return probability


def _kinds(channels: list[Channel]) -> list[list[int]]:
    """Indices of the channels of each kind: two rings are one kind, for they see the same steel."""
    names = [c.name for c in channels]
    return [[k for k, name in enumerate(names) if name == kind] for kind in dict.fromkeys(names)]


def _weights(kinds: list[list[int]], covered: list[np.ndarray]) -> list[np.ndarray]:
    """Weight of each channel's evidence at each candidate: the channels of a kind that were listening share one vote."""
    weight = [np.zeros(c.shape) for c in covered]
    for kind in kinds:
        listening = np.sum([covered[k] for k in kind], axis=0)
        for k in kind:
            weight[k] = covered[k] / np.maximum(listening, 1)
    return weight


def _contested(kinds: list[list[int]], covered: list[np.ndarray]) -> list[np.ndarray]:
    """Where each channel listened together with one of another kind: only there can false events be told from welds."""
    result = [np.zeros(c.shape, bool) for c in covered]
    for kind in kinds:
        others = [covered[k] for other in kinds if other is not kind for k in other]
        for k in kind:
            result[k] = covered[k] & np.any(others, axis=0) if others else result[k]
    return result


def _false_event(kind, classes, fired, weight, rates, background, silent: np.ndarray) -> np.ndarray:
    """Log of the rate of events that all channels of one kind make of one cause, while the others show their background."""
    total = silent.copy()
    for k in kind:
        total += weight[k] * (np.log(rates[k][classes[k]]) - np.log(background[k][classes[k]]))
    return np.where(np.any([fired[k] for k in kind], axis=0), total, -np.inf)


def _weld_share(seen: float, middle: float, spread: float, background: np.ndarray) -> np.ndarray:
    """Share of welds in each class of score: log-normal where the channel sees the weld, background where it does not."""
    below = ndtr((np.log(_LEVELS) - middle) / spread)
    share = np.diff(np.concatenate([[0.0], below, [1.0]]))
    return seen * (share + 1e-6) / (share + 1e-6).sum() + (1.0 - seen) * background


def _learned(trace: np.ndarray, weight: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Share of welds in each class, from the traces of the candidates weighted by their probability to be welds."""
    sees = weight * (trace >= _FIRES)
    seen = (sees.sum() + _PRIOR_WEIGHT * _SEEN) / (weight.sum() + _PRIOR_WEIGHT)
    size = np.log(np.maximum(trace, 1e-3))
    total = sees.sum() + _PRIOR_WEIGHT
    middle = (np.sum(sees * size) + _PRIOR_WEIGHT * np.log(_MEDIAN)) / total
    square = (np.sum(sees * (size - middle) ** 2) + _PRIOR_WEIGHT * _SPREAD**2) / total
    return _weld_share(min(seen, 0.995), middle, np.sqrt(square), background)


def _fading(channel: Channel) -> np.ndarray:
    """Falling weights of the classes: strong false events are rarer than weak ones; a detector has one class only."""
    weights = 0.7 ** np.arange(_LEVELS.size + 1)
    if channel.name == "detector":
        weights = np.where(np.arange(_LEVELS.size + 1) == np.digitize(HEARD, _LEVELS), 1.0, 1e-3)
    return weights / weights.sum()


def _background(channel: Channel, candidates: np.ndarray, reach: float, samples: int = 4000) -> np.ndarray:
    """Share of each class of score at places where nothing was found."""
    start, stop = candidates.min(), candidates.max()
    place = start + (np.arange(samples) + 0.5) * (stop - start) / samples
    if candidates.size > 1:
        place = place[np.abs(place - candidates[_nearest(place, candidates)]) > 0.5]
    place = place[channel.covers(place)]
    count = np.bincount(np.digitize(channel.trace(place, reach), _LEVELS), minlength=_LEVELS.size + 1).astype(float)
    count += 0.5 * _fading(channel)
    return count / count.sum()


def _best_of_near(place: np.ndarray, probability: np.ndarray, apart: float) -> np.ndarray:
    """Of candidates nearer than ``apart`` keep the most probable."""
    keep = np.ones(place.size, bool)
    for i in np.flatnonzero(np.diff(place) < apart):
        worse = i if probability[i] < probability[i + 1] else i + 1
        keep[worse] = False
    return keep


def _dataset(
    place: np.ndarray, sigma: np.ndarray, probability: np.ndarray, source: np.ndarray, trajectory: xr.Dataset
) -> xr.Dataset:
    """Group ``welds`` in order of chainage, with time and odometer distance through the trajectory."""
    order = np.argsort(place, kind="stable")
    place, sigma, probability, source = place[order], sigma[order], probability[order], source[order]
    time, chainage, log_distance = (trajectory[n].values for n in ("time", "chainage", "log_distance"))
    index = _first_passage(chainage)
    length = np.full(place.size, np.nan)
    length_sigma = length.copy()
    sure = np.flatnonzero(probability >= 0.5)
    length[sure[:-1]] = np.diff(place[sure])
    length_sigma[sure[:-1]] = np.hypot(np.hypot(sigma[sure[1:]], sigma[sure[:-1]]), _odometer_part(length[sure[:-1]]))
    drift = (
        np.interp(place, chainage[index], trajectory["chainage_sigma"].values[index])
        if "chainage_sigma" in trajectory
        else 0.0 * place
    )
    values = {
        "chainage": place,
        "chainage_sigma": np.hypot(sigma, drift),
        "log_distance": np.interp(place, chainage[index], log_distance[index]),
        "time": np.interp(place, chainage[index], time[index]),
        "probability": probability,
        "joint_length": length,
        "joint_length_sigma": length_sigma,
        "source": source,
    }
    return build.dataset("welds", values)


def _odometer_part(length: np.ndarray, fraction: float = 3e-4) -> np.ndarray:
    """Part of the sigma of a joint's length that grows with it: scale of distance over one joint (m)."""
    return fraction * length


def _first_passage(chainage: np.ndarray) -> np.ndarray:
    """Indices of the trajectory at which new ground is won, rising in chainage (a tool may stand, or roll back)."""
    if chainage[-1] < chainage[0]:
        return _first_passage(-chainage)[::-1]
    furthest = np.maximum.accumulate(chainage)
    return np.flatnonzero(np.concatenate([[True], furthest[1:] > furthest[:-1]]))
