"""The observer of a scenario: its model of robot, ground and noise, and its estimate at every instant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ohmward.checks import require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.simulate.closed_loop.ground import Patch
from ohmward.simulate.closed_loop.sensing import Arrival, Sensing
from ohmward.simulate.robot_sensors import GYRO, PITCH
from ohmward.trace import Kernel
from ohmward.traction.control import Measurement
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.coulomb_creep import CoulombCreep
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.friction.ward_iagnemma import WardIagnemma
from ohmward.traction.robot.robot import Robot, free_sideways
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.noise import ObserverNoise, quantisation_std_rad_s
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

METHODS = ("ekf", "aekf", "ukf", "aukf", "true")
#: Standard deviation of the speed at the start: the robot stands.
_START_STD_M_S = 0.005
#: Ripple and friction of a drive that no current shows [N m].
_TORQUE_STD_NM = 0.05


@dataclass(frozen=True)
class Observing:
    """Method of the observer, and the ground that it assumes.

    Attributes:
        method: "ekf", "ukf", with learnt noise "aekf", "aukf"; "true" gives the controller the true speed.
        terrain, friction, slip_stiffness_s_per_m: the assumed ground, as in `Patch`; where neither terrain nor friction
            is given, the ground that lies under all others.
    """

    method: str = "ukf"
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


class Observation:
    """A running observer: speeds of the wheels' centres by its last estimate, and the age of that.

    Args:
        observer: to be run; None gives the truth instead.
        robot: the true one.
    """

    def __init__(self, observer: SpeedObserver | None, robot: Robot) -> None:
        self.observer, self._robot = observer, robot
        self._taken_s, self._travel_m_s, self._std_m_s = 0.0, np.zeros(robot.driven), 0.0
        self._state: Any = None

    def update(self, arrival: Arrival) -> SlipEstimate | None:
        """Estimate after a sample; None without an observer."""
        if self.observer is None:
            return None
        if self._state is None:
            self._state = self.observer.init(arrival.sample)
            self._step = Kernel(self.observer.step, self._state, arrival.sample)
        self._state, estimate = self._step(self._state, arrival.sample)
        radius_m = self.observer.scene.robot.wheel.radius_m * estimate.radius_ratio
        self._travel_m_s = radius_m * estimate.wheel_speed_rad_s - estimate.slip_speed_m_s
        self._taken_s, self._std_m_s = arrival.taken_s, float(estimate.speed_std_m_s)
        return estimate

    def measurement(self, wheel_speed_rad_s: np.ndarray, travel_m_s: np.ndarray, now_s: float) -> Measurement:
        """Measurement for the controller; travel_m_s: (driven,) the truth, used where there is no observer."""
        std = np.zeros(self._robot.driven)
        if self.observer is None:
            return Measurement(wheel_speed_rad_s, travel_m_s, 0.0, std)
        return Measurement(wheel_speed_rad_s, self._travel_m_s, max(now_s - self._taken_s, 0.0), std + self._std_m_s)
