"""`ohmward learn`: from everyday logs to a battery file that knows more."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.file import BATTERY_FILE, load_battery, replace_battery
from ohmward.battery.learning.fold import PULSE_S
from ohmward.battery.learning.known import known
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.lesson import Lesson
from ohmward.cli import wording
from ohmward.cli.battery_inputs import load_battery_with_sensor, read_battery_log, read_options
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome, check_output, plain
from ohmward.cli.parser import selected_name, split_selection
from ohmward.cli.progress import Report, progress
from ohmward.cli.wording import FOOTER, lognormal, normal, sentence, with_assumptions
from ohmward.errors import InputError, OhmwardError
from ohmward.figures import learning as pictures
from ohmward.filters.consistency import BAND_95
from ohmward.logs.note import counted
from ohmward.logs.serial_number import serial_numbers
from ohmward.report import Page

#: Options that the lessons depend on beside the logs.
_OF_THE_JOB = ("current_sign", "column", "unit", "where", "sort_time", "initial_soc")


def run(args: argparse.Namespace) -> Outcome:
    """Learn log by log; write each battery file whole, at the end."""
    start, contradictions = load_battery_with_sensor(args.battery, args)
    require_thevenin(start)
    texts = log_files(args.logs)
    files = open_files(start, args.output, [str(split_selection(text)[0]) for text in texts])
    journal = Journal(None if args.dry_run else journal_path(args.output), _job(BATTERY_FILE.dump(start), args))
    resumed, began = len(journal.rows), time.perf_counter()
    with progress() as report:
        rows = teach_all(texts, args, files, journal, report)
    written = {} if args.dry_run else files.write()
    journal.finish()
    figures = summary(args, files, rows, written) | {
        "resumed": resumed,
        "seconds": time.perf_counter() - began,
        "notes": [f"warning: {text}" for text in contradictions] + _unused(args, rows) + _notes(rows),
    }
    nothing = not any(row["verdict"] != "set aside" for row in rows)
    return Outcome(figures, describe(figures), figures["notes"], partial(make_page, files, figures), int(nothing))


def _job(battery: str, args: argparse.Namespace) -> str:
    """Digest of the battery file and of the options that the lessons depend on."""
    options = {name: getattr(args, name) for name in _OF_THE_JOB}
    return hashlib.sha256(json.dumps([battery, options]).encode()).hexdigest()[:16]


def _unused(args: argparse.Namespace, rows: list[dict]) -> list[str]:
    """Warnings on states of charge that were given for logs that are not there."""
    names = {row["log"] for row in rows}
    unused = [name for name, _ in args.initial_soc if name and name not in names]
    return [f"warning: --initial-soc {name}: there is no log of this name" for name in unused]


def _notes(rows: list[dict]) -> list[str]:
    """Warnings about the logs, with their names; what every reader says of a good log is left out."""
    read = [(row["log"], note) for row in rows for note in row["notes"] if note.startswith("warning: ")]
    left_out = [(row["log"], note) for row in rows for note in row.get("left_out", [])]
    return [f"warning: {log}: {note.removeprefix('warning: ')}" for log, note in read + left_out]


#: Columns of the logs.
LOGS = ["log", "verdict", "hours", "SoC", "capacity", "resistance", "error", "taught"]
#: Columns of a battery file.
CHANGES = ["", "before", "after"]
_VERDICTS = ("learnt", "seen", "set aside")


def summary(
    args: argparse.Namespace, files: BatteryFiles, rows: Sequence[Row], written: Mapping[str, str | None]
) -> dict[str, Any]:
    """The object of --json."""
    counts = {verdict.replace(" ", "_"): sum(row["verdict"] == verdict for row in rows) for verdict in _VERDICTS}
    return {
        "command": "learn",
        "battery": args.battery,
        "dry_run": args.dry_run,
        "output": args.output,
        "report": args.report,
        **counts,
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
        "logs": list(rows),
    }


def state(battery: Battery) -> dict[str, Any]:
    """Knowledge of a battery file, each quantity with its standard deviation."""
    found = known(battery)
    return plain(
        {
            "capacity_Ah": found.capacity_Ah._asdict(),
            "resistance_ohm": found.resistance_ohm._asdict(),
            "current_offset_A": found.offset_A._asdict(),
            "ocv_std_V": float(np.median(found.ocv_std_V)),
            "logs": found.logs,
            "hours": found.hours,
        }
    )


def describe(figures: Mapping[str, Any]) -> str:
    """Text for people."""
    return wording.paragraphs(
        title(figures),
        *(f"{headline(file)}\n{wording.table(CHANGES, change_rows(file))}" for file in figures["files"]),
        wording.table(LOGS[:-1], [row[:-1] for row in log_rows(figures["logs"])]) if figures["logs"] else "",
        wording.bullets("Taught", [f"{row['log']}: {row['reason']}" for row in learnt(figures["logs"])]),
        wording.bullets("Not learnt from", not_learnt(figures["logs"])),
        wording.assumptions(figures["notes"]),
        ending(figures),
    )


def title(figures: Mapping[str, Any]) -> str:
    """Number of logs by their verdict, in a line."""
    parts = [f"{figures[verdict.replace(' ', '_')]} {verdict}" for verdict in _VERDICTS]
    before = f", {figures['resumed']} of them before the interruption" if figures["resumed"] else ""
    return f"{counted(len(figures['logs']), 'log')}: {', '.join(parts)}{before}; {figures['hours']:.1f} h learnt from"


def headline(file: Mapping[str, Any]) -> str:
    """Name of a battery, with its serial number and its file."""
    number = f", serial number {file['serial_number']}" if file["serial_number"] else ""
    return f"battery {file['name']!r}{number}"


def ending(figures: Mapping[str, Any]) -> str:
    """Files that were written, or the reason why none was."""
    if figures["dry_run"]:
        return "No battery file written: --dry-run."
    if figures["output"] is None:
        return "No battery file written; name one with -o."
    lines = []
    for file in figures["files"]:
        if file["written"]:
            lines.append(wording.written_battery(file))
        else:
            lines.append(f"battery file: {file['output']}, nothing new")
    return "\n".join(lines) or "No battery file written: no log was of any use."


def change_rows(file: Mapping[str, Any]) -> list[list[str]]:
    """The quantities of a battery file before and after."""
    old, new = file["before"], file["after"]
    table = [
        ["capacity", *(normal(one["capacity_Ah"], "Ah") for one in (old, new))],
        ["resistance, 10 s", *(lognormal(one["resistance_ohm"], "mΩ", 1e3) for one in (old, new))],
        ["current offset", *(normal(one["current_offset_A"], "mA", 1e3) for one in (old, new))],
    ]
    curve = [wording.quantity(one["ocv_std_V"], "mV", BAND_95 * 1e3, 2) for one in (old, new)]
    learnt_from = [f"{counted(one['logs'], 'log')}, {one['hours']:.1f} h" for one in (old, new)]
    return [*table, ["open-circuit curve", *(f"± {text}" for text in curve)], ["learnt from", *learnt_from]]


def log_rows(rows: Sequence[Row]) -> list[list[str]]:
    """A row for each log: its verdict, its range, and what is known after it."""
    return [
        [
            row["log"],
            row["verdict"],
            f"{row['hours']:.1f}" if row.get("hours") is not None else "-",
            _range(row),
            normal(row["capacity_Ah"], "Ah") if row["verdict"] == "learnt" else "-",
            lognormal(row["resistance_ohm"], "mΩ", 1e3) if row["verdict"] == "learnt" else "-",
            wording.quantity(row.get("residual_rms_V"), "mV", 1e3),
            row["reason"],
        ]
        for row in rows
    ]


def learnt(rows: Sequence[Row]) -> list[Row]:
    """The rows of the logs that taught something."""
    return [row for row in rows if row["verdict"] == "learnt"]


def not_learnt(rows: Sequence[Row]) -> list[str]:
    """The other logs, each with its reason."""
    return [f"{row['log']}, {row['verdict']}: {row['reason']}" for row in rows if row["verdict"] != "learnt"]


def _range(row: Row) -> str:
    low, high = row.get("soc_min"), row.get("soc_max")
    if low is None or high is None:
        return "-"
    return f"{100 * low:.0f} to {100 * high:.0f} %"


@dataclass
class BatteryFiles:
    """The batteries of a run by the files that they are written to."""

    start: Battery  #: what is known of each battery that has no file yet
    output: Path | None  #: the file, or the folder of one file for each serial number; None writes none
    #: each battery by its file, when it was opened and now; "" is the file of a run without output
    before: dict[str, Battery] = field(default_factory=dict)
    after: dict[str, Battery] = field(default_factory=dict)

    @property
    def one_for_each(self) -> bool:
        """True where each serial number has a file of its own."""
        return self.output is not None and self.output.is_dir()

    def open(self, serial_number: str) -> str:
        """Key of the battery with this serial number, "" where a log has none; its file is read if there is one.

        Raises:
            InputError: the log is of another battery than the file, or has no serial number to choose a file by.
        """
        key = self._key(serial_number)
        self._load(key, serial_number)
        own = self.after[key].serial_number
        if serial_number and own and serial_number != own:
            raise InputError(
                f"this is not the battery of the file: the log is of serial number {serial_number}, the file of {own}; "
                "a folder as --output takes a file for each"
            )
        if serial_number and not own:
            self.after[key] = replace(self.after[key], serial_number=serial_number)
        return key

    def restore(self, key: str, battery: Battery) -> None:
        """Put the battery of an interrupted run in its place."""
        self._load(key, battery.serial_number)
        self.after[key] = battery

    def _key(self, serial_number: str) -> str:
        """Path of the file of the battery with this serial number."""
        if not self.one_for_each:
            return "" if self.output is None else str(self.output)
        assert self.output is not None
        if not serial_number:
            raise InputError("the log has no serial number, by which the file in the folder could be chosen")
        return str(self.output / f"{re.sub(r'[^A-Za-z0-9._-]', '_', serial_number)}.toml")

    def _load(self, key: str, serial_number: str) -> None:
        """Take up the battery of a file, once; in a folder the file that is there goes on from where it stands."""
        if key in self.after:
            return
        if self.one_for_each:
            known = load_battery(key) if Path(key).exists() else replace(self.start, serial_number=serial_number)
        else:
            known = self.start
        self.before[key] = self.after[key] = known

    def write(self) -> dict[str, str | None]:
        """Write every file whose battery has changed or that is not there; each with the path of the one before."""
        written: dict[str, str | None] = {}
        for key, battery in self.after.items():
            if key and (battery != self.before[key] or not Path(key).exists()):
                backup = replace_battery(battery, key)
                written[key] = None if backup is None else str(backup)
        return written


def open_files(start: Battery, output: str | None, inputs: list[str]) -> BatteryFiles:
    """The files of a run; output: a .toml file, or a folder, which is made where it ends with a separator.

    Raises:
        InputError: neither; or the file cannot be written.
    """
    if output is None:
        return BatteryFiles(start, None)
    path = Path(output)
    if output.endswith((os.sep, "/")) and not path.exists():
        path.mkdir(parents=True)
    if not path.is_dir():
        check_output("--output", output, (".toml",), inputs)
    return BatteryFiles(start, path)


#: Row of the journal: the log as it was named, what each of its lessons says, and the battery files after it.
Row = dict[str, Any]


class Journal:
    """A file beside the output, one line for each log; it goes when the run is done.

    path: None keeps no journal.
    job: what the lessons depend on beside the logs; a journal of another job is begun anew.
    """

    def __init__(self, path: Path | None, job: str):
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []
        rows = [row for row in map(_parsed, lines) if row is not None]
        self.rows: list[Row] = rows[1:] if rows and rows[0].get("job") == job else []
        if path is not None and not self.rows:
            self._write([{"job": job}], "w")

    def add(self, row: Row) -> None:
        """Append a row; it is on the disk before the next log is read."""
        self.rows.append(row)
        if self.path is not None:
            self._write([row], "a")

    def finish(self) -> None:
        """Remove the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def _write(self, rows: Sequence[Row], mode: str) -> None:
        assert self.path is not None
        try:
            with self.path.open(mode, encoding="utf-8") as stream:
                stream.write("".join(f"{json.dumps(row)}\n" for row in rows))
        except OSError as error:
            raise OhmwardError(
                f"{self.path}: cannot be written ({error.strerror}); free space, then start again"
            ) from error


