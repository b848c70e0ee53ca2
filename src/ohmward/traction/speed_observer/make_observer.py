"""An observer for a robot and a log of it: which sensors there are, how wrong they are, which states that allows.

What can be seen in the log is measured there: quantisation and noise of encoders, noise of gyro and accelerometer, the
sampling interval. What cannot (offsets, the torque constant, the ground) keeps the values of `ObserverNoise`.
Every choice is a note.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.law import contact
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.robot.chassis import Differential, SkidSteer
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward.traction.speed_observer.disturbance import disturbance_m_s2
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import States

#: Filters by name: method, and whether R of the encoders is matched.
FILTERS = {"ekf": ("ekf", False), "aekf": ("ekf", True), "ukf": ("ukf", False), "aukf": ("ukf", True)}

#: Least standard deviations that a log may claim for its sensors: rad/s of an encoder, rad/s of a gyro with its offset,
#: m/s^2 of an accelerometer on a robot that shakes, rad of an attitude filter, m/s of a speed from outside.
LEAST_ENCODER_RAD_S = 0.01
LEAST_GYRO_RAD_S = 0.01
LEAST_ACCELEROMETER_M_S2 = 0.2
PITCH_RAD = math.radians(0.5)
LEAST_SPEED_M_S = 0.05

#: Where nobody measures the motor currents: the push of a wheel over its load, and for how long [s].
UNKNOWN_PUSH, PUSH_S = 0.3, 1.0

#: A push [g] that nothing explains, from which on neither ground nor robot are what is believed: the wheels may slip by
#: as much of their speed, as on a ground whose adhesion grows with slip no faster than one to one.
DOUBTFUL_PUSH_G = 0.05
DOUBT = (
    "the motors push {:.2g} g more than the robot accelerates: a steep slope, or a friction that the robot file lacks; "
    "until it is known (ohmward calibrate), slip may be as large, and the bands say so"
)

#: A push that the robot file does not explain changes within so long [s].
PUSH_TURNS_S = 5.0

#: Slip [m/s] at which a wheel surely grips.
SMALL_SLIP_M_S = 1e-4

#: Of the effective radius of wheels measured with a ruler, relative.
RADIUS_STD = 0.01

#: Slip of wheels that scrub, as a share of the speed of their rims, where no force and no speed from outside is known.
SCRUBBING_SHARE = 0.25

#: Accelerometer offsets that nobody calibrated: mounted 2 degrees off.
ACCELEROMETER_OFFSET_M_S2 = 0.35

#: A skid-steered robot turns as the ground lets it, not as its wheels say [rad/s over the root of a second].
SCRUBBING_YAW_WALK = 3.0

#: A step so many times as long as the usual one is a gap.
GAP_STEPS = 2.5

#: Median absolute deviation to standard deviation of a normal error.
_MAD = 1.4826
_FEWEST = 10
_SAME = 1e-9
_OUTLIER = 4.0
_MOVING_M_S = 0.1


class Chosen(NamedTuple):
    """An observer, and what was decided to make it."""

    observer: SpeedObserver
    notes: tuple[Note, ...]


def make_observer(robot: Robot, log: DriveLog, terrain: Terrain, name: str = "ukf") -> Chosen:
    """The observer for this robot on this ground with what the log has.

    terrain: the ground that is believed at first.
    name: "ekf", "aekf", "ukf" or "aukf".

    Raises:
        InputError: an unknown name, or a log without the speed of a driven wheel.
    """
    if name not in FILTERS:
        raise InputError(f"filter must be one of {', '.join(FILTERS)}, got {name!r}")
    if not np.isfinite(log.wheel_speed_rad_s[:, : robot.driven]).any():
        raise InputError(
            f"log {log.name!r} has no speed of a driven wheel; name its column with --column, or correct the robot"
        )
    method, matching = FILTERS[name]
    rolling, scrubs = without_scrubbing(robot)
    force = knows_force(robot, log)
    noise = noise_of(rolling, log, force)
    if not force:
        rim_m_s = rolling.wheel.radius_m * float(np.nanmedian(np.abs(log.wheel_speed_rad_s)))
        noise = replace(noise, speed_walk=unknown_push_walk(rolling, rim_m_s, terrain))
    if scrubs:
        noise = replace(noise, yaw_rate_walk=SCRUBBING_YAW_WALK)
    push_g = disturbance_m_s2(rolling, log) / GRAVITY if force else 0.0
    noise, notes = with_push(noise, push_g), []
    if push_g > DOUBTFUL_PUSH_G:
        notes.append(Note(DOUBT.format(push_g), "warning"))
    if "speed_m_s" not in log.channels:
        slip = SCRUBBING_SHARE if scrubs else push_g if push_g > DOUBTFUL_PUSH_G else 0.0
        noise = replace(noise, radius_std=math.hypot(RADIUS_STD, slip))
    states = states_of(noise, force)
    observer = SpeedObserver(
        scene(rolling, terrain),
        states,
        noise,
        method,
        matching,
        gap_s=max(SpeedObserver.gap_s, GAP_STEPS * usual_step_s(log)),
    )
    estimated = "; its friction and stiffness are estimated" if states.stiffness else ""
    ground = Note(f"ground believed to be {terrain.name}{estimated}")
    return Chosen(observer, (*notes, ground, *scrubs, *notes_of(noise, log)))


def without_scrubbing(robot: Robot) -> tuple[Robot, tuple[Note, ...]]:
    """The robot as the observer can have it: one that drags its wheels sideways rolls freely and needs a gyro."""
    chassis = robot.chassis
    if not isinstance(chassis, SkidSteer):
        return robot, ()
    free = Differential(chassis.front_m, chassis.rear_m, chassis.track_m, driven="all")
    text = (
        "a skid-steered robot is observed as one whose wheels are free sideways: its turns are the gyro's, and its "
        "motor currents tell no force, because much of them drags the wheels sideways"
    )
    return replace(robot, chassis=free), (Note(text),)


def knows_force(robot: Robot, log: DriveLog) -> bool:
    """Whether the motor currents tell the force that drives the robot; those of wheels that scrub mostly do not."""
    return not robot.chassis.scrubs and bool(np.isfinite(log.motor_current_A).any())


def noise_of(robot: Robot, log: DriveLog, force: bool) -> ObserverNoise:
    """How wrong the sensors of this log are, and which there are; force: whether its currents tell it.

    The accelerometer serves where they do not, and the pitch tells gravity from it.
    """
    driven, passive = np.split(log.wheel_speed_rad_s, [robot.driven], axis=1)
    has = set(log.channels)
    accelerates = {"acceleration_m_s2", "pitch_rad"} <= has and not force
    return ObserverNoise(
        encoder_std_rad_s=encoder_std_rad_s(driven),
        passive_std_rad_s=encoder_std_rad_s(passive) if np.isfinite(passive).any() else None,
        gyro_std_rad_s=noise_std(log.yaw_rate_rad_s, LEAST_GYRO_RAD_S) if "yaw_rate_rad_s" in has else None,
        speed_std_m_s=speed_std_m_s(robot, log) if "speed_m_s" in has else None,
        pitch_std_rad=PITCH_RAD if "pitch_rad" in has else None,
        accelerometer_std_m_s2=noise_std(log.acceleration_m_s2, LEAST_ACCELEROMETER_M_S2) if accelerates else None,
        accelerometer_offset_std_m_s2=ACCELEROMETER_OFFSET_M_S2,
        radius_std=RADIUS_STD,
        torque_std_Nm=ObserverNoise.torque_std_Nm if force else unknown_torque_Nm(robot, usual_step_s(log)),
        initial_speed_std_m_s=math.hypot(
            ObserverNoise.initial_speed_std_m_s, RADIUS_STD * first_speed_m_s(robot, driven)
        ),
    )


def with_push(noise: ObserverNoise, push_g: float) -> ObserverNoise:
    """The noise with a grade that may be such a push [g]: of a slope, or of friction, which turns with the robot."""
    std = max(noise.grade_std_rad, push_g)
    if std == noise.grade_std_rad:
        return noise
    return replace(noise, grade_std_rad=std, grade_walk=max(noise.grade_walk, std * math.sqrt(2 / PUSH_TURNS_S)))


def unknown_torque_Nm(robot: Robot, step_s: float) -> float:
    """Of a torque that nobody measures: any that the ground takes, for as long as robots push, as white noise."""
    load_N = robot.mass_kg * GRAVITY / len(robot.places)
    return UNKNOWN_PUSH * load_N * robot.wheel.radius_m * math.sqrt(max(PUSH_S / max(step_s, _SAME), 1.0))


def unknown_push_walk(robot: Robot, rim_m_s: float, terrain: Terrain) -> float:
    """Walk of the speed [m/s over the root of a second] where nobody knows what pushes the robot, and for how long.

    A lasting push a makes a gripping wheel slip by a/(k g), with the slope k of adhesion over slip speed; a walk q of
    the speed makes the slip unknown by q sqrt(1/(2 k g)). This q makes both the same: white torque alone would forget.
    """
    load_N = robot.mass_kg * GRAVITY / len(robot.places)
    gripping = contact(rim_m_s + SMALL_SLIP_M_S, rim_m_s, load_N)
    slope_s_per_m = float(terrain.traction.force_N(gripping)) / load_N / SMALL_SLIP_M_S
    return UNKNOWN_PUSH * GRAVITY * math.sqrt(2 / (slope_s_per_m * GRAVITY))


def first_speed_m_s(robot: Robot, wheel_speed_rad_s: np.ndarray) -> float:
    """Size of the first speed that the wheels (T, driven) show [m/s]."""
    known = wheel_speed_rad_s[np.isfinite(wheel_speed_rad_s)]
    return abs(float(known[0])) * robot.wheel.radius_m if known.size else 0.0


def states_of(noise: ObserverNoise, force: bool) -> States:
    """What the log can show: without a force nothing of the ground, without a speed from outside no radius.

    A filter learns a radius that nothing shows from the errors of its model. Where it is no state, its part in the
    sigmas is considered, see `consider_radius`.
    """
    return States(
        friction="one" if force else "known",
        stiffness=force,
        grade=force,
        radius=force and noise.speed_std_m_s is not None,
        accelerometer_offset=noise.accelerometer_std_m_s2 is not None,
    )


def encoder_std_rad_s(wheel_speed_rad_s: np.ndarray) -> float:
    """The largest noise [rad/s] of these wheels (T, wheels): of quantisation or of what else jumps; there is a floor.

    A speed from counts moves in steps q = 2 pi / (counts dt): variance q^2/12 for each of its two counts.
    """
    stds = [LEAST_ENCODER_RAD_S]
    for speed in wheel_speed_rad_s.T:
        stds += [quantum(speed) / math.sqrt(6), noise_std(speed, 0.0)]
    return max(stds)


def quantum(values: np.ndarray) -> float:
    """The step in which a channel (T,) moves: the smallest one that is usual among its changes; 0 without changes."""
    change = np.abs(np.diff(values[np.isfinite(values)]))
    change = change[change > _SAME]
    return float(np.quantile(change, 0.01)) if change.size else 0.0


def noise_std(values: np.ndarray | None, least: float) -> float:
    """Standard deviation of the white noise of a channel (T,): of each sample against the line through its neighbours.

    Robust against what the robot really does, as long as that is slow; not below `least`.
    """
    known = np.empty(0) if values is None else values[np.isfinite(values)]
    if known.size < _FEWEST:
        return max(least, 0.0)
    off_line = known[1:-1] - 0.5 * (known[:-2] + known[2:])
    return max(least, _MAD * float(np.median(np.abs(off_line))) / math.sqrt(1.5))


def speed_std_m_s(robot: Robot, log: DriveLog) -> float:
    """Of the speed from outside where a sample does not carry its own: its distance from the wheels, which mostly grip.

    Filters, lags and satellites make errors that last. With a correlation rho from each to the next, a mean of many is
    as good as one of uncorrelated errors with sqrt((1 + rho)/(1 - rho)) times the standard deviation.
    """
    if log.speed_std_m_s is not None and "speed_std_m_s" in log.channels:
        return float(np.nanmedian(log.speed_std_m_s))
    error = speed_minus_wheels_m_s(robot, log)
    if error.size < _FEWEST:
        return LEAST_SPEED_M_S
    std = _MAD * float(np.median(np.abs(error - np.median(error))))
    rho = correlation(error, _OUTLIER * std)
    return max(LEAST_SPEED_M_S, std * math.sqrt((1 + rho) / (1 - rho)))


def speed_minus_wheels_m_s(robot: Robot, log: DriveLog) -> np.ndarray:
    """(N,) the speeds from outside minus those of the driven wheels on the radius that fits best; may be empty."""
    speed, wheels = speed_and_wheels_m_s(robot, log)
    moving = np.abs(wheels) > _MOVING_M_S
    share = float(np.median(speed[moving] / wheels[moving])) if moving.any() else 1.0
    return speed - share * wheels


def speed_and_wheels_m_s(robot: Robot, log: DriveLog) -> tuple[np.ndarray, np.ndarray]:
    """The speeds from outside and, at the same times, those that the driven wheels show, each (N,); may be empty."""
    n = robot.driven
    rolled = log.wheel_speed_rad_s[:, :n] @ np.linalg.pinv(robot.rolling[:n])[0] * robot.wheel.radius_m
    speed = np.full(len(log), np.nan) if log.speed_m_s is None else log.speed_m_s
    seen, given = np.isfinite(rolled), np.isfinite(speed)
    if not seen.any():
        return np.empty(0), np.empty(0)
    return speed[given], np.interp(log.time_s[given], log.time_s[seen], rolled[seen])


def correlation(error: np.ndarray, limit: float) -> float:
    """Of each error (N,) with the next, in [0, 0.9], among those below the limit."""
    near = np.abs(error[1:]) < limit
    a, b = error[1:][near], error[:-1][near]
    power = float(a @ a)
    return float(np.clip(a @ b / power, 0.0, 0.9)) if power > 0 else 0.0


def usual_step_s(log: DriveLog) -> float:
    """Median time between samples [s]; 0 with one sample."""
    return float(np.median(np.diff(log.time_s))) if len(log) > 1 else 0.0


def notes_of(noise: ObserverNoise, log: DriveLog) -> tuple[Note, ...]:
    """What the observer takes its sensors to be."""
    stds = {
        "encoders": (noise.encoder_std_rad_s, "rad/s"),
        "encoders of passive wheels": (noise.passive_std_rad_s, "rad/s"),
        "gyro": (noise.gyro_std_rad_s, "rad/s"),
        "speed from outside": (noise.speed_std_m_s, "m/s"),
        "pitch": (noise.pitch_std_rad, "rad"),
        "accelerometer": (noise.accelerometer_std_m_s2, "m/s2"),
    }
    used = ", ".join(f"{name} {std:.2g} {unit}" for name, (std, unit) in stds.items() if std is not None)
    notes = [Note(f"standard deviations taken from the log: {used}")]
    if "acceleration_m_s2" in log.channels and noise.accelerometer_std_m_s2 is None:
        notes.append(
            Note("the accelerometer is not used: it needs a pitch, and the motor currents tell the same force")
        )
    if not np.isfinite(log.motor_current_A).any():
        text = "no motor currents: any torque up to the grip of the wheels counts as possible, so bands are wide"
        notes.append(Note(text, "warning"))
    return tuple(notes)
