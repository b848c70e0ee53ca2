"""`ohmward tune`: the noise of a battery file by maximum likelihood, on logs without a truth."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.file import replace_battery
from ohmward.battery.log_check import OTHER_FILE
from ohmward.battery.tuning.tune import TunedFactor, Tuning, tune_noise
from ohmward.cli import wording
from ohmward.cli.battery_inputs import load_battery_with_sensor, read_battery_log, read_options
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.wording import FOOTER, with_assumptions
from ohmward.figures.learning import innovation_figure
from ohmward.figures.parts import wall_clock
from ohmward.logs import Log
from ohmward.logs.note import counted
from ohmward.report import Page

#: Columns of the factors.
HEADER = ["noise", "in the file", "tuned", "95 % from", "to", ""]
#: Names of the factors, the value of the file that each stands for, its unit and scale.
_QUANTITIES = {
    "voltage": ("white noise of the voltage", "voltage_std_V", "mV", 1e3),
    "model": ("error of the model, over the file's", "", "", 1.0),
    "correlation": ("time for which it holds on", "correlation_s", "s", 1.0),
}
NOT_TUNED = (
    "Noise of the current sensor, walks of its offset, of capacity and resistance leave no trace in the voltage that "
    "could be told from these: the file keeps its own."
)


def run(args: argparse.Namespace) -> Outcome:
    """Tune, and write the battery file; the exit status is 1 where no noise explains the logs."""
    check_output("--output", args.output, (".toml",), [])
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    with progress() as report:
        logs = [read_battery_log(text, read_options(args), (), report) for text in log_files(args.logs)]
        given = dict(args.initial_soc)
        starts = {log.name: given[key] for log in logs for key in (log.name, "") if key in given}
        tuning = tune_noise(battery, logs, starts, counting(report, "looking for the most likely noise"))
    output = args.output if tuning.explains else None
    backup = replace_battery(tuning.battery, output) if output else None
    figures = {
        "command": "tune",
        "battery": args.battery,
        "logs": [log.name for log in logs],
        "voltages": tuning.voltages,
        "noise": {one.quantity: _row(battery, one) for one in tuning.factors},
        "innovations_before": tuning.excess_before,
        "innovations": tuning.excess,
        "innovations_over_steps": tuning.over_last,
        "log_likelihood_gain": tuning.gain,
        "explains": tuning.explains,
        "output": output,
        "backup": str(backup) if backup else None,
        "report": args.report,
    }
    notes = [f"warning: {text}" for text in contradictions]
    notes += [f"{note.level}: {log.name}: {note.text}" for log in logs for note in log.notes]
    hours = sum(float(log.time_s[-1] - log.time_s[0]) for log in logs) / 3600.0
    title = f"{counted(len(logs), 'log')}, {hours:.1f} h, {wording.grouped(tuning.voltages)} voltages"
    title = f"battery {battery.name!r}: {title}"
    text = wording.paragraphs(
        title,
        wording.table(HEADER, factor_rows(figures)),
        innovations(figures),
        NOT_TUNED,
        wording.assumptions(notes),
        ending(figures),
    )
    page = partial(make_page, f"Noise of battery {battery.name!r}", title, logs, tuning, figures, notes)
    return Outcome(figures, text, notes, page, status=int(not tuning.explains))


def _row(battery: Battery, one: TunedFactor) -> dict[str, Any]:
    """A factor with the file's value and the tuned one."""
    _, key, _, _ = _QUANTITIES[one.quantity]
    value = getattr(battery.noise, key) if key else 1.0
    return {
        "key": key or None,
        "before": value,
        "after": value if one.refused else value * one.factor,
        "low": value * one.low,
        "high": value * one.high,
        "factor": one.factor,
        "refused": one.refused or None,
    }


def factor_rows(figures: Mapping[str, Any]) -> list[list[str]]:
    """A row for each factor."""
    rows = []
    for quantity, row in figures["noise"].items():
        name, _, unit, scale = _QUANTITIES[quantity]
        numbers = [wording.quantity(row[key], unit, scale) for key in ("before", "after", "low", "high")]
        rows.append([name, *numbers, f"not told: {row['refused']}" if row["refused"] else ""])
    return rows


def innovations(figures: Mapping[str, Any]) -> str:
    """The size of the innovations in a sentence."""
    before, after = figures["innovations_before"], figures["innovations"]
    found = f"Innovations are {after:.2f} times as large as this noise makes them; with the file's it was {before:.2f}."
    if figures["explains"]:
        return found
    return f"{found} No noise explains these logs: {OTHER_FILE}"


def ending(figures: Mapping[str, Any]) -> str:
    """The file that was written, or the reason why none was."""
    if figures["output"]:
        return wording.written_battery(figures)
    if not figures["explains"]:
        return "No battery file written: no noise explains the logs."
    return "No battery file written; name one with -o."


def make_page(
    name: str, title: str, logs: Sequence[Log], tuning: Tuning, figures: Mapping[str, Any], notes: Sequence[str]
) -> Page:
    """The noise before and after, and the innovations of each log with both."""
    page = Page(name, title, FOOTER)
    page = page.callout("info" if figures["explains"] else "warning", innovations(figures))
    page = page.table(HEADER, factor_rows(figures), "With 95 % intervals")
    page = page.callout("info", f"{NOT_TUNED}\n\n{ending(figures)}")
    for log, found in zip(logs, tuning.innovations, strict=True):
        page = page.heading(log.name).plot(
            innovation_figure(log.time_s, found[:, 0], "With the noise of the file"),
            innovation_figure(log.time_s, found[:, 1], "With the tuned noise"),
            clock=wall_clock(log),
        )
    return with_assumptions(page, notes) if notes else page