def _parsed(line: str) -> Row | None:
    """Object in a line; None for one that was cut off when the run was interrupted."""
    try:
        return json.loads(line)
    except json.JSONDecodeError:
        return None


def journal_path(output: str | None) -> Path | None:
    """Journal of a run with this output: .battery.toml.learning beside the file, or .learning in the folder."""
    if output is None:
        return None
    path = Path(output)
    return path / ".learning" if path.is_dir() else path.with_name(f".{path.name}.learning")


@dataclass(frozen=True)
class LogTask:
    """A log, or the rows of one battery in it."""

    text: str  #: as it was named, its rows included
    serial_number: str = ""  #: of its battery, "" where the log does not tell

    @property
    def path(self) -> str:
        """The file."""
        return str(split_selection(self.text)[0])

    @property
    def name(self) -> str:
        """Name of the log."""
        path, where = split_selection(self.text)
        return selected_name(path.stem, where)


def log_tasks(text: str, args: argparse.Namespace, files: BatteryFiles) -> list[LogTask]:
    """A task for each battery whose serial number is in the log, one for a log without any.

    Raises:
        InputError: the log cannot be read, or holds several batteries where the output is one file.
    """
    path, where = split_selection(text)
    found = serial_numbers(path, dict(args.where) | where)
    if len(found) < 2:
        return [LogTask(text, found[0][1] if found else "")]
    tasks = [LogTask(f"{text}{',' if where else ':'}{column}={serial}", serial) for column, serial in found]
    if files.one_for_each:
        return tasks
    own = files.after[files.open("")].serial_number
    if not own:
        numbers = ", ".join(task.serial_number for task in tasks)
        raise InputError(
            f"it holds batteries with several serial numbers ({numbers}); choose one with --where "
            f"{found[0][0]}={found[0][1]}, or give a folder as --output"
        )
    return [task for task in tasks if task.serial_number == own] or tasks[:1]


