"""Simulated batteries, missions and sensors, clearly named as simulated."""

from ohmward_lab.simulate.cells import BATTERIES
from ohmward_lab.simulate.plant import resting_state, simulate
from ohmward_lab.simulate.profile import Profile
from ohmward_lab.simulate.robot_day import RobotDay, make_robot_day, write_robot_day

__all__ = [
    "BATTERIES",
    "Profile",
    "RobotDay",
    "make_robot_day",
    "resting_state",
    "simulate",
    "write_robot_day",
]
