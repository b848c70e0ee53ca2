"""Sensors of the robot: their settings, and the samples that arrive from them.

Encoders, currents, gyro, accelerometer and pitch come from one board (`robot_sensors`); an external speed (GNSS, visual
or lidar odometry) has its own rate, delay and losses, and arrives with the next sample of the board.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_not_negative, require_each_positive, require_positive
from ohmward.errors import InputError
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.robot import Robot
from ohmward_lab.simulate.robot_sensors import (
    COMPASS,
    GYRO,
    MOTOR_CURRENT,
    PITCH,
    Board,
    RobotSensors,
    RobotTruth,
    SensorFrame,
    sample_board,
    wheel_speed,
)

_SAME_TIME_S = 1e-9


@dataclass(frozen=True)
class ExternalSpeed:
    """External measurement of speed."""

    interval_s: float = 0.0  #: between measurements; 0 where there is none
    std_m_s: float = 0.03  #: white noise, > 0
    #: it takes delay_s plus a uniform random part of jitter_s to arrive
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop_share: float = 0.0  #: share that never arrives

    def __post_init__(self) -> None:
        require_positive("sensors.speed.std_m_s", self.std_m_s)
        require_each_not_negative("sensors.speed.", self, "interval_s", "delay_s", "jitter_s")
        require_between("sensors.speed.drop_share", self.drop_share, 0.0, 1.0)


@dataclass(frozen=True)
class Sensing:
    """The sensors of a robot."""

    interval_s: float = 0.01  #: between samples of the board, > 0
    encoders: str | tuple[str, ...] = "driven"  #: "driven", "all", or names of wheels
    counts_per_turn: int = 4096  #: of each encoder, > 0
    #: share of each encoder's speeds that a glitch changes, and by how much
    encoder_spike_share: float = 0.0
    encoder_spike_rad_s: float = 20.0
    #: noise of the wheel speed that each motor's drive gives to the controller, > 0
    drive_speed_std_rad_s: float = 0.02
    current_noise_A: float = 0.1  #: of each motor's current, >= 0
    gyro: bool = True  #: True with a gyro
    pitch: bool = False  #: True with an attitude filter that gives pitch
    compass: bool = False  #: True with a compass, whose heading goes into the log; the observer does not use it
    #: of the board's link, as in `RobotSensors`
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop_share: float = 0.0
    speed: ExternalSpeed = field(default_factory=ExternalSpeed)  #: external speed

    def __post_init__(self) -> None:
        require_each_positive("sensors.", self, "interval_s", "counts_per_turn", "drive_speed_std_rad_s")
        require_each_not_negative("sensors.", self, "current_noise_A", "delay_s", "jitter_s", "encoder_spike_rad_s")
        require_between("sensors.encoder_spike_share", self.encoder_spike_share, 0.0, 1.0)
        require_between("sensors.drop_share", self.drop_share, 0.0, 1.0)

    def encoder_wheels(self, robot: Robot) -> tuple[int, ...]:
        """Numbers of the wheels with an encoder.

        Raises:
            InputError: a wheel that the robot does not have.
        """
        names = [p.name for p in robot.places]
        if self.encoders == "driven":
            return tuple(range(robot.driven))
        chosen = tuple(names) if self.encoders == "all" else self.encoders
        if isinstance(chosen, str) or set(chosen) - set(names):
            raise InputError(
                f'sensors.encoders must be "driven", "all" or a list out of {", ".join(names)}; got {self.encoders!r}'
            )
        return tuple(names.index(name) for name in chosen)

    def board(self, robot: Robot) -> RobotSensors:
        """The board on this robot."""
        return RobotSensors(
            interval_s=self.interval_s,
            delay_s=self.delay_s,
            jitter_s=self.jitter_s,
            drop_share=self.drop_share,
            encoder_wheels=self.encoder_wheels(robot),
            counts_per_turn=self.counts_per_turn,
            motor_wheels=tuple(range(robot.driven)),
            torque_constant_N_m_per_A=robot.motor.wheel_constant_Nm_per_A,
            motor_current=replace(MOTOR_CURRENT, noise_std=self.current_noise_A),
            gyro=GYRO,
            pitch=PITCH if self.pitch else None,
            compass=COMPASS if self.compass else None,
        )


class ArrivedSample(NamedTuple):
    """A sample that has arrived, the time at which it was taken [s], and the heading of a compass [rad]."""

    taken_s: float
    sample: RobotSample
    heading_rad: float = math.nan


class DelayedSpeed(NamedTuple):
    """Measured external speed [m/s], with the times [s] at which it was taken and at which it arrives."""

    time_s: float
    arrival_s: float
    speed_m_s: float


class SensorSuite:
    """The sensors of one drive.

    Args:
        sensing: settings.
        robot: it carries them.
        rng: draws noise, delays and losses.
        start: truth at the start; without it the robot is at rest.
    """

    def __init__(
        self, sensing: Sensing, robot: Robot, rng: np.random.Generator, start: RobotTruth | None = None
    ) -> None:
        self.sensing, self.robot, self._rng = sensing, robot, rng
        self._settings = sensing.board(robot)
        self._board = Board()
        self._before: SensorFrame | None = None
        self._next_speed_s = 0.0
        self._speeds: tuple[DelayedSpeed, ...] = ()
        self._torque_Nm = np.zeros(len(robot.places))
        self._steps = 0
        self._start_rad_s = np.zeros(len(robot.places)) if start is None else start.wheel_speed_rad_s
        self.sampled = False

    def drive_speeds(self, truth: RobotTruth) -> np.ndarray:
        """(driven,) wheel speeds [rad/s] that the drives measure now."""
        n = self.robot.driven
        return truth.wheel_speed_rad_s[:n] + self.sensing.drive_speed_std_rad_s * self._rng.standard_normal(n)

    def sample(self, truth: RobotTruth) -> list[ArrivedSample]:
        """Sample what is due; return the samples that arrive now, in order, without those older than one already used.

        A motor's current is its mean since the last sample. `sampled` is True where a sample was taken.
        """
        self._sample_speed(truth)
        self._torque_Nm = self._torque_Nm + truth.torque_N_m
        self._steps += 1
        mean = truth._replace(torque_N_m=self._torque_Nm / self._steps)
        due_s = self._board.next_s
        self._board, frames = sample_board(self._board, mean, self._settings, self._rng)
        self.sampled = self._board.next_s != due_s
        if self.sampled:
            self._torque_Nm = np.zeros_like(self._torque_Nm)
            self._steps = 0
        arrivals = []
        for frame in sorted(frames, key=lambda f: f.time_s):
            if self._before is None or frame.time_s > self._before.time_s + _SAME_TIME_S:
                arrivals.append(ArrivedSample(frame.time_s, self._slip_sample(frame), frame.heading_rad))
                self._before = frame
        return arrivals

    def _sample_speed(self, truth: RobotTruth) -> None:
        """Measure the external speed where it is due."""
        speed = self.sensing.speed
        if not speed.interval_s or truth.time_s + _SAME_TIME_S < self._next_speed_s:
            return
        self._next_speed_s += speed.interval_s
        measured_m_s = truth.speed_m_s + speed.std_m_s * self._rng.standard_normal()
        arrival_s = truth.time_s + speed.delay_s + speed.jitter_s * self._rng.random()
        if self._rng.random() >= speed.drop_share:
            self._speeds = (*self._speeds, DelayedSpeed(truth.time_s, arrival_s, measured_m_s))

    def _slip_sample(self, frame: SensorFrame) -> RobotSample:
        """The observer's sample of a frame, with the newest speed that has arrived."""
        before, speed = self._before, self._newest_speed(frame)
        return RobotSample(
            frame.time_s - before.time_s if before else 0.0,
            self._wheel_speeds(frame),
            frame.motor_current_A,
            float(frame.gyro_rad_s[2]) if self.sensing.gyro else math.nan,
            float(frame.specific_force_m_s2[0]),
            frame.pitch_rad,
            speed.speed_m_s if speed else math.nan,
            self.sensing.speed.std_m_s if speed else math.nan,
            frame.time_s - speed.time_s if speed else 0.0,
        )

    def _wheel_speeds(self, frame: SensorFrame) -> np.ndarray:
        """Wheel speeds (wheels,) [rad/s] since the last frame; in the first frame, at 0 s, those of the start."""
        speeds = np.full(len(self.robot.places), math.nan)
        wheels = list(self._settings.encoder_wheels)
        if self._before is not None:
            speeds[wheels] = wheel_speed(self._before, frame, self._settings)
        elif frame.time_s == 0.0:
            speeds[wheels] = self._start_rad_s[wheels]
        return speeds + self._spikes()

    def _spikes(self) -> np.ndarray:
        """Changes (wheels,) [rad/s] of the encoders' speeds by glitches."""
        wheels, share = len(self.robot.places), self.sensing.encoder_spike_share
        if not share:
            return np.zeros(wheels)
        signs = self._rng.choice([-1.0, 1.0], wheels)
        return np.where(self._rng.random(wheels) < share, signs * self.sensing.encoder_spike_rad_s, 0.0)

    def _newest_speed(self, frame: SensorFrame) -> DelayedSpeed | None:
        """The newest external speed that has arrived with this frame; older ones are dropped."""
        arrived = [
            s for s in self._speeds if s.arrival_s <= frame.arrival_s + _SAME_TIME_S and s.time_s <= frame.time_s
        ]
        self._speeds = tuple(s for s in self._speeds if s not in arrived)
        return max(arrived, default=None)


def quantisation_std_rad_s(counts_per_turn: int, dt_s: float) -> float:
    """Standard deviation [rad/s] of a speed from the difference of two counts, `dt_s` apart.

    Each count has a uniform error over one step of 2 pi / counts_per_turn: variance step^2/12 twice.
    """
    require_positive("counts_per_turn", counts_per_turn)
    require_positive("dt_s", dt_s)
    return 2 * math.pi / counts_per_turn / dt_s / math.sqrt(6)