def teach(text: str, args: argparse.Namespace, files: BatteryFiles, starts: Mapping[str, float]) -> list[Row]:
    """The lessons of a log; the batteries in `files` have learnt them."""
    try:
        tasks = log_tasks(text, args, files)
    except InputError as error:
        return [refused(LogTask(text), str(error))]
    rows = []
    for task in tasks:
        try:
            rows += _teach(task, args, files, starts)
        except InputError as error:
            rows.append(refused(task, str(error)))
    return rows


def _teach(task: LogTask, args: argparse.Namespace, files: BatteryFiles, starts: Mapping[str, float]) -> list[Row]:
    key = files.open(task.serial_number)
    log = read_battery_log(task.text, read_options(args))
    start = starts.get(log.name, starts.get(""))
    learnt = learn(files.after[key], [log], initial_soc={} if start is None else {log.name: start})
    if learnt.battery is not files.after[key]:
        # as the file will have it, so that a run that goes on after an interruption ends with the same file
        files.after[key] = BATTERY_FILE.parse(BATTERY_FILE.dump(learnt.battery))
    head = {"path": task.path, "serial_number": task.serial_number or None, "battery_file": key or None}
    notes = [str(note) for note in log.notes]
    return [head | as_row(lesson) | {"notes": notes} for lesson in learnt.lessons]


