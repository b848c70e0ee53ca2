"""`ohmward doctor`: what is in a log, what was assumed about it, what is wrong."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, add_log_options, add_output_options
from ohmward.cli.reading import read

if TYPE_CHECKING:
    from ohmward.logs.doctor import Finding, Findings
    from ohmward.logs.log import Log
    from ohmward.logs.survey import Signal

_EXAMPLES = """\
  ohmward doctor test.csv
  ohmward doctor test.csv day.csv --report logs.html
  ohmward doctor test.csv --column current=current_A --unit current=A --json
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "doctor", "what is in a log, what was assumed, what is wrong", _EXAMPLES)
    parser.add_argument("logs", nargs="+", metavar="LOG", help="a CSV, Parquet or BDF file")
    add_log_options(parser)
    add_output_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Examine each log; the exit status is 1 if one has an error."""
    from ohmward.logs import examine

    logs = [read(path, args) for path in args.logs]
    found = [examine(log) for log in logs]

    def page():
        from ohmward.cli.doctor.report import make_page

        return make_page(logs, found)

    return Outcome(
        summary={
            "command": "doctor",
            "logs": [{"path": p} | asdict(f) | {"worst": f.worst} for p, f in zip(args.logs, found, strict=True)],
        },
        text="\n\n".join(map(describe, logs, found)),
        notes=[note for f in found for note in f.notes],
        page=page,
        status=int(any(f.worst == "error" for f in found)),
    )


def describe(log: Log, found: Findings) -> str:
    """What the doctor says, for people."""
    assumed = [note.removeprefix("info: ") for note in found.notes]
    return wording.paragraphs(
        f"{log.name}: {wording.grouped(len(log))} samples in {wording.duration(log.duration_s)}",
        wording.fields(contents(log, found)),
        wording.bullets("Assumed", assumed),
        wording.bullets("Found", [f"{finding.severity}: {advised(finding)}" for finding in found.findings])
        or "Found: nothing suspicious.",
    )


def contents(log: Log, found: Findings) -> dict[str, str]:
    """The figures of a log with their units, by name."""
    s = found.survey
    rows = {
        "sampling": f"every {s.sampling.median_s:.3g} s, {s.sampling.shortest_s:.3g} to {s.sampling.longest_s:.4g} s; "
        f"gaps: {s.sampling.gaps}",
        "current": f"{_range(s.current)} A; > 0 charges",
        "voltage": f"{_range(s.voltage)} V",
        "temperature": f"{_range(s.temperature)} degC" if s.temperature else "not recorded",
        "noise": f"{1e3 * s.current.noise_std:.3g} mA, {1e3 * s.voltage.noise_std:.3g} mV",
        "resolution": f"{1e3 * s.current.resolution:.3g} mA, {1e3 * s.voltage.resolution:.3g} mV",
        "charge": f"{s.activity.charge_in_Ah:.4g} Ah in, {s.activity.charge_out_Ah:.4g} Ah out",
        "activity": f"{s.activity.rests} rests, {s.activity.pulses} pulses between rests",
        "at rest": wording.quantity(s.activity.rest_current_A, "mA", 1e3),
        "edges": f"{s.sign.edges} of the current; dV/dI = {wording.quantity(s.sign.resistance_ohm, 'mohm', 1e3)}",
    }
    return rows | ({"also": ", ".join(log.extra)} if log.extra else {})


def advised(finding: Finding) -> str:
    """A finding with its advice, in one line."""
    return f"{finding.text} -> {finding.advice}"


def _range(signal: Signal) -> str:
    return f"{signal.minimum:.5g} to {signal.maximum:.5g}"
