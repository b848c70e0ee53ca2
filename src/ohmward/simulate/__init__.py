"""Simulated batteries, missions and sensors, clearly named as simulated."""

from ohmward.simulate.cells import BATTERIES
from ohmward.simulate.plant import resting_state, simulate
from ohmward.simulate.profile import Profile
from ohmward.simulate.robot_day import RobotDay, make_robot_day, write_robot_day

__all__ = [
    "BATTERIES",
    "Profile",
    "RobotDay",
    "make_robot_day",
    "resting_state",
    "simulate",
    "write_robot_day",
]
