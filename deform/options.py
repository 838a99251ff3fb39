"""Options of every stage: frozen, typed, an unknown key or a value that cannot be is an error."""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
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
    filter_interval_s: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0
    marker_time_sigma_s: NotNegative = 0.03  # error of the time at which a passage is heard
    error_model: Literal["full", "odometer", "inertial"] = "full"  # see deform.nav.error_model.MODELS


@dataclass(frozen=True, config=_STRICT)
class PipeBookOptions:
    """How far the lengths of a pipe book are believed."""

    length_sigma_m: Positive = 0.01  # error of one length
    scale_sigma_ppm: NotNegative = 100.0  # error that all lengths share: tape, temperature


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
    block_scans: Annotated[int, Field(ge=1000)] = 20_480  # scans read at once; it bounds the memory of the pass


@dataclass(frozen=True, config=_STRICT)
class DentStrainOptions:
    """From the shape of a dent to its strain."""

    form: Literal["b31.8-2018", "b31.8-2007"] = "b31.8-2018"
    basis: Literal["profile", "sizes"] = "profile"
    windows: tuple[Positive, Positive] = (1.5, 2.5)  # size of the surface used, in sizes of the dent; the first gives the value
    intervals: Annotated[int, Field(ge=4, le=40)] = 8  # pieces of the B-spline across a window, each way


@dataclass(frozen=True, config=_STRICT)
class StrainOptions:
    """From attitude to curvature and bending strain."""

    gauge_length_m: Positive = 2.0
    long_gauge_length_m: Positive = 12.0  # a second, smoother view of about one joint
    bend_strain: Positive = 0.005  # bending strain over the gauge from which a stretch is listed as a bend (100 OD of radius)
    dogleg_sigmas: Positive = 4.0  # a weld's deflection is listed when it exceeds this many standard deviations


@dataclass(frozen=True, config=_STRICT)
class MatchOptions:
    """Weld matching."""

    scale_range: Positive = 0.05  # largest departure of one run's length from another's
    band_half_width: Annotated[int, Field(ge=3)] = 5  # welds on each side of the expected partner
    least_joint_m: Positive = 0.1  # welds nearer than this are one
    least_evidence_nats: Positive = 15.0  # runs whose lengths speak less than this for one line are refused
    least_probability: Probability = 0.5  # of a pair to be claimed, and of a weld that stands alone to count as one
    shift_m: Positive = 0.3  # a weld that stands further than this from its place in the other runs is called shifted


@dataclass(frozen=True, config=_STRICT)
class ChangeOptions:
    """Differences of the runs and their significance."""

    k_sigma: Positive = 3.0
    axis_step_m: Positive = 0.5
    scan_step_m: Positive = 1.0
    shortest_wavelength_m: Positive = 10.0
    longest_wavelength_m: Positive = 500.0
    false_alarms_per_100_km: Positive = 0.1
    least_displacement_m: NotNegative = 0.03
    least_strain_change: NotNegative = 50e-6
    least_ovality_change: NotNegative = 0.002
    edit_margin_m: NotNegative = 10.0
    zone_margin_m: NotNegative = 4.0
    least_dent_growth_m: NotNegative = 1e-3
    dent_distance_m: Positive = 0.5
    dent_clock_deg: Positive = 25.0


@dataclass(frozen=True, config=_STRICT)
class TrendOptions:
    """Rates per year and forecasts; a limit is the reader's own, none is claimed to be that of a standard."""

    interval_probability: Probability = 0.95
    horizon_years: Positive = 20.0
    displacement_limit_m: Positive = 1.0
    bending_strain_change_limit: Positive = 0.00125
    dent_depth_limit_od: Probability = 0.06
    limit_basis: str = "chosen by the reader of the survey, not taken from a standard"


@dataclass(frozen=True, config=_STRICT)
class ReportOptions:
    """What the report shows; the two attention values only rank zones, no standard is claimed for them."""

    title: str = ""
    strain_attention: Positive = 0.00125
    displacement_attention_m: Positive = 0.5
    most_dent_cards: Annotated[int, Field(ge=0)] = 40
    most_zone_details: Annotated[int, Field(ge=0)] = 40
    most_points_per_curve: Annotated[int, Field(ge=1000)] = 200_000
    most_points_in_page: Annotated[int, Field(ge=100_000)] = 2_000_000
    crs: str = ""


