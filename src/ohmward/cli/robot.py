"""`ohmward robot`: a robot file from sizes, a drive, a URDF or a name; what is in one."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.atomic import back_up
from ohmward.cli.calibrate import PARAMETERS, parameter_facts, parameter_rows
from ohmward.cli.drive_inputs import drive_options, read_calibration_drive
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.wording import bullets, paragraphs, table
from ohmward.errors import InputError
from ohmward.logs.selection import split_selection
from ohmward.onboard.sources.ros2 import wheel_of
from ohmward.traction.calibration.parameters import Parameter
from ohmward.traction.calibration.sizes import Sizes, robot_from_drives
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.packaged import PACKAGED, generic_robot, load_robot
from ohmward.traction.robot.robot import CHASSIS, Robot, save_robot
from ohmward.traction.robot.urdf import read_urdf

_GENERIC = "motors and yaw inertia: as usual for these sizes; `ohmward calibrate` finds what they are"
#: Layout of a robot whose log has the speeds of four wheels.
_FOUR_WHEELS = "skid-steer"


class SourcedRobot(NamedTuple):
    """A robot and where it comes from; only a URDF has joints and inertial units."""

    robot: Robot
    joints: Mapping[str, str] = {}
    imu_rpy: Mapping[str, tuple[float, float, float]] = {}
    assumed: tuple[str, ...] = ()
    parameters: tuple[Parameter, ...] = ()


def run(args: argparse.Namespace) -> Outcome:
    """Write or show the robot file."""
    check_output("--output", args.output, (".toml",))
    found = _found(args)
    if args.name:
        found = found._replace(robot=replace(found.robot, name=args.name))
    backup = back_up(Path(args.output)) if args.output else None
    if args.output:
        save_robot(found.robot, args.output)
    summary = {
        "command": "robot",
        **_facts(found.robot),
        "wheels": [place._asdict() for place in found.robot.places],
        "joints": found.joints,
        "imu_rpy": found.imu_rpy,
        "assumed": list(found.assumed),
        "parameters": [parameter_facts(p) for p in found.parameters],
        "output": args.output,
        "backup": str(backup) if backup else None,
    }
    return Outcome(summary, _text(found, args.output, backup), found.assumed)


def _found(args: argparse.Namespace) -> SourcedRobot:
    """The robot that the options name."""
    sizes = {"--mass": args.mass, "--radius": args.radius, "--track": args.track}
    source = args.source or ""
    if source.lower().endswith((".urdf", ".xacro", ".xml")):
        return SourcedRobot(*read_urdf(source, args.radius, args.mass))
    if (
        source.lower() in PACKAGED
        or source.endswith(".toml")
        or (source and not Path(split_selection(source)[0]).exists())
    ):
        if given := [option for option, size in sizes.items() if size is not None]:
            raise InputError(f"{', '.join(given)}: {source} has its own; write it with -o and edit that")
        return SourcedRobot(load_robot(source))
    missing = [option for option, size in sizes.items() if size is None]
    if source and "--mass" in missing:
        raise InputError(f"no drive shows the mass of a robot; give --mass KG beside {source}")
    if source:
        return _from_drive(source, args)
    if len(missing) == len(sizes):
        known = ", ".join(PACKAGED)
        raise InputError(f"give a URDF, a robot file, one of {known}, a drive and --mass, or {', '.join(sizes)}")
    if missing:
        raise InputError(f"a robot needs {' and '.join(missing)} too")
    robot = generic_robot(args.mass, args.radius, args.track, args.wheelbase, args.gear, args.layout)
    return SourcedRobot(robot, assumed=(_GENERIC,))


def _from_drive(source: str, args: argparse.Namespace) -> SourcedRobot:
    """The robot whose sizes a drive shows."""
    sizes = Sizes(args.mass, args.radius, args.track, args.wheelbase, args.gear, args.layout)
    start = sizes.start()
    options = drive_options(args, start)._replace(radius_m=args.radius or math.nan)
    try:
        drive = read_calibration_drive(source, start, options, args)
    except InputError as error:
        other = sizes._replace(layout=_FOUR_WHEELS)
        if sizes.layout == _FOUR_WHEELS or not _reads(source, other, args):
            raise
        text = f"{source} has the wheels of a {_FOUR_WHEELS} robot; give --layout {_FOUR_WHEELS}, or: {error}"
        raise InputError(text, ("--layout", _FOUR_WHEELS)) from None
    found = robot_from_drives([drive], sizes)
    notes = [_GENERIC, *map(str, found.drives[0].log.notes), *map(str, found.notes)]
    return SourcedRobot(found.robot, assumed=tuple(notes), parameters=found.parameters)


def _reads(source: str, sizes: Sizes, args: argparse.Namespace) -> bool:
    """True if a drive has the columns of a robot of these sizes."""
    robot = sizes.robot()
    try:
        read_calibration_drive(source, robot, drive_options(args, robot)._replace(radius_m=math.nan), args)
    except InputError:
        return False
    return True


def _facts(robot: Robot) -> dict[str, Any]:
    """Key figures of a robot, for `--json` and for people."""
    return {
        "name": robot.name,
        "chassis": CHASSIS[type(robot.chassis)],
        "mass_kg": robot.mass_kg,
        "yaw_inertia_kg_m2": robot.yaw_inertia_kg_m2,
        "height_m": robot.height_m,
        "wheel_radius_m": robot.wheel.radius_m,
    }


def _text(found: SourcedRobot, output: str | None, backup: Path | None) -> str:
    """Facts, the places of the wheels, what was assumed, and what to do next."""
    robot, facts = found.robot, _facts(found.robot)
    other = ", steers" if isinstance(robot.chassis, Steered) else ", rolls along"
    places = [
        f"  {p.name:<12} {p.x_m:+.3f} m ahead, {p.y_m:+.3f} m left{'' if p.driven else other}" for p in robot.places
    ]
    unlike = {wheel: joint for wheel, joint in found.joints.items() if wheel_of(joint) != wheel}
    named = ", ".join(f'{wheel} = "{joint}"' for wheel, joint in unlike.items())
    settings = [f"joints = {{ {named} }}"] if named else []
    settings += [f"imu_rpy = {[round(angle, 4) for angle in rpy]}  # {name}" for name, rpy in found.imu_rpy.items()]
    following = [
        f"ohmward slip drive.csv --robot {shlex.quote(output or '')} --report slip.html",
        f"ohmward calibrate drive.csv --robot {shlex.quote(output or '')} ..., from drives whose true motion is known",
    ]
    return paragraphs(
        f"{facts['name']}: {facts['chassis']}, {robot.mass_kg:g} kg, wheels of {robot.wheel.radius_m:.4g} m",
        "\n".join(places),
        table(PARAMETERS, parameter_rows(found.parameters)) if found.parameters else "",
        bullets("Not identified", [f"{p.name}: {p.reason}" for p in found.parameters if not p.identified]),
        "\n  ".join(["Of the [[source]] of ROS 2 in the setup of `run`:", *settings]) if settings else "",
        f"robot file: {output}" + (f"; before: {backup}" if backup else "") if output else "",
        bullets("Next", following) if output else "",
    )
