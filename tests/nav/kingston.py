"""A recorded drive as a raw run in memory: a car as a very large pig, with the reference beside it."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from deform.geometry.earth import enu_difference
from deform.nav.navigate import Navigation
from deform.run import build
from deform.run.raw import Identity, ImuHeader, Launch, OdometerHeader, Pipe, RawRun, RunHeader

GYRO_PULSE, ACCEL_PULSE, PULSE_M = 1e-8, 1e-6, 0.01
MARK_EVERY_M, MARK_SIGMA_M = 2000.0, 1.0
END_S = 3470.0  # of what is used: behind it the car backs into its place, and road speed has no sign
REST_S, SETTLED_S = 525.0, 1000.0  # end of the standing start; from where the reference's heading has settled
STEP_M = 10.0  # along the road, at which the path is held against the reference
LATE_S = 0.2  # by which the reference lags behind the road speed's stamps

# Figures as a header gives them: those of the HG1700 class, with the random walk seen over the rest before the drive.
IMU = ImuHeader(
    rate_hz=10.0,
    gyro_bias_deg_per_h=1.0,
    gyro_random_walk_deg_per_sqrt_h=0.125,
    gyro_scale_ppm=150.0,
    accel_bias_ug=1000.0,
    accel_random_walk_ug_per_sqrt_hz=300.0,
    accel_scale_ppm=300.0,
)


@dataclass(frozen=True)
class Drive:
    """The raw run, the reference once a second (degree, metre, m/s), distance along the road and sigma of its fixes (m)."""

    raw: RawRun
    time: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    height: np.ndarray
    azimuth: np.ndarray
    speed: np.ndarray
    distance: np.ndarray
    fix_sigma: np.ndarray


def drive(folder: Path, marks_every_m: float = MARK_EVERY_M, **imu: float) -> Drive:
    """Return the drive; marks are reference positions this far apart along the road, further ones end it at both ends."""
    inertial = loadmat(folder / "f_w_IMSseconds_dt.mat")
    start = float(inertial["IMU_second"][0, 0])
    used = inertial["IMU_second"].ravel() - start < END_S
    rates, forces = (np.stack([inertial[key][0, 0][axis].ravel() for axis in "xyz"], axis=1) for key in ("w", "f"))
    time = inertial["IMU_second"].ravel()[used] - start
    counts = [_counts(v[used] * 0.1, pulse) for v, pulse in ((rates, GYRO_PULSE), (forces, ACCEL_PULSE))]
    group = build.dataset("imu", {"time": time, "gyro_count": counts[0], "accel_count": counts[1]})
    group = group.assign_attrs(gyro_pulse_rad=GYRO_PULSE, accel_pulse_m_per_s=ACCEL_PULSE)
    road = loadmat(folder / "CarChip_Speed_interpolated.mat")
    at = road["CarChip_second_10HZ"].ravel() - start + LATE_S
    way = np.cumsum(np.clip(road["CarChip_Speed_10HZ"].ravel(), 0.0, None)) * 0.1
    wheel = build.dataset("odometer", {"time": at, "count": np.floor(way / PULSE_M)[:, None]}).assign_attrs(pulse_m=PULSE_M)
    pva = {key: value.ravel() for key, value in loadmat(folder / "INSPVA.mat").items() if key.startswith("INS_")}
    when = pva["INS_second"] - start
    pva, when = {key: value[when < END_S] for key, value in pva.items()}, when[when < END_S]
    speed = np.hypot(pva["INS_vn"], pva["INS_ve"])
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    rows = np.unique([2, *np.searchsorted(distance, np.arange(marks_every_m, distance[-1], marks_every_m)), when.size - 2])
    passages = build.dataset("passages", {
        "name": [f"M{i}" for i in range(rows.size)], "kind": ["launcher", *["agm"] * (rows.size - 2), "receiver"],
        "time": when[rows], "latitude": pva["INS_Lat"][rows], "longitude": pva["INS_Long"][rows], "height": pva["INS_Alt"][rows],
        "sigma_horizontal": np.full(rows.size, MARK_SIGMA_M), "sigma_vertical": np.full(rows.size, MARK_SIGMA_M)})  # fmt: skip
    header = RunHeader(
        run=Identity("kingston", "kingston", datetime.date(2008, 6, 23)),
        pipe=Pipe(1.0, 0.01),
        launch=Launch(float(pva["INS_Lat"][2]), float(pva["INS_Long"][2]), float(pva["INS_Alt"][2]), 526.0),
        imu=ImuHeader(**{**IMU.__dict__, **imu}),
        odometer=OdometerHeader(1, scale_error=0.02),
    )
    raw = RawRun(header, group, wheel, passages=passages)
    fix = loadmat(folder / "BESTGPSPOS.mat")
    at = fix["BGP_second"].ravel() - start
    sigma = np.column_stack([np.interp(when, at, fix[f"BGP_{axis}_std"].ravel()) for axis in ("Long", "Lat", "Alt")])
    return Drive(raw, when, pva["INS_Lat"], pva["INS_Long"], pva["INS_Alt"], pva["INS_Azi"], speed, distance, sigma)


def wrapped(angle):
    return (np.asarray(angle) + 180.0) % 360.0 - 180.0


def at_reference(found: Navigation, run: Drive, name: str) -> np.ndarray:
    """A variable of the trajectory at the times of the reference."""
    return np.interp(run.time, found.trajectory["time"].values, found.trajectory[name].values)


def errors(found: Navigation, run: Drive) -> tuple[np.ndarray, np.ndarray]:
    """East, north, up of trajectory minus reference and the stated sigma (m), every 10 m of the road."""
    rows = _rows(run)
    place = [at_reference(found, run, name) for name in ("latitude", "longitude", "height")]
    off = np.column_stack(enu_difference(*place, run.latitude, run.longitude, run.height))
    sigma = np.column_stack([at_reference(found, run, f"{axis}_sigma") for axis in ("east", "north", "up")])
    return off[rows], sigma[rows]


def heading_at_rest(run: Drive) -> tuple[float, float, float]:
    """Heading at rest by the reference as it stands there, and by its later drive led back by the gyros; its scatter."""
    imu = run.raw.imu
    when, rate = imu["time"].values, imu["gyro_count"].values[:, 2] * imu.attrs["gyro_pulse_rad"]
    rest = when < REST_S
    turned = -np.degrees(np.cumsum(rate - rate[rest].mean()))  # the mean of the rest holds earth's turn and bias
    turned -= turned[rest].mean()
    back = wrapped(run.azimuth - np.interp(run.time, when, turned))
    settled = (run.time > SETTLED_S) & (run.speed > 2.0)
    return float(np.median(run.azimuth[run.time < REST_S])), float(np.median(back[settled])) % 360.0, float(back[settled].std())


def reference_sigma(run: Drive) -> np.ndarray:
    """Sigma the receiver states for its own fixes, east, north, up (m), at the places of `errors`."""
    return run.fix_sigma[_rows(run)]


def _rows(run: Drive) -> np.ndarray:
    return np.searchsorted(run.distance, np.arange(0.0, run.distance[-1], STEP_M))


def _counts(increments: np.ndarray, pulse: float) -> np.ndarray:
    """Whole pulses, the remainder carried on."""
    return np.diff(np.rint(np.cumsum(increments, axis=0) / pulse), axis=0, prepend=0.0).astype(np.int64)
