"""Two runs on the reference chainage in, their change with datum, sigma, noise floor and candidate zones out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deform.change import _kernels, zones
from deform.change.bridge import Bridges
from deform.change.curvature_change import CurvatureChange, curvature_change
from deform.change.datum import Datum, drift_model, fit_drift
from deform.change.intervals import Stretch, between, clear_of, inside, merged
from deform.change.joint_change import Elongation
from deform.change.noise_floor import speed_noise, speed_step, spread
from deform.change.position_change import displacement_on, finer, noise_about_datum, raw_difference
from deform.change.running_mean import running_mean
from deform.change.signals import Signals
from deform.change.stack import POSITION, Layer
from deform.change.support import find_support
from deform.change.wavelength import WaveNoise, Waves, scan, wavelengths, with_tails
from deform.geometry.resample import spread_about_zero
from deform.options import ChangeOptions

Floats = NDArray[Any]
_ROUNDS = 40  # of search and exclusion, at most; most lines need two to four
_ABSORBED = 0.1  # of the evidence of a zone: what remains at its ends with less is its own faint end
_MERGE = 4.0  # sigma by which the pipe between two zones must lie apart from the datum outside both
_WIDEST_MERGE = 600.0  # m


@dataclass(frozen=True)
class PairChange:
    """Change of one run since another at the same steel.

    Attributes
    ----------
    run, reference : names. displacement, displacement_sigma : (n, 5) east, north, up, lateral, axial (m), or None without
    positions. curvature : change of each component, or None. ovality, ovality_sigma : (n,) or None. stable : (n,) true where
    the pipe serves as datum. candidates : stretches that changed. waves : noise of the amplitudes of each wavelength after the
    zones were taken out. floors : noise floor by quantity and speed class. limit : threshold on twice the log likelihood ratio.
    order : places of the reference and of the run among the runs of the line, the earliest first; dates are not needed for it,
    and a run may have none. datum, bridges : drift of the two runs on the scan axis and what it is worth over pipe without
    datum, None without positions.
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
    waves: list[WaveNoise]
    floors: dict[str, dict[int, float]]
    limit: float
    order: tuple[int, int] = (0, 1)
    elongation: Elongation | None = None
    step: float = 1.0
    colour: dict[str, float] = field(default_factory=dict)
    datum: Datum | None = None
    bridges: Bridges | None = None

    @property
    def sign(self) -> float:
        """1, or -1 when the run is older than the reference: what changed since then is the other way round."""
        return -1.0 if self.order[1] < self.order[0] else 1.0

    @property
    def earlier(self) -> str:
        """Name of the earlier of the two runs."""
        return self.reference if self.sign > 0 else self.run

    @property
    def later(self) -> str:
        """Name of the later of the two runs."""
        return self.run if self.sign > 0 else self.reference


