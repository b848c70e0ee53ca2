"""Drives whose pose is known: robots drawn from the noise that the filter claims."""

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from kernels import kernel_of
from ohmward.traction import RLMA, Motor, Robot, TwoWheeled, Wheel
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.odometry.model import SCRUBBING, OdometryNoise
from ohmward.traction.odometry.pose_filter import PoseFilter, PoseState
from ohmward.traction.odometry.sample import Observed, OdometryEstimate, OdometrySample
from ohmward.traction.robot.packaged import load_robot

DT_S = 0.02
NOISE = OdometryNoise()
TRACK_M = 0.35
INDOOR = Robot("indoor", 15.0, 0.6, TwoWheeled(0.03, TRACK_M, (-0.2,)), Wheel(0.08, 0.03, 2e-3), Motor(0.03, 1.0))


def scan(settings: PoseFilter, given) -> tuple[PoseState, OdometryEstimate]:
    """State at the end, and estimates (T, ...).

    Tests of statistics scan many long drives with one filter, in machine code from the first on. One short drive with a
    filter of its own takes a tenth of the time of compiling it.
    """
    nothing = settings.no_sample()
    start = settings.init(nothing)
    lowering = "machine" if len(given.robot.dt_s) > 2500 else None
    return kernel_of(settings, start, nothing, lowering=lowering).scan(start, given)


class Drive(NamedTuple):
    """Samples (T, ...), the true pose (T, 3) after each, and the gyro's offset."""

    samples: OdometrySample
    pose: np.ndarray
    offset_rad_s: float


def samples(settings: PoseFilter, **given) -> OdometrySample:
    """Samples (T, ...) with nothing but what is given."""
    T, nothing = len(given["wheel_speed_rad_s"]), settings.no_sample()
    speeds = np.full((T, len(settings.robot.places)), np.nan)
    speeds[:, : settings.robot.driven] = given.pop("wheel_speed_rad_s")
    if "passive_rad_s" in given:
        speeds[:, settings.robot.driven :] = given.pop("passive_rad_s")
    observed = {name.removeprefix("observed_"): given.pop(name) for name in [*given] if name.startswith("observed_")}

    def filled(record, values):
        fields = {name: value for name, value in record._asdict().items() if not isinstance(value, tuple)}
        return {name: np.broadcast_to(values.get(name, v), (T, *np.shape(v))) for name, v in fields.items()}

    return OdometrySample(
        **filled(nothing, given),
        robot=RobotSample(**filled(nothing.robot, {"dt_s": DT_S, **given, "wheel_speed_rad_s": speeds})),
        observed=Observed(**filled(nothing.observed, observed)),
    )


def gauss_markov(rng, T, noise):
    """(T,) of unit variance."""
    decay = np.exp(-DT_S / noise.correlation_s)
    new = rng.standard_normal(T)
    new[1:] *= np.sqrt(1 - decay**2)
    return lfilter([1.0], [1.0, -decay], new)


def integrate(v, left, w):
    """Pose (T, 3) at the end of each step."""
    yaw = np.cumsum(w) * DT_S
    middle = yaw - w * DT_S / 2
    x = np.cumsum(v * np.cos(middle) - left * np.sin(middle)) * DT_S
    y = np.cumsum(v * np.sin(middle) + left * np.cos(middle)) * DT_S
    return np.column_stack([x, y, yaw])


def drive(settings: PoseFilter, seed: int, distance_m: float = 50.0) -> Drive:
    """[T]'s robot at 0.5 m/s after a rest of three seconds, with turns; all errors as the noise says."""
    rng, noise = np.random.default_rng(seed), settings.noise
    n = rng.standard_normal
    time_s = DT_S * np.arange(round((3.0 + distance_m / 0.5) / DT_S))
    rim_m_s = np.clip(0.4 * (time_s - 3.0), 0.0, 0.5)
    rim_rad_s = 0.3 * np.sin(0.3 * time_s + rng.uniform(0, 6)) * (rim_m_s > 0) * (np.sin(0.1 * time_s) > 0)
    T = len(time_s)
    v = rim_m_s * (1 + noise.radius_std * n()) + noise.slip_share * rim_m_s * gauss_markov(rng, T, noise)
    apart = noise.slip_difference_share * settings.turn_per_slip * rim_m_s
    in_turns = noise.turn_share * rim_rad_s
    turn_std = np.where(in_turns < -apart, -1.0, 1.0) * np.hypot(apart, in_turns)
    curvature = noise.wheel_difference_std * settings.turn_per_slip * n()
    w = rim_rad_s * (1 + noise.turn_scale_std * n()) + curvature * rim_m_s + turn_std * gauss_markov(rng, T, noise)
    side_std = np.hypot(noise.side_slip_share * rim_m_s, noise.side_arm_std_m * rim_rad_s)
    left = side_std * gauss_markov(rng, T, noise)
    offset = noise.gyro_offset_std_rad_s * n() + np.cumsum(noise.gyro_offset_walk * np.sqrt(DT_S) * n(T))
    gyro = w / (1 + noise.gyro_scale_std * n()) + offset + noise.gyro_walk / np.sqrt(DT_S) * n(T)
    motion = np.column_stack([rim_m_s, rim_rad_s])
    speeds = motion @ RLMA.rolling[: RLMA.driven].T / RLMA.wheel.radius_m
    given = {"dt_s": np.full(T, DT_S), "wheel_speed_rad_s": speeds, "yaw_rate_rad_s": gyro}
    return Drive(samples(settings, **given), integrate(v, left, w), float(offset[-1]))


