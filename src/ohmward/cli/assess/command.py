"""`ohmward assess`: the limits of the methods, on simulated shifts with known truth."""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path

from ohmward.assess.study import assess
from ohmward.cli.assess.report import make_page
from ohmward.cli.assess.result import describe, summary
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import progress


def run(args: argparse.Namespace) -> Outcome:
    """Run the study, or what is left of it."""
    with progress() as report:
        found = assess(
            Path(args.output),
            args.runs,
            args.seed,
            args.only,
            args.processes or os.cpu_count() or 1,
            report and (lambda done, total: report(f"{done:,} of {total:,} cells", done / total)),
        )
    return Outcome(summary(args, found), describe(args, found), page=partial(make_page, args, found))
