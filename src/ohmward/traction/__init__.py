"""Wheel, ground and robot: traction laws, slip, dynamics and power; see docs/traction-models.md."""

from ohmward.traction.dynamics.energy_balance import EnergyBalance, power
from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, forces, rates, scene
from ohmward.traction.dynamics.implicit_step import ALEXANDER, EULER, Step, next_state, step
from ohmward.traction.dynamics.slip import driving_slip_ratio, slip_ratio, slip_speed
from ohmward.traction.friction.rolling import CompactionResistance, RollingResistance
from ohmward.traction.friction.terrain import Terrain, hard_terrain, soft_terrain
from ohmward.traction.robot.chassis import Differential, Omni, SkidSteer
from ohmward.traction.robot.file import load_robot, save_robot
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.robot import RLMA, ROBOTINO, Robot, Wheel

__all__ = [
    "ALEXANDER",
    "EULER",
    "RLMA",
    "ROBOTINO",
    "CompactionResistance",
    "Differential",
    "EnergyBalance",
    "Forces",
    "Motor",
    "Omni",
    "Robot",
    "RobotInput",
    "RollingResistance",
    "Scene",
    "SkidSteer",
    "Step",
    "Terrain",
    "Wheel",
    "driving_slip_ratio",
    "forces",
    "hard_terrain",
    "load_robot",
    "next_state",
    "power",
    "rates",
    "save_robot",
    "scene",
    "slip_ratio",
    "slip_speed",
    "soft_terrain",
    "step",
]
