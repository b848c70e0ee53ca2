"""Slip of a robot on floors that it has learnt, or never met, from encoders and motor currents alone.

The filter (`wheel_filter`) gives the motion of the rims and the force of each wheel; the forces say what floor is under
which wheel (`recognition`); the floor says how much a wheel creeps under its force (`floor`). The slip of a floor is
believed as far as the floor is: over several floors as a mixture, and wide on one that was never met.

    lambda_i = sum over floors p_i lambda_i(F_i / N_i),    v = w - G_d^+ (lambda |w|)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel
from ohmward.traction.floors.crossing import Crossing, CrossingTest, crossing_test
from ohmward.traction.floors.demand import inertial_forces, static_loads, undetermined_force_std
from ohmward.traction.floors.floor import Floor, slip_belief
from ohmward.traction.floors.recognition import Recognition
from ohmward.traction.floors.wheel_filter import WheelBelief, WheelFilter, WheelSample
from ohmward.traction.robot import Robot

#: Slower than this [m/s] no slip ratio is given, and no floor is recognised.
SLOWEST_M_S = 0.02
#: Time over which the rims' acceleration is taken [s].
_RATE_S = 0.3


class SlipTrack(NamedTuple):
    """What is known along a log of T samples.

    time_s: (T,).
    rim: (T, freedoms) motion that the wheels make, as if none slipped.
    motion, motion_std: (T, freedoms) of the body.
    speed_m_s, speed_std_m_s: (T,) over ground.
    travel_slip, travel_slip_std: (T,) share of the rims' travel speed that is lost; nan while the wheels hardly turn.
    slip_ratio, slip_ratio_std: (T, driven) of each wheel, slip speed over the rims' travel speed.
    force_N: (T, driven) of the ground.
    floor_probability: (T, wheels, floors), floors as in `Recognition.names`.
    crossings: wheels that came to another floor.
    """

    time_s: np.ndarray
    rim: np.ndarray
    motion: np.ndarray
    motion_std: np.ndarray
    speed_m_s: np.ndarray
    speed_std_m_s: np.ndarray
    travel_slip: np.ndarray
    travel_slip_std: np.ndarray
    slip_ratio: np.ndarray
    slip_ratio_std: np.ndarray
    force_N: np.ndarray
    floor_probability: np.ndarray
    crossings: list[Crossing]


@dataclass(frozen=True, eq=False)
class SlipOnFloors:
    """The estimator: a filter of the wheels, and the floors that the robot may meet.

    Attributes:
        recognition: robot and floors.
        wheels: the filter; its robot must be the same.
        crossing: the test for other floors.
    """

    recognition: Recognition
    wheels: WheelFilter
    crossing: CrossingTest

    def __post_init__(self) -> None:
        if self.wheels.robot != self.recognition.robot:
            raise InputError("wheels.robot and recognition.robot must be the same robot")

    @cached_property
    def kernel(self) -> Kernel:
        """The filter's step, compiled."""
        n = self.wheels.robot.driven
        sample = WheelSample(0.0, np.zeros(n), np.zeros(n))
        return Kernel(self.wheels.step, self.wheels.init(sample), sample)

    def run(self, log: DriveLog) -> SlipTrack:
        """Slip and floors along a log.

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        samples = wheel_samples(log, self.wheels.robot.driven)
        first = WheelSample(0.0, samples.wheel_speed_rad_s[0], samples.current_A[0])
        _, belief = self.kernel.scan(self.wheels.init(first), samples)
        belief = self.with_friction(belief)
        rate = _rate(samples.dt_s, belief.rim)
        crossings = self.crossings(log.time_s, rate, belief)
        return self.conclude(log.time_s, belief, self.recognise(samples.dt_s, rate, belief), crossings)

    def with_friction(self, belief: WheelBelief) -> WheelBelief:
        """The belief (T, ...) with what the friction of standing motors leaves open."""
        robot = self.wheels.robot
        turning = belief.rim @ robot.rolling[: robot.driven].T / robot.wheel.radius_m
        std = np.hypot(belief.force_std_N, undetermined_force_std(robot, turning))
        return belief._replace(force_std_N=std)

    def crossings(self, time_s: np.ndarray, rate: np.ndarray, belief: WheelBelief) -> list[Crossing]:
        """When wheels came to other floors; without what the acceleration (T, freedoms) of the body takes."""
        robot = self.wheels.robot
        force = belief.force_N - inertial_forces(robot, rate)
        return self.crossing.run(robot, time_s, belief.rim, force, _travel(belief.rim) >= SLOWEST_M_S)

    def recognise(self, dt_s: np.ndarray, rate: np.ndarray, belief: WheelBelief) -> np.ndarray:
        """Probability (T, wheels, floors) of the floors; where the wheels hardly turn nothing is learnt."""
        r = self.recognition
        likelihood = r.log_likelihood(belief.rim, rate, belief.force_N, belief.force_std_N)
        likelihood[_travel(belief.rim) < SLOWEST_M_S] = 0.0
        found, now = np.empty((len(dt_s), len(r.combinations))), r.init()
        for k, (row, dt) in enumerate(zip(likelihood, dt_s, strict=True)):
            now = found[k] = r.step(now, row, float(dt))
        return r.by_wheel(found)

    def conclude(
        self, time_s: np.ndarray, belief: WheelBelief, probability: np.ndarray, crossings: list[Crossing]
    ) -> SlipTrack:
        """Slip and speed from forces and floors."""
        robot = self.recognition.robot
        load_N = static_loads(robot)[: robot.driven]
        slip, cov = self._mixture(belief.force_N / load_N, belief.force_std_N / load_N, probability)
        travel = _travel(belief.rim)
        back = np.linalg.pinv(robot.rolling[: robot.driven])
        motion = belief.rim - travel[:, None] * slip @ back.T
        speed = _travel(motion)
        along = np.einsum("tf,fd->td", motion[:, :-1] / np.maximum(speed, 1e-6)[:, None], back[:-1])
        spread = travel[:, None] * np.sqrt(np.einsum("fi,tij,fj->tf", back, cov, back))
        share_std = np.sqrt(np.einsum("ti,tij,tj->t", along, cov, along))
        moving = travel >= SLOWEST_M_S
        with np.errstate(divide="ignore", invalid="ignore"):
            lost = np.where(moving, 1 - speed / travel, np.nan)
        return SlipTrack(
            time_s,
            belief.rim,
            motion,
            spread,
            speed,
            travel * share_std,
            lost,
            np.where(moving, share_std, np.nan),
            np.where(moving[:, None], slip, np.nan),
            np.where(moving[:, None], np.sqrt(np.diagonal(cov, axis1=1, axis2=2)), np.nan),
            belief.force_N,
            probability,
            crossings,
        )

    def _mixture(
        self, share: np.ndarray, share_std: np.ndarray, probability: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean (T, driven) and covariance (T, driven, driven) of the slip over the floors."""
        p = probability[:, : share.shape[1]]
        beliefs = [slip_belief(f, share, share_std) for f in self.recognition.all_floors]
        mean = sum(p[..., k] * b.mean for k, b in enumerate(beliefs))
        cov = np.zeros((*share.shape, share.shape[1]))
        for k, b in enumerate(beliefs):
            off = b.mean - mean
            own = p[..., k] * (np.diagonal(b.cov, axis1=1, axis2=2) + off**2)
            together = p[:, :, None, k] * p[:, None, :, k] * b.cov
            cov += np.where(np.eye(share.shape[1], dtype=bool), own[..., None], together)
        return mean, cov


