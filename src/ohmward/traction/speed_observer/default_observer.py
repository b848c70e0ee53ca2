"""Default observer of a robot without a log: every sensor may come, with its usual noise.

`make_observer` does better where there is a log: it measures the noise in it, and leaves out what the robot lacks.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ohmward.errors import InputError
from ohmward.traction.dynamics.forces import scene
from ohmward.traction.friction.terrain import Terrain, terrain_named
from ohmward.traction.robot.chassis import SkidSteer
from ohmward.traction.robot.file import load_robot
from ohmward.traction.robot.robot import Robot, free_sideways
from ohmward.traction.speed_observer.make_observer import (
    FILTERS,
    LEAST_GYRO_RAD_S,
    PITCH_RAD,
    RADIUS_STD,
    SCRUBBING_SHARE,
    encoder_lag_share,
    states_of,
    unmeasured_force_walk,
    unmeasured_torque_Nm,
    yaw_rate_walk,
)
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.sensor_noise import LEAST_SPEED_M_S
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

DEFAULT_TERRAIN, DEFAULT_FILTER = "dry asphalt", "ukf"

#: Sensors of which there may be one; one that never comes costs nothing but its part of the step.
ANY_SENSORS = ObserverNoise(
    gyro_std_rad_s=LEAST_GYRO_RAD_S, pitch_std_rad=PITCH_RAD, speed_std_m_s=LEAST_SPEED_M_S, radius_std=RADIUS_STD
)

#: Speed of the rims and step of a drive that nobody has seen yet, where the motor currents do not tell the force.
USUAL_SPEED_M_S, USUAL_STEP_S = 0.5, 0.02


def default_observer(
    robot: Robot | str, terrain: Terrain | str = DEFAULT_TERRAIN, filter: str = DEFAULT_FILTER
) -> SpeedObserver:
    """The observer of a robot on this ground, before there is a log of it.

    robot: or the path of its file, or the name of a packaged one.
    terrain: or its name.
    filter: "ekf", "aekf", "ukf" or "aukf".

    Raises:
        InputError: a name that there is not.
    """
    if filter.lower() not in FILTERS:
        raise InputError(f"filter must be one of {', '.join(FILTERS)}, got {filter!r}")
    method, matching = FILTERS[filter.lower()]
    if not isinstance(robot, Robot):
        robot = load_robot(robot)
    if not isinstance(terrain, Terrain):
        terrain = terrain_named(terrain, robot.wheel.radius_m, robot.wheel.width_m)
    rolling, force = free_sideways(robot), not robot.chassis.scrubs
    noise = any_noise(rolling, terrain, force)
    if isinstance(robot.chassis, SkidSteer):
        noise = replace(noise, yaw_rate_walk=yaw_rate_walk(robot.chassis))
    states = replace(states_of(noise, force), radius=False)
    return SpeedObserver(scene(rolling, terrain), states, noise, method, matching, force)


def any_noise(robot: Robot, terrain: Terrain, force: bool) -> ObserverNoise:
    """Usual noise of every sensor that the robot may have.

    force: the motor currents tell what drives the robot; they do not where wheels scrub.
    """
    has_passive = len(robot.places) > robot.driven
    noise = replace(ANY_SENSORS, passive_std_rad_s=ObserverNoise.encoder_std_rad_s if has_passive else None)
    if force:
        return noise
    return replace(
        noise,
        encoder_lag_share=encoder_lag_share(force),
        radius_std=math.hypot(RADIUS_STD, SCRUBBING_SHARE),
        torque_std_Nm=unmeasured_torque_Nm(robot, USUAL_STEP_S),
        speed_walk=unmeasured_force_walk(robot, USUAL_SPEED_M_S, terrain),
    )
