"""`ohmward doctor`: contents, assumptions and faults of a log; doubts of a battery file and the band that follows."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ohmward.battery.file import load_battery
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.doctor.battery import battery_summary, describe_battery, examine_battery
from ohmward.cli.doctor.report import make_page
from ohmward.cli.doctor.result import describe, summary
from ohmward.cli.options import file_hints
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import split_selection
from ohmward.errors import InputError
from ohmward.logs import Log, examine
from ohmward.logs.columns import listed
from ohmward.logs.read import open_table
from ohmward.logs.wheel_columns import wheel_names


def run(args: argparse.Namespace) -> Outcome:
    """Examine each file; the exit status is 1 if a log has an error."""
    batteries = [path for path in args.files if Path(path).suffix == ".toml"]
    paths = [path for path in args.files if path not in batteries]
    logs = [_read(path, args) for path in paths]
    found = [examine(log) for log in logs]
    known = [examine_battery(path, load_battery(path)) for path in batteries]
    return Outcome(
        summary=summary(paths, found) | {"batteries": [battery_summary(one) for one in known]},
        text="\n\n".join([*map(describe, logs, found), *map(describe_battery, known)]),
        notes=[note for one in found for note in one.notes],
        page=partial(make_page, logs, found, known),
        status=int(any(one.worst == "error" for one in found)),
    )


def _read(path: str, args: argparse.Namespace) -> Log:
    """The log of a battery.

    Raises:
        InputError: it cannot be read as one; says so where it is that of a drive.
    """
    file = open_table(split_selection(path)[0], file_hints(args))
    try:
        return read_battery_log(path, args, file=file)
    except InputError as error:
        if not (wheels := wheel_names(file.names)):
            raise
        raise InputError(
            f"{file.source} looks like a drive, with {listed(wheels, 4)}; see it with `ohmward slip {path} --robot "
            f"robot.toml`. As the log of a battery: {error}"
        ) from error
