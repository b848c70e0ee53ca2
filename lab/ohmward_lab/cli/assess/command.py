"""`ohmward assess`: the limits of the methods, on simulated runs with known truth."""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path

from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import progress
from ohmward_lab.assess.study import STUDIES, assess
from ohmward_lab.cli.assess.report import make_page
from ohmward_lab.cli.assess.result import Assessed, describe, summary


def run(args: argparse.Namespace) -> Outcome:
    """Run the study, or what is left of it."""
    study = STUDIES[args.study]
    folder = Path(args.output or Path("ohmward-assess") / study.name)
    with progress() as report:
        found = assess(
            study,
            folder,
            args.runs,
            args.seed,
            args.only,
            args.processes or os.cpu_count() or 1,
            report and (lambda done, total: report(f"{done:,} of {total:,} cells", done / total)),
        )
    assessed = Assessed(study, args.runs, args.seed, folder, found, args.largest_error / 100.0)
    return Outcome(summary(assessed), describe(assessed), page=partial(make_page, assessed))
