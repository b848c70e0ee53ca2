"""Wheel, ground and robot: traction laws, slip, dynamics and power; see docs/traction-models.md."""

from ohmward.traction.dynamics.forces import RobotInput, forces, rates, scene
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.friction.terrain import (
    CompactionResistance,
    RollingResistance,
    Terrain,
    hard_terrain,
    soft_terrain,
)
from ohmward.traction.inbox import SensorInbox
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.robot.chassis import Differential, Mecanum, Omni, SkidSteer, Steered, TwoWheeled
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.packaged import RLMA, ROBOTINO, SEEDER, load_robot
from ohmward.traction.robot.robot import Robot, Wheel, save_robot

__all__ = [
    "RLMA",
    "ROBOTINO",
    "SEEDER",
    "CompactionResistance",
    "Differential",
    "Mecanum",
    "Motor",
    "Odometry",
    "Omni",
    "Robot",
    "RobotInput",
    "RollingResistance",
    "SensorInbox",
    "SkidSteer",
    "Steered",
    "Terrain",
    "TwoWheeled",
    "Wheel",
    "forces",
    "hard_terrain",
    "load_robot",
    "rates",
    "save_robot",
    "scene",
    "slip_ratio",
    "soft_terrain",
]
