"""The energy balance of a robot: the record of its terms, and their power in a given state.

battery    = electrical + idle + resistor
electrical = copper + drive + slip + rolling + climb + drawbar + kinetic + numerical

The second line follows from tau omega = d/dt (kinetic energy) + F_tr s + |F_rr| |v_f| + grade, with the motor in front.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, momentum_rates, weight_along_ground
from ohmward.traction.robot.motor import copper_loss


class EnergyBalance(NamedTuple):
    """Terms of the energy balance: power [W], or energy [J] where integrated over time; numbers or (T,) arrays.

    battery = idle + resistor + copper + drive + slip + rolling + climb + drawbar + kinetic + numerical + residual
    """

    battery: Any = 0.0  #:    out of the battery; < 0 where it is charged
    electrical: Any = 0.0  #: into the motors, part of `battery`; < 0 where braking gives back
    idle: Any = 0.0  #:       electronics
    resistor: Any = 0.0  #:   braking power that the battery does not take, burned in a resistor
    copper: Any = 0.0  #:     heats the windings
    drive: Any = 0.0  #:      lost in gears and bearings
    slip: Any = 0.0  #:       lost between wheel and ground, along and across
    rolling: Any = 0.0  #:    lost to rolling resistance
    climb: Any = 0.0  #:      lifts the robot; < 0 downhill
    drawbar: Any = 0.0  #:    pulls the load behind it
    kinetic: Any = 0.0  #:    accelerates body and wheels; < 0 where they slow down
    numerical: Any = 0.0  #:  lost by the method of integration

    @property
    def losses(self) -> Any:
        """Part of `electrical` that becomes heat."""
        return self.copper + self.drive + self.slip + self.rolling

    @property
    def residual(self) -> Any:
        """Part of `battery` that no term explains, in the unit of the terms: 0 where the balance closes."""
        return self.battery - sum(getattr(self, name) for name in TERMS)

    def accumulate(self, step: EnergyBalance) -> EnergyBalance:
        """The balance after one more step."""
        return EnergyBalance(*(total + term for total, term in zip(self, step, strict=True)))


#: Terms that add up to `battery`.
TERMS = tuple(name for name in EnergyBalance._fields if name not in ("battery", "electrical"))


def power(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> EnergyBalance:
    """Energy balance [W] in state x with the forces `f`; every loss is >= 0 in every state."""
    robot = p.robot
    motion, omega = x[: robot.freedoms], x[robot.freedoms :]
    copper = sum(copper_loss(robot.motor, u.current_A[k]) for k in range(robot.driven))
    electrical = copper + f.torque_Nm @ omega
    weight = weight_along_ground(u, robot)
    leftward = motion[1] if robot.freedoms == 3 else 0.0
    return EnergyBalance(
        battery=electrical + robot.idle_W,
        electrical=electrical,
        idle=robot.idle_W,
        copper=copper,
        drive=f.friction_Nm @ omega,
        slip=f.traction_N @ f.slip_speed_m_s - f.scrub_N @ f.sideways_m_s,
        rolling=-(f.rolling_N @ (robot.rolling @ motion)),
        climb=-(weight[0] * motion[0] + weight[1] * leftward),
        drawbar=u.drawbar_N * motion[0],
        kinetic=momentum_rates(x, u, p, f) @ x,
    )


def kinetic_energy(x: np.ndarray, inertia: np.ndarray) -> Any:
    """Kinetic energy [J] of body and wheels.

    x: (n,) or (T, n) speeds [m/s, rad/s].  inertia: (n,) of each, as `Robot.inertia`.
    """
    return 0.5 * ((x * x) @ inertia)
