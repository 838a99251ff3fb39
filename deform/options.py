"""Options of every stage: frozen, typed, an unknown key or a value that cannot be is an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from deform.errors import Fault, OptionError

_STRICT = ConfigDict(extra="forbid", validate_default=True)
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True, config=_STRICT)
class NavigationOptions:
    """From counts to a trajectory and a centreline."""

    chainage_step_m: Positive = 0.1
    output_rate_hz: Positive = 20.0


@dataclass(frozen=True, config=_STRICT)
class CaliperOptions:
    """From arms to the wall, its dents and the weld log."""

    wall_step_m: Positive = 0.1  # rows of the wall map along the whole line
    detail_step_m: Positive = 0.02  # rows of the wall map around dents
    detail_margin_m: Positive = 0.5  # wall kept at full resolution on both sides of a dent
    clock_bins: Annotated[int, Field(ge=8, le=720)] = 72  # at least one per arm is taken
    section_window_m: Positive = 0.5  # length over which ovality and diameters are formed
    least_dent_depth_od: Probability = 0.01
    ovality_definition: Literal["outside", "mean"] = "outside"  # (max - min) / outside diameter, or / mean diameter
    largest_lost_arms: Probability = 0.34  # a section that lost a greater share of its arms is refused
    weld_cluster_m: Positive = 0.15  # events of different sensors this near to each other are one weld
    block_scans: Annotated[int, Field(ge=1000)] = 100_000


@dataclass(frozen=True, config=_STRICT)
class DentStrainOptions:
    """From the shape of a dent to its strain."""

    form: Literal["b31.8-2018", "b31.8-2007"] = "b31.8-2018"
    basis: Literal["profile", "sizes"] = "profile"
    smoothing_m: Positive = 0.02  # knot distance of the B-splines
    windows: tuple[Positive, Positive] = (1.0, 2.0)  # widths of the profile used, in lengths of the dent


@dataclass(frozen=True, config=_STRICT)
class StrainOptions:
    """From attitude to curvature and bending strain."""

    gauge_length_m: Positive = 2.0


@dataclass(frozen=True, config=_STRICT)
class MatchOptions:
    """Weld matching."""

    scale_range: Positive = 0.05


@dataclass(frozen=True, config=_STRICT)
class ChangeOptions:
    """Differences of the runs and their significance."""

    k_sigma: Positive = 3.0


@dataclass(frozen=True, config=_STRICT)
class TrendOptions:
    """Rates per year and forecasts."""

    interval_probability: Probability = 0.95
    horizon_years: Positive = 20.0


@dataclass(frozen=True, config=_STRICT)
class ReportOptions:
    """What the report shows."""

    title: str = ""


@dataclass(frozen=True, config=_STRICT)
class Options:
    """Options of all stages, as in the table ``[options]`` of a survey."""

    navigation: NavigationOptions = Field(default_factory=NavigationOptions)
    caliper: CaliperOptions = Field(default_factory=CaliperOptions)
    strain: StrainOptions = Field(default_factory=StrainOptions)
    dent_strain: DentStrainOptions = Field(default_factory=DentStrainOptions)
    match: MatchOptions = Field(default_factory=MatchOptions)
    change: ChangeOptions = Field(default_factory=ChangeOptions)
    trend: TrendOptions = Field(default_factory=TrendOptions)
    report: ReportOptions = Field(default_factory=ReportOptions)


def options_from(content: Mapping[str, Any], where: str = "options") -> Options:
    """Return validated options from nested tables (``{"strain": {"gauge_length_m": 2.0}}``).

    Raises
    ------
    OptionError
        With every unknown key and every value that cannot be, and the keys that are known.
    """
    try:
        return Options(**content)
    except (ValidationError, TypeError) as fault:
        raise OptionError(option_faults(fault, where, Options)) from None


def option_faults(fault: ValidationError | TypeError, where: str, kind: type) -> list[Fault]:
    """Return the faults of a pydantic error in our words, each with the keys known at its place."""
    if not isinstance(fault, ValidationError):
        return [Fault(where, "", str(fault))]
    faults = []
    for error in fault.errors():
        path = [str(p) for p in error["loc"]]
        if error["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
            faults.append(Fault(where, ".".join(path), f"unknown option; known here are {', '.join(_known(kind, path[:-1]))}"))
        else:
            faults.append(Fault(where, ".".join(path), f"{error['msg']}, not {error['input']!r}"))
    return faults


def as_dict(options: Any) -> dict[str, Any]:
    """Return options as plain nested dictionaries, for `survey.json` and hashes."""
    return asdict(options)


def _known(kind: type, path: list[str]) -> list[str]:
    for step in path:
        kind = get_type_hints(kind).get(step, kind)
    return [f.name for f in fields(kind)]
