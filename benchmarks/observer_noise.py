"""Adaptive filters of speed where the noise they were given is wrong: `python benchmarks/accuracy.py observer_noise`.

The robot in MuJoCo changes its speed and turns on a floor that grips. One of its sensors has white noise, and the
filter was given a tenth to ten times as much. Beside each AUKF stands the UKF with the same noise; errors are over
those of a UKF that was given the right one.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most
from ohmward.filters.consistency import BAND_95
from ohmward.traction import RLMA
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.robot_sensors import RobotTruth

sys.path.extend(str(Path(__file__).resolve().parents[1] / folder) for folder in ("tests", "tests/lab"))

from observed_drives import mujoco_runs as runs

SEEDS, DURATION_S, FRICTION, GRADE_STD_RAD = range(500, 504), 8.0, 0.8, np.radians(1.0)
FACTORS = (0.1, 1 / 3, 1.0, 3.0, 10.0)
#: The filters may adapt for so many samples before they are judged: 2 s.
FIRST = 200
#: An adaptive filter is as good where its error is no more than so many times that of the right noise.
AS_GOOD, COVERED = 1.1, 0.9
#: Noise of the sensors as the simulated board has it: encoders by their counts, currents, gyro with its offset.
BOARD = {"encoder_std_rad_s": 0.07, "torque_std_Nm": 0.07, "gyro_std_rad_s": 0.003}


class NoisySensor(NamedTuple):
    """A sensor with more noise than the board has.

    setting: its standard deviation in `ObserverNoise`.
    channel: its name in the samples.
    std: of the white noise that is added to it, in its own unit.
    judged: the quantity that it shows.
    per_unit: of the setting over that unit.
    """

    setting: str
    channel: str
    std: float
    judged: str
    per_unit: float = 1.0


SENSORS = {
    "encoders": NoisySensor("encoder_std_rad_s", "wheel_speed_rad_s", 0.3, "speed"),
    "currents": NoisySensor("torque_std_Nm", "current_A", 1.0, "speed", RLMA.motor.wheel_constant_Nm_per_A),
    "gyro": NoisySensor("gyro_std_rad_s", "yaw_rate_rad_s", 0.03, "yaw rate"),
}


class Judged(NamedTuple):
    """RMSE of what the sensor shows, and its share in the 95 % band."""

    rmse: float
    covered: float


def rows() -> Iterator[Figure]:
    """Every figure of this page."""
    for name, sensor in SENSORS.items():
        right = judge(sensor, 1.0, matching=False)
        for factor in FACTORS:
            data = f"MuJoCo, {name} given {factor:.2g} times their noise"
            given, adapted = judge(sensor, factor, matching=False), judge(sensor, factor, matching=True)
            yield from figures(data, "ukf", sensor.judged, given, right, (None, None))
            yield from figures(data, "aukf", sensor.judged, adapted, right, (AS_GOOD, min(COVERED, right.covered)))


def figures(
    data: str, method: str, judged: str, found: Judged, right: Judged, bars: tuple[float | None, float | None]
) -> Iterator[Figure]:
    """RMSE over that with the right noise, and whether the band holds."""
    yield at_most(data, method, f"{judged} RMSE over the UKF's with the right noise", found.rmse / right.rmse, bars[0])
    yield at_least(data, method, f"{judged} in its 95 % band", found.covered, bars[1], ".1%")


def judge(sensor: NoisySensor, factor: float, matching: bool) -> Judged:
    """Means over the drives of a filter that was given `factor` times the noise of the sensor."""
    given = {**BOARD, sensor.setting: factor * sensor.std * sensor.per_unit}
    robot = runs.believed(np.random.default_rng(SEEDS[0]))
    observer = SpeedObserver(robot, noise=ObserverNoise(**given), matching=matching, rest_hold_s=np.inf)
    return Judged(*np.mean([judge_drive(seed, sensor, observer) for seed in SEEDS], axis=0))


def judge_drive(seed: int, sensor: NoisySensor, observer: SpeedObserver) -> Judged:
    """One drive."""
    rng, true = np.random.default_rng(seed), truth(seed)
    samples = runs.samples_of(true, rng)
    values = getattr(samples, sensor.channel)
    noisy = values + sensor.std * rng.standard_normal(values.shape)
    _, e = runs.observed(observer, samples._replace(**{sensor.channel: noisy}))
    speed = e.speed_m_s - true.speed_m_s[1:], e.speed_std_m_s
    yaw = e.yaw_rate_rad_s - true.gyro_rad_s[1:, 2], e.yaw_rate_std_rad_s
    error, std = speed if sensor.judged == "speed" else yaw
    inside = np.abs(error) <= BAND_95 * std
    return Judged(runs.rmse(error[FIRST:]), float(np.mean(inside[FIRST:])))


@cache
def truth(seed: int) -> RobotTruth:
    """A drive that changes its speed and turns."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2 * np.pi, 2)

    def torque_Nm(now: RobotTruth) -> np.ndarray:
        target = 0.6 + 0.4 * np.sin(0.7 * now.time_s + phase[0]) + 0.15 * np.sin(2.3 * now.time_s + phase[1])
        turn = np.array([0.6, -0.6]) * np.sin(0.9 * now.time_s)
        return np.clip(12.0 * (min(target, 0.5 * now.time_s) - now.speed_m_s), -4.0, 4.0) + turn

    return runs.drive_on(FRICTION, GRADE_STD_RAD * rng.standard_normal(), torque_Nm, DURATION_S)
