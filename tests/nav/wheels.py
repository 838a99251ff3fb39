"""A tool with wheels on a straight or bent line: raw runs whose travel is known."""

from __future__ import annotations

import datetime

import numpy as np
import xarray as xr

from deform.run.raw import Identity, ImuHeader, Launch, OdometerHeader, Pipe, RawRun, RunHeader

PULSE, RATE, WHEEL_RATE = 0.0025, 100.0, 50.0


def header(direction="downstream", wheels=3, lever=-1.1, diameter=0.3239, rate=RATE):
    return RunHeader(
        run=Identity("made-up", "made-up", datetime.date(2020, 1, 1), direction),
        pipe=Pipe(diameter, 0.006),
        launch=Launch(61.0, -121.0, 200.0, 60.0),
        imu=ImuHeader(rate),
        odometer=OdometerHeader(wheels, lever_arm_m=(0.0, lever, 0.0)),
    )


def run(
    duration=600.0,
    speed=1.0,
    scales=(0.002, 0.0, -0.002),
    clocks=(0.0, 120.0, 240.0),
    slips=(),
    stops=((0.0, 60.0),),
    stalls=(),
    bends=(),
    wear=0.0,
    dead=(),
    shaking=0.05,
    diameter=0.3239,
    seed=0,
):
    """Return a raw run and its travel at the IMU samples (start included).

    ``slips``: (wheel, start, end, fraction lost); ``stops`` and ``stalls``: (start, end) in seconds; ``bends``: (place of the
    wheels in metre, length in metre, angle in degree, to the right); ``wear``: change of scale of wheel 0 over the run.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(1, round(duration * RATE) + 1) / RATE
    moving = np.ones(time.size, bool)
    for start, end in stops:
        moving &= (time <= start) | (time > end)
    ramp = np.convolve(np.pad(moving, 100, mode="edge"), np.full(201, 1 / 201), mode="valid")
    ramp = np.where(moving, np.clip(2.0 * ramp - 1.0, 0.0, 1.0), 0.0)
    travel = np.cumsum(ramp * speed * (1.0 + 0.2 * np.sin(time / 40.0))) / RATE
    turn, at_wheels = np.zeros(time.size), np.zeros(time.size)
    for place, length, angle in bends:
        shape = np.radians(angle) * np.clip((travel - place) / length, 0.0, 1.0)
        at_wheels += shape
        turn += np.radians(angle) * np.clip((travel + 1.1 - place) / length, 0.0, 1.0)
    gyro = -np.diff(turn, prepend=0.0) / 1e-7
    accel = rng.normal(0.0, 1e-3, (time.size, 3)) + np.where(moving, shaking, 0.0)[:, None] * rng.normal(size=(time.size, 3))
    accel[:, 2] += 9.82
    step = np.diff(travel, prepend=0.0)
    arm = 0.5 * diameter
    wheels = []
    for i, (scale, clock) in enumerate(zip(scales, clocks, strict=True)):
        grip = np.ones(time.size)
        for wheel, start, end, lost in slips:
            grip[(wheel == i) & (time > start) & (time <= end)] -= lost
        for start, end in stalls:
            grip[(time > start) & (time <= end)] = 0.0
        own = step * (1.0 + scale + (wear * time / duration if i == 0 else 0.0))
        own = own - arm * np.sin(np.radians(clock)) * np.diff(at_wheels, prepend=0.0)
        wheels.append(np.cumsum(own * grip) * (0.0 if i in dead else 1.0))
    every = round(RATE / WHEEL_RATE)
    count = np.floor(np.stack(wheels, axis=1)[every - 1 :: every] / PULSE).astype(np.int64)
    rates = {"gyro_pulse_rad": 1e-7, "accel_pulse_m_per_s": 1e-5}
    counts = np.stack([np.zeros(time.size), np.zeros(time.size), gyro], axis=1)
    imu = xr.Dataset(
        {
            "time": ("sample", time),
            "gyro_count": (("sample", "axis"), np.round(counts).astype(np.int32)),
            "accel_count": (("sample", "axis"), np.round((accel / RATE) / 1e-5).astype(np.int32)),
        },
        attrs=rates,
    )
    odometer = xr.Dataset(
        {"time": ("sample", time[every - 1 :: every]), "count": (("sample", "wheel"), count)}, attrs={"pulse_m": PULSE}
    )
    return RawRun(header(wheels=len(scales), diameter=diameter), imu, odometer), np.concatenate([[0.0], travel])
