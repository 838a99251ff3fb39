"""Two runs on the reference chainage in, their change with datum, sigma, noise floor and candidate zones out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels, zones
from deform.change.curvature_change import CurvatureChange, curvature_change
from deform.change.datum import Datum, drift_model, fit_drift
from deform.change.noise_floor import floor_by_class, speed_class, spread
from deform.change.position_change import along_pipe, along_pipe_sigma, raw_difference
from deform.change.stack import Layer
from deform.change.wavelength import Signals, Waves, scan, wavelengths
from deform.options import ChangeOptions

Floats = NDArray[Any]
_ROUNDS = 6  # of search and exclusion; two suffice unless zones lie in each other's flanks


@dataclass(frozen=True)
class PairChange:
    """Change of one run since another at the same steel.

    Attributes
    ----------
    run, reference : names. displacement, displacement_sigma : (n, 5) east, north, up, lateral, axial (m), or None without
    positions. curvature : change of each component, or None. ovality, ovality_sigma : (n,) or None. stable : (n,) true where
    the pipe serves as datum. candidates : stretches that changed. place, signals, waves : the scan axis (m), what was
    searched on it, the amplitudes of each wavelength after the zones were taken out. drift : (m, 3) what was taken for drift
    of the runs, on the scan axis. floors : noise floor by quantity and speed class. limit : threshold on twice the log
    likelihood ratio. remarks : what the pair cannot tell, in words.
    """

    run: str
    reference: str
    displacement: Floats | None
    displacement_sigma: Floats | None
    curvature: dict[str, CurvatureChange]
    ovality: Floats | None
    ovality_sigma: Floats | None
    stable: Floats
    candidates: list[zones.Candidate]
    place: Floats
    signals: Signals | None
    waves: list[Waves]
    drift: Floats | None
    floors: dict[str, dict[int, float]]
    limit: float
    remarks: list[str] = field(default_factory=list)


def pair_change(*args, **kwargs) -> PairChange:
    """Return the change of one run since the reference run: `PairSearch` searched and finished."""
    search = PairSearch(*args, **kwargs)
    search.run()
    return search.finish()


class PairSearch:
    """Search and exclusion: find what moved with the pipe beside it as datum, take it out of the datum, look again.

    Parameters
    ----------
    reference, other : the runs on the reference chainage.
    axis : reference chainage, regular (m).
    axes : tangent, right, lift of the reference pipe, each (n, 3).
    options : thresholds and wavelengths.
    edits : stretches that were replaced between the two runs; nothing is said about them.
    elongation : gives the elongation of the joints of a stretch of the reference chainage, and its sigma (m).
    """

    def __init__(
        self,
        reference: Layer,
        other: Layer,
        axis: Floats,
        axes: tuple[Floats, Floats, Floats],
        options: ChangeOptions,
        edits: tuple[tuple[float, float], ...] = (),
        elongation: Callable[[float, float], tuple[float, float]] | None = None,
    ):
        difference = raw_difference(reference, other)
        classes = speed_class(other.values.get("speed"), axis.size)
        usable = other.valid & reference.valid & ~_inside(axis, edits, options.edit_margin_m)
        self.elongation = elongation
        self.reference, self.other, self.axis, self.options = reference, other, axis, options
        self.axes, self.difference, self.classes, self.usable = axes, difference, classes, usable
        self.step = float(axis[1] - axis[0])
        self.size = max(round(options.scan_step_m / self.step), 1)
        self.place = _scan_axis(axis, self.size)
        self.scan_difference = self._coarse(np.where(usable[:, None], difference, np.nan))
        self.scan_axes = (self._coarse(axes[0]), self._coarse(axes[1]), self._coarse(axes[2]))
        self.scan_usable = self._coarse(usable[:, None].astype(float))[:, 0] > 0.5
        self.lengths = wavelengths(options.shortest_wavelength_m, options.longest_wavelength_m, axis[-1] - axis[0])
        self.limit = zones.threshold(self.lengths, options.false_alarms_per_100_km, elongation is not None)
        self.found: list[zones.Candidate] = []
        self.excluded: list[tuple[float, float]] = []
        self.stable = usable.copy()
        self.curvature: dict[str, CurvatureChange] = {}
        self.datum: Datum | None = None
        self.signals: Signals | None = None
        self.waves: list[Waves] = []
        self.remarks: list[str] = []
        self.has_position = bool(np.isfinite(self.scan_difference).any())

    def run(self) -> None:
        """Search until a round finds nothing more."""
        for number in range(_ROUNDS):
            self._changes_of_curvature()
            if not (self.has_position or self.curvature):
                return
            self._fit()
            self.signals = self._signals()
            if self.model is None:
                return
            self.waves = scan(self.signals, self.model, self.lengths, self.scan_usable & ~_inside(self.place, self.excluded, 0.0))
            new = zones.peaks(self.waves, self.limit, self.excluded, self.elongation)
            if not new and number > 0:
                return
            if new:
                self._take(new)

    def keep_clear(self, stretches: list[tuple[float, float]]) -> None:
        """Take stretches that moved in another run out of the datum of this one as well, and fit it anew."""
        own = len(self.excluded)
        self.excluded += [(a, b) for a, b in stretches if not any(c <= a and b <= d for c, d in self.excluded)]
        if len(self.excluded) == own:
            return
        self.stable = self.usable & ~_inside(self.axis, self.excluded, 0.0)
        if self.curvature or self.has_position:
            self._changes_of_curvature()
            self._fit()
            self._measure()

    def finish(self) -> PairChange:
        """Return the change with its sigma on the datum as it stands."""
        displacement, sigma, floors = self._displacement()
        ovality, ovality_sigma = _ovality(self.reference, self.other, self.classes, self.stable, floors)
        floors |= {f"bending strain {name}": _strain_floor(c, self.other) for name, c in self.curvature.items()}
        return PairChange(
            run=self.other.run,
            reference=self.reference.run,
            displacement=displacement,
            displacement_sigma=sigma,
            curvature=self.curvature,
            ovality=ovality,
            ovality_sigma=ovality_sigma,
            stable=self.stable,
            candidates=self.found,
            place=self.place,
            signals=self.signals,
            waves=self.waves,
            drift=self.datum.drift if self.datum else None,
            floors=floors,
            limit=self.limit,
            remarks=self.remarks,
        )

    def _displacement(self):
        """Displacement (n, 5), its sigma, and the noise floors."""
        if not self.has_position or self.datum is None:
            return None, None, {}
        drift = _finer(self.axis, self.place, self.datum.drift)
        moved = np.where(self.other.valid[:, None], self.difference - drift, np.nan)
        lateral, axial = along_pipe(moved, self.axes[0], self.axes[1])
        noise, floors = [], {}
        for name, values in (("lateral", lateral), ("up", moved[:, 2]), ("axial", axial)):
            floor, floors[f"displacement {name}"] = floor_by_class(values, self.classes, self.stable)
            noise.append(floor)
        sigma = self._east_north_up(*noise)  # on the datum pipe the floor holds the scatter of the datum already
        gone = ~self.stable
        bridged = np.sqrt(sigma**2 + _finer(self.axis, self.place, self.datum.variance)) * self._bridge_factor(noise)
        sigma[gone] = bridged[gone]
        across, along = along_pipe_sigma(sigma, self.axes[0], self.axes[1])
        return np.column_stack([moved, lateral, axial]), np.column_stack([sigma, across, along]), floors

    def _bridge_factor(self, noise: list[Floats]) -> Floats:
        """By how much the datum under a zone is worse than its own variance says, east, north, up (3,); from gaps that did
        not move.

        Gaps as wide as the zones are cut into the stable pipe, the drift is fitted without them, and what it misses there is set
        against what it claims: short noise that is not white, and drift that is no random walk, show here and nowhere else.
        """
        factor = np.ones(3)
        if self.datum is None or not self.excluded:
            return factor
        width = float(np.clip(np.median([b - a for a, b in self.excluded]), 30.0, 300.0))
        stable = self.scan_usable & ~_inside(self.place, self.excluded, 0.0)
        gap = ((self.place - self.place[0]) % (4.0 * width) > 1.5 * width) & (
            (self.place - self.place[0]) % (4.0 * width) < 2.5 * width
        )
        datum = fit_drift(self.place, self.scan_difference, self.scan_axes, stable & ~gap, self.model)
        floor = self._east_north_up(*noise)[:: self.size][: self.place.size]
        claimed = np.sqrt(floor**2 + datum.variance)
        core = stable & gap & ((self.place - self.place[0]) % (4.0 * width) > 1.75 * width)
        core &= (self.place - self.place[0]) % (4.0 * width) < 2.25 * width
        for m in range(3):
            seen = spread(((self.scan_difference - datum.drift)[:, m] / claimed[:, m])[core])
            factor[m] = max(seen, 1.0) if np.isfinite(seen) else 1.0
        return factor

    def _east_north_up(self, lateral, up, axial) -> Floats:
        """Sigma of east, north, up from those along the pipe's axes."""
        tangent = self.axes[0]
        level = np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)
        sine2 = (tangent[:, 0] / level) ** 2
        east = np.sqrt(axial**2 * sine2 + lateral**2 * (1.0 - sine2))
        north = np.sqrt(axial**2 * (1.0 - sine2) + lateral**2 * sine2)
        return np.column_stack([east, north, np.broadcast_to(up, east.shape)])

    def _coarse(self, values: Floats) -> Floats:
        out = np.empty((self.place.size, values.shape[1]))
        _kernels.block_means(np.ascontiguousarray(values), self.size, out)
        return out

    def _changes_of_curvature(self) -> None:
        for name in ("horizontal", "vertical"):
            change = curvature_change(self.reference, self.other, name, self.step, self.classes, self.stable)
            if change is not None:
                self.curvature[name] = change

    def _fit(self) -> None:
        stable = self.scan_usable & ~_inside(self.place, self.excluded, 0.0)
        tangent, right, lift = self.scan_axes
        step = float(self.place[1] - self.place[0])
        self.model = drift_model(self.scan_difference, tangent, right, lift, step, stable)
        if self.has_position:
            self.datum = fit_drift(self.place, self.scan_difference, self.scan_axes, stable, self.model)

    def _signals(self) -> Signals:
        """Differences for the search; where nothing is known, or a zone is explained already, the drift stands in."""
        difference = self.scan_difference
        if self.datum is not None:
            gone = _inside(self.place, self.excluded, 0.0) | ~np.isfinite(difference).all(axis=1)
            difference = np.where((gone & _between(~gone))[:, None], self.datum.drift, difference)
        blank = np.full(self.axis.size, np.nan)
        parts = [self.curvature.get(name) for name in ("horizontal", "vertical")]
        ok = self.usable & ~_inside(self.axis, self.excluded, 0.0)
        change = self._coarse(np.column_stack([np.where(ok, c.change, np.nan) if c else blank for c in parts]))
        sigma = self._coarse(np.column_stack([np.where(ok, c.sigma, np.nan) if c else blank for c in parts]))
        _, right, lift = self.scan_axes
        return Signals(self.place, difference, right, lift, change, sigma, self.other.gauge_length)

    def _take(self, new: list[zones.Candidate]) -> None:
        """Take candidates out of the datum, first wide, then with the extent that the displacement shows without them."""
        self.found += new
        self.excluded = [_clear_of(c, self.options.zone_margin_m, 0.75) for c in self.found]
        for _ in range(2):
            self._fit()
            self._measure()
            self.excluded = [_clear_of(c, self.options.zone_margin_m, 0.6) for c in self.found]
        self.stable = self.usable & ~_inside(self.axis, self.excluded, 0.0)

    def _measure(self) -> None:
        """Give every candidate the extent that the displacement shows on the datum as it stands."""
        size, sigma = self._size()
        for k, c in enumerate(self.found):
            start, end, _ = zones.extent(self.place, size, sigma, c)
            self.found[k] = replace(c, start=start, end=end)

    def _size(self) -> tuple[Floats, Floats]:
        """Size of the displacement across the pipe, averaged over five metres, and its sigma."""
        if self.datum is None:
            zero = np.zeros(self.place.size)
            return zero, np.ones(self.place.size)
        moved = self.scan_difference - self.datum.drift
        right = self.scan_axes[1]
        lateral = np.einsum("ij,ij->i", moved, right) / np.maximum(np.linalg.norm(right, axis=1), 1e-9)
        size = _smooth(np.hypot(lateral, moved[:, 2]), max(round(5.0 / (self.place[1] - self.place[0])), 1))
        quiet = self.scan_usable & ~_inside(self.place, self.excluded, 0.0)
        floor, _ = floor_by_class(size, np.full(size.size, -1), quiet)
        return size, np.sqrt(floor**2 + self.datum.variance[:, :3].max(axis=1))


