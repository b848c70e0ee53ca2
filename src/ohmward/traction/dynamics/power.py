"""Where the power goes: every loss is >= 0 in every state, and the balance closes.

electrical = copper + drive + slip + rolling + climb + drawbar + d/dt (kinetic energy)

From tau omega = d/dt (kinetic energy) + F_tr s + |F_rr| |v_f| + grade, with the motor in front of it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, weight_along_ground
from ohmward.traction.robot.motor import copper_loss
from ohmward.traction.robot.robot import Robot


class Power(NamedTuple):
    """Watts, or joules where added up over time.

    electrical: into the motors; < 0 where braking gives back.
    copper:     heats the windings.
    drive:      lost in gears and bearings.
    slip:       lost between wheel and ground, along and across.
    rolling:    lost to rolling resistance.
    climb:      lifts the robot; < 0 downhill.
    drawbar:    pulls the load behind it.
    """

    electrical: Any
    copper: Any
    drive: Any
    slip: Any
    rolling: Any
    climb: Any
    drawbar: Any


def power(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> Power:
    """The split [W] in state x with the forces `f`."""
    robot = p.robot
    motion, omega = x[: robot.freedoms], x[robot.freedoms :]
    copper = sum(copper_loss(robot.motor, u.current_A[k]) for k in range(robot.driven))
    weight = weight_along_ground(u, robot)
    leftward = motion[1] if robot.freedoms == 3 else 0.0
    return Power(
        electrical=copper + f.torque_Nm @ omega,
        copper=copper,
        drive=f.friction_Nm @ omega,
        slip=f.traction_N @ f.slip_speed_m_s - f.scrub_N @ f.sideways_m_s,
        rolling=-(f.rolling_N @ (robot.rolling @ motion)),
        climb=-(weight[0] * motion[0] + weight[1] * leftward),
        drawbar=u.drawbar_N * motion[0],
    )


def losses(p: Power) -> Any:
    """What becomes heat."""
    return p.copper + p.drive + p.slip + p.rolling


def kinetic_energy(x: np.ndarray, robot: Robot) -> Any:
    """Energy [J] of the moving body and the turning wheels."""
    return 0.5 * (robot.inertia @ (x * x))
