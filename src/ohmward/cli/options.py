"""Options that several commands share: logs of batteries and of drives, robot and ground, estimation, results."""

from __future__ import annotations

import argparse
from typing import Any

from ohmward.cli.parser import floats, gain_std, number, offset_std, pair, positive, share
from ohmward.logs.hints import TOPIC

#: Help of an argument that names a chemistry.
CHEMISTRY = "lfp, nmc, nca, lipo, lead-acid, lto, sodium-ion or nimh, or as the label says: LiFePO4, AGM"
#: Help of an argument that names a robot.
ROBOT = "robot file, or the name of one that comes with the package, such as rlma, turtlebot4 or husky"
DEFAULT_TERRAIN = "dry asphalt"

#: Quantities whose columns --truth of a drive may name, in this order, and their dimensions.
TRUTHS = {"speed": "speed", "yaw rate": "rotation", "lateral speed": "speed"}

#: Options of facts about a file, and their fields of `FileHints`, under which they stand among the arguments.
HINTS = {
    "--names": "names",
    "--encoding": "encoding",
    "--time-format": "time_format",
    "--timezone": "timezone",
    "--from": "start",
    "--to": "stop",
    "--sample-time": "sample_time_s",
    "--temperature": "temperature_degC",
    "--dbc": "dbc",
}

#: Word for an unknown current at rest.
UNKNOWN = "unknown"

#: Help of the argument that names a log.
LOG = (
    "a text table, Parquet, BDF, Excel, MATLAB, HDF5 or JSON file, a recording (.mcap, .bag, .db3, .ulg), a folder of "
    "files that are one log, or - for standard input"
)


def add_log_options(parser: argparse.ArgumentParser, *, interval: bool = True) -> None:
    """Options of battery logs; interval: include the time between rows."""
    group = parser.add_argument_group("reading logs (text tables, Parquet, BDF, Excel, MATLAB, HDF5, JSON, bags)")
    add_current_sign_option(
        group, "what a positive current in the file does to the battery; auto finds it from the voltage (default)"
    )
    _add_reading_options(group, "time, current, voltage or temperature", "current=mA", interval)
    _add_hint(group, "--temperature", "C", "temperature of the battery [degC], where the log has none", number)


def add_current_sign_option(group: argparse._ActionsContainer, what: str) -> None:
    """Option of the sign of a battery's current; what: its help."""
    group.add_argument("--current-sign", choices=("auto", "charge", "discharge"), default="auto", help=what)


def add_drive_options(parser: argparse.ArgumentParser, *, interval: bool = True) -> None:
    """Options of logs of drives; interval: include the time between rows."""
    group = parser.add_argument_group("reading logs of drives (text tables, Parquet, Excel, MATLAB, HDF5, JSON, bags)")
    kinds = "front_left_wheel_speed, left_motor_current, yaw_rate, speed, ..."
    _add_reading_options(group, kinds, "wheel_speed=rpm, motor_current=mA", interval)
    add_shaft_options(group)


def add_shaft_options(group: argparse._ArgumentGroup) -> None:
    """Options of how the wheel columns were measured: at the motor shaft, or as encoder counts."""
    group.add_argument(
        "--motor-shaft", action="store_true", help="wheel speeds are those of the motors, before the gear"
    )
    group.add_argument(
        "--counts-per-turn", type=positive, metavar="N", help="of the encoders, where the columns hold their counts"
    )


def add_truth_options(parser: argparse.ArgumentParser) -> None:
    """Options of the columns of the true motion: speeds, or a pose."""
    group = parser.add_argument_group("the true motion (default: the log's speed from outside, and its gyro)")
    group.add_argument("--truth", metavar="COLUMN[,...]", help="columns of speed, yaw rate and lateral speed")
    group.add_argument("--pose", metavar="X,Y,HEADING", help="columns of the pose from a camera, or its topic")
    group.add_argument("--pose-scale", type=floats, default=[1.0], metavar="SX[,SY]", help="metres per unit of X and Y")
    group.add_argument("--pose-turn", type=float, default=0.0, metavar="DEG", help="added to the heading [degrees]")
    group.add_argument("--pose-unit", choices=("deg", "rad"), default="deg", help="of the heading (default deg)")


def add_soc_options(parser: argparse.ArgumentParser) -> None:
    """Options of `soc` and `compare`: log, battery, start and truth."""
    parser.add_argument("log", metavar="LOG", help=LOG)
    parser.add_argument(
        "--battery", required=True, metavar="FILE.toml", help="battery file, made by `ohmward identify`"
    )
    group = parser.add_argument_group("estimation")
    add_start_options(group, "state of charge at the start, 0 to 1; default: from the voltage")
    group.add_argument(
        "--rest-current",
        type=rest_current,
        metavar="A",
        help="true current of a rest: 0 in a laboratory, minus the idle draw on a robot, 'unknown' tells the filter "
        "nothing; default: the battery file's",
    )
    group.add_argument(
        "--truth",
        metavar="COLUMN",
        help="reference in the log: a share, percent or Ah counter; 'a - b' for a counter of each direction",
    )
    group.add_argument(
        "--truth-start", type=share, metavar="S", help="state of charge at which an Ah counter starts, 0 to 1"
    )
    add_sensor_options(group)
    add_log_options(parser)


