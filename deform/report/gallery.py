"""Which figure stands in which section: one entry per figure, placed alike in the page and in the PDF.

To add a figure, write it as a function of one dataset in a file ``*_figures.py``, and add one `Plate` to `PLATES` below: the
section it belongs to, its caption, where its datasets come from, and the function. Nothing else has to be touched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from deform.report import caliper_figures, line_figures, match_figures, navigation_figures, trend_figures
from deform.report.caliper_view import most_oval_wall, profiles_of_deepest_dent, wall_of_deepest_dent
from deform.report.content import Content
from deform.report.line_view import line_dataset, run_dataset
from deform.report.trend_view import limit_dataset, trend_dataset
from deform.report.zones import moved

ZONE_MARGIN_M = 60.0
_ZONE_COLUMNS = 400
_MOST_TRENDS = 12


@dataclass(frozen=True)
class Given:
    """What the datasets of the figures are made from: the folder's content, its zones and dents as rows, and how many to draw."""

    content: Content
    zones: list[dict]
    dents: list[dict]
    most_zones: int = 40

    @cached_property
    def line(self) -> xr.Dataset:
        """The whole line, thinned to what a picture shows."""
        return line_dataset(self.content, self.zones, self.dents)


Datasets = Iterable[tuple[str, xr.Dataset]]


@dataclass(frozen=True)
class Plate:
    """One figure of a section.

    Attributes
    ----------
    section : ``line``, ``zone``, ``trend``, ``welds``, ``run`` or ``quality``.
    caption : below the figure; ``{}`` is the name that comes with the dataset.
    datasets : gives (name, dataset) for every time that the figure is drawn; the name is the zone, run or subject.
    figure : function of one dataset.
    medium : ``both``, or ``print`` where the page has the interactive panel instead.
    """

    section: str
    caption: str
    datasets: Callable[[Given], Datasets]
    figure: Callable[[xr.Dataset], Figure]
    medium: str = "both"


def _line_with(*names: str) -> Callable[[Given], Datasets]:
    """Return the line where it holds one of the variables and any finite value of it."""

    def datasets(given: Given) -> Datasets:
        return [("", given.line)] if any(n in given.line and np.isfinite(given.line[n].values).any() for n in names) else []

    return datasets


def _zones_with(*names: str) -> Callable[[Given], Datasets]:
    def datasets(given: Given) -> Datasets:
        for zone in moved(given.zones)[: given.most_zones]:
            window = zone["start"], zone["end"]
            ds = line_dataset(given.content, [zone], [], window=window, margin=ZONE_MARGIN_M, columns=_ZONE_COLUMNS)
            if any(name in ds for name in names) and ds.sizes["chainage"] > 1:
                yield zone["id"], ds

    return datasets


def _each_run(view: Callable[[Content, str], xr.Dataset | None]) -> Callable[[Given], Datasets]:
    """Return what a view gives of each run; runs of which it gives nothing are left out."""

    def datasets(given: Given) -> Datasets:
        return ((run, ds) for run in given.content.ids if (ds := view(given.content, run)) is not None)

    return datasets


def _joints(content: Content, run: str) -> xr.Dataset | None:
    welds = content.group(run, "welds")
    known = welds is not None and "joint_length" in welds and np.isfinite(welds["joint_length"].values).any()
    stated = {k: v for k, v in content.run(run).attrs.items() if k == "nominal_joint_m"}
    return welds.assign_attrs(stated) if known and welds is not None else None


def _pairs(given: Given) -> Datasets:
    """Return the matched welds of the reference run and each other run."""
    welds, reference = given.content.tables["welds"], given.content.reference
    for run in given.content.ids:
        if run != reference and {run, reference} <= set(welds["run"]):
            first, second = sorted((reference, run), key=given.content.ids.index)
            yield f"{first} and {second}", match_figures.match_data(welds, first, second)


def _group_with(group: str, *names: str) -> Callable[[Given], Datasets]:
    """Return a group of every run that holds it with these variables."""

    def datasets(given: Given) -> Datasets:
        for run in given.content.ids:
            ds = given.content.group(run, group)
            if ds is not None and all(name in ds and ds[name].size for name in names):
                yield run, ds

    return datasets


def _trends(given: Given) -> Datasets:
    subjects = list(dict.fromkeys(given.content.tables["trends"].subject))[:_MOST_TRENDS]
    return [(name, ds) for name in subjects if (ds := trend_dataset(given.content, name)) is not None]


def _limits(given: Given) -> Datasets:
    ds = limit_dataset(given.content)
    return [] if ds is None else [("", ds)]


