"""`ohmward reproduce`: tables and figures of [T] and [P] made again, printed numbers beside those found here."""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path

from ohmward.battery.file import load_battery
from ohmward.battery.log_check import check_log, with_contradictions
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import Report, progress
from ohmward.errors import InputError
from ohmward_lab.cli.reproduce.report import errata_page, make_page
from ohmward_lab.cli.reproduce.result import describe, describe_errata, errata_summary, summary
from ohmward_lab.reproduce.errata import ERRATA, check
from ohmward_lab.reproduce.measured import measured_item
from ohmward_lab.reproduce.nmc_cell import nmc_item
from ohmward_lab.reproduce.publications import PUBLICATIONS, Publication, Reproduced, select


def run(args: argparse.Namespace) -> Outcome:
    """Compute the items of a publication, or check the errata."""
    if args.subject == "errata":
        if args.only:
            raise InputError("--only selects a table or figure; the errata are checked together")
        found = check(ERRATA)
        status = 0 if all(found) else 1
        return Outcome(errata_summary(found), describe_errata(found), page=partial(errata_page, found), status=status)
    publication = with_measured(with_nmc_cell(PUBLICATIONS[args.subject], args.data), args)
    with progress() as report:
        results = compute(publication, args.only or (), report)
    return Outcome(
        summary(publication, results), describe(publication, results), page=partial(make_page, publication, results)
    )


def with_nmc_cell(publication: Publication, data: str | None) -> Publication:
    """The publication, and for the thesis the measured NMC cell where its records are there.

    data: the folder of `--data`; without it that of OHMWARD_DATA, which need not hold the records.

    Raises:
        InputError: `--data` without the records, or for another subject than the thesis.
    """
    if data and publication.short != "[T]":
        raise InputError("--data adds a cell to the thesis; write `ohmward reproduce thesis --data ...`")
    folder = data or os.environ.get("OHMWARD_DATA")
    if not folder or publication.short != "[T]":
        return publication
    try:
        return publication._replace(items=(*publication.items, nmc_item(Path(folder).expanduser())))
    except FileNotFoundError as missing:
        if not data:
            return publication
        raise InputError(
            f"--data must name the folder that holds tue_cells (docs/data.md); {missing} is absent"
        ) from None


def with_measured(publication: Publication, args: argparse.Namespace) -> Publication:
    """The publication, and for the thesis the log that `--log` names as one item more.

    Raises:
        InputError: a log without battery or start, or for another subject than the thesis.
    """
    if args.log is None:
        return publication
    if publication.short != "[T]":
        raise InputError("--log runs the filters of the thesis; write `ohmward reproduce thesis --log ...`")
    if args.battery is None or args.initial_soc is None:
        raise InputError(
            "--log needs --battery FILE.toml and --initial-soc S: both are taken as given, as in the thesis"
        )
    battery = load_battery(args.battery)
    log = with_contradictions(check_log(read_battery_log(args.log, args, ()), battery), battery)
    return publication._replace(items=(*publication.items, measured_item(log, battery, args.initial_soc)))


def compute(publication: Publication, only: list[str] | tuple[str, ...], report: Report | None) -> list[Reproduced]:
    """Results of the chosen items, with progress by items."""
    items = select(publication, only)
    found = []
    for done, item in enumerate(items):
        if report:
            report(item.title, done / len(items))
        found.append(Reproduced(item, item.make()))
    return found
