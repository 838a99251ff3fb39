"""One dataset of a run's caliper in, one matplotlib figure out: section with residuals, unrolled wall, dent profiles, joints."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure

from deform.geometry.circle import SectionFit, adjust_ellipse
from deform.report.quantities import measure
from deform.report.style import EPOCHS, FAINT, INK, MATPLOTLIB
from deform.units import clock_text

_READING_SIGMA_M = 3e-4  # assumed of a cell of the wall; what the section scatters more widens the sigmas drawn
_HOURS = ["12:00", "3:00", "6:00", "9:00"]
_OUTWARD = "RdBu_r"  # blue inward as in the dent cards, red outward
_PUP_SHARE = 0.5


def section_residuals(wall: xr.Dataset, chainage: float) -> Figure:
    """Return a cross-section with its adjusted ellipse and scaled residuals (Porter 1990, Fig. 2-7 and 4-6).

    Residuals are drawn so many times too large that the largest takes about a third of the radius; the title says how many.

    Parameters
    ----------
    wall : group ``caliper``.
    chainage : m; the nearest section is drawn.
    """
    row = int(np.argmin(np.abs(wall["chainage"].values - chainage)))
    clock, radius = np.radians(wall["clock"].values.astype(float)), wall["radius"].values[row].astype(float)
    x, z = radius * np.sin(clock), radius * np.cos(clock)
    fit = adjust_ellipse(x[None], z[None], _READING_SIGMA_M, robust=True)
    residual = fit.residual[0]
    mean = 0.5 * float(fit.semi_major[0] + fit.semi_minor[0])
    largest = float(np.nanmax(np.abs(residual)))
    scale = max(1.0, float(f"{mean / 3 / max(largest, 1e-6):.1g}"))
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(9.2, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=[1.15, 1])
        _draw_section(left, fit, clock, residual, scale)
        left.set_title(f"Section at {wall['chainage'].values[row]:.2f} m, residuals × {scale:.0f}")
        _residual_bars(right, np.degrees(clock), residual)
    return figure


def unrolled_wall(wall: xr.Dataset, start: float, stop: float, marks: dict[str, np.ndarray] | None = None) -> Figure:
    """Return the unrolled wall between two chainages (m): radius against the mean radius there, over chainage and clock.

    Parameters
    ----------
    wall : group ``caliper``.
    marks : chainages (m) of what is drawn as a line, by name (``{"weld": ...}``).
    """
    part = wall.isel(scan=(wall["chainage"].values >= start) & (wall["chainage"].values <= stop))
    clock = np.append(part["clock"].values, 360.0)
    off = (part["radius"].values - part["reference_radius"].values[:, None]) * 1e3
    off = np.concatenate([off, off[:, :1]], axis=1)
    most = float(np.nanquantile(np.abs(off), 0.999)) if np.isfinite(off).any() else 1.0
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(9.2, 3.0), layout="constrained")
        ax = figure.subplots()
        picture = ax.pcolormesh(part["chainage"].values, clock, off.T, cmap=_OUTWARD, vmin=-most, vmax=most, shading="nearest")
        picture.set_rasterized(True)  # a kilometre of wall is no drawing
        for k, (name, places) in enumerate((marks or {}).items()):
            inside = np.asarray(places)[(np.asarray(places) >= start) & (np.asarray(places) <= stop)]
            for j, place in enumerate(inside):
                ax.axvline(place, color=INK, linewidth=0.7, linestyle=("--", ":", "-.")[k % 3], label=name if j == 0 else None)
        ax.grid(visible=False)
        ax.set(xlim=(start, stop), ylim=(360, 0), xlabel="chainage (m)", ylabel="clock (h:mm)")
        ax.set_yticks(np.arange(0, 361, 90), [*_HOURS, "12:00"])
        ax.set_title("Wall, radius against the mean radius there")
        figure.colorbar(picture, ax=ax, label="radius (mm), + = outward", pad=0.01)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    return figure


def dent_profiles(window: xr.Dataset) -> Figure:
    """Return the profiles of one dent along and around the pipe through its apex, with their sigma.

    Parameters
    ----------
    window : from `profile_dataset`.
    """
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(9.2, 3.0), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        rows = (
            ("distance", 1e3, "profile_along", "along the pipe (mm), + = downstream", window.attrs["length_m"] * 1e3),
            ("arc", 1e3, "profile_around", "around the pipe (mm), + = clockwise", window.attrs["width_m"] * 1e3),
        )
        for ax, (name, factor, variable, label, extent) in zip(axes, rows, strict=True):
            at, value = window[name].values * factor, -window[variable].values * 1e3
            sigma = window[f"{variable}_sigma"].values * 1e3
            ax.fill_between(
                at, value - 1.96 * sigma, value + 1.96 * sigma, color=EPOCHS[5], alpha=0.35, linewidth=0, label="95 %"
            )
            ax.plot(at, value, color=EPOCHS[0], label="wall")
            tenth = -0.1 * window.attrs["depth_m"] * 1e3
            ax.plot(
                [-0.5 * extent, 0.5 * extent], [tenth, tenth], color=EPOCHS[1], marker="|", label=f"{extent:.0f} mm at a tenth"
            )
            ax.axhline(0.0, color=INK, linewidth=0.6)
            ax.set_xlabel(label)
            ax.legend(fontsize=7, loc="lower right")
        axes[0].set_ylabel("wall against the undamaged pipe (mm)\n+ = outward")
        axes[0].set_title(
            f"Dent at {window.attrs['chainage_m']:.2f} m, {clock_text(window.attrs['clock_deg'])}: "
            f"{measure('dent depth', window.attrs['depth_m'], window.attrs['depth_sigma_m'])} deep (± 1 σ)"
        )
    return figure


def profile_dataset(wall: xr.Dataset, dents: xr.Dataset, index: int, outside_diameter: float, reach: float = 1.2) -> xr.Dataset:
    """Return the profiles of a dent through its apex: depth (m, positive inward) along and around the pipe, with sigma.

    Parameters
    ----------
    wall, dents : groups ``caliper`` and ``dents``.
    index : of the dent.
    outside_diameter : m, for arcs around the pipe.
    reach : half of the window, in lengths and widths of the dent.

    Notes
    -----
    The undamaged wall is the median of the pipe beside the dent at the same clock. The sigma holds the scatter of that pipe and
    the sigma of the depth, in the share of it that the profile has.
    """
    size = {n: float(dents[n][index]) for n in ("chainage", "clock", "depth", "depth_sigma", "length", "width")}
    place, off = wall["chainage"].values - size["chainage"], (wall["clock"].values - size["clock"] + 180.0) % 360.0 - 180.0
    order = np.argsort(off)
    near = np.abs(place) <= reach * size["length"]
    beside = (np.abs(place) > 0.75 * size["length"]) & (np.abs(place) <= 1.5 * size["length"] + 0.3)
    radius = wall["radius"].values.astype(float)[:, order]
    with np.errstate(all="ignore"):
        undamaged = np.nanmedian(radius[beside], axis=0)
        scatter = 1.4826 * np.nanmedian(np.abs(radius[beside] - undamaged))
    depth = undamaged[None, :] - radius[near]
    arc = np.radians(off[order]) * 0.5 * outside_diameter
    across = np.abs(arc) <= reach * size["width"]
    along = depth[:, np.argmin(np.abs(off[order]))]
    around = depth[np.argmin(np.abs(place[near]))][across]

    def sigma(profile: np.ndarray) -> np.ndarray:
        return np.hypot(scatter, size["depth_sigma"] * np.abs(profile) / size["depth"])

    values = {"profile_along": ("distance", along), "profile_around": ("arc", around)}
    values |= {f"{n}_sigma": (d, sigma(v)) for n, (d, v) in values.items()}
    attrs = {f"{n}_m": v for n, v in size.items() if n != "clock"} | {"clock_deg": size["clock"]}
    return xr.Dataset(values, coords={"distance": place[near], "arc": arc[across]}, attrs=attrs)


def joint_lengths(welds: xr.Dataset) -> Figure:
    """Return the histogram of the joint lengths of a run.

    Parameters
    ----------
    welds : group ``welds``; where its attribute ``nominal_joint_m`` is stated, what is shorter than half of it counts as a pup.
    """
    nominal_joint = float(welds.attrs.get("nominal_joint_m", np.nan))
    length = welds["joint_length"].values.astype(float)
    sigma = welds["joint_length_sigma"].values[np.isfinite(length)] if "joint_length_sigma" in welds else np.empty(0)
    length = length[np.isfinite(length)]
    with rc_context(MATPLOTLIB):
        figure = Figure(figsize=(9.2, 2.6), layout="constrained")
        ax, counts = figure.subplots(), np.empty(0, int)
        if length.size:
            step = 0.1 if np.ptp(length) < 30 else float(np.ptp(length) / 300)
            edges = np.arange(0.0, length.max() + 2 * step, step)
            counts = np.histogram(length, edges)[0]
            ax.stairs(counts, edges, fill=True, color=EPOCHS[0])
            words = f"{length.size} joints, median {np.median(length):.2f} m"
            if np.isfinite(nominal_joint):
                words += f", {int((length < _PUP_SHARE * nominal_joint).sum())} pups"
            if np.isfinite(sigma).any():
                words += f"; a length is sure to {np.nanmedian(sigma) * 1e3:.0f} mm (1 σ)"
            ax.set_title(words)
        ax.set_yscale("symlog", linthresh=10)
        top = float(np.max(counts, initial=1.0))
        ticks = [t for t in (0, 2, 5, 10, 30, 100, 300, 1000, 3000, 10000) if t <= 2 * top]
        ax.set_yticks(ticks, [str(t) for t in ticks])
        ax.set_ylim(0, 1.3 * top)
        ax.set(xlabel="joint length (m)", ylabel="joints")
    return figure


def _draw_section(ax, fit: SectionFit, clock: np.ndarray, residual: np.ndarray, scale: float) -> None:
    """Ellipse, its axes, and the wall with scaled residuals, looking downstream."""
    a, b, turn = float(fit.semi_major[0]), float(fit.semi_minor[0]), float(fit.orientation[0])
    t = np.linspace(0.0, 2 * np.pi, 361)
    ellipse = _ellipse(t, a, b, turn)
    at = _ellipse_at(clock, a, b, turn)
    drawn = at + scale * residual[:, None] * np.stack([np.sin(clock), np.cos(clock)], axis=1)
    closed = np.append(np.arange(len(drawn)), 0)
    ax.plot(*(ellipse.T * 1e3), color=INK, linewidth=0.8, linestyle=":", label="adjusted ellipse")
    for half, way in ((a, turn), (b, turn + 0.5 * np.pi)):
        ends = np.array([-half, half]) * 1e3
        ax.plot(ends * np.sin(way), ends * np.cos(way), color=FAINT, linewidth=0.8)
    ax.plot(*(drawn[closed].T * 1e3), color=EPOCHS[0], label="wall, residuals scaled")
    for start, end in zip(at, drawn, strict=True):
        ax.plot(*(np.stack([start, end]).T * 1e3), color=EPOCHS[1], linewidth=0.5)
    ovality = measure("ovality", fit.ovality[0], fit.ovality_sigma[0] * max(1.0, fit.sigma_unit[0]))
    words = f"diameter {measure('diameter', 2 * a).number} and {measure('diameter', 2 * b)}\novality {ovality} (± 1 σ)"
    ax.text(0.0, 0.0, words, ha="center", va="center", fontsize=7)
    ax.set_aspect("equal")
    ax.grid(visible=False)
    ax.set(xlabel="right (mm), looking downstream", ylabel="up (mm)")


def _residual_bars(ax, clock: np.ndarray, residual: np.ndarray) -> None:
    ax.bar(clock, residual * 1e3, width=360.0 / clock.size * 0.8, color=np.where(residual < 0, EPOCHS[1], EPOCHS[0]))
    ax.axhline(0.0, color=INK, linewidth=0.6)
    ax.set(xlim=(-3, 363), xlabel="clock (h:mm)", ylabel="residual (mm), + = outward", title="Wall minus ellipse")
    ax.set_xticks(np.arange(0, 361, 90), [*_HOURS, "12:00"])


def _ellipse(t: np.ndarray, a: float, b: float, turn: float) -> np.ndarray:
    """Points (n, 2) right, up of an ellipse about the origin, its greater axis turned clockwise from up."""
    u, v = a * np.cos(t), b * np.sin(t)
    return np.stack([u * np.sin(turn) + v * np.cos(turn), u * np.cos(turn) - v * np.sin(turn)], axis=-1)


def _ellipse_at(clock: np.ndarray, a: float, b: float, turn: float) -> np.ndarray:
    """Points (n, 2) of the ellipse at clocks (rad)."""
    size = 1.0 / np.hypot(np.cos(clock - turn) / a, np.sin(clock - turn) / b)
    return np.stack([size * np.sin(clock), size * np.cos(clock)], axis=1)