def refused(task: LogTask, reason: str) -> Row:
    """Row of a log that could not be read or is of no battery of the run."""
    return {
        "path": task.path,
        "serial_number": task.serial_number or None,
        "battery_file": None,
        "log": task.name,
        "verdict": "set aside",
        "reason": _without_name(reason, Path(task.path).name, task.name),
        "notes": [],
    }


def as_row(lesson: Lesson) -> Row:
    """A lesson as JSON knows it."""
    return plain(_as_plain(lesson._replace(reason=_without_name(lesson.reason, lesson.log))))


def _without_name(reason: str, *names: str) -> str:
    """The reason without the name of the log at its head, which stands beside it anyway."""
    for name in names:
        reason = reason.removeprefix(f"{name}: ")
    return reason


def _as_plain(value: Any) -> Any:
    """Named tuples as objects of their fields."""
    if hasattr(value, "_asdict"):
        return {name: _as_plain(item) for name, item in value._asdict().items()}
    if isinstance(value, tuple | list):
        return [_as_plain(item) for item in value]
    return value


def teach_all(
    texts: list[str], args: argparse.Namespace, files: BatteryFiles, journal: Journal, report: Report | None
) -> list[Row]:
    """Rows of all logs, those of the journal as they were."""
    starts = dict(args.initial_soc)
    done = {row["text"]: row for row in journal.rows}
    rows: list[Row] = []
    for k, text in enumerate(texts):
        if report:
            report(f"{k + 1} of {len(texts)}: {Path(text).name}", k / len(texts))
        if text in done:
            for key, battery in done[text]["batteries"].items():
                files.restore(key, BATTERY_FILE.parse(battery))
            rows += done[text]["lessons"]
            continue
        before = dict(files.after)
        lessons = teach(text, args, files, starts)
        changed = {key: BATTERY_FILE.dump(b) for key, b in files.after.items() if before.get(key) is not b}
        journal.add({"text": text, "lessons": lessons, "batteries": changed})
        rows += lessons
    return rows


