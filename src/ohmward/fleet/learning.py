"""Learning battery files from everyday logs, log by log: a file for each serial number; can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.battery.battery import Battery
from ohmward.battery.file import BATTERY_FILE, load_battery, replace_battery
from ohmward.battery.learning.learn import learn
from ohmward.battery.log_check import read_log_of
from ohmward.errors import InputError
from ohmward.fleet.run import digest_of, file_name, fingerprint, read_rows, write_rows
from ohmward.logs.battery_columns import serial_column
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table
from ohmward.logs.selection import labels_in, selected_name, split_selection

#: Result of a log: its file and battery, then the fields of the update; in the journal: a log and its updates.
Row = dict[str, Any]


class LearningJob(NamedTuple):
    """Inputs of the updates."""

    texts: Sequence[str]  #: logs, the oldest first: files, perhaps with a selection of their rows
    start: Battery  #: starting point for each battery that has no file yet
    reading: ReadOptions
    starts: Mapping[str, float]  #: initial state of charge by the log's name, that of "" holds for all others

    @property
    def digest(self) -> str:
        """Digest of the job, different for every job with other results."""
        logs = [list(self.texts), fingerprint(self.texts)]
        return digest_of([*logs, BATTERY_FILE.dump(self.start), asdict(self.reading), dict(self.starts)])


def learn_all(
    job: LearningJob,
    files: BatteryFiles,
    journal: Journal,
    report: Callable[[str, float], None] | None = None,
) -> list[Row]:
    """Learn from all logs and return their rows, those in the journal unchanged; updates the batteries in `files`.

    report: called with the log and the fraction done.
    """
    done = {row["text"]: row for row in journal.rows}
    rows: list[Row] = []
    for k, text in enumerate(job.texts):
        if report:
            report(f"{k + 1} of {len(job.texts)}: {Path(text).name}", k / len(job.texts))
        if text in done:
            for key, battery in done[text]["batteries"].items():
                files.restore(key, BATTERY_FILE.parse(battery))
            rows += done[text]["updates"]
            continue
        before = dict(files.after)
        updates = learn_log(text, job, files)
        changed = {key: BATTERY_FILE.dump(b) for key, b in files.after.items() if before.get(key) is not b}
        journal.add({"text": text, "updates": updates, "batteries": changed})
        rows += updates
    return rows


def learn_log(text: str, job: LearningJob, files: BatteryFiles) -> list[Row]:
    """Learn from a log and return its updates; updates the batteries in `files`."""
    try:
        parts = by_battery(text, job.reading, files)
    except InputError as error:
        return [refused(text, "", str(error))]
    rows = []
    for part, serial_number in parts:
        try:
            rows += _learn(part, serial_number, job, files)
        except InputError as error:
            rows.append(refused(part, serial_number, str(error)))
    return rows


def by_battery(text: str, reading: ReadOptions, files: BatteryFiles) -> list[tuple[str, str]]:
    """The selection of rows for each battery in a log, and its serial number, "" if the log gives none.

    Raises:
        InputError: the log cannot be read, or holds several batteries where the output is one file.
    """
    path, where = split_selection(text)
    rows = dict(reading.where) | where
    file = open_table(path)
    column = serial_column(file.names)
    if column is None:
        return [(text, "")]
    found = [str(rows[column])] if column in rows else labels_in(file, column)
    if len(found) < 2:
        return [(text, "".join(found))]
    parts = [(f"{text}{',' if where else ':'}{column}={serial}", serial) for serial in found]
    if files.one_for_each:
        return parts
    own = files.after[files.open("")].serial_number
    if not own:
        raise InputError(
            f"it holds batteries with several serial numbers ({', '.join(found)}); choose one with --where "
            f"{column}={found[0]}, or give a folder as --output"
        )
    return [part for part in parts if part[1] == own] or parts[:1]


def _learn(text: str, serial_number: str, job: LearningJob, files: BatteryFiles) -> list[Row]:
    key = files.open(serial_number)
    log = read_log_of(files.after[key], text, job.reading)
    start = job.starts.get(log.name, job.starts.get(""))
    learnt = learn(files.after[key], [log], initial_soc={} if start is None else {log.name: start})
    if learnt.battery is not files.after[key]:
        # as written to the file, so that a run resumed after an interruption ends with the same file
        files.after[key] = BATTERY_FILE.parse(BATTERY_FILE.dump(learnt.battery))
    path = str(split_selection(text)[0])
    head = {"path": path, "serial_number": serial_number or None, "battery_file": key or None}
    notes = [str(note) for note in log.notes]
    return [
        head | update.as_dict() | {"reason": update.reason.removeprefix(f"{update.log}: "), "notes": notes}
        for update in learnt.updates
    ]


def refused(text: str, serial_number: str, reason: str) -> Row:
    """Row of a log that could not be read or is of no battery of the run."""
    path, where = split_selection(text)
    name = selected_name(path.stem, where)
    return {
        "path": str(path),
        "serial_number": serial_number or None,
        "battery_file": None,
        "log": name,
        "verdict": "set aside",
        # the row names the log anyway
        "reason": reason.removeprefix(f"{path.name}: ").removeprefix(f"{name}: "),
        "notes": [],
    }


@dataclass
class BatteryFiles:
    """The batteries of a run by the files that they are written to."""

    start: Battery  #: starting point for each battery that has no file yet
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
        if self.output is None:
            key = ""
        elif not self.output.is_dir():
            key = str(self.output)
        elif serial_number:
            key = str(self.output / f"{file_name(serial_number)}.toml")
        else:
            raise InputError("the log has no serial number, by which the file in the folder could be chosen")
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
        """Restore the battery of an interrupted run."""
        self._load(key, battery.serial_number)
        self.after[key] = battery

    def _load(self, key: str, serial_number: str) -> None:
        """Load the battery of a file, once; in a folder an existing file is continued."""
        if key in self.after:
            return
        if self.one_for_each:
            known = load_battery(key) if Path(key).exists() else replace(self.start, serial_number=serial_number)
        else:
            known = self.start
        self.before[key] = self.after[key] = known

    def write(self) -> dict[str, str | None]:
        """Write every file whose battery has changed or that is missing; each with the path of its backup, or None."""
        written: dict[str, str | None] = {}
        for key, battery in self.after.items():
            if key and (battery != self.before[key] or not Path(key).exists()):
                backup = replace_battery(battery, key)
                written[key] = None if backup is None else str(backup)
        return written


class Journal:
    """A file beside the output, one line for each log; it is removed when the run is done.

    path: None keeps no journal.
    job: digest of the inputs besides the logs; a journal of another job is restarted.
    """

    def __init__(self, path: Path | None, job: str):
        self.path = path
        rows = read_rows(path) if path else []
        self.rows: list[Row] = rows[1:] if rows and rows[0].get("job") == job else []
        if path is not None and not self.rows:
            write_rows(path, [{"job": job}], "w")

    def add(self, row: Row) -> None:
        """Append a row; it is on the disk before the next log is read."""
        self.rows.append(row)
        if self.path is not None:
            write_rows(self.path, [row])

    def finish(self) -> None:
        """Remove the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def journal_path(output: str | None) -> Path | None:
    """Journal of a run with this output: .battery.toml.learning beside the file, or .learning in the folder."""
    if output is None:
        return None
    path = Path(output)
    return path / ".learning" if path.is_dir() else path.with_name(f".{path.name}.learning")