def add_start_options(group: argparse._ActionsContainer, start: str) -> None:
    """Options of the state of charge at the start and of its standard deviation; start: help of the former."""
    group.add_argument("--initial-soc", type=share, metavar="S", help=start)
    group.add_argument(
        "--initial-soc-std", type=positive, default=0.03, metavar="S", help="how sure that is (default %(default)s)"
    )


def add_sensor_options(
    group: argparse._ActionsContainer, offset: str = "the battery file's", gain: str = "the battery file's"
) -> None:
    """Options of current and voltage sensor, for a parser or a group of one.

    offset, gain: defaults of the current sensor, as the help gives them.
    """
    group.add_argument(
        "--sensor-offset",
        type=offset_std,
        metavar="A",
        help=f"standard deviation of the current sensor's offset [A], from its data sheet; default: {offset}",
    )
    group.add_argument(
        "--sensor-gain",
        type=gain_std,
        metavar="SHARE",
        help=f"that of its gain, as a share: 0.02 for 2 %%; default: {gain}",
    )
    group.add_argument(
        "--voltage-gain",
        type=gain_std,
        metavar="SHARE",
        help="that of the gain of the voltage sensor, where it is not the one of the test: 0.005 for 0.5 %%; default: "
        "the battery file's, else 0",
    )


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """Options of the result."""
    group = parser.add_argument_group("results")
    group.add_argument("--json", action="store_true", help="print one JSON object on standard output and nothing else")
    group.add_argument("--report", metavar="FILE.html", help="write a page with plots, one file that needs no network")


def rest_current(text: str) -> float | str:
    """A current [A], or `UNKNOWN`."""
    return UNKNOWN if text == UNKNOWN else number(text)


def add_initial_soc_option(group: argparse._ArgumentGroup, where: str) -> None:
    """Option for the state of charge at the start of one log or of all; where: the case in which it is needed."""
    group.add_argument(
        "--initial-soc",
        type=initial_soc,
        action="append",
        default=[],
        metavar="[LOG=]S",
        help=f"state of charge at the start of the logs, or of the log of this name, where {where}",
    )


def initial_soc(text: str) -> tuple[str, float]:
    """Name of the log ("" for all logs) and state of charge, from `test=0.8` or `0.8`."""
    name, _, value = text.rpartition("=")
    return name, share(value)


def _add_reading_options(group: argparse._ArgumentGroup, kinds: str, unit: str, interval: bool) -> None:
    """Options of the columns and rows of a file, of properties that it does not state, and of the part to be read.

    kinds: kinds of columns.  unit: an example.  interval: include the time between rows.
    """
    for option, metavar, text in (
        ("--column", "KIND=NAME", f"the column of {kinds}"),
        ("--unit", "KIND=UNIT", f"its unit, where the name is silent or wrong: {unit}"),
        ("--where", "NAME=VALUE", "only the rows with this value, where a file holds several recordings"),
    ):
        what = f"{text}; may be repeated"
        group.add_argument(option, metavar=metavar, type=pair, action="append", default=[], help=what)
    group.add_argument(
        "--topic",
        metavar="/A,/B",
        type=lambda names: (TOPIC, names),
        action="append",
        dest="where",
        help="topics of a recording of ROS or PX4, where types are ambiguous or several have the same type",
    )
    group.add_argument("--sort-time", action="store_true", help="sort rows that are out of order")
    for option, metavar, text in (
        ("--names", "A,B,C", "names of all columns of a table without a header"),
        ("--encoding", "NAME", "encoding of a text, where it cannot be recognised: cp1251, shift_jis"),
        ("--time-format", "FORMAT", "notation of dates: '%%d/%%m/%%Y %%H:%%M:%%S', or excel for serial dates"),
        ("--timezone", "ZONE", "zone of dates that name none: Europe/Berlin (UTC unless given)"),
        ("--from", "TIME", "start of the part to use: seconds of the log, h:mm:ss, or a date"),
        ("--to", "TIME", "its end, not included"),
        ("--dbc", "FILE", "database of the bus (DBC, KCD, SYM, ARXML), of a recording of CAN frames"),
    ):
        _add_hint(group, option, metavar, text)
    if interval:
        _add_hint(group, "--sample-time", "S", "interval between rows [s], where the log has no time", positive)


def _add_hint(group: argparse._ArgumentGroup, option: str, metavar: str, text: str, type_: Any = str) -> None:
    group.add_argument(option, dest=HINTS[option], type=type_, metavar=metavar, help=text)
