"""Parameters of the plant; the defaults are the robot of [T] (RLMA)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from ohmward.checks import require_each_not_negative, require_each_positive
from ohmward.errors import InputError
from ohmward.traction.robot.chassis import Differential
from ohmward.traction.robot.robot import GRAVITY, RLMA

FRONT = (0, 1)
FRONT_AND_REAR = (0, 1, 2, 3)

_CHASSIS = cast(Differential, RLMA.chassis)


@dataclass(frozen=True)
class RlmaParameters:
    """Robot of four wheels on two axles.

    Mass, axles, track, radius, outer size and driven wheels are those of [T], the other values are assumed. All four
    wheels are fixed to the body: to turn, it must slide sideways, unlike the planar model of [T].

    Raises:
        InputError: a value out of its range.
    """

    mass_kg: float = RLMA.mass_kg  #: with the wheels
    wheel_mass_kg: float = 1.5  #: of each wheel, a solid disc of `wheel_width_m`
    rotor_inertia_kg_m2: float = 0.0  #: of each motor, as felt at the wheel (n^2 J_rotor)
    wheel_radius_m: float = RLMA.wheel.radius_m  #: rolling radius under the static load
    wheel_width_m: float = RLMA.wheel.width_m
    #: from the centre of gravity to the axles (L_f, L_r)
    front_m: float = _CHASSIS.front_m
    rear_m: float = _CHASSIS.rear_m
    track_m: float = _CHASSIS.track_m  #: between left and right wheels (b)
    #: length, width, height of the body, which gives its moments of inertia
    body_m: tuple[float, float, float] = (0.68, 0.38, 0.20)
    centre_height_m: float = RLMA.height_m  #: of the centre of gravity, wheels included
    driven: tuple[int, ...] = FRONT  #: wheels with a motor, numbered as `WHEELS`: `FRONT` or `FRONT_AND_REAR`
    rolling_resistance: float = 0.01  #: moment against the turning of each wheel, over static load times radius
    drag_N_s2_per_m2: float = 0.0  #: drag over the square of the speed, at the centre of the body
    slip_stiffness_s_per_m: float = 6.25  #: traction over static load and slip speed, below the friction limit
    #: of each wheel against the ground
    contact_stiffness_N_per_m: float = 60e3
    contact_damping_N_s_per_m: float = 1000.0

    def __post_init__(self) -> None:
        require_each_positive("rlma.", self, *_POSITIVE)
        require_each_not_negative("rlma.", self, "rotor_inertia_kg_m2", "rolling_resistance", "drag_N_s2_per_m2")
        if not self.body_mass_kg > 0:
            raise InputError(f"rlma.mass_kg must exceed that of the 4 wheels, {4 * self.wheel_mass_kg:g} kg")
        if not self.driven or not set(self.driven) <= set(FRONT_AND_REAR) or len(set(self.driven)) < len(self.driven):
            raise InputError(f"rlma.driven must name wheels out of {FRONT_AND_REAR}, each once, got {self.driven}")

    @property
    def body_mass_kg(self) -> float:
        """Mass without the wheels."""
        return self.mass_kg - 4 * self.wheel_mass_kg

    @property
    def body_height_m(self) -> float:
        """Height of the centre of gravity without the wheels."""
        return (self.mass_kg * self.centre_height_m - 4 * self.wheel_mass_kg * self.wheel_radius_m) / self.body_mass_kg

    @property
    def body_x_m(self) -> float:
        """Place of the centre of gravity of the body ahead of the robot's, which the wheels alone would miss."""
        return -2 * self.wheel_mass_kg * (self.front_m - self.rear_m) / self.body_mass_kg

    @property
    def wheel_inertia_kg_m2(self) -> float:
        """Moment of inertia of one wheel about its axle, without the rotor."""
        return 0.5 * self.wheel_mass_kg * self.wheel_radius_m**2

    @property
    def wheel_position_m(self) -> np.ndarray:
        """(4, 2) place of the wheels ahead of and to the left of the centre of gravity."""
        x, y = (self.front_m, self.front_m, -self.rear_m, -self.rear_m), 0.5 * self.track_m
        return np.column_stack([x, (y, -y, y, -y)])

    @property
    def static_load_N(self) -> np.ndarray:
        """(4,) normal load of the wheels at rest on level ground."""
        share = np.array([self.rear_m, self.rear_m, self.front_m, self.front_m]) / (self.front_m + self.rear_m)
        return 0.5 * share * self.mass_kg * GRAVITY


_POSITIVE = (
    "mass_kg",
    "wheel_mass_kg",
    "wheel_radius_m",
    "wheel_width_m",
    "front_m",
    "rear_m",
    "track_m",
    "body_m",
    "centre_height_m",
    "slip_stiffness_s_per_m",
    "contact_stiffness_N_per_m",
    "contact_damping_N_s_per_m",
)
