"""Arguments of `ohmward setup`; `command` carries it out."""

from __future__ import annotations

import argparse
from socket import gethostname

from ohmward.cli.options import CHEMISTRY, ROBOT, add_current_sign_option
from ohmward.cli.parser import count, pair, positive

EXAMPLES = """\
  ohmward setup robot.dbc --chemistry lfp --capacity-ah 40 --mass-kg 60 --wheel-radius-m 0.1 --track-m 0.45
  ohmward setup can0 --dbc robot.dbc                listens for ten seconds, so that signs and units show
  ohmward setup candump.log --dbc robot.dbc --battery battery.toml --robot wheels.toml
  ohmward setup run.mcap --battery battery.toml --robot rlma
  ohmward setup mqtt://broker.local --battery battery.toml --unit wheel_speed=rpm
  ohmward setup /dev/ttyACM0 --message 1=battery_current_A,battery_voltage_V --battery battery.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
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
    _add_signals(parser.add_argument_group("signals"))
    _add_robot(parser.add_argument_group("battery and robot"))


def _add_signals(group: argparse._ArgumentGroup) -> None:
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


def _add_robot(group: argparse._ArgumentGroup) -> None:
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
