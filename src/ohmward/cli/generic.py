"""`ohmward generic`: a first battery file for a battery that has not been tested."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ohmward.battery.bpx import battery_from_bpx
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import load_battery, replace_battery
from ohmward.battery.product import battery_of_type
from ohmward.cli.battery_inputs import with_sensor
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.wording import bullets, paragraphs, written_battery
from ohmward.errors import InputError


def run(args: argparse.Namespace) -> Outcome:
    """Write the battery file."""
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
