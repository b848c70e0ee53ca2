"""`ohmward generic`: a first battery file for a battery that has not been tested."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ohmward.cli.options import CHEMISTRY, add_sensor_options
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import count, positive
from ohmward.errors import InputError

EXAMPLES = """\
  ohmward generic --chemistry lfp --capacity-ah 12 --n-series 4 -o battery.toml
  ohmward generic --chemistry nmc --capacity-ah 2.0 --name cell -o cell.toml --json
  ohmward generic --bpx cell.json --chemistry nmc --n-series 4 -o battery.toml
  ohmward generic --type-of cell-1.toml cell-2.toml --n-series 4 -o battery.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
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


def run(args: argparse.Namespace) -> Outcome:
    """Write the battery file."""
    from ohmward.battery.bpx import battery_from_bpx
    from ohmward.battery.chemistries import generic_battery
    from ohmward.battery.file import load_battery, replace_battery
    from ohmward.battery.product import battery_of_type
    from ohmward.cli.battery_inputs import with_sensor
    from ohmward.cli.wording import bullets, paragraphs, written_battery

    check_output("--output", args.output, (".toml",), args.type_of or ())
    if args.type_of:
        if args.bpx or args.capacity_ah or args.chemistry:
            raise InputError("--type-of takes chemistry and capacity from its files; leave the other options out")
        battery = battery_of_type([load_battery(path) for path in args.type_of], args.n_series, args.name)
    elif not args.chemistry:
        raise InputError("--chemistry is needed, as on the label, or --type-of with the files of tested batteries")
    elif args.bpx:
        battery = battery_from_bpx(args.bpx, args.chemistry, args.n_series or 1, args.capacity_ah, args.name)
    elif args.capacity_ah:
        battery = generic_battery(args.chemistry, args.capacity_ah, args.n_series or 1, args.name)
    else:
        raise InputError("--capacity-ah is needed, as on the label, or --bpx with the parameters of a cell")
    battery, _ = with_sensor(battery, args)
    backup = replace_battery(battery, args.output)
    summary = {
        "command": "generic",
        "name": battery.name,
        "chemistry": battery.chemistry,
        "capacity_Ah": battery.capacity_Ah,
        "n_series": battery.n_series,
        "sensor": asdict(battery.sensor),
        "not_identified": list(battery.not_identified),
        "output": args.output,
        "backup": str(backup) if backup else None,
    }
    return Outcome(summary, paragraphs(written_battery(summary), bullets("Not known", battery.not_identified)))
