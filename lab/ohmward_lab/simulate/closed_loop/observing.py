"""The observer of a scenario: its model of robot, ground and noise, and its estimate at every instant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ohmward.checks import require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.control import Measurement
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.law import CoulombCreep, WardIagnemma
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.robot import Robot, free_sideways
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.closed_loop.sensing import ArrivedSample, Sensing, quantisation_std_rad_s
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.robot_sensors import ACCELEROMETER, GYRO, PITCH, RobotTruth
from ohmward_lab.traction.momentum_observer import (
    AngleSample,
    MomentumEstimate,
    MomentumNoise,
    MomentumObserver,
    count_std_rad,
)

METHODS = ("ekf", "aekf", "ukf", "aukf", "momentum", "true")
#: Standard deviation of the speed at the start: the robot is at rest.
_START_STD_M_S = 0.005
#: Number of missing samples after which the momentum observer no longer knows the speed.
_LONGEST_GAPS = 50.0
#: Ripple and friction of a drive that do not show in its current [N m].
_TORQUE_STD_NM = 0.05


@dataclass(frozen=True)
class Observing:
    """Method of the observer, and the ground that it assumes."""

    #: "ekf", "ukf", with learnt noise "aekf", "aukf"; "momentum", which assumes no friction law; "true" gives the
    #: controller the true speed
    method: str = "ukf"
    #: the assumed ground, as in `Patch`; where neither terrain nor friction is given, the ground that lies under all
    #: others
    terrain: str | None = None
    friction: float | None = None
    slip_stiffness_s_per_m: float | None = None

    def __post_init__(self) -> None:
        require_one_of("observer.method", self.method, METHODS)
        if self.slip_stiffness_s_per_m is not None:
            require_positive("observer.slip_stiffness_s_per_m", self.slip_stiffness_s_per_m)
        try:
            self.assumed_patch(Patch())
        except InputError as error:
            raise InputError(str(error).replace("ground", "observer", 1)) from error

    def assumed_patch(self, base: Patch) -> Patch:
        """The ground that the observer assumes; base: the one that lies under all others."""
        ground = base if self.terrain is None and self.friction is None else Patch(self.terrain, self.friction)
        stiffness = self.slip_stiffness_s_per_m
        return ground if stiffness is None else replace(ground, slip_stiffness_s_per_m=stiffness)


def make_observer(observing: Observing, sensing: Sensing, robot: Robot, base: Patch) -> SpeedObserver:
    """The observer with a model of the robot, the noise of its sensors, and the ground that it assumes."""
    assumed = free_sideways(robot)
    return SpeedObserver(
        scene(assumed, assumed_terrain(observing.assumed_patch(base), assumed)),
        noise=noise(sensing, robot),
        method=observing.method.removeprefix("a"),
        matching=observing.method.startswith("a"),
    )


def make_momentum_observer(observing: Observing, sensing: Sensing, robot: Robot, base: Patch) -> MomentumObserver:
    """The momentum observer with the robot and its sensors; of the ground it uses the rolling resistance alone."""
    assumed = free_sideways(robot)
    stds = noise(sensing, robot)
    count_rad = count_std_rad(sensing.counts_per_turn)
    return MomentumObserver(
        scene(assumed, assumed_terrain(observing.assumed_patch(base), assumed)),
        MomentumNoise(
            encoder_std_rad=count_rad,
            torque_std_Nm=stds.torque_std_Nm,
            passive_std_rad=None if stds.passive_std_rad_s is None else count_rad,
            accelerometer_std_m_s2=ACCELEROMETER.noise_std,
            gyro_std_rad_s=stds.gyro_std_rad_s,
            speed_std_m_s=stds.speed_std_m_s,
        ),
        gap_s=_LONGEST_GAPS * sensing.interval_s,
    )


def assumed_terrain(patch: Patch, robot: Robot) -> Terrain:
    """The terrain of a patch, without the corner of `CoulombCreep`, beyond which the friction is not observable.

    The law of Ward and Iagnemma with the same friction and the same slope at rest takes its place.
    """
    ground = patch.ground(robot)
    law = ground.traction
    if not isinstance(law, CoulombCreep):
        return ground
    return ground._replace(traction=WardIagnemma(law.adhesion, law.slope_s_per_m / law.adhesion))


def noise(sensing: Sensing, robot: Robot) -> ObserverNoise:
    """Noise of the observer's model from the settings of the sensors."""
    quantisation = quantisation_std_rad_s(sensing.counts_per_turn, sensing.interval_s)
    torque = robot.motor.wheel_constant_Nm_per_A * sensing.current_noise_A
    passive = any(k >= robot.driven for k in sensing.encoder_wheels(robot))
    return ObserverNoise(
        encoder_std_rad_s=quantisation,
        torque_std_Nm=math.hypot(torque, _TORQUE_STD_NM),
        gyro_std_rad_s=math.hypot(GYRO.noise_std, GYRO.offset) if sensing.gyro else None,
        passive_std_rad_s=quantisation if passive else None,
        speed_std_m_s=sensing.speed.std_m_s if sensing.speed.interval_s else None,
        pitch_std_rad=math.hypot(PITCH.noise_std, PITCH.offset) if sensing.pitch else None,
        initial_speed_std_m_s=_START_STD_M_S,
    )


