"""A recorded drive as a raw run in memory: a car as a very large pig, with the reference beside it."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial import cKDTree

from deform.geometry.earth import earth_rate, enu_difference
from deform.geometry.rotation import attitude_to_matrix, matrix_to_attitude, rotation_vector_to_matrix
from deform.nav.alignment import level_and_gyrocompass
from deform.nav.navigate import Navigation
from deform.run import build
from deform.run.raw import Identity, ImuHeader, Launch, OdometerHeader, Pipe, RawRun, RunHeader

GYRO_PULSE, ACCEL_PULSE, PULSE_M = 1e-8, 1e-6, 0.01
MARK_EVERY_M = 2000.0
END_S = 3470.0  # of what is used: behind it the car backs into its place, and road speed has no sign
REST_S, SETTLED_S = 525.0, 1000.0  # end of the standing start; from where the reference's heading has settled
STEP_M = 10.0  # along the road, at which the path is held against the reference
SAME_ROAD_M, LATER_S = 4.0, 600.0  # places so near, passed so much later, are the same road passed again
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
    """Return the drive; marks are reference positions this far apart along the road, further ones end it at both ends.

    Their sigma is what the receiver states for its fixes at that time: the reference rests on these.
    """
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
    fix = loadmat(folder / "BESTGPSPOS.mat")
    at = fix["BGP_second"].ravel() - start
    sigma = np.column_stack([np.interp(when, at, fix[f"BGP_{axis}_std"].ravel()) for axis in ("Long", "Lat", "Alt")])
    passages = build.dataset("passages", {
        "name": [f"M{i}" for i in range(rows.size)], "kind": ["launcher", *["agm"] * (rows.size - 2), "receiver"],
        "time": when[rows], "latitude": pva["INS_Lat"][rows], "longitude": pva["INS_Long"][rows], "height": pva["INS_Alt"][rows],
        "sigma_horizontal": np.sqrt(np.mean(sigma[rows, :2] ** 2, axis=1)), "sigma_vertical": sigma[rows, 2]})  # fmt: skip
    header = RunHeader(
        run=Identity("kingston", "kingston", datetime.date(2008, 6, 23)),
        pipe=Pipe(1.0, 0.01),
        launch=Launch(float(pva["INS_Lat"][2]), float(pva["INS_Long"][2]), float(pva["INS_Alt"][2]), 526.0),
        imu=ImuHeader(**{**IMU.__dict__, **imu}),
        odometer=OdometerHeader(1, scale_error=0.02),
    )
    raw = RawRun(header, group, wheel, passages=passages)
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
    """Heading at rest by the reference as it stands there, and by its later drive led back by the gyros; its scatter.

    All three gyros: the car pitches and leans while it turns, and the vertical one alone misses half a degree of the turns. What
    the rest shows, less the earth's turn, is their bias.
    """
    imu = run.raw.imu
    when, turn, push = imu["time"].values, imu["gyro_count"].values * imu.attrs["gyro_pulse_rad"], imu["accel_count"].values
    rest, step = when < REST_S, 1.0 / IMU.rate_hz
    there = float(np.median(run.azimuth[run.time < REST_S]))
    _, pitch, roll = matrix_to_attitude(level_and_gyrocompass(turn[rest].mean(axis=0), push[rest].mean(axis=0)))
    C = attitude_to_matrix(there, float(pitch), float(roll))
    earth = earth_rate(float(run.latitude[0])) * step
    turn = rotation_vector_to_matrix(turn - (turn[rest].mean(axis=0) - C.T @ earth))
    frame, azimuth = rotation_vector_to_matrix(-earth), np.empty(when.size)
    for i in range(when.size):
        C = frame @ C @ turn[i]
        azimuth[i] = np.arctan2(C[0, 1], C[1, 1])
    turned = np.degrees(np.unwrap(azimuth))
    turned -= turned[rest].mean()
    back = wrapped(run.azimuth - np.interp(run.time, when, turned))
    settled = (run.time > SETTLED_S) & (run.speed > 2.0)
    return there, float(np.median(back[settled])) % 360.0, float(back[settled].std())


def reference_error(run: Drive) -> tuple[float, int]:
    """Error of the reference (m) by its heights where the same road is passed again minutes later, and how often it is."""
    east, north, _ = enu_difference(run.latitude, run.longitude, run.height, run.latitude[0], run.longitude[0], run.height[0])
    one, other = cKDTree(np.column_stack([east, north])).query_pairs(SAME_ROAD_M, output_type="ndarray").T
    again = (np.abs(run.time[one] - run.time[other]) > LATER_S) & (np.minimum(run.speed[one], run.speed[other]) > 2.0)
    apart = (run.height[one] - run.height[other])[again]
    return float(np.sqrt(np.mean(apart**2) / 2.0)), int(again.sum())


def _rows(run: Drive) -> np.ndarray:
    return np.searchsorted(run.distance, np.arange(0.0, run.distance[-1], STEP_M))


def _counts(increments: np.ndarray, pulse: float) -> np.ndarray:
    """Whole pulses, the remainder carried on."""
    return np.diff(np.rint(np.cumsum(increments, axis=0) / pulse), axis=0, prepend=0.0).astype(np.int64)
