"""`ohmward learn`: from everyday logs to a battery file that knows more."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.learning.fold import PULSE_S, known
from ohmward.cli.battery_inputs import load_with_sensor, log_files, read_options
from ohmward.cli.outcome import Outcome, check_output, progress
from ohmward.cli.wording import bullets, paragraphs, sentence, table, written_battery
from ohmward.figures import learning as pictures
from ohmward.figures.numbers import known as is_known
from ohmward.figures.numbers import lognormal, normal, quantity
from ohmward.filters.consistency import BAND_95
from ohmward.fleet.learning import BatteryFiles, Journal, LearningJob, Row, journal_path, learn_all
from ohmward.logs.selection import split_selection
from ohmward.logs.table import counted
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report import Page

#: Columns of the table of logs.
LOGS = ["log", "verdict", "hours", "SoC", "capacity", "resistance", "error", "learnt"]
#: Columns of the table of a battery file.
CHANGES = ["", "before", "after"]
_VERDICTS = ("learnt", "seen", "set aside")


def run(args: argparse.Namespace) -> Outcome:
    """Learn log by log; write each battery file whole, at the end."""
    start, notes = load_with_sensor(args.battery, args)
    texts = log_files(args.logs)
    files = open_files(start, args.output, [str(split_selection(text)[0]) for text in texts])
    job = LearningJob(texts, start, read_options(args), dict(args.initial_soc))
    journal = Journal(None if args.dry_run else journal_path(args.output), job.digest)
    resumed, began = len(journal.rows), time.perf_counter()
    with progress() as report:
        rows = learn_all(job, files, journal, report)
    written = {} if args.dry_run else files.write()
    journal.finish()
    names = {row["log"] for row in rows}
    notes += [
        f"warning: --initial-soc {name}: there is no log of this name"
        for name in job.starts
        if name and name not in names
    ]
    # notes of the readers on good logs are left out
    warnings = [(row["log"], note) for row in rows for note in row["notes"] if note.startswith("warning: ")]
    warnings += [(row["log"], note) for row in rows for note in row.get("left_out", [])]
    notes += [f"warning: {log}: {note.removeprefix('warning: ')}" for log, note in warnings]
    figures = {
        "command": "learn",
        "battery": args.battery,
        "dry_run": args.dry_run,
        "output": args.output,
        "report": args.report,
        **{verdict.replace(" ", "_"): sum(row["verdict"] == verdict for row in rows) for verdict in _VERDICTS},
        "hours": sum(row["hours"] for row in rows if row["verdict"] == "learnt"),
        "files": [
            {
                "output": key or None,
                "written": key in written,
                "backup": written.get(key),
                "name": after.name,
                "serial_number": after.serial_number or None,
                "before": state(files.before[key]),
                "after": state(after),
            }
            for key, after in files.after.items()
        ],
        "logs": rows,
        "resumed": resumed,
        "seconds": time.perf_counter() - began,
        "notes": notes,
    }
    nothing = not any(row["verdict"] != "set aside" for row in rows)
    return Outcome(figures, describe(figures), notes, partial(make_page, files, figures), int(nothing))


def open_files(start: Battery, output: str | None, inputs: list[str]) -> BatteryFiles:
    """The files of a run; output: a .toml file, or a folder, which is made if its name ends with a separator.

    Raises:
        InputError: output is neither, or the file cannot be written.
    """
    if output is None:
        return BatteryFiles(start, None)
    path = Path(output)
    if output.endswith((os.sep, "/")) and not path.exists():
        path.mkdir(parents=True)
    if not path.is_dir():
        check_output("--output", output, (".toml",), inputs)
    return BatteryFiles(start, path)


def state(battery: Battery) -> dict[str, Any]:
    """Knowledge of a battery file, each quantity with its standard deviation."""
    found = known(battery)
    return {
        "capacity_Ah": found.capacity_Ah._asdict(),
        "resistance_ohm": found.resistance_ohm._asdict(),
        "current_offset_A": found.offset_A._asdict(),
        "ocv_std_V": float(np.median(found.ocv_std_V)),
        "logs": found.logs,
        "hours": found.hours,
    }


def describe(f: Mapping[str, Any]) -> str:
    """Text for people.

    f: the summary of the run, here and in all functions below.
    """
    rows = f["logs"]
    left = [f"{row['log']}, {row['verdict']}: {row['reason']}" for row in rows if row["verdict"] != "learnt"]
    return paragraphs(
        title(f),
        *(f"{headline(file)}\n{table(CHANGES, change_rows(file))}" for file in f["files"]),
        table(LOGS[:-1], [row[:-1] for row in log_rows(rows)]) if rows else "",
        bullets("Learnt", [f"{row['log']}: {row['reason']}" for row in rows if row["verdict"] == "learnt"]),
        bullets("Not learnt from", left),
        ending(f),
    )


def title(f: Mapping[str, Any]) -> str:
    """Number of logs by their verdict, in a line."""
    parts = [f"{f[verdict.replace(' ', '_')]} {verdict}" for verdict in _VERDICTS]
    before = f", {f['resumed']} of them before the interruption" if f["resumed"] else ""
    return f"{counted(len(f['logs']), 'log')}: {', '.join(parts)}{before}; {f['hours']:.1f} h learnt from"


def headline(file: Mapping[str, Any]) -> str:
    """Name of a battery, with its serial number."""
    number = f", serial number {file['serial_number']}" if file["serial_number"] else ""
    return f"battery {file['name']!r}{number}"


def ending(f: Mapping[str, Any]) -> str:
    """Files that were written, or the reason why none was."""
    if f["dry_run"]:
        return "No battery file written: --dry-run."
    if f["output"] is None:
        return "No battery file written; name one with -o."
    lines = [
        written_battery(file) if file["written"] else f"battery file: {file['output']}, nothing new"
        for file in f["files"]
    ]
    return "\n".join(lines) or "No battery file written: no log was of any use."


def quantities(of: Mapping[str, Any]) -> dict[str, str]:
    """Capacity, resistance and current offset of a battery with their 95 % bands, by name."""
    return {
        "capacity": normal(of["capacity_Ah"], "Ah"),
        "resistance, 10 s": lognormal(of["resistance_ohm"], "mΩ", 1e3),
        "current offset": normal(of["current_offset_A"], "mA", 1e3),
    }


def change_rows(file: Mapping[str, Any]) -> list[list[str]]:
    """The quantities of a battery file before and after."""
    columns = [
        quantities(of)
        | {
            "open-circuit curve": f"± {quantity(of['ocv_std_V'], 'mV', BAND_95 * 1e3, 2)}",
            "learnt from": f"{counted(of['logs'], 'log')}, {of['hours']:.1f} h",
        }
        for of in (file["before"], file["after"])
    ]
    return [[name, *(column[name] for column in columns)] for name in columns[0]]


def log_rows(rows: Sequence[Row]) -> list[list[str]]:
    """A row for each log: its verdict, its SoC range, and the estimates after it."""
    return [
        [
            row["log"],
            row["verdict"],
            f"{row['hours']:.1f}" if is_known(row.get("hours")) else "-",
            f"{100 * row['soc_min']:.0f} to {100 * row['soc_max']:.0f} %" if is_known(row.get("soc_min")) else "-",
            normal(row["capacity_Ah"], "Ah") if row["verdict"] == "learnt" else "-",
            lognormal(row["resistance_ohm"], "mΩ", 1e3) if row["verdict"] == "learnt" else "-",
            quantity(row.get("residual_rms_V"), "mV", 1e3),
            row["reason"],
        ]
        for row in rows
    ]


def make_page(files: BatteryFiles, f: Mapping[str, Any]) -> Page:
    """Each battery before and after, what each log contributed, which logs were set aside and why."""
    names = [file["name"] for file in f["files"]]
    page = Page(f"Battery {names[0]!r}" if len(names) == 1 else f"{len(names)} batteries", title(f))
    page = page.callout("info", ending(f))
    for row in f["logs"]:
        if row["verdict"] == "set aside":
            page = page.callout("warning", f"{row['log']} was set aside.\n\n{sentence(row['reason'])}")
    for file in f["files"]:
        page = _battery(page, files, file, [row for row in f["logs"] if row["battery_file"] == file["output"]])
    page = page.heading("Logs").table(LOGS, log_rows(f["logs"]), "In the order in which they were learnt")
    anchors: list[list[str]] = []
    for row in f["logs"]:
        anchors += [_anchor_row(row["log"], anchor) for anchor in row.get("anchors", [])]
    if anchors:
        header = ["log", "time", "anchor", "state of charge"]
        page = page.heading("Anchors").table(
            header, anchors, "What showed the state of charge beside the voltage, once each"
        )
    return page


def _anchor_row(log: str, anchor: Mapping[str, Any]) -> list[str]:
    time_s = anchor.get("time_s")
    return [
        log,
        "start" if time_s is None else f"{time_s / SECONDS_PER_HOUR:.2f} h",
        str(anchor.get("kind", "given")),
        f"{100 * anchor['soc']:.0f} ± {100 * BAND_95 * anchor['soc_std']:.0f} %",
    ]


def _battery(page: Page, files: BatteryFiles, file: Mapping[str, Any], rows: Sequence[Row]) -> Page:
    """One battery: its figures and curves before and after, and its knowledge log by log."""
    key = file["output"] or ""
    before, after = files.before[key], files.after[key]
    numbers = {name[:1].upper() + name[1:]: value for name, value in quantities(file["after"]).items()}
    page = page.heading(sentence(headline(file)).rstrip(".")).numbers(numbers)
    page = page.table(CHANGES, change_rows(file), "With 95 % bands")
    page = page.plot(pictures.ocv_change_figure(before, after), pictures.ocv_correction_figure(before, after))
    page = page.plot(pictures.resistance_change_figure(before, after))
    learnt = [row for row in rows if row["verdict"] == "learnt"]
    if not learnt:
        return page
    figures = []
    steps = [
        ("Capacity", "Capacity [Ah]", "capacity_Ah", 1.0),
        (f"Resistance to {PULSE_S:g} s of current", "Resistance [mΩ]", "resistance_ohm", 1e3),
    ]
    for name, label, field, scale in steps:
        knowledge = [file["before"][field], *(row[field] for row in learnt)]
        figures.append(pictures.progress_figure(name, label, knowledge, scale))
    return page.plot(*figures)
