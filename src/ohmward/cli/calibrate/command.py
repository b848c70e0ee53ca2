"""`ohmward calibrate`: radius, motors and floors of a robot, from drives whose true motion is known."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli import wording
from ohmward.cli.driving import add_drive_options, make_robot, read_drive_log, read_drive_truth, truth_columns
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_output_options
from ohmward.cli.progress import progress
from ohmward.cli.reading import split_selection
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95

if TYPE_CHECKING:
    from ohmward.logs import DriveLog
    from ohmward.traction import Robot
    from ohmward.traction.calibration import CalibrationDrive, Parameter
    from ohmward.traction.terrain.floor import Floor

_EXAMPLES = """\
  ohmward calibrate drive.csv --robot start.toml --truth speed_true_m_s -o robot.toml
  ohmward calibrate table.parquet --each exp --robot robotino --motor-shaft --pose xpos,ypos,ang \\
      --pose-scale 1.84046e-3,-1.83716e-3 --pose-turn 91.4 --wheel-load 30.4,49.5,30.3 -o robot.toml
  ohmward calibrate carpet.csv --robot robot.toml --truth gnss_speed --floor carpet --floors floors.toml
  ohmward slip day.csv --robot robot.toml --floors floors.toml
"""
WHAT = ("radius", "motor")
PARAMETERS = ["parameter", "value", "95 % interval", ""]


class Result(NamedTuple):
    """The calibrated robot, its parameters, and the floor if one was learnt."""

    robot: Robot
    parameters: tuple[Parameter, ...]
    floor: Floor | None
    drives: tuple[CalibrationDrive, ...]


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    what = "radius, motors and floors of a robot, from drives whose true motion is known"
    parser = add_command(commands, "calibrate", what, _EXAMPLES)
    parser.add_argument("logs", nargs="+", metavar="LOG", help="drives on one floor: CSV or Parquet")
    group = parser.add_argument_group("robot and floor")
    group.add_argument("--robot", required=True, metavar="FILE.toml", help="what is known before; rlma or robotino")
    group.add_argument("--what", metavar="LIST", help=f"of {','.join(WHAT)} (default: both, or neither with --floor)")
    group.add_argument("--floor", metavar="NAME", help="learn the floor of these drives; the robot must be calibrated")
    group.add_argument("--floors", metavar="FILE.toml", help="where the floor goes, beside those that it has")
    group.add_argument(
        "--rolling", type=floats, metavar="C[,STD]", help="rolling resistance of the floor over the load"
    )
    group.add_argument("--wheel-load", type=floats, metavar="N,N,...", help="load of each wheel as weighed [N]")
    add_truth_options(parser)
    parser.add_argument("--each", metavar="COLUMN", help="every value of this column is a recording of its own")
    add_drive_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the robot file")
    parser.set_defaults(run=run)


def add_truth_options(parser: argparse.ArgumentParser) -> None:
    """How the body really moved: from speeds, or from a pose."""
    group = parser.add_argument_group("the true motion")
    group.add_argument("--truth", metavar="COLUMN[,...]", help="columns of speed, yaw rate and lateral speed")
    group.add_argument("--pose", metavar="X,Y,HEADING", help="columns of the pose that a camera or total station saw")
    group.add_argument("--pose-scale", type=floats, default=[1.0], metavar="SX[,SY]", help="metres per unit of X and Y")
    group.add_argument("--pose-turn", type=float, default=0.0, metavar="DEG", help="added to the heading [degrees]")
    group.add_argument("--pose-unit", choices=("deg", "rad"), default="deg", help="of the heading (default deg)")


def run(args: argparse.Namespace) -> Outcome:
    """Calibrate, write the robot and its floors."""
    check(args)
    robot = weighed_robot(make_robot(args.robot), args.wheel_load)
    with progress() as report:
        drives = read_drives(args, robot, report)
        result = calibrate(drives, robot, wanted(args), args.floor, args.rolling)
    write(result, args)

    def page():
        from ohmward.cli.calibrate.report import make_page

        return make_page(result, figures)

    figures = summary(result, args)
    return Outcome(figures, describe(result, figures), figures["notes"], page)


def check(args: argparse.Namespace) -> None:
    """Refuse what cannot work before anything is read.

    Raises:
        InputError: no truth or two, a floor without its file, or a file that cannot be written.
    """
    if (args.truth is None) == (args.pose is None):
        raise InputError("give either --truth COLUMN, a measured speed, or --pose X,Y,HEADING; see --help")
    if (args.floor is None) != (args.floors is None):
        raise InputError("--floor NAME and --floors FILE.toml belong together: the floor's name, and where it is kept")
    inputs = [str(split_selection(text)[0]) for text in args.logs]
    check_output("--output", args.output, (".toml",), inputs)
    check_output("--floors", args.floors, (".toml",), inputs)


def wanted(args: argparse.Namespace) -> tuple[str, ...]:
    """What to calibrate of the robot.

    Raises:
        InputError: something else.
    """
    if args.what is None:
        return () if args.floor else WHAT
    names = tuple(name.strip() for name in args.what.split(","))
    if unknown := [name for name in names if name not in WHAT]:
        raise InputError(f"--what takes {', '.join(WHAT)}, separated by commas; got {unknown[0]!r}")
    return names


def calibrate(
    drives: tuple[CalibrationDrive, ...],
    robot: Robot,
    what: tuple[str, ...],
    floor: str | None,
    rolling: list[float] | None,
) -> Result:
    """Radius first, then the motors with it, then the floor with both."""
    from ohmward.traction.calibration import calibrate_motor, calibrate_radius, learn_floor, with_parameters
    from ohmward.traction.calibration.motor import ROLLING

    found: list[Parameter] = []
    if "radius" in what:
        found.append(calibrate_radius(drives, robot))
        robot = with_parameters(robot, found)
    if "motor" in what:
        known = ROLLING if rolling is None else (rolling[0], rolling[1] if len(rolling) > 1 else 0.5 * rolling[0])
        found += calibrate_motor(drives, robot, known)
        robot = with_parameters(robot, found)
    return Result(robot, tuple(found), learn_floor(floor, drives, robot) if floor else None, drives)


def read_drives(args: argparse.Namespace, robot: Robot, report: Any) -> tuple[CalibrationDrive, ...]:
    """The recordings that the arguments name, with the motion of the body."""
    texts = [one for text in args.logs for one in recordings(text, args.each)]
    drives = []
    for k, text in enumerate(texts):
        drives.append(read_one(text, robot, args))
        if report:
            report("reading", (k + 1) / len(texts))
    return tuple(drives)


def recordings(text: str, each: str | None) -> list[str]:
    """The file with each value of the column `each`, in order; the file itself without one.

    Raises:
        InputError: no such column.
    """
    if each is None:
        return [text]
    import numpy as np

    from ohmward.logs.read import open_table

    path, where = split_selection(text)
    file = open_table(path)
    if each not in file.names:
        raise InputError(f"{path}: there is no column {each!r} for --each; it has: {', '.join(file.names)}")
    values = np.unique(np.asarray(file.load({each}).columns[each], dtype=float))
    chosen = "".join(f"{name}={value}," for name, value in where.items())
    return [f"{path}:{chosen}{each}={value:g}" for value in values[np.isfinite(values)]]


def read_one(text: str, robot: Robot, args: argparse.Namespace) -> CalibrationDrive:
    """One recording with the motion of the body."""
    from ohmward.traction.calibration import CalibrationDrive

    names = truth_columns(args.truth) if args.truth else [name.strip() for name in args.pose.split(",")]
    log = read_drive_log(text, robot, args, leave=names)
    if args.pose:
        return CalibrationDrive(log, pose_motion(log, names, args, robot))
    truth = read_drive_truth(log, robot, args.truth).values
    return CalibrationDrive(log, speed_motion(robot, log.time_s, truth))


def speed_motion(robot: Robot, time_s: Any, truth: Any) -> Any:
    """Motion (T, freedoms) from measured speeds."""
    import numpy as np

    from ohmward.traction.calibration import motion_from_speed
    from ohmward.traction.calibration.truth import between

    if robot.freedoms == 3 and truth.lateral_speed_m_s is not None and truth.yaw_rate_rad_s is not None:
        columns = truth.speed_m_s, truth.lateral_speed_m_s, truth.yaw_rate_rad_s
        return np.column_stack([between(time_s, column) for column in columns])
    return motion_from_speed(robot, time_s, truth.speed_m_s, truth.yaw_rate_rad_s)


def pose_motion(log: DriveLog, names: list[str], args: argparse.Namespace, robot: Robot) -> Any:
    """Motion (T, freedoms) from a pose.

    Raises:
        InputError: not three columns, or one that the log does not have.
    """
    import numpy as np

    from ohmward.traction.calibration import motion_from_pose

    if len(names) != 3 or any(name not in log.extra for name in names):
        raise InputError(
            f"{log.name}: --pose takes three columns X,Y,HEADING of the log, got {args.pose!r}; "
            f"it has: {', '.join(log.extra)}"
        )
    x, y, heading = (log.extra[name] for name in names)
    scale = np.radians(1.0) if args.pose_unit == "deg" else 1.0
    turned = scale * heading + np.radians(args.pose_turn)
    motion = motion_from_pose(log.time_s, args.pose_scale[0] * x, args.pose_scale[-1] * y, turned)
    return motion if robot.freedoms == 3 else motion[:, [0, 2]]


def weighed_robot(robot: Robot, loads: list[float] | None) -> Robot:
    """The robot with its wheels' loads as weighed, its mass their sum.

    Raises:
        InputError: a sum that is far from the robot's weight.
    """
    from dataclasses import replace

    from ohmward.traction.robot.robot import GRAVITY

    if loads is None:
        return robot
    weight, found = robot.mass_kg * GRAVITY, sum(loads)
    if not weight / 3 < found < 3 * weight:
        raise InputError(
            f"--wheel-load adds up to {found:.4g} N, the robot file's mass weighs {weight:.4g} N; "
            "give newtons, not kilograms or grams, or correct robot.mass_kg"
        )
    return replace(robot, mass_kg=found / GRAVITY, wheel_load_N=tuple(loads))


def write(result: Result, args: argparse.Namespace) -> None:
    """The files that the options name."""
    from ohmward.traction import save_robot
    from ohmward.traction.terrain.file import Floors, load_floors, save_floors

    if args.output:
        save_robot(result.robot, args.output)
    if args.floors and result.floor:
        known = load_floors(args.floors) if Path(args.floors).exists() else Floors(result.robot.name)
        save_floors(known.with_floor(result.floor), args.floors)


def summary(result: Result, args: argparse.Namespace) -> dict[str, Any]:
    """The object of --json."""
    from dataclasses import asdict

    notes = dict.fromkeys(str(note) for drive in result.drives for note in drive.log.notes if note.level != "info")
    return {
        "command": "calibrate",
        "robot": result.robot.name,
        "drives": len(result.drives),
        "duration_s": sum(drive.log.duration_s for drive in result.drives),
        "parameters": [{**p._asdict(), "identified": p.identified} for p in result.parameters],
        "floor": asdict(result.floor) if result.floor else None,
        "notes": list(notes),
        "output": args.output,
        "floors": args.floors,
        "report": args.report,
    }


def describe(result: Result, figures: dict[str, Any]) -> str:
    """The same for people."""
    title = (
        f"robot {result.robot.name!r}: {figures['drives']} drive{'s' if figures['drives'] > 1 else ''}, "
        f"{wording.duration(figures['duration_s'])}"
    )
    files = {"robot file": figures["output"], "floors": figures["floors"]}
    written = [f"{name}: {path}" for name, path in files.items() if path]
    return wording.paragraphs(
        title,
        wording.table(PARAMETERS, parameter_rows(result)) if result.parameters else "",
        wording.fields(floor_fields(result.floor)) if result.floor else "",
        wording.bullets("Not identified", [f"{p.name}: {p.reason}" for p in result.parameters if not p.identified]),
        wording.bullets("Assumed", figures["notes"]),
        "\n".join(written) or "No robot file written; name one with -o.",
    )


def parameter_rows(result: Result) -> list[list[str]]:
    """Each parameter with its interval."""
    return [
        [
            p.name,
            f"{p.value:.4g}",
            f"{p.value - BAND_95 * p.std:.4g} to {p.value + BAND_95 * p.std:.4g}" if p.identified else "-",
            "" if p.identified else "kept",
        ]
        for p in result.parameters
    ]


def floor_fields(floor: Floor) -> dict[str, str]:
    """What was learnt of a floor, with its sigmas."""
    return {
        "floor": floor.name,
        "stiffness": f"{floor.stiffness:.3g} ± {wording.percent(BAND_95 * floor.stiffness_std, 0)} (95 %)",
        "friction": f"{floor.friction:.3g} ± {wording.percent(BAND_95 * floor.friction_std, 0)} (95 %)",
        "slip left unexplained": f"{floor.slip_std:.3f} of each wheel from drive to drive",
        "rolling, rollers": f"{floor.rolling:.3f}, {floor.roller:.3f} of the load",
    }


def floats(text: str) -> list[float]:
    """Numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers separated by commas, got {text!r}") from None
