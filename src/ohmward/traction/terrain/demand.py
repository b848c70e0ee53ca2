"""Demand of floors on the driven wheels: the forces that keep a body moving against the drag under all its wheels.

    G_d' F = M dv/dt + sum over wheels of N_j [ rolling_j d(v_j) + roller_j d(v_j along the axle) ]

G_d are the rows of the driven wheels, v_j is the motion of wheel j over the ground, d the direction of a motion. With
as many driven wheels as the body has motions, F is unique; with more, it is the smallest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.trace import maximum, sqrt, tanh
from ohmward.traction.robot.robot import GRAVITY, Robot

#: Speed [m/s] below which a direction fades.
FADING_M_S = 0.01
#: Share of a wheel's motion that goes across it where the drag of its rollers has grown to tanh(1) of its full size:
#: rubber creeps before it turns a roller. Fitted to 396 drives of an omni robot on three floors.
ROLLER_CREEP = 0.3


def drag_columns(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """Forces (..., driven, wheels, 2) [N] of the driven wheels for a rolling and a roller share of 1 under each wheel.

    motion: (..., freedoms) of the rims: the body's own is known only once the floor is. Drags learnt along it differ
        more from floor to floor, and leave less unexplained, than those along the body's.
    """
    along, across = wheel_motion(robot, motion)
    size = sqrt(along**2 + across**2 + FADING_M_S**2)
    load = static_loads(robot)
    rolling = _on_body(robot, load * along / size, load * across / size)
    rollers = _on_body(robot, np.zeros(np.shape(along)), load * tanh(across / (ROLLER_CREEP * size)))
    by_wheel = np.stack([rolling, rollers], axis=-2) @ robot.motion_by_rims
    return np.moveaxis(by_wheel, -1, -3)


def wheel_motion(robot: Robot, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion (..., wheels) of each wheel in its rolling direction and across it; fixed wheels are taken to roll."""
    along = motion @ robot.rolling.T
    across = motion @ robot.sideways.T if robot.chassis.rollers else np.zeros(np.shape(along))
    return along, across


def inertial_forces(robot: Robot, acceleration: np.ndarray) -> np.ndarray:
    """Forces (..., driven) [N] of the driven wheels that accelerate the body so, (..., freedoms)."""
    return (robot.inertia[: robot.freedoms] * acceleration) @ robot.motion_by_rims


def undetermined_force_std(robot: Robot, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Standard deviation (..., driven) [N] of the force that the dry friction of a standing motor may hold, either way.

    Friction has the size tau_c and the direction of the rotation; at rest it is anything between, whatever the current
    says.
    """
    motor = robot.motor
    free = 1.0 - abs(tanh(wheel_speed_rad_s / motor.friction_speed_rad_s))
    return motor.friction_Nm / robot.wheel.radius_m * free


def drag_share(robot: Robot, motion: np.ndarray, force_N: np.ndarray) -> Any:
    """Force (...,) of the wheels (..., driven) along the motion (..., freedoms), over the weight."""
    body = force_N @ robot.rolling[: robot.driven]
    along = (body[..., :-1] * motion[..., :-1]).sum(axis=-1) / maximum(travel_speed(motion), 1e-6)
    return along / static_loads(robot).sum()


def travel_speed(motion: np.ndarray) -> Any:
    """Speed (...,) [m/s] of a motion (..., freedoms), its rotation left out."""
    return sqrt((motion[..., :-1] * motion[..., :-1]).sum(axis=-1))


def static_loads(robot: Robot) -> np.ndarray:
    """Load of each wheel (wheels,) [N] at rest."""
    return robot.mass_kg * GRAVITY * robot.loads[:, 0]


def mean_load(robot: Robot) -> float:
    """Load of a driven wheel [N] at rest, their mean."""
    return float(static_loads(robot)[: robot.driven].mean())


def _on_body(robot: Robot, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Forces (..., wheels, freedoms) on the body of forces along and across each wheel."""
    return along[..., None] * robot.rolling + across[..., None] * robot.sideways
