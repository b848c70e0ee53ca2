"""Samples of a drive by the sensors of a condition."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipSample
from ohmward_lab.assess.draws import generator, signs
from ohmward_lab.assess.traction.conditions import DriveCondition
from ohmward_lab.assess.traction.drives import INTERVAL_S, ROBOTS, Drives, drives
from ohmward_lab.simulate.closed_loop.sensing import ExternalSpeed
from ohmward_lab.simulate.robot_sensors import ACCELEROMETER, GYRO, PITCH

#: Size of a glitch of an encoder [rad/s].
_GLITCH_RAD_S = 20.0


@lru_cache(maxsize=2)
def measured(name: str, condition: DriveCondition, runs: int, seed: int) -> tuple[SlipSample, Drives]:
    """Samples (T, ..., B) as the sensors of this condition give them, and the truth at their times."""
    robot = ROBOTS[name]
    every = round(condition.interval_s / INTERVAL_S)
    truth = Drives(*(values[::every] for values in drives(name, condition.world, runs, seed)))
    rng = generator("sensors", name, condition.name, seed)
    sign = signs(runs)
    times = truth.speed_m_s.shape
    gyro = truth.yaw_rate_rad_s + sign * condition.gyro_offset_rad_s + GYRO.noise_std * rng.standard_normal(times)
    ahead = (
        truth.specific_force_m_s2 + sign * ACCELEROMETER.offset + ACCELEROMETER.noise_std * rng.standard_normal(times)
    )
    pitch = truth.grade_rad + sign * PITCH.offset + PITCH.noise_std * rng.standard_normal(times)
    speed = _outside_speed(condition, truth.speed_m_s, rng)
    known = np.isfinite(speed)
    dt_s = np.full(times[0], condition.interval_s)
    dt_s[0] = 0.0
    sample = SlipSample(
        dt_s=dt_s,
        wheel_speed_rad_s=_wheel_speeds(condition, robot, truth.angle_rad, rng),
        current_A=_currents(condition, robot, truth.impulse_Nms, rng),
        yaw_rate_rad_s=gyro if condition.has_gyro else np.full(times, np.nan),
        acceleration_m_s2=ahead if condition.has_pitch else np.full(times, np.nan),
        pitch_rad=pitch if condition.has_pitch else np.full(times, np.nan),
        speed_m_s=speed,
        speed_std_m_s=np.where(known, ExternalSpeed.std_m_s, np.nan),
        speed_age_s=np.where(known, condition.speed_delay_s, 0.0),
    )
    return sample, truth


def _wheel_speeds(
    condition: DriveCondition, robot: Robot, angle_rad: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(T, wheels, B) from the counts between two samples; the first is that of a robot at rest."""
    step_rad = 2 * np.pi / condition.counts_per_turn
    start = rng.random(angle_rad.shape[1:])
    counts = np.floor(angle_rad / step_rad + start)
    speed = np.diff(counts, axis=0, prepend=counts[:1]) * step_rad / condition.interval_s
    signs_of_glitches = rng.choice([-1.0, 1.0], speed.shape)
    speed = speed + np.where(rng.random(speed.shape) < condition.glitches, _GLITCH_RAD_S * signs_of_glitches, 0.0)
    speed[rng.random(speed.shape) < condition.missing] = np.nan
    if not condition.all_encoders:
        speed[:, robot.driven :] = np.nan
    return speed


def _currents(condition: DriveCondition, robot: Robot, impulse_Nms: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(T, driven, B) means between two samples."""
    if not condition.has_currents:
        return np.full_like(impulse_Nms, np.nan)
    torque_Nm = np.diff(impulse_Nms, axis=0, prepend=impulse_Nms[:1]) / condition.interval_s
    gain = 1.0 + signs(impulse_Nms.shape[-1]) * condition.current_gain
    noise_A = condition.current_noise_A * rng.standard_normal(torque_Nm.shape)
    current_A = gain * torque_Nm / robot.motor.wheel_constant_Nm_per_A + noise_A
    return np.where(rng.random(current_A.shape) < condition.missing, np.nan, current_A)


def _outside_speed(condition: DriveCondition, speed_m_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(T, B) nan where none arrives."""
    found = np.full_like(speed_m_s, np.nan)
    if condition.speed_interval_s:
        late = round(condition.speed_delay_s / condition.interval_s)
        at = np.arange(late, len(speed_m_s), round(condition.speed_interval_s / condition.interval_s))
        noise = ExternalSpeed.std_m_s * rng.standard_normal((at.size, speed_m_s.shape[1]))
        found[at] = speed_m_s[at - late] + noise
    return found
