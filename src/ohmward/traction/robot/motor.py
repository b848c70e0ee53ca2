"""DC motor with gear on a wheel: torque, voltage and losses from current and speed.

tau      = n K_m I - tau_f                                          at the wheel
tau_f    = [tau_c + (1 - eta) n K_m |I|] tanh(omega / omega_0) + b omega
V        = R I + n K_m omega
J_rotor  counts n^2 times at the wheel

Gear loss is a friction that grows with the torque: when driving, the fraction eta of the motor's power reaches the
wheel; when braking, 1/(2 - eta) of the wheel's power reaches the motor. It never adds energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ohmward.checks import require_each_not_negative, require_each_positive
from ohmward.errors import InputError
from ohmward.trace import tanh
from ohmward.traction.friction.law import direction_and_size


@dataclass(frozen=True)
class Motor:
    """One motor and its gear; torque and speed are at the wheel."""

    torque_constant_Nm_per_A: float  #: K_m of the bare motor, equal to its back-EMF constant in V s/rad, > 0
    resistance_ohm: float  #: R of the winding, > 0
    gear_ratio: float = 1.0  #: n, turns of the motor per turn of the wheel, > 0
    gear_efficiency: float = 1.0  #: eta, in (0, 1]
    friction_Nm: float = 0.0  #: tau_c, dry friction at the wheel, >= 0
    damping_Nms_per_rad: float = 0.0  #: b, viscous friction at the wheel, >= 0
    friction_speed_rad_s: float = 0.5  #: omega_0, wheel speed over which dry friction changes sign, > 0
    rotor_inertia_kg_m2: float = 0.0  #: moment of inertia of the rotor about its axis, >= 0

    def __post_init__(self) -> None:
        require_each_positive(
            "motor.", self, "torque_constant_Nm_per_A", "resistance_ohm", "gear_ratio", "friction_speed_rad_s"
        )
        require_each_not_negative("motor.", self, "friction_Nm", "damping_Nms_per_rad", "rotor_inertia_kg_m2")
        if not 0 < self.gear_efficiency <= 1:
            raise InputError(f"motor.gear_efficiency must be > 0 and at most 1, got {self.gear_efficiency:g}")

    @property
    def wheel_constant_Nm_per_A(self) -> float:
        """Torque at the wheel for a current, without losses: n K_m."""
        return self.gear_ratio * self.torque_constant_Nm_per_A

    @property
    def inertia_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor at the wheel: n^2 J_rotor."""
        return self.gear_ratio**2 * self.rotor_inertia_kg_m2


def ideal_torque(motor: Motor, current_A: Any) -> Any:
    """Torque [N m] at the wheel without losses."""
    return motor.wheel_constant_Nm_per_A * current_A


def friction_torque(motor: Motor, current_A: Any, wheel_speed_rad_s: Any) -> Any:
    """Friction [N m] of bearings and gear, against the rotation."""
    _, torque_Nm = direction_and_size(ideal_torque(motor, current_A))
    dry = motor.friction_Nm + (1 - motor.gear_efficiency) * torque_Nm
    return dry * tanh(wheel_speed_rad_s / motor.friction_speed_rad_s) + motor.damping_Nms_per_rad * wheel_speed_rad_s


def wheel_torque(motor: Motor, current_A: Any, wheel_speed_rad_s: Any) -> Any:
    """Torque [N m] that reaches the wheel."""
    return ideal_torque(motor, current_A) - friction_torque(motor, current_A, wheel_speed_rad_s)


def current_for_torque(motor: Motor, torque_Nm: Any, wheel_speed_rad_s: Any) -> Any:
    """Current [A] for this torque at the wheel: the exact inverse of `wheel_torque`."""
    turning = tanh(wheel_speed_rad_s / motor.friction_speed_rad_s)
    needed = torque_Nm + motor.friction_Nm * turning + motor.damping_Nms_per_rad * wheel_speed_rad_s
    direction, _ = direction_and_size(needed)
    return needed / (motor.wheel_constant_Nm_per_A * (1 - (1 - motor.gear_efficiency) * direction * turning))


def copper_loss(motor: Motor, current_A: Any) -> Any:
    """Power [W] that heats the winding."""
    return motor.resistance_ohm * current_A * current_A
