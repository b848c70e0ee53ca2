"""Slip of a robot on floors that it has learnt, or never met, from encoders and motor currents alone.

The filter (`wheel_filter`) gives the motion of the rims and the force of each wheel; the forces say what floor is under
which wheel (`recognition`); the floor says how much a wheel creeps under its force (`floor`). The slip of a floor is
believed as far as the floor is: over several floors as a mixture, and wide on one that was never met.

    lambda_i = sum over floors p_i lambda_i(F_i / N_i),    v = w - G_d^+ (lambda |w|)

All of it is one recursive step that looks at nothing to come: a robot runs it live (`live`), a log is a scan of it. The
acceleration of the body, which the forces carry besides the drag, is that of the rims, filtered.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel, exp, maximum, sqrt, where
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.clean_sample import EncoderWatch, sanitize, watch_from
from ohmward.traction.terrain.crossing import Crossing, CrossingState, CrossingTest, crossing_test
from ohmward.traction.terrain.demand import (
    drag_share,
    inertial_forces,
    mean_load,
    static_loads,
    travel_speed,
    undetermined_force_std,
)
from ohmward.traction.terrain.estimate import FloorEstimate, FloorFlag
from ohmward.traction.terrain.floor import Floor
from ohmward.traction.terrain.recognition import Recognition
from ohmward.traction.terrain.slip_curves import SlipCurves
from ohmward.traction.terrain.wheel_filter import WheelBelief, WheelFilter, WheelSample, WheelState

#: Slower than this [m/s] no slip ratio is given, and no floor is recognised; nor where the motion of the rims is known
#: to no better than this share of it.
SLOWEST_M_S, UNSURE_SHARE = 0.02, 0.5
#: Time constant [s] of each of two filters that the rims' acceleration is taken from.
RATE_S = 0.075
_TINY = 1e-6


class FloorState(NamedTuple):
    """All that is carried from sample to sample: plain numbers.

    wheels: of the filter.
    slow_rim: (2, freedoms) motion of the rims, `RATE_S` late and twice as late.
    combinations: (C,) probability of each combination of floors.
    crossing: of the test.
    encoders: as watched.
    """

    wheels: WheelState
    slow_rim: np.ndarray
    combinations: np.ndarray
    crossing: CrossingState
    encoders: EncoderWatch


class FloorRun(Run[FloorEstimate]):
    """Slip and floors along a log of T samples: every field of `FloorEstimate` with time in front."""

    flag_type = FloorFlag

    @property
    def crossings(self) -> list[Crossing]:
        """Changes to another floor under a wheel."""
        e = self.estimates
        rows = np.flatnonzero(e.crossing)
        return [Crossing(float(self.time_s[k]), float(e.drag_before[k]), float(e.drag_after[k])) for k in rows]


@dataclass(frozen=True, eq=False)
class SlipOnFloors:
    """Settings: a filter of the wheels, and the floors that the robot may meet; `init` and `step` are pure.

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

    def no_sample(self) -> WheelSample:
        """A sample without any measurement, to be filled with `_replace`."""
        nothing = np.full(self.wheels.robot.driven, math.nan)
        return WheelSample(0.0, nothing, nothing)

    def init(self, first: WheelSample) -> FloorState:
        """State before the first sample, which it looks at: rims that turn as the encoders say."""
        robot = self.wheels.robot
        watch = watch_from(robot.driven)
        state = self.wheels.init(sanitize(first, watch).sample)
        rim = state.belief.mean[: robot.freedoms]
        return FloorState(state, np.array([rim, rim]), self.recognition.init(), self.crossing.init(robot), watch)

    def step(self, state: FloorState, sample: WheelSample) -> tuple[FloorState, FloorEstimate]:
        """The state after a sample, and what is known then."""
        robot = self.wheels.robot
        safe, watch, flags = sanitize(sample, state.encoders)
        wheels, belief = self.wheels.step(state.wheels, safe)
        belief = with_friction(robot, belief)
        slow_rim, rate = followed(state.slow_rim, belief.rim, safe.dt_s)
        moving = knows_motion(belief)
        likelihood = self.recognition.log_likelihood(belief.rim, rate, belief.force_N, belief.force_std_N)
        combinations = self.recognition.step(state.combinations, where(moving, likelihood, 0.0), safe.dt_s)
        force_N = belief.force_N - inertial_forces(robot, rate)
        seen = self.crossing.sample(robot, belief.rim, force_N, moving, safe.dt_s)
        crossing, found = self.crossing.step(state.crossing, seen)
        estimate = self.conclude(belief, self.recognition.by_wheel(combinations), moving)._replace(
            crossing=where(found.alarm, 1.0, 0.0),
            drag_before=drag_share(robot, belief.rim, state.crossing.mean * mean_load(robot)),
            drag_after=drag_share(robot, belief.rim, force_N),
            crossing_delay_s=found.delay_s,
            flags=flags + where(moving, 0.0, float(FloorFlag.MOTION_UNKNOWN)),
        )
        return FloorState(wheels, slow_rim, combinations, crossing, watch), estimate

    @cached_property
    def kernel(self) -> Kernel:
        """The step, compiled."""
        return self.compiled()

    def compiled(self, lowering: str | None = None) -> Kernel:
        """The step, compiled; `lowering` as in `ohmward.trace.Kernel`."""
        sample = self.no_sample()
        return Kernel(self.step, self.init(sample), sample, lowering=lowering)

    def run(self, log: DriveLog) -> FloorRun:
        """Slip and floors along a log.

        Raises:
            InputError: a driven wheel without encoder or motor current.
        """
        began = time.perf_counter()
        samples = wheel_samples(log, self.wheels.robot.driven)
        _, estimates = self.kernel.scan(self.init(first_of(samples)), samples)
        return FloorRun(log.time_s, estimates, time.perf_counter() - began)

    def conclude(self, belief: WheelBelief, probability: np.ndarray, moving: Any) -> FloorEstimate:
        """Slip and speed from forces and floors (wheels, floors)."""
        robot = self.wheels.robot
        load_N = static_loads(robot)[: robot.driven]
        slip, cov = self.mixture(belief.force_N / load_N, belief.force_std_N / load_N, probability)
        travel, back = travel_speed(belief.rim), np.linalg.pinv(robot.rolling[: robot.driven])
        lost = back @ slip
        motion = belief.rim - travel * lost
        speed = travel_speed(motion)
        along = motion[:-1] / maximum(speed, _TINY) @ back[:-1]
        turned = (lost[:-1] @ lost[:-1]) * travel_variance(belief) / maximum(travel * travel, _TINY)
        share_std = sqrt(maximum(along @ cov @ along + turned, 0.0))
        spread = [sqrt(travel**2 * (row @ cov @ row) + std**2) for row, std in zip(back, belief.rim_std, strict=True)]
        return FloorEstimate(
            rim=belief.rim,
            motion=motion,
            motion_std=np.array(spread),
            speed_m_s=speed,
            speed_std_m_s=sqrt(travel**2 * share_std**2 + travel_variance(belief)),
            travel_slip=where(moving, 1.0 - speed / maximum(travel, SLOWEST_M_S), math.nan),
            travel_slip_std=where(moving, share_std, math.nan),
            slip_ratio=where(moving, slip, math.nan),
            slip_ratio_std=where(moving, sqrt(np.diag(cov)), math.nan),
            force_N=belief.force_N,
            floor_probability=probability,
            crossing=0.0,
            drag_before=0.0,
            drag_after=0.0,
            crossing_delay_s=np.zeros(len(robot.places)),
            flags=0.0,
        )

    def mixture(
        self, share: np.ndarray, share_std: np.ndarray, probability: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean (driven,) and covariance (driven, driven) of the slip over the floors."""
        p = probability[: len(share)].T
        beliefs = [curves.belief(share, share_std) for curves in self.curves]
        mean = sum(q * b.mean for q, b in zip(p, beliefs, strict=True))
        together = sum(np.outer(q, q) * b.cov for q, b in zip(p, beliefs, strict=True))
        own = sum(q * (np.diag(b.cov) + (b.mean - mean) ** 2) for q, b in zip(p, beliefs, strict=True))
        return mean, np.where(np.eye(len(share), dtype=bool), np.diag(own), together)

    @cached_property
    def curves(self) -> tuple[SlipCurves, ...]:
        """Of each floor, the one that was never met last."""
        return tuple(SlipCurves(floor) for floor in self.recognition.all_floors)


def slip_on_floors(robot: Robot, floors: Sequence[Floor] = (), method: str = "ukf") -> SlipOnFloors:
    """The estimator of a calibrated robot that has learnt these floors; `method` as in `wheel_filter.METHODS`."""
    return SlipOnFloors(Recognition(robot, tuple(floors)), WheelFilter(robot, method), crossing_test(floors))


def with_friction(robot: Robot, belief: WheelBelief) -> WheelBelief:
    """The belief with what the friction of standing motors leaves open."""
    turning = robot.rolling[: robot.driven] @ belief.rim / robot.wheel.radius_m
    open_N = undetermined_force_std(robot, turning)
    return belief._replace(force_std_N=sqrt(belief.force_std_N**2 + open_N**2))


def followed(slow_rim: np.ndarray, rim: np.ndarray, dt_s: Any) -> tuple[np.ndarray, np.ndarray]:
    """The rims' motion (2, freedoms) after two filters of the first order, one behind the other, and its rate."""
    share = 1.0 - exp(-dt_s / RATE_S)
    first = slow_rim[0] + share * (rim - slow_rim[0])
    behind = first - slow_rim[1]
    rate = behind * where(dt_s > _TINY, share / maximum(dt_s, _TINY), 1.0 / RATE_S)
    return np.array([first, slow_rim[1] + share * behind]), rate


def knows_motion(belief: WheelBelief) -> Any:
    """Whether the rims turn, and it is known how."""
    travel = travel_speed(belief.rim)
    return (travel >= SLOWEST_M_S) & (travel_variance(belief) <= (UNSURE_SHARE * travel) ** 2)


def travel_variance(belief: WheelBelief) -> Any:
    """Variance [m^2/s^2] of the rims' travel speed, whatever its direction."""
    return belief.rim_std[:-1] @ belief.rim_std[:-1]


def wheel_samples(log: DriveLog, driven: int, before_s: float = math.nan) -> WheelSample:
    """The log as samples (T, ...), its first step counted from `before_s` where that is a time before it.

    Raises:
        InputError: a driven wheel without encoder or motor current.
    """
    speed, current = log.wheel_speed_rad_s[:, :driven], log.motor_current_A
    for name, values in (("encoder", speed), ("motor current", current)):
        if values.shape[1] != driven or not np.isfinite(values).any(axis=0).all():
            raise InputError(f"log {log.name!r}: slip on floors needs the {name} of every driven wheel; one has none")
    start_s = log.time_s[0] if not before_s < log.time_s[0] else before_s
    return WheelSample(np.diff(log.time_s, prepend=start_s), speed, current)


def first_of(samples: WheelSample) -> WheelSample:
    """The first of the samples (T, ...)."""
    return WheelSample(0.0, samples.wheel_speed_rad_s[0], samples.current_A[0])
