"""Make an observer for a robot and a log: which sensors there are, their noise, and which states they allow.

Noise that is visible in a log is measured there: quantisation, white noise, errors of an external speed. The rest
(offsets, the torque constant, the ground) keeps the values of `ObserverNoise`. Every choice is reported in a note.
Without a log every sensor is possible, with its usual noise (`default_observer`).

Disturbance acceleration of a drive: the part that neither the robot file nor a level ground explains.

    d = | G' (tau - J_w d omega/dt) / r | / m - | dv/dt |      as vectors, of the body

tau is the motors' torque, and v the motion that the wheels show while they grip. d contains slopes, rolling resistance,
and all friction that the robot file lacks. Its median is robust against slip, which is rare.

A robot whose motor currents do not show the force that drives it is observed by wheels and gyro, see `SlipByOdometry`:
one whose currents are not measured, and one that scrubs or steers.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_one_of
from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.signals.survey import noise_std, spread
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.terrain import DEFAULT_TERRAIN, Terrain, terrain_named
from ohmward.traction.motion.outside_speed import ASSUMED_STD_M_S, TURNS_M_S
from ohmward.traction.odometry.model import RADIUS_STD, noise_of
from ohmward.traction.odometry.pose_filter import PoseFilter, pose_filter
from ohmward.traction.odometry.slip import SlipByOdometry
from ohmward.traction.robot.chassis import currents_show_force
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import GRAVITY, Robot, motion_from_wheels
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import States

#: Smallest standard deviation [rad/s] taken from a log for an encoder; that of an external speed is `ASSUMED_STD_M_S`.
LEAST_ENCODER_RAD_S = 0.01

#: Fewest samples from which the error of an external speed is measured.
_FEWEST_FOR_ERROR = 10
#: Changes below this are rounding.
_SAME = 1e-9
#: Standard deviations beyond which an error of the speed is an outlier, left out of the correlation.
_OUTLIER = 4.0


def encoder_std_rad_s(wheel_speed_rad_s: np.ndarray) -> float:
    """Largest noise [rad/s] of these wheels (T, wheels), from quantisation or other jumps, with a floor.

    A speed from counts moves in steps q = 2 pi / (counts dt): variance q^2/12 for each of its two counts.
    """
    stds = [LEAST_ENCODER_RAD_S]
    for speed in wheel_speed_rad_s.T:
        stds += [quantum(speed) / math.sqrt(6), noise_std(speed)]
    return max(stds)


def quantum(values: np.ndarray) -> float:
    """Quantisation step of a channel (T,): the smallest common one among its changes; 0 without changes."""
    change = np.abs(np.diff(values[np.isfinite(values)]))
    change = change[change > _SAME]
    return float(np.quantile(change, 0.01)) if change.size else 0.0


def speed_std_m_s(robot: Robot, log: DriveLog) -> float:
    """Standard deviation of an external speed: its own, else that against the wheels, which mostly grip.

    Filters, lags and satellites cause lasting errors. With a correlation rho from each to the next, a mean of many is
    as accurate as one of uncorrelated errors with sqrt((1 + rho)/(1 - rho)) times the standard deviation.
    """
    if log.speed_std_m_s is not None and "speed_std_m_s" in log.channels:
        return float(np.nanmedian(log.speed_std_m_s))
    error = speed_minus_wheels_m_s(robot, log)
    if error.size < _FEWEST_FOR_ERROR:
        return ASSUMED_STD_M_S
    std = spread(error)
    rho = correlation(error, _OUTLIER * std)
    return max(ASSUMED_STD_M_S, std * math.sqrt((1 + rho) / (1 - rho)))


def speed_minus_wheels_m_s(robot: Robot, log: DriveLog) -> np.ndarray:
    """External speeds (N,) minus those of the driven wheels with the radius that fits best; may be empty.

    Ages are not corrected: they are known only to some hundredths of a second, and the change of speed in them is
    noise.
    """
    speed, wheels = speed_and_wheels_m_s(robot, replace(log, speed_age_s=None))
    moving = np.abs(wheels) > TURNS_M_S
    radius_ratio = float(np.median(speed[moving] / wheels[moving])) if moving.any() else 1.0
    return speed - radius_ratio * wheels


def speed_and_wheels_m_s(robot: Robot, log: DriveLog) -> tuple[np.ndarray, np.ndarray]:
    """External speeds and those by the driven wheels at the times of measurement, each (N,); may be empty."""
    rolled = motion_from_wheels(robot, log.wheel_speed_rad_s[:, : robot.driven])[:, 0]
    speed = np.full(len(log), np.nan) if log.speed_m_s is None else log.speed_m_s
    seen, given = np.isfinite(rolled), np.isfinite(speed)
    if not seen.any():
        return np.empty(0), np.empty(0)
    age_s = 0.0 if log.speed_age_s is None else np.nan_to_num(log.speed_age_s[given])
    return speed[given], np.interp(log.time_s[given] - age_s, log.time_s[seen], rolled[seen])


def correlation(error: np.ndarray, limit: float) -> float:
    """Correlation of each error (N,) with the next, in [0, 0.9], among those below the limit."""
    near = np.abs(error[1:]) < limit
    a, b = error[1:][near], error[:-1][near]
    power = float(a @ a)
    return float(np.clip(a @ b / power, 0.0, 0.9)) if power > 0 else 0.0


def usual_step_s(log: DriveLog) -> float:
    """Median time [s] between samples; 0 with one sample."""
    return float(np.median(np.diff(log.time_s))) if len(log) > 1 else 0.0


#: Window [s] over which speeds change by more than the noise of encoders.
WINDOW_S = 0.3

#: Speed [rad/s] from which a wheel turns.
WHEEL_TURNS_RAD_S = 0.2

#: Fewest samples from which a disturbance is found.
_FEWEST_FOR_DISTURBANCE = 20


#: Filters by name: method, and whether R of the encoders is matched.
FILTERS = {"ekf": ("ekf", False), "aekf": ("ekf", True), "ukf": ("ukf", False), "aukf": ("ukf", True)}

#: Smallest standard deviation [rad/s] taken from a log for a gyro, with its offset.
LEAST_GYRO_RAD_S = 0.01

#: Standard deviation of an attitude filter [rad].
PITCH_RAD = math.radians(0.5)

#: Disturbance [g] from which ground or robot differ from the assumed ones: the wheels may slip by that share of their
#: speed, as on a ground whose adhesion grows with slip no faster than one to one.
LARGE_DISTURBANCE_G = 0.05
LARGE_DISTURBANCE = (
    "the motors push {:.2g} g more than the robot accelerates: a steep slope, or a friction that the robot file lacks; "
    "until it is known (ohmward calibrate), slip may be as large, and the bands say so"
)

#: Correlation time [s] of a disturbance.
DISTURBANCE_S = 5.0

SCRUBBING = (
    "the slip of a skid-steered robot follows from wheels and gyro: its motor currents give no force, because much of "
    "them drags the wheels sideways"
)
NO_CURRENTS = " and no gyro: slip shows only in an outside speed"
NO_CURRENTS_BUT_GYRO = (
    ": wheels and gyro show which wheel slips beside others; that all slip alike shows only in an outside speed"
)

#: Length of a step, over the usual one, from which it is a gap.
GAP_STEPS = 2.5


class Chosen(NamedTuple):
    """An observer, and notes on the choices that made it."""

    observer: SpeedObserver | SlipByOdometry
    notes: tuple[Note, ...]


def make_observer(robot: Robot, log: DriveLog, terrain: Terrain, name: str = "ukf") -> Chosen:
    """The observer for this robot on this ground with the sensors of the log.

    terrain: ground that is assumed at first.
    name: "ekf", "aekf", "ukf" or "aukf".

    Raises:
        InputError: an unknown name, or a log without the speed of a driven wheel.
    """
    method, matching = filter_named(name)
    if not np.isfinite(log.wheel_speed_rad_s[:, : robot.driven]).any():
        raise InputError(
            f"log {log.name!r} has no speed of a driven wheel; name its column with --column left_wheel_speed=NAME "
            "(columns={'left_wheel_speed': 'NAME'}), or correct the robot"
        )
    if not (currents_show_force(robot.chassis) and np.isfinite(log.motor_current_A).any(axis=0).all()):
        return Chosen(SlipByOdometry(odometry_for(robot, log)), unforced_notes(robot, log))
    disturbance_g = disturbance_m_s2(robot, log) / GRAVITY
    noise = with_disturbance(sensor_noise(robot, log), disturbance_g)
    if "speed_m_s" not in log.channels and disturbance_g > LARGE_DISTURBANCE_G:
        noise = replace(noise, radius_std=math.hypot(RADIUS_STD, disturbance_g))
    gap_s = max(SpeedObserver.gap_s, GAP_STEPS * usual_step_s(log))
    states = States(radius=noise.speed_std_m_s is not None)
    observer = SpeedObserver(scene(robot, terrain), states, noise, method, matching, gap_s=gap_s)
    return Chosen(observer, notes_of(observer, log, disturbance_g))


def odometry_for(robot: Robot, log: DriveLog) -> PoseFilter:
    """Odometry of a robot, with the initial standard deviation of an outside speed taken from the log."""
    if "speed_m_s" not in log.channels:
        return pose_filter(robot)
    return pose_filter(robot, replace(noise_of(robot), speed_std_m_s=speed_std_m_s(robot, log)))


def filter_named(name: str) -> tuple[str, bool]:
    """Method of that name, and True where it matches the noise; upper and lower case are the same."""
    require_one_of("filter", name.lower(), FILTERS)
    return FILTERS[name.lower()]


def sensor_noise(robot: Robot, log: DriveLog) -> ObserverNoise:
    """Noise of the sensors that the log has."""
    driven, passive = np.split(log.wheel_speed_rad_s, [robot.driven], axis=1)
    has = set(log.channels)
    gyro_rad_s = log.yaw_rate_rad_s if "yaw_rate_rad_s" in has else None
    known_rad_s = driven[np.isfinite(driven)]
    first_m_s = abs(float(known_rad_s[0])) * robot.wheel.radius_m if known_rad_s.size else 0.0
    return ObserverNoise(
        encoder_std_rad_s=encoder_std_rad_s(driven),
        passive_std_rad_s=encoder_std_rad_s(passive) if np.isfinite(passive).any() else None,
        gyro_std_rad_s=None if gyro_rad_s is None else max(LEAST_GYRO_RAD_S, noise_std(gyro_rad_s)),
        speed_std_m_s=speed_std_m_s(robot, log) if "speed_m_s" in has else None,
        pitch_std_rad=PITCH_RAD if "pitch_rad" in has else None,
        radius_std=RADIUS_STD,
        initial_speed_std_m_s=math.hypot(ObserverNoise.initial_speed_std_m_s, RADIUS_STD * first_m_s),
    )


def with_disturbance(noise: ObserverNoise, disturbance_g: float) -> ObserverNoise:
    """The noise with a grade for this disturbance [g]: a slope, or friction, which turns with the robot."""
    std = max(noise.grade_std_rad, disturbance_g)
    if std == noise.grade_std_rad:
        return noise
    return replace(noise, grade_std_rad=std, grade_walk=max(noise.grade_walk, std * math.sqrt(2 / DISTURBANCE_S)))


def notes_of(observer: SpeedObserver, log: DriveLog, disturbance_g: float) -> tuple[Note, ...]:
    """Notes on the choices, in order of importance."""
    notes = []
    if disturbance_g > LARGE_DISTURBANCE_G:
        notes.append(Note(LARGE_DISTURBANCE.format(disturbance_g), "warning"))
    ground = observer.scene.terrains[0].name
    notes.append(Note(f"ground assumed to be {ground}; its friction and stiffness are estimated"))
    return (*notes, *sensor_notes(observer.noise, log))


def unforced_notes(robot: Robot, log: DriveLog) -> tuple[Note, ...]:
    """Notes where the motor currents of the log do not show the force that drives the robot."""
    notes = [Note(SCRUBBING)] if robot.chassis.scrubs else []
    measured = np.isfinite(log.motor_current_A).any()
    if currents_show_force(robot.chassis) or not measured:
        text = NO_CURRENTS_BUT_GYRO if "yaw_rate_rad_s" in log.channels else NO_CURRENTS
        notes.append(Note(f"{'not all' if measured else 'no'} motor currents{text}", "warning"))
    return tuple(notes)


def sensor_notes(noise: ObserverNoise, log: DriveLog) -> tuple[Note, ...]:
    """Notes on the sensors."""
    stds = {
        "encoders": (noise.encoder_std_rad_s, "rad/s"),
        "encoders of passive wheels": (noise.passive_std_rad_s, "rad/s"),
        "gyro": (noise.gyro_std_rad_s, "rad/s"),
        "speed from outside": (noise.speed_std_m_s, "m/s"),
        "pitch": (noise.pitch_std_rad, "rad"),
    }
    used = ", ".join(f"{name} {std:.2g} {unit}" for name, (std, unit) in stds.items() if std is not None)
    notes = [Note(f"standard deviations taken from the log: {used}")]
    if "acceleration_m_s2" in log.channels:
        notes.append(Note("the accelerometer is not used: the motor currents give the same force"))
    return tuple(notes)


def yaw_rate_of_wheels(robot: Robot, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Yaw rate (T,) [rad/s] by the driven wheels of a log (T, wheels) and the track, as if no wheel scrubbed."""
    return motion_from_wheels(robot, wheel_speed_rad_s[:, : robot.driven])[:, -1]