ANCHORS = ["log", "time", "anchor", "state of charge"]


def make_page(files: BatteryFiles, figures: Mapping[str, Any]) -> Page:
    """Each battery before and after, what each log taught, what was not learnt from and why."""
    names = [file["name"] for file in figures["files"]]
    page = Page(f"Battery {names[0]!r}" if len(names) == 1 else f"{len(names)} batteries", title(figures), FOOTER)
    page = page.callout("info", ending(figures))
    for row in figures["logs"]:
        if row["verdict"] == "set aside":
            page = page.callout("warning", f"{row['log']} was set aside.\n\n{sentence(row['reason'])}")
    for file in figures["files"]:
        page = _battery(page, files, file, [row for row in figures["logs"] if row["battery_file"] == file["output"]])
    page = page.heading("Logs").table(LOGS, log_rows(figures["logs"]), "In the order in which they were learnt")
    page = _anchors(page, figures["logs"])
    return with_assumptions(page, figures["notes"]) if figures["notes"] else page


def _battery(page: Page, files: BatteryFiles, file: Mapping[str, Any], rows: Sequence[Row]) -> Page:
    """One battery: its figures and curves before and after, and its knowledge log by log."""
    key = file["output"] or ""
    before, after = files.before[key], files.after[key]
    page = page.heading(sentence(headline(file)).rstrip(".")).numbers(_numbers(file["after"]))
    page = page.table(CHANGES, change_rows(file), "With 95 % bands")
    page = page.plot(pictures.ocv_change_figure(before, after), pictures.ocv_correction_figure(before, after))
    page = page.plot(pictures.resistance_change_figure(before, after))
    taught = learnt(rows)
    if not taught:
        return page
    steps = [
        ("Capacity", "Capacity [Ah]", "capacity_Ah", 1.0),
        (f"Resistance to {PULSE_S:g} s of current", "Resistance [mΩ]", "resistance_ohm", 1e3),
    ]
    return page.plot(
        *(
            pictures.progress_figure(name, label, [file["before"][key], *(row[key] for row in taught)], scale)
            for name, label, key, scale in steps
        )
    )


def _numbers(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "Capacity": normal(state["capacity_Ah"], "Ah"),
        "Resistance, 10 s": lognormal(state["resistance_ohm"], "mΩ", 1e3),
        "Current offset": normal(state["current_offset_A"], "mA", 1e3),
    }


def _anchors(page: Page, rows: Sequence[Row]) -> Page:
    """The anchors of all logs, where there are any."""
    found = [[row["log"], anchor] for row in rows for anchor in row.get("anchors", [])]
    if not found:
        return page
    cells = [[log, _hours(anchor), str(anchor.get("kind", "given")), _soc(anchor)] for log, anchor in found]
    return page.heading("Anchors").table(ANCHORS, cells, "What told the state of charge beside the voltage, once each")


def _hours(anchor: Mapping[str, Any]) -> str:
    return f"{anchor['time_s'] / 3600:.2f} h" if anchor.get("time_s") is not None else "start"


def _soc(anchor: Mapping[str, Any]) -> str:
    return f"{100 * anchor['soc']:.0f} ± {100 * BAND_95 * anchor['soc_std']:.0f} %"