def slip_on_floors(robot: Robot, floors: Sequence[Floor] = (), method: str = "ukf") -> SlipOnFloors:
    """The estimator of a calibrated robot that has learnt these floors; `method` as in `wheel_filter.METHODS`."""
    return SlipOnFloors(Recognition(robot, floors), WheelFilter(robot, method), crossing_test(floors))


def wheel_samples(log: DriveLog, driven: int) -> WheelSample:
    """The log's samples; a number that is missing keeps its last value.

    Raises:
        InputError: a wheel that never has one.
    """
    speed, current = _held(log.wheel_speed_rad_s[:, :driven]), _held(log.motor_current_A)
    for name, values in (("encoder", speed), ("motor current", current)):
        if not np.isfinite(values).all():
            raise InputError(f"log {log.name!r}: slip on floors needs the {name} of every driven wheel; one has none")
    return WheelSample(np.diff(log.time_s, prepend=log.time_s[0]), speed, current)


def _held(values: np.ndarray) -> np.ndarray:
    """Columns (T, n) with the last known value where there is none, the first known one before it."""
    known = np.isfinite(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values))[:, None], -1), axis=0)
    first = known.argmax(axis=0)
    return np.take_along_axis(values, np.where(last < 0, first, last), axis=0)


def _rate(dt_s: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Acceleration (T, freedoms) over the last 0.3 s."""
    t = np.cumsum(dt_s)
    before = np.searchsorted(t, t - _RATE_S)
    return (rim - rim[before]) / np.maximum(t - t[before], _RATE_S)[:, None]


def _travel(motion: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(motion[..., :-1] ** 2, axis=-1))
