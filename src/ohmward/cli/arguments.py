"""Arguments of every command, with examples of its use in the docstring of its function, from which `--help` has them.

This imports little, so that `--help` and a mistyped option are answered at once; a module `cli.NAME` does the work.
"""

from __future__ import annotations

import argparse
import re
from datetime import datetime
from socket import gethostname

from ohmward.cli.options import (
    CHEMISTRY,
    DEFAULT_TERRAIN,
    LOG,
    ROBOT,
    TRUTHS,
    add_current_sign_option,
    add_drive_options,
    add_initial_soc_option,
    add_log_options,
    add_output_options,
    add_sensor_options,
    add_shaft_options,
    add_soc_options,
    add_start_options,
    add_truth_options,
)
from ohmward.cli.parser import count, floats, number, pair, positive, share


def doctor(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward doctor`.

    ohmward doctor test.csv
    ohmward doctor test.csv day.csv --report logs.html
    ohmward doctor battery.toml robot.toml
    ohmward doctor drive.csv --robot robot.toml
    ohmward doctor test.csv --column current=current_A --unit current=A --json
    """
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a log of a battery, a drive or both (any format of docs/logs.md, - for standard input), or a file of a "
        "battery, a robot or a setup (.toml)",
    )
    add_log_options(parser)
    group = parser.add_argument_group("drives")
    group.add_argument("--robot", metavar="FILE.toml", help=f"checks the drive with it: {ROBOT}")
    add_shaft_options(group)
    add_output_options(parser)


def identify(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward identify`.

    ohmward identify test.csv --capacity-ah 12 -o battery.toml
    ohmward identify test.csv --capacity-ah 12 --chemistry lfp --n-series 4 --report identify.html -o battery.toml
    ohmward identify test.csv --capacity-ah 12 --model thevenin-1rc --initial-soc test=1.0 --json
    ohmward identify day.csv --capacity-ah 12 --n-series 3 --ocv ocv.csv --initial-soc 0.9 -o battery.toml
    ohmward identify test.csv day.csv --capacity-ah 12 --chemistry nmc --n-series 3 --initial-soc day=0.9 -o battery.toml

    A file that holds several recordings may be named several times: ocv.parquet:script=1,temp_C=25
    """  # noqa: E501
    parser.add_argument("logs", nargs="+", metavar="LOG", help="pulse tests, low-rate tests, drives of one battery")
    _add_label_options(parser.add_argument_group("the battery"))
    add_log_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the battery file")


def _add_label_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--capacity-ah", type=positive, required=True, metavar="Q", help="charge between full and empty [Ah]"
    )
    group.add_argument(
        "--model",
        default="thevenin",
        metavar="NAME",
        help="thevenin, its number of RC pairs chosen by evidence, or thevenin-0rc to thevenin-3rc, or rc (default "
        "%(default)s)",
    )
    group.add_argument("--chemistry", default="", metavar="NAME", help=CHEMISTRY)
    group.add_argument("--n-series", type=count, default=1, metavar="N", help="cells in series (default 1)")
    group.add_argument("--name", default="", help="what to call the battery; default: the first log's name")
    add_initial_soc_option(group, "they do not show it")
    group.add_argument(
        "--ocv",
        metavar="FILE",
        help="table of the open-circuit voltage that you have, of a cell or of the pack: columns soc (0 to 1 or "
        "percent) and ocv_V, or ocv_charge_V and ocv_discharge_V; optional dV/dT; no low-rate test is needed then",
    )
    group.add_argument(
        "--idle-current",
        type=number,
        metavar="A",
        help="what flows at every rest, <= 0: 0 in a laboratory, -0.7 on a robot that draws 0.7 A; goes into the "
        "battery file, and then each rest shows the current sensor's offset (default: not declared)",
    )
    add_sensor_options(group, "2.5 %% of 1 C", "1 %%")


def learn(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward learn`.

    ohmward learn day.csv --battery battery.toml --dry-run
    ohmward learn day.csv --battery battery.toml -o battery.toml --report learn.html
    ohmward learn 'logs/*.csv' --battery battery.toml -o battery.toml --json
    ohmward learn fleet-logs/ --battery type.toml -o batteries/

    With a folder as --output every battery gets a file of its own, named by the serial number in its logs.
    """
    parser.add_argument(
        "logs",
        nargs="+",
        metavar="LOG",
        help="drives, charges, rests, days or weeks of one battery, the oldest first: files, patterns or folders",
    )
    parser.add_argument(
        "--battery",
        required=True,
        metavar="FILE.toml",
        help="file to start from, made by `generic`, `identify` or `learn`",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE.toml",
        help="battery file to write; one that is there is kept as FILE.toml.bak. A folder takes one file for each "
        "serial number",
    )
    parser.add_argument("--dry-run", action="store_true", help="say what would change, and write no battery file")
    group = parser.add_argument_group("the battery")
    add_initial_soc_option(group, "it is known")
    add_sensor_options(group)
    add_log_options(parser)
    add_output_options(parser)


def generic(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward generic`.

    ohmward generic --chemistry lfp --capacity-ah 12 --n-series 4 -o battery.toml
    ohmward generic --chemistry nmc --capacity-ah 2.0 --name cell -o cell.toml --json
    ohmward generic --bpx cell.json --chemistry nmc --n-series 4 -o battery.toml
    ohmward generic --type-of cell-1.toml cell-2.toml --n-series 4 -o battery.toml
    """
    parser.add_argument("--chemistry", metavar="NAME", help=f"{CHEMISTRY}; of --type-of that of its files")
    parser.add_argument(
        "--capacity-ah", type=positive, metavar="Q", help="as on the label [Ah]; with --bpx, of all strings"
    )
    parser.add_argument(
        "--bpx",
        metavar="FILE.json",
        help="parameters of the cell in the Battery Parameter eXchange format: its curve and resistances",
    )
    parser.add_argument(
        "--type-of",
        nargs="+",
        metavar="FILE.toml",
        help="files of several batteries of one product, each identified from its own tests: the new one has what they "
        "have in common, and is in doubt by what they differ by",
    )
    parser.add_argument(
        "--n-series", type=count, metavar="N", help="cells in series (default 1, of --type-of as many as they have)"
    )
    parser.add_argument("--name", default="", help="what to call the battery; default: generic and the chemistry")
    add_sensor_options(parser, "2.5 %% of 1 C", "1 %%")
    parser.add_argument("-o", "--output", required=True, metavar="FILE.toml", help="write the battery file")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def soc(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward soc`.

    ohmward soc day.csv --battery battery.toml
    ohmward soc day.csv --battery battery.toml --initial-soc 1.0 --filter ukf -o estimates.csv --report soc.html
    ohmward soc day.csv --battery battery.toml --truth soc_true --json
    """
    add_soc_options(parser)
    parser.add_argument(
        "--filter",
        default="default",
        metavar="NAME",
        help="ekf, ukf, gsf, rc, textbook-ekf, textbook-ukf, coulomb or ocv (default gsf); as "
        "published: published.aekf, published.aukf, published.hybrid, published.rc-kf",
    )
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv, .parquet or .mcap")


def compare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward compare`.

    ohmward compare day.csv --battery battery.toml
    ohmward compare day.csv --battery battery.toml --truth soc_true --report compare.html
    ohmward compare day.csv --battery battery.toml --truth soc_true --filters coulomb,ekf,ukf --initial-soc 0.8 --json
    """
    add_soc_options(parser)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--filters", metavar="A,B,...", help="only these; default: all that the battery file allows")
    which.add_argument("--published", action="store_true", help="with those that reproduce a publication")
    add_output_options(parser)


def health(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward health`.

    ohmward health logs/ --battery battery.toml
    ohmward health logs/ --battery battery.toml --report health.html
    ohmward health 2024-*.csv 2025-*.csv --battery new.toml --worn 0.7 --json
    """
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs of one battery, or folders of them, in any order")
    group = parser.add_argument_group("the battery")
    group.add_argument(
        "--battery",
        required=True,
        metavar="FILE.toml",
        help="battery file of the battery when new: of `ohmward identify`, or of `ohmward generic`; it stays as it is",
    )
    group.add_argument(
        "--new-capacity-ah",
        type=positive,
        metavar="Q",
        help="capacity when new that all is measured against [Ah]; default: the battery file's",
    )
    group.add_argument(
        "--worn",
        type=share,
        default=0.8,
        metavar="SHARE",
        help="share of the capacity when new at which the battery is worn out (default %(default)s)",
    )
    add_sensor_options(group)
    add_log_options(parser)
    add_output_options(parser)


def robot(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward robot`.

    ohmward robot --radius 0.06 --track 0.3 --mass 12 -o robot.toml
    ohmward robot --layout mecanum --radius 0.05 --track 0.3 --wheelbase 0.25 --mass 9 -o robot.toml
    ohmward robot --layout tricycle --radius 0.12 --track 0.6 --wheelbase 1.1 --mass 200 -o robot.toml
    ohmward robot drive.mcap --topic /odom --mass 12 -o robot.toml
    ohmward robot drive.csv --truth gnss_speed --layout car --track 0.6 --mass 40 -o robot.toml
    ohmward robot robot.urdf -o robot.toml
    ohmward robot husky -o robot.toml
    ohmward robot robot.toml
    """
    parser.add_argument(
        "source",
        nargs="?",
        metavar="FILE|NAME",
        help="a URDF, a robot file, a robot that comes with ohmward: turtlebot4, husky, jackal ..., or a drive, which "
        "shows radius and track beside a speed or pose from outside (/odom, GNSS) and a gyro; none: sizes",
    )
    parser.add_argument("--radius", type=positive, metavar="M", help="radius of the wheels [m]")
    parser.add_argument(
        "--track", type=positive, metavar="M", help="between left and right wheels, or across the circle of omni-wheels"
    )
    parser.add_argument(
        "--wheelbase", type=positive, metavar="M", help="between the axles, or from axle to caster; default: the track"
    )
    parser.add_argument("--mass", type=positive, metavar="KG", help="of the robot with its load [kg]")
    parser.add_argument("--gear", type=positive, default=1.0, metavar="N", help="turns of a motor for one of its wheel")
    parser.add_argument(
        "--layout",
        default="two-wheel",
        metavar="NAME",
        help="two-wheel: two driven wheels and a caster (default), also for a car with encoders at both rear wheels; "
        "skid-steer: four driven wheels or tracks; car: one speed, of its motor, and a steering angle; tricycle: its "
        "front wheel is driven and steered; mecanum: four wheels with rollers at 45 degrees; omni: three omni-wheels",
    )
    parser.add_argument("--name", metavar="TEXT", help="what to call the robot")
    add_truth_options(parser)
    add_drive_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the robot file; else it is only shown")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def calibrate(parser: argparse.ArgumentParser) -> None:
    r"""Add the arguments of `ohmward calibrate`.

    ohmward calibrate drive.csv --robot start.toml --truth speed_true_m_s -o robot.toml
    ohmward calibrate table.parquet --each exp --robot robotino --motor-shaft --pose xpos,ypos,ang \
        --pose-scale 1.84046e-3,-1.83716e-3 --pose-turn 91.4 --wheel-load 30.4,49.5,30.3 -o robot.toml
    ohmward calibrate carpet.csv --robot robot.toml --truth gnss_speed --floor carpet --floors floors.toml
    ohmward slip day.csv --robot robot.toml --floors floors.toml
    """
    parser.add_argument("logs", nargs="+", metavar="LOG", help=f"drives on one floor: each {LOG}")
    group = parser.add_argument_group("robot and floor")
    group.add_argument("--robot", required=True, metavar="FILE.toml", help=f"what is known before: {ROBOT}")
    group.add_argument("--what", metavar="LIST", help="of radius,track,motor (default: all shown, none with --floor)")
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


def slip(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward slip`.

    ohmward slip drive.csv --robot robot.toml
    ohmward slip drive.csv --robot rlma --terrain gravel --truth speed_true_m_s --json
    ohmward slip drive.csv --robot robot.toml -o slip.csv --report slip.html
    ohmward slip gray.parquet --robot robotino --where exp=5 --motor-shaft
    ohmward slip gray.parquet --robot robot.toml --floors floors.toml --where exp=5 --motor-shaft
    ohmward slip gray.parquet --robot robot.toml --floors floors.toml --floor gray --where exp=5 --motor-shaft
    ohmward slip husky.csv --robot husky.toml --unit wheel_speed=m/s --column yaw_rate=gyro_up
    """
    parser.add_argument("log", metavar="LOG", help=LOG)
    group = parser.add_argument_group("robot and ground")
    group.add_argument("--robot", required=True, metavar="FILE.toml", help=ROBOT)
    group.add_argument(
        "--terrain",
        default=DEFAULT_TERRAIN,
        metavar="NAME",
        help="ground that is assumed at first, 'gravel' or 'soft soil' for example (default: %(default)s)",
    )
    group = parser.add_argument_group("estimation")
    group.add_argument("--filter", default="ukf", metavar="NAME", help="ekf, aekf, ukf or aukf (default %(default)s)")
    group.add_argument(
        "--floors", metavar="FILE.toml", help="floors that `ohmward calibrate` has learnt: slip by motor currents alone"
    )
    group.add_argument(
        "--floor",
        action="append",
        default=[],
        metavar="NAME",
        help="floor of --floors that the robot drives on; repeat for several; otherwise it is recognised",
    )
    group.add_argument(
        "--truth", metavar="COLUMN[,...]", help=f"references in the log to compare with: {', '.join(TRUTHS)}"
    )
    add_drive_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv, .parquet or .mcap")


def mission(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward mission`.

    ohmward mission drive.csv --robot robot.toml --battery battery.toml -o table.toml --report drive.html
    ohmward mission day.csv --mass-kg 42 --terrain grass --battery battery.toml --column speed=gnss_speed
    ohmward mission --plan-example > plan.toml
    ohmward mission --plan plan.toml --battery battery.toml --soc 0.6 --soc-std 0.03 --consumption table.toml
    """
    parser.add_argument("log", metavar="LOG", nargs="?", help=f"battery and speed or wheels in {LOG}")
    parser.add_argument("--battery", metavar="FILE.toml", help="battery file, made by `ohmward identify`")
    parser.add_argument("--plan", metavar="FILE.toml", help="the mission ahead")
    parser.add_argument("--plan-example", action="store_true", help="print a plan with comments, and nothing else")
    robot = parser.add_argument_group("robot and ground")
    robot.add_argument("--robot", metavar="FILE.toml", help=ROBOT)
    robot.add_argument("--mass-kg", type=positive, metavar="M", help="where there is no robot file")
    robot.add_argument(
        "--terrain",
        default="ground",
        metavar="NAME",
        help="ground of the log, where it has no column 'terrain' (default: %(default)s)",
    )
    robot.add_argument("--payload-kg", type=number, default=0.0, metavar="M", help="load during the log (default 0)")
    robot.add_argument("--consumption", metavar="FILE.toml", help="what was learned before; default: from the robot")
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the consumption learnt, this log included")
    _add_charge_options(parser)
    add_log_options(parser)
    add_shaft_options(parser.add_argument_group("reading wheels"))
    add_output_options(parser)


def _add_charge_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("battery")
    group.add_argument("--soc", type=share, metavar="S", help="state of charge now; default: estimated from the log")
    group.add_argument("--soc-std", type=positive, default=0.03, metavar="S", help="how sure --soc is (%(default)s)")
    add_start_options(group, "at the log's start; default: from the voltage")
    group.add_argument(
        "--filter", default="default", metavar="NAME", help="SoC estimator, see `soc` (default %(default)s)"
    )
    group.add_argument("--reserve-soc", type=share, metavar="S", help="to be left; default: the plan's, else 0.1")
    add_sensor_options(group)
    group.add_argument("--cutoff-v", type=positive, metavar="V", help="voltage at which the robot stops")
    group.add_argument(
        "--confidence", type=share, default=0.95, metavar="P", help="of the latest point of return (%(default)s)"
    )


def setup(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward setup`.

    ohmward setup robot.dbc --chemistry lfp --capacity-ah 40 --mass-kg 60 --wheel-radius-m 0.1 --track-m 0.45
    ohmward setup can0 --dbc robot.dbc                listens for ten seconds, so that signs and units show
    ohmward setup candump.log --dbc robot.dbc --battery battery.toml --robot wheels.toml
    ohmward setup run.mcap --battery battery.toml --robot rlma
    ohmward setup mqtt://broker.local --battery battery.toml --unit wheel_speed=rpm
    ohmward setup /dev/ttyACM0 --message 1=battery_current_A,battery_voltage_V --battery battery.toml
    """
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="where measurements come from: a CAN database (.dbc, .kcd, .sym, .arxml), a recording of CAN or of ROS; "
        "or what to listen to: can0 or INTERFACE:CHANNEL of python-can, mqtt://[USER@]HOST[:PORT], a serial port",
    )
    parser.add_argument(
        "-o", "--output", default="robot.toml", metavar="FILE.toml", help="write the setup (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, and ask nothing")
    group = parser.add_argument_group("source")
    group.add_argument("--dbc", metavar="FILE", help="database of the CAN bus, of a recording or of what is heard")
    group.add_argument("--channel", metavar="NAME", help="of the CAN bus of the robot (default: can0)")
    group.add_argument("--baud", type=count, default=921_600, help="of a serial line (default: %(default)s)")
    group.add_argument(
        "--message",
        type=pair,
        action="append",
        default=[],
        metavar="NUMBER=NAME,NAME",
        help="names of the values of a message of a serial line, in order",
    )
    group.add_argument("--password", metavar="WHERE", help="of the broker: an environment variable, or file:PATH")
    group.add_argument("--seconds", type=positive, default=10.0, metavar="S", help="listen for so long (default: 10)")
    _add_signal_options(parser.add_argument_group("signals"))
    _add_robot_options(parser.add_argument_group("battery and robot"))


def _add_signal_options(group: argparse._ArgumentGroup) -> None:
    """Options of the signals, where their names do not suffice."""
    for option, metavar, text in (
        ("--signal", "SIGNAL=NAME", "wire a signal: battery_current_A=BMS.Pack_I, wheel_speed_rad_s.left=Drive.nL"),
        ("--unit", "KIND=UNIT", "where neither name nor database has it: wheel_speed=rpm, current=mA, yaw_rate=deg/s"),
    ):
        group.add_argument(option, type=pair, action="append", default=[], metavar=metavar, help=text)
    add_current_sign_option(
        group, "what a positive current does to the battery; auto finds it from values, if any are heard"
    )
    group.add_argument("--shaft", choices=("wheel", "motor"), help="that speeds are of: behind the gear, or before it")
    group.add_argument("--counts-per-turn", type=positive, metavar="N", help="of the encoders, where they send counts")


def _add_robot_options(group: argparse._ArgumentGroup) -> None:
    """Options of the battery and robot files, or of the data that first files are made from."""
    group.add_argument(
        "--name",
        default=gethostname(),
        help="of the robot: in topics, in the store, on the page; default: this machine's",
    )
    group.add_argument("--battery", metavar="FILE.toml", help="battery file; or what the label says:")
    group.add_argument("--chemistry", metavar="NAME", help=CHEMISTRY)
    group.add_argument("--capacity-ah", type=positive, metavar="Q", help="as on the label [Ah]")
    group.add_argument("--n-series", type=count, metavar="N", help="cells in series (default: as many as are found)")
    group.add_argument("--robot", metavar="FILE.toml", help=f"{ROBOT}; or its sizes:")
    group.add_argument("--mass-kg", type=positive, metavar="M", help="with its load")
    group.add_argument("--wheel-radius-m", type=positive, metavar="R", help="of the wheels")
    group.add_argument("--track-m", type=positive, metavar="B", help="between left and right wheels")
    group.add_argument("--wheelbase-m", type=positive, metavar="L", help="between axles, or from axle to caster")
    group.add_argument(
        "--gear", type=positive, default=1.0, metavar="N", help="turns of the motor for one of the wheel"
    )
    group.add_argument("--wheels", type=int, choices=(2, 4), help="that are driven (default: as many as are found)")


def run(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward run`.

    ohmward run --demo                                a simulated robot, with nothing attached
    ohmward run --demo --drive                        the same, driven by `ohmward drive` in another terminal
    ohmward run --example > robot.toml                a setup to edit
    ohmward run --check robot.toml                    is everything there, and wired as it should be?
    ohmward run robot.toml
    """
    parser.add_argument(
        "setup", nargs="?", metavar="SETUP.toml", help="battery, robot, sources and sinks; --example prints one"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--demo", action="store_true", help="run a simulated robot in real time, and show it")
    what.add_argument("--example", action="store_true", help="print a setup with comments, to edit")
    what.add_argument(
        "--check",
        action="store_true",
        help="listen for 10 s (or --seconds) and check every signal, its unit and its sign; drive a little meanwhile",
    )
    parser.add_argument(
        "--drive",
        action="store_true",
        help="with --demo: it waits for an operator, `ohmward drive` in another terminal",
    )
    parser.add_argument("--seconds", type=float, metavar="S", help="end after so long")
    parser.add_argument("--json", action="store_true", help="with --check: print the findings as JSON")
    parser.add_argument(
        "--log-format",
        choices=("text", "json"),
        default="text",
        help="of the log on standard error: lines for people, or a JSON object a line",
    )


def service(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward service`.

    ohmward service install --print                   the unit of systemd, to look at
    sudo ohmward service install                      for /etc/ohmward/robot.toml
    sudo ohmward service install /etc/ohmward/other.toml --replace
    """
    parser.add_argument("action", choices=("install",), help="write the unit into /etc/systemd/system")
    parser.add_argument(
        "setup",
        nargs="?",
        default="/etc/ohmward/robot.toml",
        metavar="SETUP.toml",
        help="of `ohmward run`; by default %(default)s",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--print", action="store_true", help="print the unit and write nothing")
    what.add_argument(
        "--replace", action="store_true", help="replace a unit that is there; it stays beside it, .before"
    )


def drive(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward drive`.

    ohmward drive                                      the robot on this machine, by keys
    ohmward drive robot.local:4720 --token DRIVE_TOKEN
    ohmward drive robot.local:4720 --token file:token --joystick /dev/input/js0
    ohmward drive --stop                               safe stop, whoever drives
    """
    parser.add_argument(
        "robot", nargs="?", default="127.0.0.1:4720", metavar="HOST:PORT", help="of its control sink's operator"
    )
    parser.add_argument(
        "--token", metavar="WHERE", help="where the token is: name of an environment variable, or file:PATH of mode 600"
    )
    parser.add_argument("--joystick", metavar="DEVICE", help="of a joystick or gamepad: /dev/input/js0")
    parser.add_argument("--stop", action="store_true", help="stop the robot and end")
    parser.add_argument("--json", action="store_true", help="print how it ended as JSON")


#: Seconds in each unit of a time before now.
_BACK = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0}


def store(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward store`.

    ohmward store list ohmward-store
    ohmward store query ohmward-store --names soc,soc_std --from "2026-11-22 08:00" --every 60
    ohmward store query ohmward-store --kind drive --from 10min
    ohmward store export ohmward-store --kind battery -o day.csv
    ohmward store export ohmward-store --kind drive --from 1d -o drive.mcap
    ohmward store export ohmward-store --kind both --from 1d -o mission.csv
    """
    parser.add_argument(
        "action",
        choices=("list", "query", "export"),
        help="list: what is there; query: rows as CSV; export: rows into a file",
    )
    parser.add_argument("folder", metavar="FOLDER", help="of the sink `store`")
    parser.add_argument(
        "--kind",
        choices=("battery", "drive", "both"),
        default="battery",
        help="of rows (default %(default)s); both: as `ohmward mission` needs them",
    )
    parser.add_argument("--names", metavar="A,B,...", help="columns; default: all")
    parser.add_argument(
        "--from",
        dest="since",
        type=moment,
        metavar="TIME",
        help="as 2026-11-22 08:00 (local), or 10min, 2h, 3d for so long ago",
    )
    parser.add_argument("--to", dest="until", type=moment, metavar="TIME", help="the same")
    parser.add_argument("--every", type=count, default=1, metavar="N", help="only every N-th row")
    parser.add_argument("-o", "--output", metavar="FILE", help="of export: .csv, .parquet or .mcap")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def moment(text: str) -> float:
    """Seconds since 1970 of a date and time, or of a time before now: `10min`, `2h`, `3d`."""
    ago = re.fullmatch(r"([\d.]{1,15}) *(s|min|h|d)", text)
    try:
        if ago:
            return datetime.now().timestamp() - float(ago[1]) * _BACK[ago[2]]
        return datetime.fromisoformat(text).timestamp()
    except (ValueError, OverflowError, OSError):
        raise argparse.ArgumentTypeError(
            f"must be like '2026-11-22 08:00' or 10min, 2h, 3d for so long ago, got {text!r}"
        ) from None


def fleet(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward fleet`.

    ohmward fleet 'logs/*.parquet' --battery battery.toml -o results
    ohmward fleet logs/ --battery battery.toml --by robot_id -o results
    ohmward fleet 'logs/**/*.csv' --battery battery.toml --filter ukf --processes 8 --estimates -o results --json
    ohmward fleet '/shared/logs/*.parquet' --battery battery.toml --dask tcp://10.0.0.5:8786 -o results
    """
    parser.add_argument(
        "logs", nargs="+", metavar="LOGS", help="files, folders, or patterns, quoted: 'logs/**/*.parquet'"
    )
    parser.add_argument("--battery", required=True, metavar="FILE.toml", help="battery file of all of them")
    parser.add_argument(
        "-o", "--output", required=True, metavar="DIR", help="folder for report.html, summary.csv and progress"
    )
    parser.add_argument(
        "--by",
        metavar="WAY",
        help="whose log it is: the name of a column (robot_id), serial, name (amr-3 of amr-3_2026-01-31.csv), folder; "
        "log: each alone; auto: the first of these that each log has, folders if most have none (default)",
    )
    group = parser.add_argument_group("estimation")
    group.add_argument("--filter", default="default", metavar="NAME", help="as in `ohmward soc`")
    add_start_options(group, "at the start of every log; default: its voltage")
    add_sensor_options(group)
    group.add_argument("--estimates", action="store_true", help="write the estimates of every log too, as Parquet")
    group = parser.add_argument_group("where")
    where = group.add_mutually_exclusive_group()
    where.add_argument("--processes", type=count, metavar="N", help="side by side; default: one for each processor")
    where.add_argument(
        "--dask", metavar="ADDRESS", help="on the workers of this scheduler, such as tcp://10.0.0.5:8786"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    add_log_options(parser)


def export(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward export`.

    ohmward export battery.toml -o firmware/soc
    ohmward export battery.toml --filter textbook-ekf --sample-time 1 --flash-kb 8 -o firmware/cell
    ohmward export battery.toml --filter textbook-joint --style loops -o firmware/joint
    ohmward export battery.toml --language python -o submission
    ohmward export battery.toml --for mcmaster -o submission.zip --score drives/ --truth Ah --truth-start 1
    ohmward export robot.toml --filter ekf -o firmware/speed
    ohmward export rlma --filter slip-controller -o firmware/wheel
    """
    parser.add_argument("file", metavar="FILE", help=f"battery file, made by `ohmward identify`; or {ROBOT}")
    parser.add_argument(
        "--filter",
        metavar="NAME",
        help="as in `ohmward soc`, whose default gsf is three times as large as ekf; or textbook-joint for the "
        "parameters of the RC model; of a robot as in `ohmward slip`, or odometry, slip-controller or "
        "speed-controller (default ekf in C and with --for; in Python that of `ohmward soc`)",
    )
    parser.add_argument(
        "--language",
        choices=("c", "python"),
        default="c",
        help="c: a C99 library in single precision; python: one file for a battery, which needs NumPy only and has "
        "Model(X, z) over rows of current, voltage and temperature, as blind benchmarks call it (default %(default)s)",
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="DIR",
        help="folder to write, made if there is none; FILE.zip with --for",
    )
    parser.add_argument(
        "--name",
        metavar="WORD",
        help="prefix of files and symbols in C (default: the folder's name); in Python the module (default Model, as "
        "blind benchmarks import it)",
    )
    blind = parser.add_argument_group("blind benchmark")
    blind.add_argument(
        "--for",
        dest="benchmark",
        choices=("mcmaster",),
        help="write what McMaster University's blind comparison of SoC estimators takes: a flat archive, -o FILE.zip",
    )
    blind.add_argument(
        "--score",
        nargs="+",
        metavar="LOG",
        help="rehearse it on logs from full: padding, restarts in mid-drive, an offset of the current sensor",
    )
    blind.add_argument("--truth", metavar="COLUMN", help="of these logs: a share, percent or Ah counter, as in soc")
    blind.add_argument("--truth-start", type=share, metavar="S", help="state of charge at which an Ah counter starts")
    parser.add_argument("--terrain", metavar="NAME", help="ground under a robot (default dry asphalt)")
    _add_target_options(parser)
    add_log_options(parser, interval=False)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def _add_target_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("start and target")
    group.add_argument(
        "--initial-soc",
        type=share,
        metavar="S",
        help="state of charge at the start: in C of the example (default 0.5; filters that must start there say so), "
        "in Python weighed with the first voltage (default: from that voltage alone)",
    )
    group.add_argument(
        "--initial-soc-std",
        type=positive,
        metavar="S",
        help="standard deviation of that (default 0.3 in C, 0.03 in Python)",
    )
    group.add_argument(
        "--sample-time",
        type=positive,
        metavar="S",
        help="samples always come so many seconds apart: smaller and faster, dt_s is not looked at",
    )
    group.add_argument(
        "--style",
        choices=("lines", "loops"),
        default="lines",
        help="lines: no loops, the fastest; loops: a few filters, the smallest (default %(default)s)",
    )
    group.add_argument(
        "--curve-error",
        type=positive,
        metavar="MV",
        help="of textbook-ekf and textbook-ukf: for a smaller table the open-circuit voltage of a cell may be so many "
        "millivolts off",
    )
    add_sensor_options(group)
    group.add_argument("--flash-kb", type=positive, metavar="K", help="refuse what takes more flash")
    group.add_argument("--ram-kb", type=positive, metavar="K", help="refuse what takes more RAM")


def twin(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward twin`.

    ohmward export battery.toml --filter ekf -o firmware/soc
    ohmward twin firmware/soc day.csv -o twin.csv
    ohmward twin firmware/soc day.csv --battery battery.toml --filter ekf --initial-soc 1.0
    ohmward twin firmware/speed drive.csv --robot robot.toml --filter ekf --json
    """
    parser.add_argument("library", metavar="DIR", help="folder that `ohmward export` has written")
    parser.add_argument("log", metavar="LOG", help=LOG)
    parser.add_argument("--name", metavar="WORD", help="prefix of the library, where the folder holds several")
    group = parser.add_argument_group("what was exported")
    group.add_argument("--filter", metavar="NAME", help="as in `ohmward export`: compare with it in double precision")
    group.add_argument("--battery", metavar="FILE.toml", help="battery file of that filter")
    group.add_argument("--sample-time", type=positive, metavar="S", help="as given to `ohmward export`")
    group.add_argument("--curve-error", type=positive, metavar="MV", help="the same")
    add_sensor_options(group)
    group.add_argument("--robot", metavar="FILE.toml", help=f"{ROBOT}; needed for logs of drives")
    group.add_argument(
        "--terrain",
        default=DEFAULT_TERRAIN,
        metavar="NAME",
        help="as in `ohmward export` (default %(default)s)",
    )
    group.add_argument(
        "--initial-soc", type=share, metavar="S", help="of the start, if it takes one; default: that of the export"
    )
    group.add_argument("--initial-soc-std", type=positive, metavar="S", help="how sure that is; default: as above")
    add_drive_options(parser, interval=False)
    add_current_sign_option(
        parser, "of a battery's log: what a positive current in the file does to it (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("-o", "--output", metavar="FILE", help="write what the firmware says: .csv, .parquet or .mcap")
