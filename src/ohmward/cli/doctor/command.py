"""`ohmward doctor`: contents, assumptions and faults of a log."""

from __future__ import annotations

import argparse
from functools import partial

from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.doctor.report import make_page
from ohmward.cli.doctor.result import describe, summary
from ohmward.cli.outcome import Outcome
from ohmward.logs import examine


def run(args: argparse.Namespace) -> Outcome:
    """Examine each log; the exit status is 1 if one has an error."""
    logs = [read_battery_log(path, args) for path in args.logs]
    found = [examine(log) for log in logs]
    return Outcome(
        summary=summary(args.logs, found),
        text="\n\n".join(map(describe, logs, found)),
        notes=[note for one in found for note in one.notes],
        page=partial(make_page, logs, found),
        status=int(any(one.worst == "error" for one in found)),
    )