def angle_sample(sample: RobotSample) -> AngleSample:
    """The sample for the momentum observer, with the angles that the wheels have turned since the last one."""
    unknown = np.full(sample.wheel_speed_rad_s.size, math.nan)
    return AngleSample(
        dt_s=sample.dt_s,
        turned_rad=sample.wheel_speed_rad_s * sample.dt_s,
        current_A=sample.current_A,
        edge_age_s=unknown,
        acceleration_m_s2=sample.acceleration_m_s2,
        pitch_rad=sample.pitch_rad,
        yaw_rate_rad_s=sample.yaw_rate_rad_s,
        speed_m_s=sample.speed_m_s,
    )


def unknown_ground(driven: int) -> SlipEstimate:
    """Estimate of a method that knows no ground, to be filled with `_replace`: nan, a radius as given, and no alarm."""
    of_wheels = ("wheel_speed_rad_s", "slip_speed_m_s", "slip_speed_std_m_s", "slip_ratio", "traction_N")
    of_ground = ("friction_ratio", "friction_std", "grip")
    unknown: dict[str, Any] = dict.fromkeys(SlipEstimate._fields, math.nan)
    unknown_each = dict.fromkeys((*of_wheels, *of_ground), np.full(driven, math.nan))
    without_alarm = dict.fromkeys(("radius_std", "unobserved_s", "immobilised", "flags"), 0.0)
    known = without_alarm | {"radius_ratio": 1.0, "slipping": np.zeros(driven)}
    return SlipEstimate(**unknown | unknown_each | known)


def slip_estimate(e: MomentumEstimate) -> SlipEstimate:
    """The momentum observer's estimate in the form of the speed observer's; what it does not estimate is nan."""
    return unknown_ground(e.force_N.size)._replace(
        speed_m_s=e.speed_m_s,
        speed_std_m_s=e.speed_std_m_s,
        yaw_rate_rad_s=e.yaw_rate_rad_s,
        wheel_speed_rad_s=e.wheel_speed_rad_s,
        slip_speed_m_s=e.slip_speed_m_s,
        slip_speed_std_m_s=e.slip_speed_std_m_s,
        slip_ratio=e.slip_ratio,
        traction_N=e.force_N,
    )


class Observation:
    """A running observer: speeds of the wheels' centres by its last estimate, and the age of that estimate.

    Args:
        observer: to be run; None gives the truth instead.
        robot: the true one.
        start: truth at the start; without it the robot is at rest.
    """

    def __init__(
        self, observer: SpeedObserver | MomentumObserver | None, robot: Robot, start: RobotTruth | None = None
    ) -> None:
        self.observer, self._robot = observer, robot
        self._taken_s, self._std_m_s = 0.0, 0.0
        self._travel_m_s = np.zeros(robot.driven) if start is None else start.wheel_centre_speed_m_s[: robot.driven]
        self._force_N = np.full(robot.driven, math.nan)
        self._state: Any = None

    def update(self, arrival: ArrivedSample) -> SlipEstimate | None:
        """Estimate after a sample; None without an observer."""
        if self.observer is None:
            return None
        estimate = self._estimate(self.observer, arrival.sample)
        radius_m = self.observer.scene.robot.wheel.radius_m * estimate.radius_ratio
        self._travel_m_s = radius_m * estimate.wheel_speed_rad_s - estimate.slip_speed_m_s
        self._taken_s, self._std_m_s = arrival.taken_s, float(estimate.speed_std_m_s)
        self._force_N = estimate.traction_N
        return estimate

    def _estimate(self, observer: SpeedObserver | MomentumObserver, sample: RobotSample) -> SlipEstimate:
        """Estimate of either observer after a sample."""
        momentum = isinstance(observer, MomentumObserver)
        taken = angle_sample(sample) if momentum else sample
        if self._state is None:
            self._state = observer.init() if isinstance(observer, MomentumObserver) else observer.init(sample)
            self._step = Kernel(observer.step, self._state, taken)
        self._state, estimate = self._step(self._state, taken)
        return slip_estimate(estimate) if momentum else estimate

    def measurement(self, wheel_speed_rad_s: np.ndarray, travel_m_s: np.ndarray, now_s: float) -> Measurement:
        """Measurement for the controller; travel_m_s: (driven,) the truth, used where there is no observer."""
        std = np.zeros(self._robot.driven)
        if self.observer is None:
            return Measurement(wheel_speed_rad_s, travel_m_s, 0.0, std, np.full(self._robot.driven, math.nan))
        age_s = max(now_s - self._taken_s, 0.0)
        fresh = isinstance(self.observer, MomentumObserver) and age_s == 0.0
        force_N = self._force_N if fresh else np.full(self._robot.driven, math.nan)
        return Measurement(wheel_speed_rad_s, self._travel_m_s, age_s, std + self._std_m_s, force_N)
