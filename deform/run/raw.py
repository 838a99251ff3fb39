"""The raw run: what one passage of the tool delivered, on time axes, with its header."""

from __future__ import annotations

import datetime
from dataclasses import dataclass as plain_dataclass
from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

_STRICT = ConfigDict(extra="ignore")
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Axis = Annotated[int, Field(ge=0, le=2)]


@dataclass(frozen=True, config=_STRICT)
class Identity:
    """Table ``[run]``: who and when."""

    id: str
    line: str
    date: datetime.date
    direction: Literal["downstream", "upstream"] = "downstream"


@dataclass(frozen=True, config=_STRICT)
class Pipe:
    """Table ``[pipe]`` (metre)."""

    outside_diameter_m: Annotated[float, Field(gt=0.02, lt=3.0)]
    nominal_wall_m: Annotated[float, Field(gt=0, lt=0.2)]
    nominal_joint_m: Annotated[float, Field(gt=0, lt=100)] = 12.2


@dataclass(frozen=True, config=_STRICT)
class Launch:
    """Table ``[launch]``: where the tool stood, or began, at time 0 (degree, metre), and how long it stood (second)."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=360)]
    height_m: Annotated[float, Field(ge=-1000, le=9000)]
    static_s: NotNegative = 0.0


@dataclass(frozen=True, config=_STRICT)
class Compensation:
    """Table ``[imu.compensation]``, optional: known errors of each sensor axis, added to the truth by the sensors.

    Drifts and biases come from a calibration (`deform.nav.calibration`), the others from the maker. Mass unbalance is that of
    mechanical gyros, along spin and input axis (degree per hour per g); ``spin_axis`` names the sensor axis along which the
    rotor of each gyro spins.
    """

    gyro_drift_deg_per_h: Triple = (0.0, 0.0, 0.0)
    gyro_scale_ppm: Triple = (0.0, 0.0, 0.0)
    gyro_scale_asymmetry_ppm: Triple = (0.0, 0.0, 0.0)
    mass_unbalance_spin_deg_per_h_per_g: Triple = (0.0, 0.0, 0.0)
    mass_unbalance_input_deg_per_h_per_g: Triple = (0.0, 0.0, 0.0)
    spin_axis: tuple[Axis, Axis, Axis] = (0, 1, 2)
    accel_bias_ug: Triple = (0.0, 0.0, 0.0)
    accel_scale_ppm: Triple = (0.0, 0.0, 0.0)
    accel_scale_asymmetry_ppm: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, config=_STRICT)
class ImuHeader:
    """Table ``[imu]``: the maker's one-sigma figures, the mounting, and what is known of the sensors' errors."""

    rate_hz: Positive
    sensor_to_body: tuple[Triple, Triple, Triple] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    gyro_bias_deg_per_h: NotNegative = 0.01
    gyro_random_walk_deg_per_sqrt_h: NotNegative = 0.002
    gyro_scale_ppm: NotNegative = 10.0
    accel_bias_ug: NotNegative = 50.0
    accel_random_walk_ug_per_sqrt_hz: NotNegative = 10.0
    accel_scale_ppm: NotNegative = 50.0
    compensation: Compensation | None = None

    @property
    def mounting(self) -> np.ndarray:
        """Matrix (3, 3) that turns sensor axes into body axes."""
        return np.array(self.sensor_to_body, float)


@dataclass(frozen=True, config=_STRICT)
class OdometerHeader:
    """Table ``[odometer]``; the lever arm goes from the IMU to the wheel set, in the body frame."""

    wheels: Annotated[int, Field(ge=1)]
    scale_error: NotNegative = 0.003
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, config=_STRICT)
class CaliperHeader:
    """Table ``[caliper]``; ring offsets go from the IMU along the body's y axis."""

    arms: Annotated[int, Field(ge=3)]
    ring_offset_m: tuple[float, ...] = (0.0,)
    noise_m: NotNegative = 0.0003


@dataclass(frozen=True, config=_STRICT)
class RunHeader:
    """Content of ``run.toml``: everything that is constant over the run."""

    run: Identity
    pipe: Pipe
    launch: Launch
    imu: ImuHeader
    odometer: OdometerHeader
    caliper: CaliperHeader | None = None

    @property
    def id(self) -> str:
        """Name of the run."""
        return self.run.id

    @property
    def travel_sign(self) -> int:
        """+1 when the tool ran downstream, -1 when it ran upstream."""
        return 1 if self.run.direction == "downstream" else -1


@plain_dataclass(frozen=True)
class RawRun:
    """One raw run.

    Attributes
    ----------
    header : content of ``run.toml``.
    imu : group ``imu`` of the vocabulary (``sample``, ``axis``), with attributes ``gyro_pulse_rad`` and ``accel_pulse_m_per_s``.
    odometer : group ``odometer`` (``sample``, ``wheel``), with attribute ``pulse_m``.
    arms : group ``arms`` (``scan``, ``arm``; with two rings ``scan``, ``ring``, ``arm``) or None. It is opened lazily and packed:
        ``radius`` holds raw counts with attributes ``scale_factor``, ``add_offset``, ``_FillValue``; read it in blocks of scans.
    weld_events : group ``weld_events`` (``event``) or None.
    passages : group ``passages`` (``marker``) or None.
    hashes : SHA-256 of each input file by name.
    repairs : what the reader repaired, in words.
    """

    header: RunHeader
    imu: xr.Dataset
    odometer: xr.Dataset
    arms: xr.Dataset | None = None
    weld_events: xr.Dataset | None = None
    passages: xr.Dataset | None = None
    folder: Path | None = None
    hashes: dict[str, str] = field(default_factory=dict)
    repairs: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """Name of the run."""
        return self.header.id
