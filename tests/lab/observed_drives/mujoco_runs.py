"""Drives of the MuJoCo robot, seen by its sensors, as samples for an observer; benchmarks/traction_mujoco.py takes them
too."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.traction import RLMA, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.speed_observer.encoders import wheel_speeds
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.ground import Grade, Patch
from ohmward_lab.simulate.mujoco_plant import DRY, RlmaParameters, RlmaPlant, drive
from ohmward_lab.simulate.robot_sensors import RobotSensors, RobotTruth, record
from traction.speed_observer.examples import observed

DT_S = 0.01
RUNS = 10
SENSORS = RobotSensors(interval_s=DT_S)
#: What the observer believes of the ground: rubber on a hard floor. The plant creeps 1.5 times as much.
FLOOR = Terrain("rubber on a hard floor", WardIagnemma(0.7, 13.0), RollingResistance(a3_s_per_m=0.0), "tests")


def believed(rng, radius_std=0.005, terrain=FLOOR):
    """The robot that the observer believes in: its radius is off as radii are."""
    wheel = replace(RLMA.wheel, radius_m=RLMA.wheel.radius_m * (1 + radius_std * rng.standard_normal()))
    return scene(replace(RLMA, wheel=wheel), terrain)


def cruising(rng):
    """Between 0.1 and 0.5 m/s, the speeds of [T], at up to 0.4 m/s^2: on a floor of 0.8 the wheels grip."""
    phase = rng.uniform(0.0, 2 * np.pi)

    def torque_Nm(truth):
        target = 0.3 + 0.2 * np.sin(1.5 * truth.time_s + phase)
        return np.clip(12.0 * (min(target, 0.5 * truth.time_s) - truth.speed_m_s), -3.0, 3.0)

    return torque_Nm


def spinning(rng):
    """More than a floor of 0.2 can take, from the start on."""
    return lambda truth: 3.0


def drive_on(friction, grade_rad, torque, duration_s):
    """The truth of a drive, (T, ...)."""
    plant = RlmaPlant(RlmaParameters(), [Patch(friction=friction)], Grade(grade_rad=(grade_rad,)))
    return drive(plant, torque, duration_s, DT_S)


def ice_on_a_slope(friction, grade_rad):
    """The robot on a dry floor, from 0.6 m on a slope of this friction."""
    patches = [DRY, Patch(friction=friction, from_m=0.6)]
    return RlmaPlant(RlmaParameters(), patches, Grade((0.6, 0.6 + 1e-9), (0.0, grade_rad)))


def samples_of(truth, rng, passive=False, speed_every=0, speed_std=0.05, age_steps=0, pitch_std=None):
    """What the sensors say, (T - 1, ...), without the first reading; every so many steps a speed from outside."""
    readings = record(truth, SENSORS, rng)
    time_s = np.array([r.time_s for r in readings])
    counts = np.array([r.encoder_count for r in readings])
    speeds = wheel_speeds(counts, time_s, SENSORS.counts_per_turn)[1:]
    if not passive:
        speeds[:, 2:] = np.nan
    external = np.full(len(speeds), np.nan)
    if speed_every:
        true = truth.speed_m_s[1:]
        noisy = true + speed_std * rng.standard_normal(len(true))
        external[age_steps::speed_every] = noisy[: len(true) - age_steps : speed_every]
    nothing = np.full(len(speeds), np.nan)
    pitch = nothing if pitch_std is None else truth.grade_rad[1:] + pitch_std * rng.standard_normal(len(speeds))
    return RobotSample(
        np.diff(time_s),
        speeds,
        np.array([r.motor_current_A for r in readings[1:]]),
        np.array([r.gyro_rad_s[2] for r in readings[1:]]),
        np.array([r.specific_force_m_s2[0] for r in readings[1:]]),
        pitch,
        external,
        nothing,
        np.full(len(speeds), age_steps * DT_S),
    )


class Runs(NamedTuple):
    """Errors of the speed [m/s], those of speed and left slip over sigma, (runs, T), the last truth and estimates."""

    error: np.ndarray
    normalised: np.ndarray
    slip: np.ndarray
    truth: object
    estimate: object


#: Drives of MuJoCo by what they depend on: several observers see the same ones.
TRUTHS: dict[Any, RobotTruth] = {}


def drives(
    friction, torque, duration_s, noise=None, method="ukf", terrain=FLOOR, seeds=range(100, 100 + RUNS), **sensors
):
    """A drive for each seed, on a slope of about a degree, with a radius of about the right one."""
    errors, normalised, slip = [], [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        observer = SpeedObserver(
            believed(rng, terrain=terrain), noise=noise or ObserverNoise(), method=method, rest_hold_s=np.inf
        )
        grade_rad, demand = np.radians(1.0) * rng.standard_normal(), torque(rng)
        if (drawn := (friction, torque, duration_s, seed)) not in TRUTHS:
            TRUTHS[drawn] = drive_on(friction, grade_rad, demand, duration_s)
        truth = TRUTHS[drawn]
        _, e = observed(observer, samples_of(truth, rng, **sensors))
        errors.append(e.speed_m_s - truth.speed_m_s[1:])
        normalised.append(errors[-1] / e.speed_std_m_s)
        slip.append(((e.slip_speed_m_s - truth.slip_speed_m_s[1:, :2]) / e.slip_speed_std_m_s)[:, 0])
    return Runs(np.array(errors), np.array(normalised), np.array(slip), truth, e)


def rmse(error):
    return float(np.sqrt(np.mean(error**2)))


def mean_nees(normalised):
    """Mean NEES over the runs at four times, (4,)."""
    times = np.linspace(0.25, 1.0, 4) * (normalised.shape[1] - 1)
    return np.mean(normalised[:, times.astype(int)] ** 2, axis=0)