def one_side_spins(side, outside, rng):
    """Samples of a skid-steered robot on a winding way, one side of which spins twice, and the conditions that it does.

    outside: with a speed of GNSS, 5 times a second.
    """
    robot = load_robot("husky")
    time_s = DT_S * np.arange(1500)
    turn = 0.3 * np.sin(2.0 * np.pi * time_s / 17.0)
    spins = ((time_s > 10.0) & (time_s < 13.0)) | ((time_s > 20.0) & (time_s < 22.0))
    ramp = np.convolve(spins, np.full(15, 1.0 / 15.0), "same")
    scrubbed_m = 1.3 * robot.rolling[:, -1]  # the effective track is another than the file's
    speeds = 0.8 + np.outer(turn, scrubbed_m) + 0.5 * np.outer(ramp, [i % 2 == side for i in range(4)])
    settings = PoseFilter(robot, SCRUBBING)
    gnss = np.where(np.arange(1500) % 10 == 0, 0.8 + 0.05 * rng.standard_normal(1500), np.nan)
    sensors = {"yaw_rate_rad_s": turn + 0.002 * rng.standard_normal(1500), **({"speed_m_s": gnss} if outside else {})}
    given = samples(settings, wheel_speed_rad_s=speeds / robot.wheel.radius_m, **sensors)
    return settings, given, ramp > 0.0


class StopAndGo(NamedTuple):
    """Speeds of the wheels (T, 2) by their counts, the gyro (T,), the true pose (T, 3), and the gyro's offset."""

    wheel_speed_rad_s: np.ndarray
    gyro_rad_s: np.ndarray
    pose: np.ndarray
    offset_rad_s: float


def ramped(wanted: np.ndarray, most: float) -> np.ndarray:
    """What is wanted, from 0 on, but at most so much more or less at each step."""
    reached = [0.0]
    for value in wanted[1:].tolist():
        reached.append(reached[-1] + min(max(value - reached[-1], -most), most))
    return np.array(reached)


def stop_and_go(seed: int, counts: int, late_s: float = 0.0, every: int = 1, seconds: float = 120.0) -> StopAndGo:
    """A robot that drives, turns on the spot and rests in turn, on floors that change its slip and its track."""
    rng = np.random.default_rng(seed)
    steps, start = round(seconds / DT_S), round(3.0 / DT_S)
    wanted = np.zeros((steps, 2))
    while start < steps:
        end = start + round(rng.uniform(2.0, 8.0) / DT_S)
        kinds = (rng.uniform(0.3, 0.9), 0.0), (rng.uniform(0.3, 0.8), rng.uniform(-0.6, 0.6)), (0.0, rng.uniform(-1, 1))
        wanted[start:end] = (*kinds, (0.0, 0.0))[rng.integers(4)]
        start = end
    v, w = (ramped(column, most * DT_S) for column, most in zip(wanted.T, (0.5, 1.5), strict=True))
    pose = integrate(v, np.zeros(steps), w)
    patch = (np.cumsum(np.abs(v)) * DT_S // rng.uniform(3.0, 8.0)).astype(int)
    slip, turned = (share * rng.standard_normal(patch.max() + 1)[patch] for share in (0.003, 0.02))
    radii = 1.0 + 0.005 * rng.standard_normal() + 0.0006 * rng.standard_normal(2)
    half_m = TRACK_M / 2
    rims = np.column_stack([v - half_m * w * (1 + turned), v + half_m * w * (1 + turned)]) * (1 + slip)[:, None]
    count = 2 * math.pi / counts
    angles = np.cumsum(rims / radii * DT_S, axis=0) / INDOOR.wheel.radius_m
    angles = count * np.floor(angles / count + rng.random(2))[every - 1 :: every]
    time_s = DT_S * np.arange(steps)
    yaw = np.interp(time_s - late_s, time_s, pose[:, 2])[every - 1 :: every]
    step_s = every * DT_S
    offset = 0.01 * rng.choice([-1.0, 1.0])
    gyro = np.diff(yaw, prepend=0.0) / step_s * (1 + 0.01 * rng.standard_normal()) + offset
    gyro += 0.002 * rng.standard_normal(len(gyro))
    return StopAndGo(np.diff(angles, axis=0, prepend=angles[:1]) / step_s, gyro, pose[every - 1 :: every], offset)