@dataclass(frozen=True, config=_STRICT)
class RouteOptions:
    """A line as it was built: where it runs and of which pipe."""

    length_m: Positive = 4000.0
    latitude_deg: Annotated[float, Field(gt=-85, lt=85)] = 61.0
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = -121.0
    height_m: float = 230.0
    azimuth_deg: float = 150.0
    outside_diameter_m: Annotated[float, Field(gt=0.1, lt=1.5)] = 0.3239
    wall_m: Positive = 0.00635
    heavy_wall_m: Positive = 0.00953  # at crossings
    joint_m: Positive = 12.2
    pup_share: Probability = 0.05
    wander_deg: NotNegative = 12.0  # slow turning of the route to both sides
    hill_pitch_deg: Annotated[float, Field(ge=0, lt=40)] = 4.0
    induction_bends_deg: tuple[float, ...] = (45.0, -30.0)  # 5D bends spread over the line, positive to the right
    crossings: Annotated[int, Field(ge=0)] = 1  # river crossings with heavier wall
    bend_fields: Annotated[int, Field(ge=0)] = 1  # stretches of cold bends that never change
    valve_spacing_m: Positive = 2500.0
    valve_recess_m: NotNegative = 0.0  # the bore of a valve opens by this over 0.3 m in its middle
    marker_spacing_m: Positive = 1000.0
    vertices: tuple[tuple[float, float], ...] = ()  # longitude, latitude of a real route to follow, in order


@dataclass(frozen=True, config=_STRICT)
class MovementOptions:
    """Ground that moves and takes the pipe along."""

    id: str
    start_m: NotNegative
    length_m: Positive
    amplitude_m: Positive  # largest displacement, at the last run or at fraction 1
    kind: Literal["landslide", "settlement", "heave"] = "landslide"
    side_deg: float = 90.0  # direction from the pipe's own, clockwise: 90 = to the right; the part along the pipe is left out
    drop: float = 0.15  # downward part of a landslide, in parts of its amplitude
    plateau: Probability = 0.2  # part of the length that moves as one
    straight: bool = True  # the line is laid without bends there
    history: Literal["linear", "step", "accelerating"] = "linear"
    step_run: Annotated[int, Field(ge=1)] = 1  # first run that sees a step
    fractions: tuple[float, ...] = ()  # fraction of the amplitude in each run, in place of the history


@dataclass(frozen=True, config=_STRICT)
class ReplacementOptions:
    """Pipe that was cut out and replaced, in its place (cut-out) or beside it (re-route)."""

    id: str
    start_m: NotNegative
    length_m: Positive
    kind: Literal["cutout", "reroute"] = "cutout"
    first_run: Annotated[int, Field(ge=1)] = 1
    offset_m: float = 0.1  # to the right of the old pipe


@dataclass(frozen=True, config=_STRICT)
class DentOptions:
    """A dent with its depth (of the outside diameter) in each run; zero where it is not there."""

    id: str
    chainage_m: NotNegative
    clock_deg: float
    depths_od: tuple[NotNegative, ...]
    length_m: Positive = 0.3
    width_m: Positive = 0.2
    sharpness: Positive = 2.0  # exponent of its flanks: 2 = bell


@dataclass(frozen=True, config=_STRICT)
class FittingOptions:
    """A feature of the wall that is there from the start: the opening of a tee, or a wrinkle."""

    id: str
    chainage_m: NotNegative
    kind: Literal["tee", "wrinkle"] = "tee"
    clock_deg: float = 0.0
    height_m: Positive = 0.02  # of the opening, outward, or of the wrinkle's crests
    length_m: Positive = 0.1  # diameter of the opening, or wavelength of the wrinkle


@dataclass(frozen=True, config=_STRICT)
class ToolOptions:
    """The tool of a run and how it travels."""

    imu: str = "navigation"  # a grade of `synthetic.imu.GRADES`
    imu_rate_hz: Positive | None = None  # none = that of the grade
    sensor_to_body: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    mounting_deg: NotNegative = 0.15  # sigma of the constant misalignment of the IMU in the tool
    vibration: NotNegative = 1.0  # 0 = none
    speed_m_per_s: Positive = 1.2
    speed_variation: Annotated[float, Field(ge=0, lt=0.8)] = 0.2
    stops: Annotated[int, Field(ge=0)] = 2
    static_start_s: NotNegative = 600.0
    static_end_s: NotNegative = 300.0
    roll_turns_per_km: NotNegative = 0.3
    wobble_deg: NotNegative = 0.14
    wobble_length_m: tuple[Positive, Positive] = (12.0, 150.0)  # shortest and longest wavelength
    wobble_waves: Annotated[int, Field(ge=1)] = 10  # sinusoids that make it, their lengths evenly drawn in the logarithm
    wobble_slope: float = 1.0  # power of a sinusoid goes with this power of its length: 0 = 1/f, -1 = white
    wobble_pivot_m: float = 0.0  # the tool turns about a point this far ahead of the IMU, which then swings with the wobble
    offset_m: NotNegative = 0.002
    wheels: Annotated[int, Field(ge=1)] = 3
    wheel_lever_m: float = -1.1
    wheel_pulse_m: Positive = 0.0025
    wheel_rate_hz: Positive = 50.0
    wheel_scale: NotNegative = 0.003
    wheel_wear_per_km: NotNegative = 1e-5
    slips_per_km: NotNegative = 2.0
    caliper: bool = True
    arms: Annotated[int, Field(ge=3)] = 24
    ring_offset_m: tuple[float, ...] = (-0.6,)
    caliper_rate_hz: Positive = 75.0
    arm_noise_m: NotNegative = 0.0003
    arm_dropout: Probability = 0.0006
    dead_arms: tuple[int, ...] = ()
    weld_miss: Probability = 0.02
    weld_false: Probability = 0.01
    weld_jitter_s: NotNegative = 0.005
    marker_noise_m: NotNegative = 0.3
    trap_noise_m: NotNegative = 0.05
    marker_time_noise_s: NotNegative = 0.025
    unheard: Probability = 0.05
    gross_markers: Annotated[int, Field(ge=0)] = 0


