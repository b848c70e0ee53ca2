"""`ohmward identify`: from logs of tests to a battery file."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_log_options, add_output_options, count, number, positive, share
from ohmward.cli.progress import progress
from ohmward.cli.reading import read, split_selection

if TYPE_CHECKING:
    from ohmward.battery.battery import Battery
    from ohmward.battery.identification import Identified
    from ohmward.logs import Log

_EXAMPLES = """\
  ohmward identify test.csv --capacity-ah 12 -o battery.toml
  ohmward identify test.csv --capacity-ah 12 --chemistry lfp --n-series 4 --report identify.html -o battery.toml
  ohmward identify test.csv --capacity-ah 12 --model thevenin-1rc --initial-soc test=1.0 --json

A file that holds several recordings may be named several times: ocv.parquet:script=1,temp_C=25
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "identify", "from logs of tests to a battery file", _EXAMPLES)
    parser.add_argument("logs", nargs="+", metavar="LOG", help="pulse tests, low-rate tests, drives of one battery")
    group = parser.add_argument_group("the battery")
    group.add_argument(
        "--capacity-ah", type=positive, required=True, metavar="Q", help="charge between full and empty [Ah]"
    )
    group.add_argument(
        "--model",
        default="thevenin-2rc",
        metavar="NAME",
        help="thevenin-0rc to thevenin-3rc, or rc (default %(default)s)",
    )
    group.add_argument("--chemistry", default="", metavar="NAME", help="such as lfp, nmc, nca, lipo, lead-acid")
    group.add_argument("--n-series", type=count, default=1, metavar="N", help="cells in series (default 1)")
    group.add_argument("--name", default="", help="what to call the battery; default: the first log's name")
    group.add_argument(
        "--initial-soc",
        type=initial_soc,
        action="append",
        default=[],
        metavar="[LOG=]S",
        help="state of charge at the start of the logs, or of the log of this name, where they do not tell it",
    )
    group.add_argument(
        "--idle-current",
        type=number,
        metavar="A",
        help="what flows at every rest, <= 0: 0 in a laboratory, -0.7 on a robot that draws 0.7 A; goes into the "
        "battery file, and then each rest tells the current sensor's offset (default: not declared)",
    )
    add_log_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the battery file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Identify the battery, write its file."""
    check_output("--output", args.output, (".toml",), [str(split_selection(text)[0]) for text in args.logs])
    logs = [read(text, args) for text in args.logs]
    began = time.perf_counter()
    found = _identify(logs, args)
    seconds = time.perf_counter() - began
    if args.output:
        from ohmward.battery.file import save_battery

        save_battery(found.battery, args.output)

    def page():
        from ohmward.cli.identify.report import make_page

        return make_page(found, notes)

    figures = summary(found.battery, args.model, seconds)
    notes = _notes(logs) + figures["notes"]
    figures |= {"notes": notes, "output": args.output, "report": args.report}
    return Outcome(figures, describe(found.battery, figures), notes, page)


def summary(battery: Battery, model: str, seconds: float) -> dict[str, Any]:
    """The object of --json."""
    from dataclasses import asdict

    source = battery.identification
    return {
        "command": "identify",
        "name": battery.name,
        "model": model,
        "chemistry": battery.chemistry or None,
        "n_series": battery.n_series,
        "capacity_Ah": battery.capacity_Ah,
        "capacity_measured_Ah": source.capacity_measured_Ah or None if source else None,
        "parameters": [asdict(c) for c in source.confidence] if source else [],
        "logs": [asdict(fit) for fit in source.logs] if source else [],
        "not_identified": list(battery.not_identified),
        "seconds": seconds,
        "notes": list(source.notes) if source else [],
    }


def describe(battery: Battery, figures: dict[str, Any]) -> str:
    """The same for people."""
    measured = wording.quantity(figures["capacity_measured_Ah"], "Ah", digits=4)
    capacity = f"{battery.capacity_Ah:g} Ah given" + ("" if measured == "-" else f", {measured} measured")
    title = f"battery {battery.name!r}: {figures['model']}, {capacity}; identified in {figures['seconds']:.2g} s"
    assumed = [note.removeprefix("info: ") for note in figures["notes"]]
    written = (
        f"battery file: {figures['output']}" if figures["output"] else "No battery file written; name one with -o."
    )
    return wording.paragraphs(
        title,
        wording.table(PARAMETERS, rows) if (rows := parameter_rows(battery, at_soc="0.5")) else "",
        wording.table(FITS, fit_rows(battery)),
        wording.bullets("Not identified", battery.not_identified),
        wording.bullets("Assumed", assumed),
        written,
    )


PARAMETERS = ["parameter", "value", "95 % interval"]
FITS = ["log", "test", "SoC", "voltage error, RMS", "largest"]


def parameter_rows(battery: Battery, at_soc: str = "") -> list[list[str]]:
    """Each parameter with its confidence interval, in the unit of its name.

    at_soc: of the resistances along SoC only those at this one.
    """
    confidence = battery.identification.confidence if battery.identification else ()
    wanted = [
        c for c in confidence if " at soc " not in c.name or c.name.endswith(f"at soc {at_soc}" if at_soc else "")
    ]
    return [[c.name, f"{c.value:.4g}", f"{c.low:.4g} to {c.high:.4g}"] for c in wanted]


def fit_rows(battery: Battery) -> list[list[str]]:
    """How well each log is reproduced."""
    fits = battery.identification.logs if battery.identification else ()
    return [
        [
            fit.log,
            fit.test,
            f"{max(100 * fit.soc_min, 0.0):.0f} to {100 * fit.soc_max:.0f} %",
            wording.quantity(fit.residual_rms_V or None, "mV", 1e3),
            wording.quantity(fit.residual_max_V or None, "mV", 1e3),
        ]
        for fit in fits
    ]


def initial_soc(text: str) -> tuple[str, float]:
    """`test=0.8` or `0.8` as the log's name, "" for all, and the state of charge."""
    name, _, value = text.rpartition("=")
    return name, share(value)


def _identify(logs: list[Log], args: argparse.Namespace) -> Identified:
    from ohmward.battery.identification import IdentificationSettings, identify_in_detail

    settings = IdentificationSettings(
        args.capacity_ah,
        args.model,
        args.chemistry,
        args.n_series,
        args.name,
        _starts(logs, args.initial_soc),
        args.idle_current,
    )
    with progress() as report:
        return identify_in_detail(logs, settings, report)


def _notes(logs: list[Log]) -> list[str]:
    """What was assumed about the logs, with their names where there are several."""
    if len(logs) == 1:
        return [str(note) for note in logs[0].notes]
    return [f"{note.level}: {log.name}: {note.text}" for log in logs for note in log.notes]


def _starts(logs: list[Log], given: list[tuple[str, float]]) -> dict[str, float]:
    """Initial SoC by the log's name; a value without a name holds for all that are not named."""
    everywhere = {log.name: soc for name, soc in given if not name for log in logs}
    return everywhere | {name: soc for name, soc in given if name}