def _strain_floor(change: CurvatureChange, other: Layer) -> dict[int, float]:
    return {k: v * other.outside_diameter / 2.0 for k, v in change.floors.items()}


def _ovality(reference: Layer, other: Layer, classes: Floats, stable: Floats, floors: dict):
    if not (reference.has("ovality") and other.has("ovality")):
        return None, None
    change = other.values["ovality"] - reference.values["ovality"]
    formal = np.hypot(*(run.values.get("ovality_sigma", np.ones_like(change)) for run in (reference, other)))
    factor, _ = floor_by_class(change / formal, classes, stable)
    floors["ovality"] = floor_by_class(change, classes, stable)[1]
    return change, factor * formal


def _finer(axis: Floats, place: Floats, values: Floats) -> Floats:
    """Values of the scan axis on the reference chainage, column by column."""
    return np.column_stack([np.interp(axis, place, column) for column in values.T])


def _clear_of(c: zones.Candidate, margin: float, share: float) -> tuple[float, float]:
    """Stretch that carries no datum: the wave's own share of wavelengths, and the extent with a margin for its faint ends."""
    margin = max(margin, 0.15 * (c.end - c.start))
    return min(c.start - margin, c.centre - share * c.length), max(c.end + margin, c.centre + share * c.length)


def _inside(place: Floats, spans, margin: float) -> Floats:
    inside = np.zeros(place.size, bool)
    for start, end in spans:
        inside |= (place >= start - margin) & (place <= end + margin)
    return inside


def _between(known: Floats) -> Floats:
    """True from the first to the last known place."""
    out = np.zeros(known.size, bool)
    at = np.flatnonzero(known)
    if at.size:
        out[at[0] : at[-1] + 1] = True
    return out


def _scan_axis(axis: Floats, size: int) -> Floats:
    count = axis.size // size
    return axis[0] + (np.arange(count) * size + 0.5 * (size - 1)) * (axis[1] - axis[0])


def _smooth(values: Floats, width: int) -> Floats:
    known = np.isfinite(values)
    kernel = np.ones(width | 1)
    weight = np.convolve(known.astype(float), kernel, mode="same")
    total = np.convolve(np.where(known, values, 0.0), kernel, mode="same")
    return np.where(weight > 0, total / np.maximum(weight, 1e-9), np.nan)
