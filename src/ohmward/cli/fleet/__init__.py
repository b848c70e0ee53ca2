"""Arguments of `ohmward fleet`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_log_options, add_sensor_options, add_start_options
from ohmward.cli.parser import count

EXAMPLES = """\
  ohmward fleet 'logs/*.parquet' --battery battery.toml -o results
  ohmward fleet logs/ --battery battery.toml --by robot_id -o results
  ohmward fleet 'logs/**/*.csv' --battery battery.toml --filter ukf --processes 8 --estimates -o results --json
  ohmward fleet '/shared/logs/*.parquet' --battery battery.toml --dask tcp://10.0.0.5:8786 -o results
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
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
