"""Arguments of `ohmward store`; `command` carries it out."""

from __future__ import annotations

import argparse
import re
from datetime import datetime

from ohmward.cli.parser import count

EXAMPLES = """\
  ohmward store list ohmward-store
  ohmward store query ohmward-store --names soc,soc_std --from "2026-11-22 08:00" --every 60
  ohmward store query ohmward-store --kind drive --from 10min
  ohmward store export ohmward-store --kind battery -o day.csv
  ohmward store export ohmward-store --kind drive --from 1d -o drive.mcap
  ohmward store export ohmward-store --kind both --from 1d -o mission.csv
"""

ACTIONS = ("list", "query", "export")

#: Seconds in each unit of a time before now.
_BACK = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "action", choices=ACTIONS, help="list: what is there; query: rows as CSV; export: rows into a file"
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