@dataclass(frozen=True, config=_STRICT)
class RunOptions:
    """One passage."""

    id: str
    date: datetime.date
    direction: Literal["downstream", "upstream"] = "downstream"
    tool: ToolOptions | None = None  # none = the tool of the simulation


@dataclass(frozen=True, config=_STRICT)
class SimulateOptions:
    """A line, what happens to it, and the runs that see it."""

    line: str = "simulated"
    seed: Annotated[int, Field(ge=0)] = 1
    route: RouteOptions = Field(default_factory=RouteOptions)
    tool: ToolOptions = Field(default_factory=ToolOptions)
    runs: Annotated[tuple[RunOptions, ...], Field(min_length=1)] = (
        RunOptions(id="simulated-2019", date=datetime.date(2019, 7, 2)),
        RunOptions(id="simulated-2022", date=datetime.date(2022, 8, 9)),
    )
    movements: tuple[MovementOptions, ...] = ()
    replacements: tuple[ReplacementOptions, ...] = ()
    dents: tuple[DentOptions, ...] = ()
    fittings: tuple[FittingOptions, ...] = ()

    @classmethod
    def demo(cls) -> SimulateOptions:
        """Return the small line of `deform demo`: two runs, a landslide, a cut-out, three dents of which one grows."""
        return cls(
            line="demo",
            seed=7,
            route=RouteOptions(length_m=1200.0, induction_bends_deg=(30.0,), valve_spacing_m=700.0, marker_spacing_m=400.0),
            tool=ToolOptions(static_start_s=300.0, static_end_s=60.0, stops=1, unheard=0.0),
            runs=(
                RunOptions(id="demo-2019", date=datetime.date(2019, 7, 2)),
                RunOptions(id="demo-2022", date=datetime.date(2022, 8, 9)),
            ),
            movements=(MovementOptions(id="LS1", start_m=600.0, length_m=120.0, amplitude_m=0.8),),
            replacements=(ReplacementOptions(id="C1", start_m=960.0, length_m=60.0),),
            dents=(
                DentOptions(id="D01", chainage_m=233.3, clock_deg=172.0, depths_od=(0.022, 0.022)),
                DentOptions(id="D02", chainage_m=771.8, clock_deg=35.0, depths_od=(0.025, 0.042), length_m=0.34, width_m=0.22),
                DentOptions(id="D03", chainage_m=1085.1, clock_deg=300.0, depths_od=(0.018, 0.018), length_m=0.26),
            ),
        )


@dataclass(frozen=True, config=_STRICT)
class MeshOptions:
    """3-D surfaces: grid, colour (``depth``, ``strain``, or ``change`` since the first run), exaggerations (1 = true size)."""

    step_m: Positive = 0.01
    least_points_around: Annotated[int, Field(ge=12)] = 72
    least_rows: Annotated[int, Field(ge=10)] = 41
    least_half_length_m: Positive = 0.3
    most_half_length_m: Positive = 1.0
    colour: Literal["depth", "strain", "change"] = "depth"
    exaggeration: Positive = 1.0
    shell_exaggeration: Positive = 10.0


@dataclass(frozen=True, config=_STRICT)
class Options:
    """Options of all stages, as in the table ``[options]`` of a survey."""

    navigation: NavigationOptions = Field(default_factory=NavigationOptions)
    pipe_book: PipeBookOptions = Field(default_factory=PipeBookOptions)
    caliper: CaliperOptions = Field(default_factory=CaliperOptions)
    strain: StrainOptions = Field(default_factory=StrainOptions)
    dent_strain: DentStrainOptions = Field(default_factory=DentStrainOptions)
    match: MatchOptions = Field(default_factory=MatchOptions)
    change: ChangeOptions = Field(default_factory=ChangeOptions)
    trend: TrendOptions = Field(default_factory=TrendOptions)
    report: ReportOptions = Field(default_factory=ReportOptions)
    mesh: MeshOptions = Field(default_factory=MeshOptions)


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


def simulate_options_from(path: Path) -> SimulateOptions:
    """Return validated options of a simulation from a TOML file.

    Raises
    ------
    OptionError
        With every unknown key and every value that cannot be, and the keys that are known.
    """
    try:
        return SimulateOptions(**tomllib.loads(Path(path).read_text(encoding="utf-8")))
    except (ValidationError, TypeError) as fault:
        raise OptionError(option_faults(fault, str(path), SimulateOptions)) from None


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
