"""Robots and grounds that the tests share."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ohmward.trace import Kernel
from ohmward.traction import (
    RLMA,
    ROBOTINO,
    Differential,
    Motor,
    RobotInput,
    RollingResistance,
    SkidSteer,
    Terrain,
    hard_terrain,
    soft_terrain,
)
from ohmward.traction.friction.law import Brush, CoulombCreep, SoftGround, WardIagnemma
from ohmward.traction.friction.terrain import ROADS, SOILS
from ohmward_lab.simulate.implicit_step import ALEXANDER, next_state

LOAD_N = 100.0

LAWS: dict[str, Any] = {
    "ward-iagnemma": WardIagnemma(0.7, 20.0),
    "ward-iagnemma with peak": WardIagnemma.with_peak(0.8, 0.55, 0.1),
    "burckhardt": ROADS["wet asphalt road"],
    "brush": Brush(0.7, 0.05, 4e5),
    "brush with lead": Brush(0.7, 0.05, 4e5, lead_length_m=0.01),
    "coulomb creep": CoulombCreep(0.6, 6.2),
    "soft ground": SoftGround(SOILS["LETE sand"], 0.12, 0.05),
}

LOSSY = Motor(
    torque_constant_Nm_per_A=0.05,
    resistance_ohm=0.4,
    gear_ratio=20.0,
    gear_efficiency=0.8,
    friction_Nm=0.2,
    damping_Nms_per_rad=0.01,
    rotor_inertia_kg_m2=1e-5,
)
HARD = Terrain("rubber on a hard floor", WardIagnemma(0.7, 20.0), RollingResistance(), "tests")
SLIPPERY = Terrain("slippery floor", WardIagnemma(0.2, 20.0), RollingResistance(), "tests")

#: RLMA with its weight at the ground: no load moves, so that closed forms hold.
LOW = replace(RLMA, height_m=0.0)
ROBOTS = {
    "front-driven": LOW,
    "front-driven, lossy, high": replace(RLMA, motor=LOSSY, height_m=0.15),
    "all driven": replace(LOW, chassis=Differential(0.314, 0.314, 0.30, driven="all")),
    "skid-steer": replace(RLMA, chassis=SkidSteer(0.35, 0.25, 0.30), height_m=0.15),
    "omni": ROBOTINO,
}

TERRAINS = {
    "hard": HARD,
    "asphalt": hard_terrain("dry asphalt"),
    "ice": hard_terrain("ice"),
    "soil": soft_terrain("firm soil", 0.12, 0.05),
}


@cache
def plant(place, dt_s=0.01, method=ALEXANDER) -> Kernel:
    """Compiled (state, currents) -> (state, state): the robot itself."""

    def step(x, current_A):
        after = next_state(x, RobotInput(current_A), place, dt_s, method)
        return after, after

    return Kernel(step, np.zeros(len(place.robot.state_names)), np.zeros(place.robot.driven))