class PairSearch:
    """Search and exclusion: find what moved with the pipe beside it as datum, take it out of the datum, look again.

    Parameters
    ----------
    reference, other : the runs on the reference chainage.
    axis : reference chainage, regular (m).
    axes : tangent, right, lift of the reference pipe, each (n, 3).
    options : thresholds and wavelengths.
    edits : stretches that were replaced between the two runs; nothing is said about them.
    elongation : of the joints of a stretch of the reference chainage, where both runs know their welds.
    order : places of the two runs among those of the line, the earliest first.
    """

    def __init__(
        self,
        reference: Layer,
        other: Layer,
        axis: Floats,
        axes: tuple[Floats, Floats, Floats],
        options: ChangeOptions,
        edits: tuple[tuple[float, float], ...] = (),
        elongation: Elongation | None = None,
        order: tuple[int, int] = (0, 1),
    ):
        difference = raw_difference(reference, other)
        usable = other.valid & reference.valid & ~inside(axis, edits, options.edit_margin_m)
        self.elongation, self.order = elongation, order
        self.reference, self.other = (run.without(*POSITION, "azimuth", "pitch", "speed") for run in (reference, other))
        self.axis, self.options = axis, options
        self.axes, self.difference, self.usable = axes, difference, usable
        self.speeds = speed_step(reference.values.get("speed"), axis.size), speed_step(other.values.get("speed"), axis.size)
        self.step = float(axis[1] - axis[0])
        self.size = max(round(options.scan_step_m / self.step), 1)
        self.place = _scan_axis(axis, self.size)
        self.scan_difference = self._coarse(np.where(usable[:, None], difference, np.nan))
        self.scan_axes = (self._coarse(axes[0]), self._coarse(axes[1]), self._coarse(axes[2]))
        self.scan_usable = self._coarse(usable[:, None].astype(float))[:, 0] > 0.5
        self.lengths = wavelengths(options.shortest_wavelength_m, options.longest_wavelength_m, axis[-1] - axis[0])
        self.limit = zones.threshold(self.lengths, options.false_alarms_per_100_km, elongation is not None)
        self.found: list[zones.Candidate] = []
        self.excluded: list[Stretch] = []
        self.settled: list[Stretch] | None = None  # the stretches that the curvature, the drift
        self.scanned: list[Stretch] | None = None  # and the waves are without
        self.spent: list[zones.Candidate] = []
        self.stable = usable.copy()
        self.curvature: dict[str, CurvatureChange] = {}
        self.datum: Datum | None = None
        self.bridges: Bridges | None = None
        self.signals: Signals | None = None
        self.waves: list[Waves] = []
        self.noise: list[WaveNoise] = []
        self.has_position = bool(np.isfinite(self.scan_difference).any())

    def run(self) -> None:
        """Search until a round finds nothing more, then hold what was found against the noise of the pipe that is left."""
        for _ in range(_ROUNDS):
            self._settle()
            if not (self.has_position or self.curvature):
                return
            self._scan()
            new = zones.peaks(self.waves, self.limit, self.excluded, self.spent, self.elongation)
            if not new or not self._take(new):
                break
        self._verify()
        self._join()
        self.noise, self.waves = [wave.noise for wave in self.waves], []  # the amplitudes of a long line are large

    def finish_clear_of(self, stretches: list[Stretch]) -> PairChange:
        """Return the change on a datum from which stretches that moved in another run are taken as well."""
        own = len(self.excluded)
        self.excluded += [(a, b) for a, b in stretches if not any(c <= a and b <= d for c, d in self.excluded)]
        if len(self.excluded) > own and (self.curvature or self.has_position):
            self._settle()
        return self.finish()

    def finish(self) -> PairChange:
        """Return the change with its sigma on the datum as it stands."""
        displacement, sigma, floors = self._displacement()
        ovality, ovality_sigma = self._ovality(floors)
        half = self.other.outside_diameter / 2.0
        for name, change in self.curvature.items():
            floors[f"bending strain {name}"] = {k: v * half for k, v in change.floors.items()}
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
            waves=self.noise,
            floors=floors,
            limit=self.limit,
            order=self.order,
            elongation=self.elongation,
            step=self.step,
            colour=dict(zip(("horizontal", "vertical"), self._colour(), strict=True)),
            datum=self.datum,
            bridges=self.bridges,
        )

    def _displacement(self) -> tuple[Floats | None, Floats | None, dict[str, dict[int, float]]]:
        """Displacement (n, 5), its sigma, and the noise floors."""
        if not self.has_position or self.datum is None:
            return None, None, {}
        moved = np.where(self.other.valid[:, None], self.difference - finer(self.axis, self.place, self.datum.drift), np.nan)
        noise = noise_about_datum(moved, self.axes, self.speeds, self.stable)
        quiet = self.scan_usable & ~inside(self.place, self.excluded)
        floor = np.nanmedian(noise.east_north_up, axis=0)
        self.bridges = Bridges(self.place, self.scan_difference, self.scan_axes, quiet, self.model, floor)
        return *displacement_on(self.datum, self.bridges, noise, self.excluded, self.axis, moved, self.axes), noise.floors

    def _ovality(self, floors: dict[str, dict[int, float]]) -> tuple[Floats | None, Floats | None]:
        if not (self.reference.has("ovality") and self.other.has("ovality")):
            return None, None
        change = self.other.values["ovality"] - self.reference.values["ovality"]
        runs = self.reference, self.other
        formal = np.hypot(*(run.values.get("ovality_sigma", np.ones_like(change)) for run in runs))
        floors["ovality"] = speed_noise(change, *self.speeds, self.stable).floors
        return change, speed_noise(change / formal, *self.speeds, self.stable).at(*self.speeds) * formal

    def _coarse(self, values: Floats) -> Floats:
        out = np.empty((self.place.size, values.shape[1]))
        _kernels.block_means(np.ascontiguousarray(values), self.size, out)
        return out

    def _settle(self) -> None:
        """Changes of curvature, and the drift of the two runs, with what is excluded out of both; nothing when they are so."""
        if self.settled == (excluded := merged(self.excluded)):
            return
        self.settled = excluded
        self.stable = self.usable & ~inside(self.axis, self.excluded)
        for name in ("horizontal", "vertical"):
            change = curvature_change(self.reference, self.other, name, self.step, self.speeds, self.stable)
            if change is not None:
                self.curvature[name] = change
        stable = self.scan_usable & ~inside(self.place, self.excluded)
        step = float(self.place[1] - self.place[0])
        self.model = drift_model(self.scan_difference, *self.scan_axes, step, stable)
        if self.has_position:
            self.datum = fit_drift(self.place, self.scan_difference, self.scan_axes, stable, self.model)

    def _scan(self, *, tails: bool = False) -> None:
        """Amplitudes of all wavelengths on what is settled; nothing but their tails when they are known."""
        reach = float(np.sqrt(self.limit))
        if self.scanned != self.settled:
            self.signals = self._signals()
            quiet = self.scan_usable & ~inside(self.place, self.excluded)
            self.waves = scan(self.signals, self.model, self.lengths, quiet, reach=reach)
            self.scanned = self.settled
        if tails:
            self.waves = with_tails(self.waves, reach)

    def _signals(self) -> Signals:
        """Differences for the search; where nothing is known, or a zone is explained already, the drift stands in.

        Along the pipe it stands in everywhere: welds set wrong by centimetres shift the runs against each other there, and in a
        bend what lies along one leg lies across the other.
        """
        difference = self.scan_difference
        if self.datum is not None:
            along = self.scan_axes[0] / np.linalg.norm(self.scan_axes[0], axis=1, keepdims=True)
            difference = difference - np.einsum("ij,ij->i", difference - self.datum.drift, along)[:, None] * along
            gone = inside(self.place, self.excluded) | ~np.isfinite(difference).all(axis=1)
            difference = np.where((gone & between(~gone))[:, None], self.datum.drift, difference)
        change, sigma = np.full((2, self.place.size, 2), np.nan)
        for m, name in enumerate(("horizontal", "vertical")):
            if (known := self.curvature.get(name)) is not None:
                for into, part in ((change, known.change), (sigma, known.sigma)):
                    into[:, m] = self._coarse(np.where(self.stable, part, np.nan)[:, None])[:, 0]
        _, right, lift = self.scan_axes
        return Signals(self.place, difference, right, lift, change, sigma, self.other.gauge_length)

    def _take(self, new: list[zones.Candidate]) -> bool:
        """Give candidates their extent and take them out of the datum; false when none of them is new after all."""
        signals = self.signals
        assert signals is not None
        white = np.sqrt(np.nan_to_num(signals.gauge_length, nan=2.0) / signals.step)
        change, noise = signals.curvature.copy(), signals.curvature_sigma * self._colour() * white
        taken = 0
        for c in new:
            if any(a < c.centre < b for a, b in self.excluded[-taken:] if taken):
                continue
            support = find_support(self.place, change, noise, c.centre - 0.25 * c.length, c.centre + 0.25 * c.length)
            if support is not None and support.worth > 0:
                c = replace(
                    c, **{k: getattr(support, k) for k in ("start", "end", "start_sigma", "end_sigma", "evidence", "closed")}
                )
            else:
                c = self._by_displacement(c)
            if self._absorb(c):
                self.spent.append(c)
            else:
                self.found.append(c)
            self.excluded.append(clear_of(c, self.options.zone_margin_m))
            change[inside(self.place, self.excluded[-1:])] = np.nan
            taken += 1
        return taken > 0

    def _colour(self) -> Floats:
        """Scatter of means of curvature over some eight metres against what its sigma says for white noise over the gauge."""
        signals = self.signals
        if signals is None:
            return np.ones(2)
        z = signals.curvature / signals.curvature_sigma
        size, gauge = max(round(8.0 / signals.step), 1), signals.gauge_length if np.isfinite(signals.gauge_length) else 2.0
        count = z.shape[0] // size
        if count < 8:
            return np.ones(2)
        means = z[: count * size].reshape(count, size, 2).mean(axis=1) * np.sqrt(size * signals.step / gauge)
        found = np.array([spread_about_zero(means[:, m]) for m in range(2)])
        return np.where(np.isfinite(found), np.maximum(found, 0.3), 1.0)

    def _absorb(self, c: zones.Candidate) -> bool:
        """True for what remains at the ends of a zone that is known; the zone is led on over it when curvature shows it."""
        for k, known in enumerate(self.found):
            gap = max(c.start - known.end, known.start - c.end)
            if gap > self.options.zone_margin_m + 3.0 * max(known.start_sigma, known.end_sigma):
                continue
            if c.evidence >= _ABSORBED * known.evidence and known.evidence > 0:
                continue
            if c.evidence > 0 and c.start < known.start:
                known = replace(known, start=c.start, start_sigma=float(np.hypot(c.start_sigma, known.start_sigma)))
            if c.evidence > 0 and c.end > known.end:
                known = replace(known, end=c.end, end_sigma=float(np.hypot(c.end_sigma, known.end_sigma)))
            self.found[k] = known
            return True
        return False

    def _by_displacement(self, c: zones.Candidate) -> zones.Candidate:
        """A candidate that curvature does not show, with the extent that the displacement shows."""
        if self.datum is None:
            return c
        stable = self.scan_usable & ~inside(
            self.place, [*self.excluded, (c.centre - 0.75 * c.length, c.centre + 0.75 * c.length)]
        )
        datum = fit_drift(self.place, self.scan_difference, self.scan_axes, stable, self.model)
        size, sigma = self._size(datum, stable)
        start, end, _ = zones.extent(self.place, size, sigma, c)
        return replace(c, start=start, end=end)

    def _size(self, datum: Datum, quiet: Floats) -> tuple[Floats, Floats]:
        """Size of the displacement across the pipe, averaged over five metres, and its sigma."""
        moved = self.scan_difference - datum.drift
        right = self.scan_axes[1]
        lateral = np.einsum("ij,ij->i", moved, right) / np.maximum(np.linalg.norm(right, axis=1), 1e-9)
        size = running_mean(np.hypot(lateral, moved[:, 2]), round(5.0 / (self.place[1] - self.place[0])))
        floor = spread(size[quiet])
        return size, np.sqrt((floor if np.isfinite(floor) else 0.0) ** 2 + datum.variance[:, :3].max(axis=1))

    def _verify(self) -> None:
        """Drop what does not stand out of the tails of the noise, which are known once all that moved is out of them."""
        if not self.found:
            return
        self._settle()
        self._scan(tails=True)
        held = [zones.against(c, self.waves) for c in self.found]
        kept = [c for c in held if c.statistic + c.joint_score > self.limit]
        if len(kept) < len(held):
            self.excluded = [clear_of(c, self.options.zone_margin_m) for c in kept]
        self.found = kept

    def _join(self) -> None:
        """Make one zone of two when the pipe between them lies apart from the datum outside both."""
        self.found.sort(key=lambda c: c.start)
        k = 0
        while self.has_position and k + 1 < len(self.found):
            first, second = self.found[k], self.found[k + 1]
            if second.start - first.end < _WIDEST_MERGE and self._between_moved(first, second):
                both = max(first, second, key=lambda c: c.statistic)
                self.found[k : k + 2] = [
                    replace(both, start=first.start, start_sigma=first.start_sigma, end=second.end, end_sigma=second.end_sigma)
                ]
            else:
                k += 1
        self.excluded = [clear_of(c, self.options.zone_margin_m) for c in self.found]
        self._settle()
        self._scan(tails=True)

    def _between_moved(self, first: zones.Candidate, second: zones.Candidate) -> bool:
        gap = (self.place > first.end) & (self.place < second.start) & self.scan_usable
        if not gap.any():
            return False
        whole = (clear_of(first, 0.0)[0], clear_of(second, 0.0)[1])
        stable = self.scan_usable & ~inside(self.place, [*self.excluded, whole])
        datum = fit_drift(self.place, self.scan_difference, self.scan_axes, stable, self.model)
        size, sigma = self._size(datum, stable)
        known = np.isfinite(size) & gap
        return bool(known.any() and np.median(size[known] / sigma[known]) > _MERGE)


def _scan_axis(axis: Floats, size: int) -> Floats:
    count = axis.size // size
    return axis[0] + (np.arange(count) * size + 0.5 * (size - 1)) * (axis[1] - axis[0])
