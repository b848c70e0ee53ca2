"""Torque that the battery can feed: its voltage limits each motor's current, its power all of them together.

|R I + n K_m omega| <= V      and      sum (R I^2 + n K_m omega I) <= P_most - P_idle
"""

from __future__ import annotations

import math

import numpy as np

from ohmward.simulate.closed_loop.supply import Supplied
from ohmward.traction.robot.robot import Robot


def available_torque(torque_Nm: np.ndarray, omega_rad_s: np.ndarray, robot: Robot, now: Supplied) -> np.ndarray:
    """Torques (driven,) [N m] that the battery can feed, in the demanded proportions where its power limits them.

    torque_Nm: (driven,) demanded.  omega_rad_s: (driven,) speeds of the wheels.
    """
    motor = robot.motor
    back_V = motor.wheel_constant_Nm_per_A * omega_rad_s
    lowest_A = (-now.voltage_V - back_V) / motor.resistance_ohm
    highest_A = (now.voltage_V - back_V) / motor.resistance_ohm
    current = np.clip(torque_Nm / motor.wheel_constant_Nm_per_A, lowest_A, highest_A)
    heat_W = motor.resistance_ohm * float(current @ current)
    moving_W = float(back_V @ current)
    share = affordable_share(heat_W, moving_W, max(now.available_W - robot.idle_W, 0.0))
    return share * motor.wheel_constant_Nm_per_A * current


def affordable_share(heat_W: float, moving_W: float, most_W: float) -> float:
    """The largest share s <= 1 with heat_W s^2 + moving_W s <= most_W."""
    if heat_W + moving_W <= most_W:
        return 1.0
    root = math.sqrt(moving_W * moving_W + 4 * heat_W * most_W)
    return 2 * most_W / (moving_W + root) if moving_W + root > 0 else 0.0
