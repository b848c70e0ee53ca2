"""`ohmward generic`: a battery file for a battery that nobody has tested, to start with."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import replace_battery
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.sensor import with_sensor
from ohmward.cli.wording import written_battery


def run(args: argparse.Namespace) -> Outcome:
    """Write the battery file."""
    check_output("--output", args.output, (".toml",))
    battery, _ = with_sensor(generic_battery(args.chemistry, args.capacity_ah, args.n_series, args.name), args)
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
    text = f"{written_battery(summary)}\n\n" + "\n".join(f"  - {sentence}" for sentence in battery.not_identified)
    return Outcome(summary, text)
