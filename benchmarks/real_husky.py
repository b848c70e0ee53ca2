"""A real robot on ice, snow, loam, asphalt and flooring (Husky, BorealTC): no truth, but the noise that robots have.

Wheel speeds come at 6.5 Hz, the gyro at 100 Hz; the motor currents show no force, as the wheels scrub.
What counts: no number that is none, sigmas that stay sane, few alarms where wheels surely roll, and the turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from figure import Figure, at_most
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import Motor, Robot, SkidSteer, Wheel
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.estimator import SlipEstimator, SlipRun
from real_data import columns

DATA = "BorealTC Husky"
METHOD = "wheels 6.5 Hz, gyro 100 Hz"
HUSKY = Robot(
    "Husky",
    75.0,
    6.0,
    SkidSteer(0.256, 0.256, 0.5708),
    Wheel(0.165, 0.12, 0.03),
    Motor(0.02, 0.5, gear_ratio=78.7, friction_Nm=2.0, rotor_inertia_kg_m2=1e-5),
)
GRIPPING = ("ASPHALT", "FLOORING")
#: Wheels surely roll where their two sides differ by less than this [m/s].
EVEN_M_S = 0.02


class Run(NamedTuple):
    """One recording; turn_rad_s: (T,) as the wheels say it, held from sample to sample of theirs."""

    terrain: str
    log: DriveLog
    turn_rad_s: np.ndarray
    straight: np.ndarray


def rows() -> Iterator[Figure]:
    runs = list(recordings())
    tracks = [SlipEstimator(HUSKY).run(run.log) for run in runs]
    for terrain in sorted({run.terrain for run in runs}):
        chosen = [(r, t) for r, t in zip(runs, tracks, strict=True) if r.terrain == terrain]
        yield from terrain_figures(terrain, chosen)


def terrain_figures(terrain: str, chosen: list[tuple[Run, SlipRun]]) -> Iterator[Figure]:
    data = f"{DATA}, {terrain.lower().replace('_', ' ')}"
    bad = sum(int(np.count_nonzero(~np.isfinite(t.estimates.speed_m_s + t.estimates.speed_std_m_s))) for _, t in chosen)
    yield at_most(data, METHOD, f"samples without a number, of {sum(len(r.log) for r, _ in chosen)}", bad, 0, "d")
    std = np.concatenate([t.estimates.speed_std_m_s for _, t in chosen])
    yield at_most(data, METHOD, "sigma of the speed, median [m/s]", float(np.median(std)))
    yield at_most(data, METHOD, "sigma of the speed, largest [m/s]", float(np.max(std)))
    alarm = np.concatenate([t.estimates.slipping[r.straight].ravel() for r, t in chosen])
    bar = 1e-2 if terrain in GRIPPING else None
    yield at_most(data, METHOD, "alarms at 0.001 while both sides run alike", float(np.mean(alarm)), bar, ".2g")
    yield Figure(data, METHOD, "flags, share of samples", flags(chosen))
    turns = np.concatenate([r.turn_rad_s for r, _ in chosen])
    gyro = np.concatenate([np.asarray(r.log.yaw_rate_rad_s) for r, _ in chosen])
    seen = np.isfinite(turns) & np.isfinite(gyro)
    if np.std(turns[seen]) > 0.05:
        share = float(turns[seen] @ gyro[seen] / (turns[seen] @ turns[seen]))
        yield at_most(data, "gyro against wheels", "turn that the wheels' turn gives", share, form=".2f")


def flags(chosen: list[tuple[Run, SlipRun]]) -> str:
    """Every flag that occurs, those left out that say only that wheels are slower than gyros."""
    found = np.concatenate([t.estimates.flags.astype(int) for _, t in chosen])
    shares = {
        f.name.lower(): np.mean((found & f) > 0)
        for f in SlipFlag
        if f not in (SlipFlag.NO_CURRENT, SlipFlag.NO_ENCODER)
    }
    return ", ".join(f"{name} {share:.2g}" for name, share in shares.items() if share) or "none"


def recordings() -> Iterator[Run]:
    wheels, imu = (columns(f"borealtc_husky_subset/{name}.parquet") for name in ("wheel_service", "imu"))
    for terrain in np.unique(wheels["terrain"]):
        for run in np.unique(wheels["run"][wheels["terrain"] == terrain]):
            yield recording(str(terrain), *(part(data, terrain, run) for data in (wheels, imu)))


def part(data: dict[str, np.ndarray], terrain: str, run: int) -> dict[str, np.ndarray]:
    rows = (data["terrain"] == terrain) & (data["run"] == run)
    return {name: values[rows] for name, values in data.items()}


def recording(terrain: str, wheel: dict[str, np.ndarray], imu: dict[str, np.ndarray]) -> Run:
    """At the times of the IMU; a wheel's sample goes to the first of them that is not before it."""
    time_s = imu["t_s"]
    row = np.searchsorted(time_s, wheel["t_s"])
    there = row < len(time_s)
    speed = np.full((len(time_s), 4), np.nan)
    sides = np.column_stack([wheel["velL"], wheel["velR"]])[there]
    speed[row[there]] = np.tile(sides, 2) / HUSKY.wheel.radius_m
    left, right = (np.interp(time_s, wheel["t_s"], wheel[name]) for name in ("velL", "velR"))
    log = DriveLog(terrain, time_s, speed, np.full_like(speed, np.nan), imu["wz"].astype(float))
    return Run(terrain, log, (right - left) / HUSKY.chassis.track_m, np.abs(right - left) < EVEN_M_S)