def _parted(given: Given) -> Datasets:
    """Return the pairs of runs in which some weld has no partner."""
    return ((names, ds) for names, ds in _pairs(given) if not np.isfinite(ds["probability"].values).all())


PLATES = (
    Plate("line", "Plan of the reference run with its zones.", _line_with("along"), line_figures.plan, "print"),
    Plate(
        "line",
        "Height, total bending strain and ovality of every run; the peaks of bends are kept.",
        _line_with("height"),
        line_figures.profile_and_strain,
        "print",
    ),
    Plate(
        "line",
        "Change against the reference run; grey: within the threshold of none, last run.",
        _line_with("displacement_lateral", "displacement_up", "bending_strain_change_horizontal"),
        line_figures.changes,
        "print",
    ),
    Plate(
        "zone",
        "Displacement and change of bending strain in {}, bands ± one sigma; the shaded stretch is the zone.",
        _zones_with("displacement_lateral", "bending_strain_change_horizontal"),
        line_figures.zone_detail,
        "print",
    ),
    Plate(
        "zone",
        "Curvature in {}: reference run, and the other runs minus it.",
        _zones_with("curvature_vertical", "curvature_horizontal"),
        line_figures.curvature_comparison,
    ),
    Plate("trend", "{}", _trends, trend_figures.trend),
    Plate(
        "welds",
        "Change of joint lengths; grey: within the threshold of none. An axial strain shows here and nowhere else.",
        _line_with("joint_change"),
        line_figures.joint_changes,
        "print",
    ),
    Plate(
        "welds",
        "Welds of {} about the first that has no partner; a link is one weld, a cross stands where a run should list one.",
        _parted,
        match_figures.ribbon,
        "print",
    ),
    Plate(
        "welds",
        "Matching of {}: one minus the probability of every pair; those above the red line want a look.",
        _pairs,
        match_figures.probability_strip,
        "print",
    ),
    Plate("welds", "Odometers of {}: place of each common weld, later against earlier run.", _pairs, match_figures.drift),
    Plate(
        "run",
        "Navigation of {}: plan, profile, pitch, roll, azimuth, speed.",
        _each_run(run_dataset),
        line_figures.navigation_panel,
    ),
    Plate("run", "Joint lengths of {}.", _each_run(_joints), caliper_figures.joint_lengths),
    Plate(
        "run",
        "Most oval section of {}, with the ellipse adjusted to it (Porter 1990, Fig. 2-7).",
        _each_run(most_oval_wall),
        lambda wall: caliper_figures.section_residuals(wall, wall.attrs["chainage_m"]),
    ),
    Plate(
        "run",
        "Unrolled wall about the deepest dent of {}.",
        _each_run(wall_of_deepest_dent),
        lambda wall: caliper_figures.unrolled_wall(
            wall, wall.attrs["ends_m"][0], wall.attrs["ends_m"][1], {"weld": wall.attrs["welds"]}
        ),
    ),
    Plate(
        "run",
        "Profiles of the deepest dent of {} with their uncertainty; length and width are taken at a tenth of the depth.",
        _each_run(profiles_of_deepest_dent),
        caliper_figures.dent_profiles,
    ),
    Plate(
        "run",
        "Residuals of {} at its markers: hollow, the trajectory without the marker minus the marker; filled, the final one.",
        _group_with("markers", "misclosure_east_before", "used"),
        navigation_figures.mark_residuals,
    ),
    Plate(
        "run",
        "Innovations of {} over their sigmas; where sigmas are honest, 95 % lie in the grey band.",
        _group_with("navigation", "innovation_along"),
        navigation_figures.innovations,
        "print",
    ),
    Plate(
        "run",
        "Sensor biases and odometer scale of {}, bands ± one sigma.",
        _group_with("navigation", "gyro_bias", "accel_bias"),
        navigation_figures.biases,
        "print",
    ),
    Plate(
        "quality", "Least amplitude of a movement that these runs show, by its length.", _limits, trend_figures.detection_limits
    ),
)


def drawn(given: Given, draw: Callable[[Figure, str], Any], medium: str) -> dict[str, list[dict[str, Any]]]:
    """Return the figures of every section as (name, caption, picture).

    Parameters
    ----------
    given : what there is to draw.
    draw : makes a picture of (figure, words for those who cannot see it): inline SVG for the page, an image for the PDF.
    medium : ``page`` or ``print``.
    """
    sections: dict[str, list[dict[str, Any]]] = {plate.section: [] for plate in PLATES}
    for plate in PLATES:
        if plate.medium not in ("both", medium):
            continue
        for name, ds in plate.datasets(given):
            caption = plate.caption.format(name)
            sections[plate.section].append({"name": name, "caption": caption, "picture": draw(plate.figure(ds), caption)})
    return sections