def disturbance_m_s2(robot: Robot, log: DriveLog) -> float:
    """Median of d [m/s^2] over the samples in which the robot moves; 0 if there are too few."""
    n = robot.driven
    speed, current = log.wheel_speed_rad_s[:, :n], log.motor_current_A
    rows = np.isfinite(speed).all(axis=1) & np.isfinite(current).all(axis=1)
    time_s, speed, torque = log.time_s[rows], speed[rows], wheel_torque(robot.motor, current[rows], speed[rows])
    half = max(1, round(0.5 * WINDOW_S / float(np.median(np.diff(time_s))))) if time_s.size > 1 else 1
    moving = np.abs(speed[half:-half]).max(axis=1, initial=0.0) > WHEEL_TURNS_RAD_S
    if time_s.size < _FEWEST_FOR_DISTURBANCE + 2 * half or moving.sum() < _FEWEST_FOR_DISTURBANCE:
        return 0.0
    wheel_rate = (speed[2 * half :] - speed[: -2 * half]) / (time_s[2 * half :] - time_s[: -2 * half])[:, None]
    force_N = (window_mean(torque, half) - robot.inertia[robot.freedoms :] * wheel_rate) / robot.wheel.radius_m
    linear = slice(0, robot.freedoms - 1)
    forced = (force_N @ robot.rolling[:n])[:, linear] / robot.mass_kg
    measured = motion_from_wheels(robot, wheel_rate)[:, linear]
    return float(np.median(np.linalg.norm(forced - measured, axis=1)[moving]))


