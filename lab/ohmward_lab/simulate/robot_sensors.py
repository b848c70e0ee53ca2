"""Sensors of a robot's wheels and body: one board that samples all at once, and a link with delay and losses.

`sample_board` is called with the truth at any rate and returns the frames that have arrived by then. Sensors with
another rate need another board.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.robot.packaged import RLMA
from ohmward_lab.simulate.sensors import Sensor

T = TypeVar("T")

#: The order of the wheels of a robot on two axles; other robots have that of `Robot.places`, driven wheels first.
WHEELS = ("front left", "front right", "rear left", "rear right")


class RobotTruth(NamedTuple):
    """One instant; wheels in the order of the robot. Stacked over time every field gets (T,) in front."""

    time_s: Any  #: since the reset [s]
    #: (3,) of the robot's centre at axle height, in the world: x uphill, y to the left, z off the ground [m]
    position_m: Any
    heading_rad: Any  #: 0 along x, > 0 to the left
    #: of the centre, forward and to the left
    speed_m_s: Any
    lateral_speed_m_s: Any
    yaw_rate_rad_s: Any  #: > 0 to the left
    #: (wheels,), > 0 forward
    wheel_angle_rad: Any
    wheel_speed_rad_s: Any
    torque_N_m: Any  #: (wheels,) of the motors on the wheels
    wheel_centre_speed_m_s: Any  #: (wheels,) forward speed of the wheel's centre, v_f
    slip_speed_m_s: Any  #: (wheels,) s = r omega - v_f
    slip_ratio: Any  #: (wheels,) s / max(|r omega|, |v_f|), NaN below the floor of `traction.slip`
    #: (wheels,) force of the ground on the wheel, forward, to the left, up
    traction_N: Any
    lateral_N: Any
    normal_N: Any
    friction: Any  #: (wheels,) adhesion under the wheel
    grade_rad: Any  #: slope of the ground, > 0 where x leads uphill
    gyro_rad_s: Any  #: (3,) angular velocity about forward, left, up
    specific_force_m_s2: Any  #: (3,) of an ideal accelerometer, forward, left, up; 9.81 up at rest on level ground


def stack(records: Sequence[T]) -> T:
    """Records of one structure as one, with time (T,) in front of every number; a field that is None stays so."""
    first: Any = records[0]
    if isinstance(first, tuple):
        fields: Any = zip(*cast(Any, records), strict=True)
        return cast(T, type(first)(*map(stack, fields)))
    return cast(T, first if first is None else np.array(records, dtype=float))


def driven_torques(torque_N_m: Any, driven: tuple[int, ...]) -> np.ndarray:
    """Torques (driven,) [N m] from a number or one for each driven wheel; driven: numbers of these wheels.

    Raises:
        InputError: a wrong number of torques, or a number that is not finite.
    """
    given = np.asarray(torque_N_m, dtype=float)
    if given.shape not in ((), (len(driven),)):
        raise InputError(f"torque_N_m must be a number or one for each driven wheel {driven}, got {given.shape}")
    if not np.isfinite(given).all():
        raise InputError(f"torque_N_m must be finite, got {given.tolist()}")
    return np.broadcast_to(given, len(driven))


_SAME_TIME_S = 1e-9

MOTOR_CURRENT = Sensor(low=-60.0, high=60.0, resolution=0.03, noise_std=0.1)
GYRO = Sensor(low=-8.7, high=8.7, resolution=2.7e-4, noise_std=2e-3, offset=2e-3)
ACCELEROMETER = Sensor(low=-39.2, high=39.2, resolution=1.2e-3, noise_std=0.02, offset=0.05)
#: Pitch of an attitude filter: 0.1 degree of noise and 0.15 of offset.
PITCH = Sensor(low=-1.6, high=1.6, resolution=1e-4, noise_std=0.0017, offset=0.0026)
#: Heading of a compass: resolution of 0.1 degree, 3 degrees of noise and as much offset.
COMPASS = Sensor(low=-np.pi, high=np.pi, resolution=0.0017, noise_std=0.05, offset=0.05)


@dataclass(frozen=True)
class RobotSensors:
    """One board: encoders, motor currents, gyro and accelerometer (MEMS class), and its link; see `Sensing`."""

    interval_s: float = 0.01  #: between samples
    #: a frame takes delay_s plus a uniform random part of jitter_s to arrive, and may be overtaken
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop_share: float = 0.0  #: share of the frames that never arrive
    #: wheels with an encoder, in the order of the truth; encoders of driven wheels only are (0, 1)
    encoder_wheels: tuple[int, ...] = (0, 1, 2, 3)
    counts_per_turn: int = 4096  #: of each encoder
    motor_wheels: tuple[int, ...] = (0, 1)  #: wheels with a motor whose current is measured
    #: torque at the wheel over motor current (K_m times gear ratio and efficiency)
    torque_constant_N_m_per_A: float = RLMA.motor.torque_constant_Nm_per_A
    #: their errors [A, rad/s, m/s^2], drawn separately for each wheel and axis
    motor_current: Sensor = MOTOR_CURRENT
    gyro: Sensor = GYRO
    accelerometer: Sensor = ACCELEROMETER
    pitch: Sensor | None = None  #: error of an attitude filter [rad]; None where there is none
    compass: Sensor | None = None  #: error of a compass [rad]; None where there is none


class SensorFrame(NamedTuple):
    """Measurements of the board at one instant."""

    #: times [s] at which it was taken, and at which it arrives
    time_s: float
    arrival_s: float
    encoder_count: np.ndarray  #: one for each of `encoder_wheels`, counted from the reset, whole numbers
    motor_current_A: np.ndarray  #: one for each of `motor_wheels`, > 0 drives forward
    #: (3,) forward, left, up
    gyro_rad_s: np.ndarray
    specific_force_m_s2: np.ndarray
    pitch_rad: float = math.nan  #: > 0 with the nose up; nan without an attitude filter
    heading_rad: float = math.nan  #: of a compass, > 0 to the left, within half a turn of zero; nan without one


class Board(NamedTuple):
    """Time [s] at which the next frame is due, and the frames that are still under way."""

    next_s: float = 0.0
    under_way: tuple[SensorFrame, ...] = ()


def sample_board(
    board: Board, truth: RobotTruth, sensors: RobotSensors, rng: np.random.Generator
) -> tuple[Board, tuple[SensorFrame, ...]]:
    """Take a frame of `truth` if one is due; return the board after it and the frames that have arrived by now.

    Call it at least every `interval_s`; a late call delays the frame that is due.
    """
    now = truth.time_s + _SAME_TIME_S
    under_way = board.under_way
    if now >= board.next_s:
        frame = measure(truth, sensors, rng)
        dropped = rng.random() < sensors.drop_share
        under_way = under_way if dropped else (*under_way, frame)
        board = board._replace(next_s=max(board.next_s + sensors.interval_s, now))
    arrived = sorted((frame for frame in under_way if frame.arrival_s <= now), key=lambda frame: frame.arrival_s)
    waiting = tuple(frame for frame in under_way if frame.arrival_s > now)
    return board._replace(under_way=waiting), tuple(arrived)


def record(truth: RobotTruth, sensors: RobotSensors, rng: np.random.Generator) -> list[SensorFrame]:
    """Frames of a whole drive that arrive before its end, in the order of arrival; truth: stacked over time."""
    board = Board(float(truth.time_s[0]))
    frames: list[SensorFrame] = []
    for instant in zip(*truth, strict=True):
        board, arrived = sample_board(board, RobotTruth(*instant), sensors, rng)
        frames.extend(arrived)
    return frames


def measure(truth: RobotTruth, sensors: RobotSensors, rng: np.random.Generator) -> SensorFrame:
    """Frame of the board at this instant."""

    def measured(sensor: Sensor, true: np.ndarray) -> np.ndarray:
        return sensor.measure(true, np.full(true.size, truth.time_s), rng)

    def angle(sensor: Sensor | None, true: float) -> float:
        return math.nan if sensor is None else float(measured(sensor, np.array([true]))[0])

    current_A = truth.torque_N_m[list(sensors.motor_wheels)] / sensors.torque_constant_N_m_per_A
    turns = truth.wheel_angle_rad[list(sensors.encoder_wheels)] / (2 * np.pi)
    return SensorFrame(
        time_s=float(truth.time_s),
        arrival_s=float(truth.time_s + sensors.delay_s + sensors.jitter_s * rng.random()),
        encoder_count=np.floor(turns * sensors.counts_per_turn).astype(int),
        motor_current_A=measured(sensors.motor_current, current_A),
        gyro_rad_s=measured(sensors.gyro, truth.gyro_rad_s),
        specific_force_m_s2=measured(sensors.accelerometer, truth.specific_force_m_s2),
        pitch_rad=angle(sensors.pitch, math.asin(math.sin(truth.grade_rad) * math.cos(truth.heading_rad))),
        heading_rad=angle(sensors.compass, math.remainder(truth.heading_rad, 2 * math.pi)),
    )


def wheel_speed(before: SensorFrame, after: SensorFrame, sensors: RobotSensors) -> np.ndarray:
    """Mean speed of the encoder wheels between two frames [rad/s], to within a count.

    Raises:
        InputError: `after` was not taken after `before`.
    """
    if not after.time_s > before.time_s:
        raise InputError(f"after must be taken later than before, got {after.time_s:g} s and {before.time_s:g} s")
    counts = after.encoder_count - before.encoder_count
    return 2 * np.pi / sensors.counts_per_turn * counts / (after.time_s - before.time_s)
