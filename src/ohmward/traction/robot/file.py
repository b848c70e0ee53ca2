"""Robot file: one robot as TOML that people read and edit. Units are part of the names; every key is known."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from ohmward.errors import InputError
from ohmward.toml_file import TomlFile
from ohmward.traction.robot.chassis import Differential, Omni, SkidSteer, TwoWheeled
from ohmward.traction.robot.robot import RLMA, ROBOTINO, SEEDER, Robot

#: Robots that need no file.
PACKAGED: Mapping[str, Robot] = {"rlma": RLMA, "robotino": ROBOTINO, "seeder": SEEDER}

#: What `kind` in the table [chassis] may be.
CHASSIS: Mapping[type, str] = {
    Differential: "differential",
    SkidSteer: "skid-steer",
    TwoWheeled: "two-wheel",
    Omni: "omni",
}
_HEADER = """\
# A robot as ohmward knows it. Edit what you know better; every key carries its unit.
# x points forward, y to the left, both from the centre of gravity. [chassis] kind is one of:
#   differential (front_m, rear_m, track_m, driven = "front" or "all"), skid-steer (front_m, rear_m, track_m, and
#   effective_track_m once it is calibrated), two-wheel (axle_m, track_m, casters_m), omni (arm_m, bearings_deg).
# [motor] is each of the motors: constant, resistance and rotor of the bare motor, friction and damping at the wheel.
"""
#: Its `dump` and `parse` give and take the text.
ROBOT_FILE = TomlFile(Robot, "ohmward-robot/1", _HEADER, digits=9, kinds=CHASSIS)


def save_robot(robot: Robot, path: str | PathLike[str]) -> None:
    """Write the robot file; it is either whole or not there.

    Raises:
        OhmwardError: the file cannot be written.
    """
    ROBOT_FILE.save(robot, path)


def load_robot(path: str | PathLike[str]) -> Robot:
    """The robot in a file, or a packaged one by its name, see `PACKAGED`.

    Raises:
        InputError: the file cannot be read, or no robot can be as it says; names file, key, rule and fix.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(f"a robot must be a Robot, or the path or name of one, got {type(path).__name__}")
    if robot := PACKAGED.get(str(path).lower()):
        return robot
    if not Path(path).suffix and not Path(path).exists():
        raise InputError(f"robot must be a robot file or one of {', '.join(PACKAGED)}, got {str(path)!r}")
    return ROBOT_FILE.load(path)