def window_mean(values: np.ndarray, half: int) -> np.ndarray:
    """Mean (T - 2 half, N) of each column over the window."""
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


DEFAULT_FILTER = "ukf"

#: Sensors that a robot may have; an absent one costs only its part of the step.
ANY_SENSORS = ObserverNoise(
    gyro_std_rad_s=LEAST_GYRO_RAD_S, pitch_std_rad=PITCH_RAD, speed_std_m_s=ASSUMED_STD_M_S, radius_std=RADIUS_STD
)


def default_observer(
    robot: Robot | str, terrain: Terrain | str = DEFAULT_TERRAIN, filter: str = DEFAULT_FILTER
) -> SpeedObserver | SlipByOdometry:
    """The observer of a robot on this ground, before there is a log of it.

    robot: or the path of its file, or the name of a packaged one.
    terrain: or its name.
    filter: "ekf", "aekf", "ukf" or "aukf".

    Raises:
        InputError: an unknown name.
    """
    method, matching = filter_named(filter)
    if not isinstance(robot, Robot):
        robot = load_robot(robot)
    if not isinstance(terrain, Terrain):
        terrain = terrain_named(terrain, robot.wheel)
    if not currents_show_force(robot.chassis):
        return SlipByOdometry(pose_filter(robot))
    has_passive = len(robot.places) > robot.driven
    noise = replace(ANY_SENSORS, passive_std_rad_s=ObserverNoise.encoder_std_rad_s if has_passive else None)
    return SpeedObserver(scene(robot, terrain), States(radius=False), noise, method, matching)
