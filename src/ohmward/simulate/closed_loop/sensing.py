"""What the robot measures of itself: settings of its sensors, and the samples that arrive from them.

Encoders, currents, gyro, accelerometer and pitch come from one board (`robot_sensors`); an external speed (GNSS, visual
or lidar odometry) has its own rate, delay and losses, and rides along with the next sample of the board.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.simulate.robot_sensors import (
    GYRO,
    MOTOR_CURRENT,
    PITCH,
    Board,
    RobotSensors,
    SensorFrame,
    sample,
    wheel_speed,
)
from ohmward.simulate.robot_truth import RobotTruth
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipSample

_SAME_TIME_S = 1e-9


@dataclass(frozen=True)
class ExternalSpeed:
    """A speed from outside.

    Attributes:
        interval_s: between measurements; 0 where there is none.
        std_m_s: white noise, > 0.
        delay_s, jitter_s: under way for delay_s plus an even share of jitter_s.
        drop_share: share that never arrives.
    """

    interval_s: float = 0.0
    std_m_s: float = 0.03
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop_share: float = 0.0

    def __post_init__(self) -> None:
        require_positive("sensors.speed.std_m_s", self.std_m_s)
        for name in ("interval_s", "delay_s", "jitter_s"):
            require_between(f"sensors.speed.{name}", getattr(self, name), 0.0, math.inf)
        require_between("sensors.speed.drop_share", self.drop_share, 0.0, 1.0)


@dataclass(frozen=True)
class Sensing:
    """The sensors of a robot.

    Attributes:
        interval_s: between samples of the board, > 0.
        encoders: "driven", "all", or names of wheels.
        counts_per_turn: of each encoder, > 0.
        drive_speed_std_rad_s: noise of the speed that each motor's drive knows of its own wheel, > 0; it is what the
            controller gets.
        current_noise_A: of each motor's current, >= 0.
        gyro: whether there is one.
        pitch: whether an attitude filter gives pitch.
        delay_s, jitter_s, drop_share: of the board's link, as in `RobotSensors`.
        speed: from outside.
    """

    interval_s: float = 0.01
    encoders: str | tuple[str, ...] = "driven"
    counts_per_turn: int = 4096
    drive_speed_std_rad_s: float = 0.02
    current_noise_A: float = 0.1
    gyro: bool = True
    pitch: bool = False
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop_share: float = 0.0
    speed: ExternalSpeed = field(default_factory=ExternalSpeed)

    def __post_init__(self) -> None:
        for name in ("interval_s", "counts_per_turn", "drive_speed_std_rad_s"):
            require_positive(f"sensors.{name}", getattr(self, name))
        for name in ("current_noise_A", "delay_s", "jitter_s"):
            require_between(f"sensors.{name}", getattr(self, name), 0.0, math.inf)
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
        )


class Arrival(NamedTuple):
    """A sample that has arrived, and when it was taken [s]."""

    taken_s: float
    sample: SlipSample


class Late(NamedTuple):
    """An external speed: when it was true and when it arrives [s], and what it says [m/s]."""

    time_s: float
    arrival_s: float
    speed_m_s: float


class SensorSuite:
    """The sensors at work on one drive.

    Args:
        sensing: settings.
        robot: that carries them.
        rng: draws noise, delays and losses.
    """

    def __init__(self, sensing: Sensing, robot: Robot, rng: np.random.Generator) -> None:
        self.sensing, self.robot, self._rng = sensing, robot, rng
        self._settings = sensing.board(robot)
        self._board = Board()
        self._before: SensorFrame | None = None
        self._next_speed_s, self._speeds = 0.0, tuple[Late, ...]()
        self._torque_Nm, self._steps = np.zeros(len(robot.places)), 0
        self.sampled = False

    def drive_speeds(self, truth: RobotTruth) -> np.ndarray:
        """(driven,) [rad/s] what the drives know of their wheels now."""
        n = self.robot.driven
        return truth.wheel_speed_rad_s[:n] + self.sensing.drive_speed_std_rad_s * self._rng.standard_normal(n)

    def see(self, truth: RobotTruth) -> list[Arrival]:
        """Sample what is due; what arrives now, in order. What arrives after something newer is left out.

        A motor's current is its mean since the sample before. `sampled` says whether a sample was taken.
        """
        self._see_speed(truth)
        self._torque_Nm, self._steps = self._torque_Nm + truth.torque_N_m, self._steps + 1
        mean = truth._replace(torque_N_m=self._torque_Nm / self._steps)
        due_s = self._board.next_s
        self._board, arrived = sample(self._board, mean, self._settings, self._rng)
        self.sampled = self._board.next_s != due_s
        if self.sampled:
            self._torque_Nm, self._steps = np.zeros_like(self._torque_Nm), 0
        used = []
        for reading in sorted(arrived, key=lambda r: r.time_s):
            if self._before is None or reading.time_s > self._before.time_s + _SAME_TIME_S:
                used.append(Arrival(reading.time_s, self._sample(reading)))
                self._before = reading
        return used

    def _see_speed(self, truth: RobotTruth) -> None:
        speed = self.sensing.speed
        if speed.interval_s and truth.time_s + _SAME_TIME_S >= self._next_speed_s:
            self._next_speed_s += speed.interval_s
            shown = truth.speed_m_s + speed.std_m_s * self._rng.standard_normal()
            arrival_s = truth.time_s + speed.delay_s + speed.jitter_s * self._rng.random()
            if self._rng.random() >= speed.drop_share:
                self._speeds = (*self._speeds, Late(truth.time_s, arrival_s, shown))

    def _sample(self, reading: SensorFrame) -> SlipSample:
        """The reading as an observer takes it, with the newest speed that has arrived."""
        before, late = self._before, self._newest_speed(reading)
        return SlipSample(
            reading.time_s - before.time_s if before else 0.0,
            self._wheel_speeds(reading),
            reading.motor_current_A,
            float(reading.gyro_rad_s[2]) if self.sensing.gyro else math.nan,
            float(reading.specific_force_m_s2[0]),
            reading.pitch_rad,
            late.speed_m_s if late else math.nan,
            self.sensing.speed.std_m_s if late else math.nan,
            reading.time_s - late.time_s if late else 0.0,
        )

    def _wheel_speeds(self, reading: SensorFrame) -> np.ndarray:
        """(wheels,) [rad/s] since the reading before; without one, 0 at the start, where the robot stands."""
        speeds = np.full(len(self.robot.places), math.nan)
        wheels = list(self._settings.encoder_wheels)
        if self._before is not None:
            speeds[wheels] = wheel_speed(self._before, reading, self._settings)
        elif reading.time_s == 0.0:
            speeds[wheels] = 0.0
        return speeds

    def _newest_speed(self, reading: SensorFrame) -> Late | None:
        here = [
            s for s in self._speeds if s.arrival_s <= reading.arrival_s + _SAME_TIME_S and s.time_s <= reading.time_s
        ]
        self._speeds = tuple(s for s in self._speeds if s not in here)
        return max(here, default=None)
