"""Methods of the study of traction, from the wheels alone to the filters, each made for the same robot and ground."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.trace import where
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.default_observer import default_observer
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipSample, unknown_ground
from ohmward.traction.speed_observer.estimator import considered_step
from ohmward.traction.speed_observer.observer_state import ObserverState
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.assess.recommendation import Processor


class SlipMethod(NamedTuple):
    """A method by its name, in words, and the function that makes it for a robot and the name of a ground."""

    name: str
    title: str
    make: Callable[[Robot, str], SlipObserver]


class SlipObserver(Protocol):
    """An observer: the state before a first sample, and a step that traces."""

    def init(self, sample: SlipSample) -> Any:
        """State."""
        ...

    def step(self, state: Any, sample: SlipSample) -> tuple[Any, SlipEstimate]:
        """State after a sample, and the estimate."""
        ...


class WheelsAlone(NamedTuple):
    """The wheels are believed to roll without slip; a lost value holds the one before."""

    robot: Robot

    def init(self, sample: SlipSample) -> np.ndarray:
        """(driven,) speeds of the wheels [rad/s]."""
        del sample
        return np.zeros(self.robot.driven)

    def step(self, state: np.ndarray, sample: SlipSample) -> tuple[np.ndarray, SlipEstimate]:
        """Speeds after a sample, and the motion of the body that fits them best."""
        n = self.robot.driven
        pairs = zip(sample.wheel_speed_rad_s[:n], state, strict=True)
        speeds = np.array([where(new == new, new, old) for new, old in pairs])
        motion = np.linalg.pinv(self.robot.rolling[:n]) @ (self.robot.wheel.radius_m * speeds)
        return speeds, unknown_ground(n)._replace(
            speed_m_s=motion[0],
            yaw_rate_rad_s=motion[-1],
            wheel_speed_rad_s=speeds,
            slip_speed_m_s=np.zeros(n),
            slip_ratio=np.zeros(n),
        )


class ConsideredObserver(NamedTuple):
    """A speed observer, with the doubt about the wheels' radius in its bands."""

    observer: SpeedObserver

    def init(self, sample: SlipSample) -> ObserverState:
        """State before the first sample."""
        return self.observer.init(sample)

    def step(self, state: ObserverState, sample: SlipSample) -> tuple[ObserverState, SlipEstimate]:
        """State after a sample, and the estimate."""
        return considered_step(self.observer, state, sample)


def _filtered(robot: Robot, ground: str, name: str) -> ConsideredObserver:
    return ConsideredObserver(default_observer(robot, ground, name))


def _of_filter(name: str, title: str) -> SlipMethod:
    return SlipMethod(name, title, partial(_filtered, name=name))


#: The method without a filter.
PLAIN = "wheels"

SLIP_METHODS: tuple[SlipMethod, ...] = (
    SlipMethod(PLAIN, "the wheels are believed to roll without slip", lambda robot, ground: WheelsAlone(robot)),
    _of_filter("ekf", "extended Kalman filter"),
    _of_filter("aekf", "extended, the encoders' noise is matched"),
    _of_filter("ukf", "unscented Kalman filter, the default"),
    _of_filter("aukf", "unscented, the encoders' noise is matched"),
)

#: The extended filters for a robot with two driven wheels take 60 KB of code, the unscented ones 150 KB and more.
OBSERVER_PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("64 KB of flash", 8000.0),
    Processor("512 KB of flash, or a computer", math.inf),
)
