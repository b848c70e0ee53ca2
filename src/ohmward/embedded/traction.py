"""The speed observer and the controllers of a robot file as C99 libraries."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntFlag
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_one_of
from ohmward.embedded.c_library import VECTORS, Export
from ohmward.errors import InputError
from ohmward.trace import trace
from ohmward.traction import control
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.terrain import Terrain, terrain_named
from ohmward.traction.motion.sample import no_sample
from ohmward.traction.odometry.model import noise_of
from ohmward.traction.odometry.pose_filter import PoseFilter
from ohmward.traction.odometry.sample import OdometryFlag
from ohmward.traction.robot.chassis import currents_show_force
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.make_observer import FILTERS
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

CONTROLLERS = ("slip-controller", "speed-controller")

#: Name of the odometry among the filters.
ODOMETRY = "odometry"


class ControlSample(NamedTuple):
    """Sample of a controller of one wheel."""

    command: Any  #: target and bound
    measurement: control.Measurement  #: measured or estimated motion of the wheel
    dt_s: Any  #: time since the step before [s], > 0


class ControllerOutput(NamedTuple):
    """Output of a controller of one wheel."""

    torque_Nm: Any  #: to hold until the next step [N m]
    report: control.Report  #: of this step


def robot_export(robot: Robot, filter_name: str, name: str, terrain: str) -> Export:
    """The observer, the odometry or the controller of a robot.

    terrain: name of the ground that the observer assumes at first.

    Raises:
        InputError: no such filter or ground, or no observer for this robot.
    """
    if filter_name in CONTROLLERS:
        return controller_export(robot, filter_name, name)
    if filter_name == ODOMETRY:
        return odometry_export(robot, name)
    return observer_export(robot, terrain_named(terrain, robot.wheel), filter_name, name)


def observer_export(robot: Robot, terrain: Terrain, filter_name: str = "ekf", name: str = "speed") -> Export:
    """Speed observer with encoders and motor currents; it starts at rest.

    Raises:
        InputError: no such filter, or a robot that scrubs or steers.
    """
    if filter_name not in FILTERS:
        raise InputError(f"filter must be one of {', '.join((*FILTERS, ODOMETRY, *CONTROLLERS))}, got {filter_name!r}")
    if not currents_show_force(robot.chassis):
        raise InputError(
            f"{robot.name}: motor currents do not show the speed of a robot that scrubs or steers; export its pose and "
            f"speed by wheels and gyro, --filter {ODOMETRY}"
        )
    method, matching = FILTERS[filter_name]
    observer = SpeedObserver(scene(robot, terrain), method=method, matching=matching)
    at_rest = {"wheel_speed_rad_s": np.zeros(len(robot.places)), "current_A": np.zeros(robot.driven)}
    example = observer.no_sample()._replace(dt_s=0.01, **at_rest)
    state = observer.init(example)
    title = f"Speed and slip of {robot.name}: {filter_name}, encoders and motor currents"
    return _export(name, title, observer.step, state, example, SlipFlag, _drive(observer))


def odometry_export(robot: Robot, name: str = ODOMETRY) -> Export:
    """Pose and twist from encoders, gyro, external speeds and a speed observer; it starts at the origin of its frame.

    Pose increments are left out: they need the memory of the last steps.
    """
    settings = PoseFilter(robot, noise_of(robot), late_steps=0)
    example = settings.no_sample()
    state = settings.init(example)
    title = f"Pose and twist of {robot.name}: wheels and gyro"
    return _export(name, title, settings.step, state, example, OdometryFlag, _way(settings))


def controller_export(robot: Robot, controller: str = "slip-controller", name: str = "control") -> Export:
    """Sliding-mode controller of one driven wheel, for friction 0.5 +- 0.5; it starts without torque.

    Raises:
        InputError: no such controller.
    """
    wheel = control.driven_wheel(robot)
    law = control.SlidingMode(control.Uncertainty(force_N=0.5 * wheel.load_N))
    limits = control.Limits(torque_Nm=wheel.radius_m * wheel.load_N)
    makers: dict[str, tuple[Any, Any]] = {
        "slip-controller": (control.SlipController(wheel, law, limits), control.SlipCommand(0.0, 1.0)),
        "speed-controller": (control.SpeedController(wheel, law, limits), control.SpeedCommand(0.0, 0.12)),
    }
    require_one_of("controller", controller, makers)
    settings, command = makers[controller]
    example = ControlSample(command, control.Measurement(0.0, 0.0), 0.001)
    state = settings.init(example.measurement)

    def step(state: Any, sample: ControlSample) -> tuple[Any, ControllerOutput]:
        after, torque_Nm, report = settings.step(state, *sample)
        return after, ControllerOutput(torque_Nm, report)

    title = f"{controller.replace('-', ' ').capitalize()} of a wheel of {robot.name}: sliding mode"
    return _export(name, title, step, state, example, control.ControlFlag, _commands(command, wheel.radius_m))


def _export(
    name: str,
    title: str,
    step: Callable[..., Any],
    state: Any,
    example: Any,
    flags: type[IntFlag],
    samples: np.ndarray,
) -> Export:
    """A step that always starts from the same state."""
    traced = trace(step, state, example, with_origins=True)
    start = trace(lambda sample: state, example, with_origins=True)
    return Export(name, title, traced, start, flags, (), samples)


def _row(sample: Any) -> np.ndarray:
    return np.concatenate([_row(x) if isinstance(x, tuple) else np.ravel(x) for x in sample]).astype(float)


def _drive(observer: SpeedObserver) -> np.ndarray:
    """Samples (T, m): from rest, with a wheel that spins, and faults of encoder, motor current and clock."""
    rng, robot = np.random.default_rng(0), observer.scene.robot
    rows = []
    for k in range(VECTORS):
        wheels = np.full(len(robot.places), 0.1 * k) + 0.05 * rng.standard_normal(len(robot.places))
        wheels[0] += 2.0 * (30 < k < 40)
        currents = 1.0 + 0.1 * rng.standard_normal(robot.driven)
        rows.append(_row(observer.no_sample()._replace(dt_s=0.01, wheel_speed_rad_s=wheels, current_A=currents)))
    samples = np.array(rows)
    samples[10, 1], samples[14, 1 + len(robot.places)], samples[18, 0], samples[22, 0] = math.nan, math.inf, -1.0, 5.0
    return samples


def _way(settings: PoseFilter) -> np.ndarray:
    """Samples (T, m): a curve, with faults of encoder, gyro and clock, and an external speed."""
    rng, driven = np.random.default_rng(0), settings.robot.driven
    rows = []
    for k in range(VECTORS):
        wheels = np.linspace(1.0, 1.2, driven) * min(0.1 * k, 3.0) + 0.01 * rng.standard_normal(driven)
        sample = no_sample(settings.robot)
        speeds = np.concatenate([wheels, sample.wheel_speed_rad_s[driven:]])
        sample = sample._replace(dt_s=0.02, wheel_speed_rad_s=speeds, yaw_rate_rad_s=0.1 + 0.001 * k)
        if k % 10 == 9:
            sample = sample._replace(speed_m_s=0.011 * k, speed_std_m_s=0.05)
        rows.append(_row(settings.no_sample()._replace(robot=sample)))
    samples = np.array(rows)
    gyro = 1 + len(sample.wheel_speed_rad_s) + driven
    samples[10, 1] = math.nan
    samples[14, gyro] = math.inf
    samples[18, 0] = -1.0
    samples[22, 0] = 5.0
    return samples


def _commands(command: Any, radius_m: float) -> np.ndarray:
    """Samples (T, m): driving, braking, an outdated speed, an excessive command and a missing speed."""
    rng, rows = np.random.default_rng(0), []
    for k in range(VECTORS):
        speed = 0.02 * k
        wanted = command._replace(**{command._fields[0]: 0.12 if k < 40 else -0.1})
        seen = control.Measurement(
            speed * (1.1 + 0.02 * rng.standard_normal()) / radius_m, speed, 1.0 if 20 < k < 25 else 0.0
        )
        rows.append(np.array([*wanted, *seen, 0.001], dtype=float))
    samples = np.array(rows)
    samples[12, 0], samples[16, 2] = 5.0, math.nan
    return samples
