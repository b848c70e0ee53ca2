"""Arguments of `ohmward export`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import ROBOT, add_log_options, add_sensor_options
from ohmward.cli.parser import positive, share

EXAMPLES = """\
  ohmward export battery.toml -o firmware/soc
  ohmward export battery.toml --filter textbook-ekf --sample-time 1 --flash-kb 8 -o firmware/cell
  ohmward export battery.toml --filter textbook-joint --style loops -o firmware/joint
  ohmward export battery.toml --language python -o submission
  ohmward export battery.toml --for mcmaster -o submission.zip --score drives/ --truth Ah --truth-start 1
  ohmward export robot.toml --filter ekf -o firmware/speed
  ohmward export rlma --filter slip-controller -o firmware/wheel
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
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
